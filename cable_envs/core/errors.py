"""Errors that name what is wrong and what would be right."""

import difflib
from collections.abc import Iterable


class ConfigurationError(ValueError):
    """A rig, task, option or command-line value that cannot be used; the message says what would be right."""


class UnknownOption(ConfigurationError, TypeError):
    """A keyword argument that an environment does not have.

    It is a TypeError in Python's words too: libraries offer an argument and go on without it where Python refuses it.
    """

    @classmethod
    def of(cls, maker: str, name: str, valid: Iterable[str]) -> "UnknownOption":
        """The error for one name.

        Parameters
        ----------
        maker : str
            What was called, for the message.
        name : str
            The argument that it does not have.
        valid : iterable of str
            Those that it has.

        Returns
        -------
        UnknownOption
            To be raised.

        Examples
        --------
        >>> print(UnknownOption.of("CableEnv", "rgi", ["rig"]))
        CableEnv() got an unexpected keyword argument 'rgi'; did you mean 'rig'? Valid: rig
        """
        return cls(f"{maker}() got an unexpected keyword argument '{name}'; {nearest(name, valid)}")


MOST_NAMES, LONGEST_NAME = 200, 200
"""Names among which an error looks for the closest, and characters of each: a file of others may have any number."""
LISTED, CLOSEST = 36, 12
"""Names that an error lists all, and how many of more than those."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """A clause for error messages: the closest valid name, and all of them.

    Parameters
    ----------
    name : str
        What was given.
    valid : iterable of str
        What there is.

    Returns
    -------
    str
        The list of all valid names in alphabetical order, behind the closest one where one is close. Of more than
        `LISTED` names the closest `CLOSEST` are listed, and how many more there are.

    Examples
    --------
    >>> nearest("fricton", ["friction", "mass"])
    "did you mean 'friction'? Valid: friction, mass"
    """
    options = sorted(map(str, valid))
    close = difflib.get_close_matches(str(name)[:LONGEST_NAME], options[:MOST_NAMES], n=1, cutoff=0.5)
    hint = f"did you mean '{close[0]}'? " if close else ""
    listed, more = options, ""
    if len(options) > LISTED:
        likely = difflib.get_close_matches(str(name)[:LONGEST_NAME], options[:MOST_NAMES], n=CLOSEST, cutoff=0.0)
        listed, more = sorted(likely), f" and {len(options) - len(likely)} more"
    return f"{hint}Valid: {', '.join(option[:LONGEST_NAME] for option in listed)}{more}"


def require_known(kind: str, names: Iterable[str], valid: Iterable[str]) -> None:
    """Raise ConfigurationError for the first of ``names`` that is not in ``valid``.

    Parameters
    ----------
    kind : str
        What the names are, for the error.
    names : iterable of str
        What was given.
    valid : iterable of str
        What there is.

    Raises
    ------
    ConfigurationError
        With the nearest valid name.

    Examples
    --------
    >>> require_known("effect", ["backlsh"], ["backlash", "bias"])
    Traceback (most recent call last):
        ...
    cable_envs.core.errors.ConfigurationError: unknown effect 'backlsh'; did you mean 'backlash'? Valid: backlash, bias
    """
    valid = list(valid)
    for name in names:
        if name not in valid:
            raise ConfigurationError(f"unknown {kind} '{name}'; {nearest(name, valid)}")
