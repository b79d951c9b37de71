"""What sensors make of signals: wrong in a way that can be named, noisy, quantised, each on a clock of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

NOISES = ("white", "ar1", "flicker")


def distort(time: np.ndarray, signals: Mapping[str, np.ndarray], faults: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Signals as faulty sensors give them.

    Parameters
    ----------
    time : ndarray
        s [ticks].
    signals : Mapping of str to ndarray
        [ticks] by channel.
    faults : Mapping of str to float
        "kind:channel" -> size (`cable_envs.proof.effects`).

    Returns
    -------
    dict of str to ndarray
        The same channels.

    Raises
    ------
    KeyError
        For a kind that there is not.
    """
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

    Flicker goes down to one wave in `SLOWEST` samples: sensors are zeroed before a record, and what is slower is gone.
    Its half is what a record of `USUAL` samples shows.
    """

    kind: str
    rho: float = 0.0

    def draw(self, rng: np.random.Generator, samples: int, std: float) -> np.ndarray:
        """Noise of standard deviation ``std`` [samples], at most `_LONGEST`."""
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
            f = np.arange(1, _LONGEST // 2) / _LONGEST
            waves = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / np.sqrt(2.0)
            waves *= np.sqrt(_LONGEST * _SHARE / f) * (f >= 1.0 / SLOWEST)
            slow = np.fft.irfft(np.r_[0.0, waves, 0.0], _LONGEST)[:samples]
        return std * np.sqrt(0.5) * (white + slow)

    def power(self, f: np.ndarray) -> np.ndarray:
        """Of each frequency, cycles per sample, over the variance."""
        if self.kind == "white":
            return np.ones(len(f))
        if self.kind == "ar1":
            return 0.5 + 0.5 * (1.0 - self.rho**2) / np.abs(1.0 - self.rho * np.exp(-2j * np.pi * f)) ** 2
        return 0.5 + 0.5 * _SHARE / f

    def of_mean(self, count: int) -> float:
        """The same of the mean of ``count`` samples: its variance times their number."""
        if self.kind != "flicker":
            return float(self.power(np.zeros(1))[0])
        f = np.arange(_LONGEST // SLOWEST, _LONGEST // 20) / _LONGEST
        window = (np.sin(np.pi * f * count) / (count * np.sin(np.pi * f))) ** 2
        return 0.5 + 0.5 * 2.0 * count / _LONGEST * float(np.sum(window * _SHARE / f))


USUAL, SLOWEST, _LONGEST = 2700, 6000, 24_000
_SHARE = 0.5 / float(np.sum(1.0 / np.arange(1, USUAL // 2)))
"""So that the waves of `USUAL` samples have a variance of 1 together."""


def random_colour(kind: str, rng: np.random.Generator) -> Colour:
    """Of a sensor, the same in all records. KeyError for a kind that is not in `NOISES`."""
    if kind not in NOISES:
        raise KeyError(f"no noise '{kind}'")
    return Colour(kind, float(rng.uniform(0.8, 0.97)) if kind == "ar1" else 0.0)


class HasSpectrum(Protocol):
    """Noise whose power is known at every frequency."""

    def power(self, f: np.ndarray) -> np.ndarray:
        """Of each frequency, cycles per sample, over the variance."""

    def of_mean(self, count: int) -> float:
        """The same of the mean of ``count`` samples: its variance times their number."""


def flat(colour: HasSpectrum, series: np.ndarray) -> np.ndarray:
    """Series [T, n] as amplitudes of its waves over those of noise of variance 1: independent, [about T, n]."""
    count = len(series)
    waves = np.fft.rfft(series, axis=0) / np.sqrt(count)
    f = np.maximum(np.arange(len(waves)), 1.0) / count
    power = np.r_[colour.of_mean(count), colour.power(f[1:])]
    both = np.full(len(waves), 2.0)  # a wave has a sine and a cosine
    both[0] = 1.0
    both[-1] = 1.0 if count % 2 == 0 else 2.0
    waves *= np.sqrt(both / power)[:, None]
    return np.concatenate([waves.real, waves.imag])


def quantise(values: np.ndarray, step: float) -> np.ndarray:
    """Values on a grid."""
    return np.round(values / step) * step


def stamps(rng: np.random.Generator, first: float, seconds: float, period: float, jitter: float) -> np.ndarray:
    """Times at which samples are taken.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the jitter.
    first, seconds, period : float
        s.
    jitter : float
        Share of the period by which each is off at most.

    Returns
    -------
    ndarray
        s, rising.
    """
    regular = first + period * np.arange(round(seconds / period))
    return np.sort(regular + period * jitter * rng.uniform(-0.5, 0.5, len(regular)))
