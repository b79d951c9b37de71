"""Signals and cables that each episode draws anew, from the key of the episode.

A number of a signal may be a range ``[low, high]``, and a signal may be one of several::

    reference: {one_of: [{kind: sine, amplitude: [0.002, 0.012], frequency: [0.05, 1.0], fastest: 0.03}, ...]}

Frequencies and times are drawn evenly in their logarithm, all others evenly. ``fastest`` is the largest speed (SI unit
of the signal per second) that the draw may ask for: the frequency is lowered, or the ramp lengthened, until it is
kept.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number
from cable_envs.sim.references import FIELDS, KINDS, MULTISINE_SPEED, pack_signal

ONE_OF, FASTEST = "one_of", "fastest"
_LOGARITHMIC = ("frequency", "hold", "ramp")
SIGNALS, PLACES, CABLES = 0, 3, 4
"""What is drawn from an episode's key: the number of the signal is added to the first."""


def draws(key: float, what: int) -> np.random.Generator:
    """The generator of one of the things that an episode draws.

    Parameters
    ----------
    key : float
        Key of the episode, a whole number.
    what : int
        `SIGNALS` + the number of the signal, `PLACES` or `CABLES`.

    Returns
    -------
    numpy.random.Generator
        The same for the same arguments.
    """
    return np.random.Generator(np.random.PCG64([int(key), what]))


@dataclass(frozen=True)
class DrawnSignal:
    """A signal, or several of which an episode draws one, with ranges for its numbers.

    Attributes
    ----------
    low, high : ndarray, shape (FIELDS.count, k)
        Ends of the ranges of each of the k signals.
    fastest : ndarray, shape (k,)
        Largest speed that a draw may ask for, infinite where none is given.
    """

    low: np.ndarray
    high: np.ndarray
    fastest: np.ndarray

    @classmethod
    def of(cls, what: str, spec: Any) -> "DrawnSignal":
        """From a mapping as the head of this module shows it.

        Parameters
        ----------
        what : str
            What errors call it.
        spec : mapping
            What `cable_envs.sim.references.pack_signal` takes, with ranges; or ``{"one_of": [...]}`` of such.

        Raises
        ------
        ConfigurationError
            As `pack_signal`, for both ends of each range.

        Examples
        --------
        >>> DrawnSignal.of("reference", {"kind": "step", "amplitude": [0.1, 0.2]}).high[FIELDS.row("amplitude")]
        array([0.2])
        """
        if isinstance(spec, Mapping) and ONE_OF in spec:
            require_known(f"key in {what}", spec, (ONE_OF,))
            choices = spec[ONE_OF]
            if not isinstance(choices, Sequence) or isinstance(choices, str) or not choices:
                raise ConfigurationError(f"{what}.{ONE_OF}: expected a list of signals, got {choices!r}")
        else:
            choices = [spec]
        ends, fastest = [], []
        for one in choices:
            if not isinstance(one, Mapping):
                raise ConfigurationError(f"{what}: expected a mapping with 'kind', got {one!r}")
            speed = one.get(FASTEST, math.inf)
            if FASTEST in one and (not is_number(speed) or speed <= 0.0):
                raise ConfigurationError(f"{what}.{FASTEST}: expected a number above 0, got {speed!r}")
            rest = {name: value for name, value in one.items() if name != FASTEST}
            ends.append([pack_signal(what, {n: _end(what, n, v, k) for n, v in rest.items()}) for k in (0, 1)])
            fastest.append(float(speed))
        low, high = (np.array([pair[k] for pair in ends]).T for k in (0, 1))
        return cls(low, high, np.array(fastest))

    @cached_property
    def fixed(self) -> bool:
        """Whether every episode has the same one, but for what its key draws."""
        return self.low.shape[1] == 1 and bool(np.array_equal(self.low, self.high)) and math.isinf(self.fastest[0])

    def draw(self, keys: np.ndarray, number: int) -> np.ndarray:
        """The signals of episodes.

        Parameters
        ----------
        keys : ndarray, shape (n,)
            Keys of the episodes.
        number : int
            Which of their signals this is: each draws for itself.

        Returns
        -------
        ndarray, shape (FIELDS.count, n)
            Columns as `pack_signal` makes them.
        """
        if self.fixed:
            return np.repeat(self.low, len(keys), axis=1)
        return np.array([self._drawn(key, number) for key in keys]).T.copy()

    def _drawn(self, key: float, number: int) -> np.ndarray:
        rng = draws(key, SIGNALS + number)
        choice = int(rng.integers(self.low.shape[1]))
        low, high, at = self.low[:, choice], self.high[:, choice], rng.random(FIELDS.count)
        column = low + at * (high - low)
        for name in _LOGARITHMIC:
            row = FIELDS.row(name)
            if 0.0 < low[row] < high[row]:
                column[row] = low[row] * (high[row] / low[row]) ** at[row]
        return _slowed(column, self.fastest[choice])


def _end(what: str, name: str, value: Any, end: int) -> Any:
    """The value, or that end of the range."""
    if name == "kind" or not isinstance(value, (list, tuple)):
        return value
    if len(value) != 2 or not all(map(is_number, value)) or value[0] > value[1]:
        raise ConfigurationError(f"{what}.{name}: expected a number or a range [low, high], got {value!r}")
    return value[end]


def _slowed(column: np.ndarray, fastest: float) -> np.ndarray:
    """The signal with a lower frequency or a longer ramp where it would be faster than that."""
    kind, amplitude = KINDS[int(column[FIELDS.row("kind")])], abs(column[FIELDS.row("amplitude")])
    frequency, ramp = FIELDS.row("frequency"), FIELDS.row("ramp")
    slopes = {"sine": 2.0 * math.pi, "triangle": 4.0, "multisine": MULTISINE_SPEED}
    if kind in slopes and amplitude > 0.0:
        column[frequency] = min(column[frequency], fastest / (slopes[kind] * amplitude))
    elif kind == "trapezoids":
        column[ramp] = max(column[ramp], 2.0 * amplitude / fastest)
    return column
