"""Tension ratios from records of both tensions: blocks of steady sliding, each averaged to one point.

The friction of the hole is known only while the cable slides, and quasi-static only while its speed is steady; the rest
of a record (rest, reversals, jerks, slack) is left out and counted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.contact import wrap_in_contact

REASONS = ("at rest or reversing", "speed not steady", "tension not steady", "slack", "gaps")
"""Why a block is left out."""


@dataclass(frozen=True)
class Samples:
    """Points for `problem.RatioProblem`; all arrays [points], SI."""

    wrap: np.ndarray
    speed: np.ndarray
    """mean sliding speed, positive while hauling in"""
    ratio: np.ndarray
    """larger tension over the smaller: drive over load while hauling in"""
    noise_std: np.ndarray
    left_out: Mapping[str, int] = field(default_factory=dict)
    """blocks by reason"""

    def __len__(self) -> int:
        return len(self.ratio)


@dataclass(frozen=True)
class BlockSettings:
    """How a record is cut."""

    seconds: float = 0.2
    """length of a block; at least 4 samples"""
    slowest: float = 0.01
    """speeds below this share of the largest count as rest"""
    steady_speed: float = 0.02
    """change of the speed through a block, as a share of its mean, beyond what its noise explains"""
    settled: float = 0.05
    """a block whose speed differs from the one before by more than this share still holds the transition"""
    steady_tension: float = 0.003
    """the same for both tensions: little, because it goes into the ratio as it is"""
    least_tension: float = 0.1
    """N; less counts as slack"""


def derivative(time: np.ndarray, position: np.ndarray, seconds: float) -> np.ndarray:
    """Speed from positions: the slope of a straight line through each window; differences would be noise.

    Parameters
    ----------
    time, position : ndarray
        [samples]: s, m.
    seconds : float
        Of a window.

    Returns
    -------
    ndarray
        m/s [samples].
    """
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(time)))
    uniform = np.arange(time[0], time[-1] + 0.5 * step, step)
    window = min(max(round(seconds / step) | 1, 3), len(uniform) - 1 | 1)
    if window > len(uniform):
        return np.gradient(position, time)
    slope = savgol_filter(np.interp(uniform, time, position), window, 1, deriv=1, delta=step)
    return np.interp(time, uniform, slope)


def ratio_samples(
    time: np.ndarray,
    velocity: np.ndarray,
    wrap: np.ndarray,
    drive_tension: np.ndarray,
    load_tension: np.ndarray,
    *,
    drive_std: float | None = None,
    load_std: float | None = None,
    rigidity: float = 0.0,
    radius: float = 1.0,
    settings: BlockSettings | None = None,
) -> Samples:
    """Points of one record for the identification of the tension ratio: blocks of steady motion.

    Parameters
    ----------
    time, velocity, wrap, drive_tension, load_tension : ndarray
        [samples]: s, m/s, rad, N, N.
    drive_std, load_std : float, optional
        Noise of one tension sample, N (0 for a known weight); where one is None the noise is taken from the scatter
        within blocks.
    rigidity, radius : float
        B, N m^2, and the bending radius R, m, which reduce the wrap, Eq. (1), Gu 2024.
    settings : BlockSettings, optional
        How the record is cut.

    Returns
    -------
    Samples
        Wrap, speed, ratio and its noise [points], and why blocks were left out.
    """
    s = settings or BlockSettings()
    length = max(round(s.seconds / float(np.median(np.diff(time)))), 4)
    fastest = float(np.nanmax(np.abs(velocity)))
    left_out, found, speed = dict.fromkeys(REASONS, 0), [], 0.0
    for first in range(0, len(time) - length + 1, length):
        block = slice(first, first + length)
        arrays = (velocity[block], wrap[block], drive_tension[block], load_tension[block])
        reason = _unfit(*arrays, fastest, s)
        before, speed = speed, float(arrays[0].mean())
        if not reason and abs(speed - before) > s.settled * abs(
            speed
        ):  # also after a rest, a reversal, or at the start
            reason = "speed not steady"
        if reason:
            left_out[reason] += 1
            continue
        v, phi, t1, t2 = (float(np.mean(a)) for a in arrays)
        scatter = [_noise(a) / abs(a.mean()) for a in arrays[2:]]
        n = t1 / t2 if v > 0 else t2 / t1
        contact = wrap_in_contact(phi, rigidity, radius, t1, t2) if rigidity else phi
        found.append((contact, v, n, t1, t2, *scatter))
    if not found:
        empty = np.empty(0)
        return Samples(empty, empty, empty, empty, left_out)
    contact, v, n, t1, t2, scatter_1, scatter_2 = np.array(found).T
    relative = [  # of one sample; the pooled scatter, because a single block of four samples knows it poorly
        np.sqrt(np.mean(scatter**2)) * np.ones_like(n) if std is None else std / tension
        for std, tension, scatter in ((drive_std, t1, scatter_1), (load_std, t2, scatter_2))
    ]
    std = n * np.maximum(np.sqrt(relative[0] ** 2 + relative[1] ** 2) / np.sqrt(length), 1e-9)
    return Samples(contact, v, n, std, left_out)


def _unfit(v, phi, t1, t2, fastest: float, s: BlockSettings) -> str | None:
    if not all(np.isfinite(a).all() for a in (v, phi, t1, t2)):
        return "gaps"
    mean = abs(float(v.mean()))
    if mean <= s.slowest * fastest or (v.min() < 0.0 < v.max()):
        return "at rest or reversing"
    if _drifts(v, s.steady_speed):
        return "speed not steady"
    if min(t1.mean(), t2.mean()) < s.least_tension:
        return "slack"
    # while the drive takes up the stretch after a reversal the cable sticks in the hole and the tension climbs
    if _drifts(t1, s.steady_tension) or _drifts(t2, s.steady_tension):
        return "tension not steady"
    return None


def _drifts(values: np.ndarray, share: float) -> bool:
    """Whether the first and the last quarter differ by more than ``share`` of the mean and three times their noise."""
    quarter = max(len(values) // 4, 1)
    change = abs(float(values[-quarter:].mean() - values[:quarter].mean()))
    return change > share * abs(float(values.mean())) + 3.0 * _noise(values) * np.sqrt(2.0 / quarter)


def _noise(values: np.ndarray) -> float:
    """Standard deviation of white noise, from successive differences: a slope or a step hardly counts."""
    return float(np.sqrt(0.5 * np.mean(np.diff(values) ** 2)))


def together(parts: Sequence[Samples]) -> Samples:
    """Points of several records as one set.

    Raises
    ------
    ConfigurationError
        Where there is none, or where directions contradict.
    """
    left_out = {reason: sum(part.left_out.get(reason, 0) for part in parts) for reason in REASONS}
    names = ("wrap", "speed", "ratio", "noise_std")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    whole = Samples(**arrays, left_out=left_out)
    if not len(whole):
        why = (
            ", ".join(f"{count} {reason}" for reason, count in left_out.items() if count) or "records shorter than one"
        )
        raise ConfigurationError(f"no block of steady sliding in the records ({why})")
    if np.mean(whole.ratio < 1.0 - 3.0 * whole.noise_std) > 0.5:
        raise ConfigurationError(
            "most tension ratios are below 1: the drive side pulls less than the load while hauling in. "
            "Check the sign of drive_velocity (positive hauls in) and which tension is which"
        )
    return whole
