"""What sensors make of signals: wrong in a way that can be named, noisy, quantised, each on a clock of its own."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

NOISES = ("white", "ar1", "flicker")


def distort(time: np.ndarray, signals: Mapping[str, np.ndarray], faults: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Signals [ticks] as faulty sensors give them; faults: "kind:channel" -> size (see `effects`)."""
    seen = dict(signals)
    for key, size in faults.items():
        kind, channel = key.split(":")
        value = seen[channel]
        if kind == "delay":
            value = np.interp(time - size, time, value)
        elif kind == "bias":
            value = value + size
        elif kind == "scale":
            value = value * (1.0 + size)
        elif kind == "rectification":
            value = value - size * np.minimum(value, 0.0)
        elif kind == "thermal_scale":  # the scale's support warms up
            value = value * (1.0 + size * (1.0 - np.exp(-(time - time[0]) / 15.0)))
        elif kind == "lost_counts":  # some are lost whenever the motion is fast
            speed = np.abs(np.gradient(value, time))
            fast = speed > 0.7 * np.quantile(speed, 0.98)
            value = value - size * np.cumsum(np.diff(fast.astype(int), prepend=0) == 1)
        else:
            raise KeyError(f"no sensor fault '{kind}'")
        seen[channel] = value
    return seen


@dataclass(frozen=True)
class Colour:
    """Noise of one sensor, of `NOISES`: white; half white, half AR(1) of memory ``rho``; half white, half 1/f.

    Flicker goes down to one wave in `SLOWEST` samples; its half is what a record of `USUAL` samples shows.
    """

    kind: str
    rho: float = 0.0

    def draw(self, rng: np.random.Generator, samples: int, std: float) -> np.ndarray:
        """Noise of standard deviation ``std`` [samples], at most `SLOWEST`."""
        white = rng.standard_normal(samples)
        if self.kind == "white":
            return std * white
        if self.kind == "ar1":
            slow = np.empty(samples + 300)
            slow[0], drive = 0.0, rng.standard_normal(samples + 300) * np.sqrt(1.0 - self.rho**2)
            for k in range(1, len(slow)):
                slow[k] = self.rho * slow[k - 1] + drive[k]
            slow = slow[300:]
        else:
            f = np.arange(1, SLOWEST // 2) / SLOWEST
            waves = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / np.sqrt(2.0)
            spectrum = np.r_[0.0, waves * np.sqrt(SLOWEST * _SHARE / f), 0.0]
            slow = np.fft.irfft(spectrum, SLOWEST)[:samples]
        return std * np.sqrt(0.5) * (white + slow)

    def power(self, f: np.ndarray) -> np.ndarray:
        """Of each frequency, cycles per sample, over the variance."""
        if self.kind == "white":
            return np.ones(len(f))
        if self.kind == "ar1":
            return 0.5 + 0.5 * (1.0 - self.rho**2) / np.abs(1.0 - self.rho * np.exp(-2j * np.pi * f)) ** 2
        return 0.5 + 0.5 * _SHARE / f


USUAL, SLOWEST = 2700, 60_000
_SHARE = 0.5 / float(np.sum(1.0 / np.arange(1, USUAL // 2)))
"""So that the waves of `USUAL` samples have a variance of 1 together."""


def random_colour(kind: str, rng: np.random.Generator) -> Colour:
    """Of a sensor, the same in all records. KeyError for a kind that is not in `NOISES`."""
    if kind not in NOISES:
        raise KeyError(f"no noise '{kind}'")
    return Colour(kind, float(rng.uniform(0.8, 0.97)) if kind == "ar1" else 0.0)


def standing_out(colour: Colour, std: float, signal: np.ndarray) -> float:
    """Sum of squares of a signal [samples] over the spectrum of the noise it is in: what knowing it would gain."""
    count = len(signal)
    power = np.abs(np.fft.rfft(signal)) ** 2 / count
    power[1 : (count + 1) // 2] *= 2.0
    f = np.maximum(np.arange(len(power)), 1.0) / count  # a mean counts as the slowest wave
    return float(np.sum(power / colour.power(f)) / std**2)


def quantise(values: np.ndarray, step: float) -> np.ndarray:
    """Values on a grid."""
    return np.round(values / step) * step


def stamps(rng: np.random.Generator, first: float, seconds: float, period: float, jitter: float) -> np.ndarray:
    """Times at which samples are taken, s: every ``period``, each off by a share ``jitter`` of it at most."""
    regular = first + period * np.arange(round(seconds / period))
    return np.sort(regular + period * jitter * rng.uniform(-0.5, 0.5, len(regular)))
