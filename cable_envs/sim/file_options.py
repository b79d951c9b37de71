"""Environment options that stand in a file: which of them there are, and that none of them leads to code being run."""

from collections.abc import Mapping
from typing import Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.setup import OPTIONS

EXECUTED = ("effect_file",)
"""Options whose value names Python code that is run: they are given in code or on a command line, never by a file."""

KNOWN = ("reference", *OPTIONS)
"""Names of all options that decide what an environment does."""


def check_options_of_file(options: Any, source: str) -> None:
    """Refuse environment options that a file may not set: unknown ones, and those that run code.

    Parameters
    ----------
    options : mapping
        Options of an environment as a protocol or a settings file has them.
    source : str
        What the error calls the file and the place in it.

    Raises
    ------
    ConfigurationError
        Where it is no mapping, and for the first option that is refused.

    Examples
    --------
    >>> check_options_of_file({"effect_file": "mine.py"}, "f")
    Traceback (most recent call last):
        ...
    cable_envs.core.errors.ConfigurationError: f: 'effect_file' runs a Python file; only the command line may name one
    """
    if not isinstance(options, Mapping):
        raise ConfigurationError(f"{source}: options must map names to values, found {options!r}")
    for name in options:
        if name in EXECUTED:
            raise ConfigurationError(f"{source}: '{name}' runs a Python file; only the command line may name one")
    require_known(f"environment option in {source}", options, KNOWN)
