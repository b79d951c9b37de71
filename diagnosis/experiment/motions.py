"""Motions that a drive can make: families with a few numbers each, within limits of place, speed and acceleration.

A motion begins and ends at rest where the drive stands, keeps to the limits, and comes as samples on an even clock.
Where the range has no room for its amplitude about the start, it goes to the middle of that room first.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.core.errors import ConfigurationError

REST = 1.0
"""s at rest before and after a motion, in which zeros show."""
EASE = 0.5
"""s in which it begins, and ends."""


@dataclass(frozen=True)
class Limits:
    """What the drive may do, in the SI unit of the channel that drives it, and its derivatives.

    Parameters
    ----------
    low, high : float
        Range of the channel's place.
    speed, acceleration : float
        Largest magnitudes of its first and second derivative.
    frequency : float
        Hz of its fastest sine.
    """

    low: float
    high: float
    speed: float
    acceleration: float
    frequency: float = np.inf

    def __post_init__(self) -> None:
        rates = {"speed": self.speed, "acceleration": self.acceleration, "frequency": self.frequency}
        if not self.high > self.low or not min(rates.values()) > 0.0:
            raise ConfigurationError(
                "limits of a motion: expected low < high, and a speed, an acceleration and a frequency above 0; got "
                f"low {self.low:g}, high {self.high:g}, " + ", ".join(f"{n} {v:g}" for n, v in rates.items())
            )

    @property
    def span(self) -> float:
        """Of the range."""
        return self.high - self.low


@dataclass(frozen=True)
class Motion:
    """A motion of a family.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    numbers : ndarray
        What is drawn, each in [0, 1] [4]: size, pace, and two that the family gives a meaning.
    """

    family: str
    numbers: np.ndarray

    def near(self, rng: np.random.Generator, spread: float) -> "Motion":
        """Another one of the family whose numbers are as far off as a normal draw of this standard deviation."""
        return replace(self, numbers=np.clip(self.numbers + spread * rng.normal(size=self.numbers.size), 0.0, 1.0))

    def samples(self, limits: Limits, start: float, period: float, count: int) -> np.ndarray:
        """Places at every sample [count], within the limits, from ``start`` and back to it."""
        time = period * np.arange(count)
        moving = max(time[-1] - 2.0 * REST, period)
        at = np.clip((time - REST) / moving, 0.0, 1.0)
        size = _between(0.01, 1.0, self.numbers[0])
        half = 0.5 * size * limits.span
        middle = float(np.clip(start, limits.low + half, limits.high - half)) - start
        ease = max(EASE, 4.0 * abs(middle) / limits.speed, np.sqrt(10.0 * abs(middle) / limits.acceleration))
        gate = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(at, 1.0 - at) * moving / ease, 0.0, 1.0))
        shape = _rounded(FAMILIES[self.family](at, moving, self.numbers, limits, size), period, limits)
        offset = gate * (middle + half * shape)
        return start + offset * _within(offset, period, limits)


def draw(rng: np.random.Generator, count: int) -> list[Motion]:
    """So many motions, all families in turn."""
    names = list(FAMILIES)
    return [Motion(names[k % len(names)], rng.uniform(size=4)) for k in range(count)]


def _between(low: float, high: float, share: float) -> float:
    """From low to high in equal ratios."""
    return float(low * (high / low) ** share)


def _within(offset: np.ndarray, period: float, limits: Limits) -> float:
    """Factor, at most 1, by which a motion keeps to speed and acceleration."""
    speed = np.max(np.abs(np.diff(offset))) / period
    acceleration = np.max(np.abs(np.diff(offset, 2))) / period**2 if len(offset) > 2 else 0.0
    return min(1.0, limits.speed / max(speed, 1e-300), limits.acceleration / max(acceleration, 1e-300))


def _rounded(shape: np.ndarray, period: float, limits: Limits) -> np.ndarray:
    """A shape with its corners rounded over the time in which the drive turns round."""
    turn = min(limits.speed / limits.acceleration, EASE)
    width = 2 * int(turn / period / 2) + 1
    if width < 3:
        return shape
    window = np.hanning(width + 2)[1:-1]
    padded = np.concatenate([np.full(width, shape[0]), shape, np.full(width, shape[-1])])
    return np.convolve(padded, window / window.sum(), mode="same")[width:-width]


def _highest(limits: Limits, size: float, moving: float) -> float:
    """Hz at which a sine of this size meets the limit of speed, acceleration or frequency."""
    amplitude = 0.5 * size * limits.span
    turn = 2.0 * np.pi * amplitude
    by_speed, by_force = limits.speed / turn, np.sqrt(limits.acceleration / (2.0 * np.pi * turn))
    return float(max(min(by_speed, by_force, limits.frequency), 2.0 / moving))


def _rate(numbers: np.ndarray, limits: Limits, size: float, moving: float) -> float:
    """Hz, from a single wave in the motion to the limits."""
    return _between(1.0 / moving, _highest(limits, size, moving), float(numbers[1]))


def _sine(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    return np.sin(2.0 * np.pi * _rate(numbers, limits, size, moving) * moving * at)


def _triangle(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    return 2.0 / np.pi * np.arcsin(_sine(at, moving, numbers, limits, size))


def _holds(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    """From hold to hold; number 2: the share of the time that it rests."""
    steep = 1.0 / (1.0 - 0.9 * numbers[2])
    return np.clip(steep * _triangle(at, moving, numbers, limits, size), -1.0, 1.0)


def _growing(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    """Reversals from small to large ones; number 2: how small they begin."""
    small = _between(3e-3, 0.3, float(numbers[2]))
    return _triangle(at, moving, numbers, limits, size) * small ** (1.0 - at)


def _chirp(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    """Faster and faster; number 2: how slowly it begins."""
    last = _rate(numbers, limits, size, moving)
    first = last * _between(0.02, 0.5, float(numbers[2]))
    growth = np.log(last / first)
    return np.sin(2.0 * np.pi * first * moving * np.expm1(growth * at) / growth)


def _tones(at: np.ndarray, moving: float, numbers: np.ndarray, limits: Limits, size: float) -> np.ndarray:
    """A slow and a fast sine together; number 2: how much faster, number 3: how large the fast one is."""
    slow = _rate(numbers, limits, size, moving)
    fast = min(slow * _between(2.0, 20.0, float(numbers[2])), max(limits.frequency, slow))
    share = _between(0.02, 0.5, float(numbers[3]))
    waves = np.sin(2.0 * np.pi * slow * moving * at) + share * np.sin(2.0 * np.pi * fast * moving * at)
    return waves / (1.0 + share)


Shape = Callable[[np.ndarray, float, np.ndarray, Limits, float], np.ndarray]
"""(share of the motion's time [T], s that it takes, numbers, limits, size) -> shape in [-1, 1] [T]."""

FAMILIES: Mapping[str, Shape] = {
    "sine": _sine,
    "triangle": _triangle,
    "holds": _holds,
    "growing reversals": _growing,
    "chirp": _chirp,
    "two sines": _tones,
}
"""Shapes of motion."""
