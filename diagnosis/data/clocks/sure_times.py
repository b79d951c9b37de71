"""What samples say of their own times.

All channels of a row are read at one moment. A time that is off by d moves each of them by its slope times d, more than
their noise where the rig is fast. How far a stamp is from an even clock is known, so that the samples tell whether they
were taken when their stamps say or evenly: which of the two leaves less of a smooth motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from cable_envs.diagnosis.data.clocks.even import numbers, sample_period, zero
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

NEAR = 7
"""Samples of a smooth motion: about each of them it is a parabola."""
SCATTER = 1e-6
"""Of a period, below which stamps are even."""
FAST = 0.1
"""Of a channel's greatest slope, from which its samples tell their times."""
SURE = 3.0
"""Log odds (20 to 1) from which samples are believed, and not their stamps."""


def with_sure_times(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """The recording with its rows at the times at which its samples were taken, as far as these tell.

    Parameters
    ----------
    recording : Recording
        Of records without long gaps.

    Returns
    -------
    Recording, tuple of str
        Stamps that scatter where the samples do not are even; what was done, in sentences.
    """
    moving = [(r, sample_period([r])) for r in recording.records if r.use != "rest"]
    measured = [name for name in recording.channels if name != "time" and not told(name)]
    if sum(_odds_of_even(moving, channel) for channel in measured) <= SURE:
        return recording, ()
    off = {record.name: _scatter(record, period) for record, period in moving}
    records = tuple(
        replace(r, data={**r.data, "time": r.time - off[r.name]}) if r.name in off else r for r in recording.records
    )
    scatter = 1e3 * max(float(np.std(own)) for own in off.values())
    said = f"stamps scatter by {scatter:.2g} ms where the samples do not: these are taken as even"
    return replace(recording, records=records), (said,)


def _scatter(record: Record, period: float) -> np.ndarray:
    """How far each stamp is from an even clock, s."""
    return record.time - zero(record.time, period) - period * numbers(record.time, period)


def _odds_of_even(records: Sequence[tuple[Record, float]], channel: str) -> float:
    """Log odds by a channel that samples are even over that they are as stamped: of the sizes of what both leave."""
    left = np.concatenate([np.zeros((0, 2)), *(_left(record, channel, period) for record, period in records)])
    if len(left) < NEAR:
        return 0.0
    even, stamped = np.maximum(np.sum(left**2, axis=0), 1e-300)
    return 0.5 * len(left) * float(np.log(stamped / even))


def _left(record: Record, channel: str, period: float) -> np.ndarray:
    """What a smooth motion leaves of samples that go fast, if they are even and if they are as stamped [n, 2]."""
    off, values, good = _scatter(record, period), record.data[channel], record.usable(channel)
    parts = [np.zeros((0, 3))]
    if np.std(off) > SCATTER * period:
        ends = np.flatnonzero((np.diff(numbers(record.time, period)) != 1.0) | ~good[1:] | ~good[:-1]) + 1
        for rows in np.split(np.arange(len(values)), ends):
            if len(rows) > NEAR:
                slope = savgol_filter(values[rows], NEAR, 2, deriv=1, delta=period)
                both = np.column_stack([values[rows], values[rows] - slope * off[rows]])
                parts.append(np.column_stack([slope, both - savgol_filter(both, NEAR, 2, axis=0)]))
    table = np.concatenate(parts)
    size = np.abs(table[:, 0])
    return table[size > FAST * np.max(size, initial=0.0), 1:]
