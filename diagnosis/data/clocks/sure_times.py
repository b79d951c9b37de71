"""What samples say of their own times.

All channels of a row are read at one moment. A time that is off by d moves each of them by its slope times d, more than
their noise where the rig is fast. The samples tell whether they were taken when their stamps say, or evenly, or when a
smooth command of the same row has the value that it has there: which of these leaves less of a smooth motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from cable_envs.diagnosis.data.clocks.even import numbers, runs, sample_period, zero
from cable_envs.diagnosis.data.clocks.told_times import told_times
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

NEAR = 7
"""Samples of a smooth motion: about each of them it is a parabola."""
SCATTER = 1e-6
"""Of a period, below which stamps are even."""
FAST = 0.1
"""Of a channel's greatest slope, from which its samples tell their times."""
PLACES = ("m", "rad")
"""Of commands whose corners, in the slope, no rig follows: where a speed has corners, a drive that follows has them."""
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
        Rows as they are stamped, or evenly where their samples do not scatter as the stamps do, or where a smooth
        command says that they were read and the samples confirm it; what was done, in sentences.
    """
    moving = [(r, sample_period([r])) for r in recording.records if r.use != "rest"]
    measured = [name for name in recording.channels if name != "time" and not told(name)]
    stamped = [_scatter(record, period) for record, period in moving]

    def odds(late: Sequence[np.ndarray], over: Sequence[np.ndarray]) -> float:
        return sum(_odds(moving, channel, late, over) for channel in measured)

    off, said = stamped, ""
    even = [np.zeros(len(own)) for own in stamped]
    if odds(even, off) > SURE:
        off, said = even, f"stamps scatter by {_ms(stamped)} ms where the samples do not: these are taken as even"
    for command in (c for c, about in recording.channels.items() if told(c) and about.si_unit in PLACES):
        late = told_times(moving, command, stamped)
        if late is not None and odds(late, off) > SURE:
            where = f"rows were read {_ms(late)} ms beside an even clock, as {command.replace('_', ' ')} tells"
            off, said = late, f"{where} and the other samples confirm: these times are taken"
    if not said:
        return recording, ()
    moved = {r.name: now - before for (r, _), now, before in zip(moving, off, stamped, strict=True)}
    records = tuple(
        replace(r, data={**r.data, "time": r.time + moved[r.name]}) if r.name in moved else r for r in recording.records
    )
    return replace(recording, records=records), (said,)


def _ms(late: Sequence[np.ndarray]) -> str:
    """The scatter of the record in which it is largest."""
    return f"{1e3 * max(float(np.std(own)) for own in late):.2g}"


def _scatter(record: Record, period: float) -> np.ndarray:
    """How far each stamp is from an even clock, s."""
    return record.time - zero(record.time, period) - period * numbers(record.time, period)


def _odds(
    records: Sequence[tuple[Record, float]], channel: str, late: Sequence[np.ndarray], over: Sequence[np.ndarray]
) -> float:
    """Log odds by a channel of times that are off an even clock so over others: of the sizes of what both leave."""
    parts = [_left(record, channel, period, a, b) for (record, period), a, b in zip(records, late, over, strict=True)]
    left = np.concatenate([np.zeros((0, 2)), *parts])
    if len(left) < NEAR:
        return 0.0
    own, other = np.maximum(np.sum(left**2, axis=0), 1e-300)
    return 0.5 * len(left) * float(np.log(other / own))


def _left(record: Record, channel: str, period: float, late: np.ndarray, over: np.ndarray) -> np.ndarray:
    """What a smooth motion leaves of samples that go fast, by either times [n, 2]."""
    values, parts = record.data[channel], [np.zeros((0, 3))]
    if np.std(late - over) > SCATTER * period:
        for rows in runs(record, period, record.usable(channel)):
            if len(rows) > NEAR:
                slope = savgol_filter(values[rows], NEAR, 2, deriv=1, delta=period)
                both = values[rows, None] - slope[:, None] * np.column_stack([late[rows], over[rows]])
                parts.append(np.column_stack([slope, both - savgol_filter(both, NEAR, 2, axis=0)]))
    table = np.concatenate(parts)
    size = np.abs(table[:, 0])
    return table[size > FAST * np.max(size, initial=0.0), 1:]
