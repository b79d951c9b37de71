"""The even clock of a record: its period, and the number of each sample on it."""

from collections.abc import Sequence

import numpy as np

from cable_envs.diagnosis.data.record import Record


def sample_period(records: Sequence[Record]) -> float:
    """The period of the records' clock, s: the slope of time over the number of the sample, gaps counted.

    The median of the differences alone would be off by 1e-6 s with a jittery clock: half a sample after a minute.
    """
    median = float(np.median(np.concatenate([np.diff(record.time) for record in records])))
    counted = [numbers(record.time, median) for record in records]
    over = sum(float(np.sum((k - k.mean()) * (r.time - r.time.mean()))) for k, r in zip(counted, records, strict=True))
    under = sum(float(np.sum((k - k.mean()) ** 2)) for k in counted)
    return over / under


def numbers(time: np.ndarray, period: float) -> np.ndarray:
    """Number of each sample on a clock of that period; a gap skips numbers, jitter does not add up."""
    return np.cumsum(np.r_[0.0, np.maximum(np.round(np.diff(time) / period), 1.0)])


def zero(time: np.ndarray, period: float) -> float:
    """Time, s, of the number 0 on an even clock; the first stamp where the clock is too uneven for a mean phase."""
    counted = numbers(time, period)
    first = float(np.mean(time - period * counted)) if counted[-1] else float(time[0])
    return float(time[0]) if abs(first - time[0]) > period else first


def runs(record: Record, period: float, good: np.ndarray) -> list[np.ndarray]:
    """Rows of a record between which nothing was lost."""
    ends = np.flatnonzero((np.diff(numbers(record.time, period)) != 1.0) | ~good[1:] | ~good[:-1]) + 1
    return np.split(np.arange(len(good)), ends)
