"""The clock of records: its period, the number of each sample on it, and what the samples say of their own times.

All channels of a row are read at one moment. A time that is off by d moves each of them by its slope times d, more than
their noise where the rig is fast. How far a stamp is from an even clock is known, so that the samples tell whether they
were taken when their stamps say or evenly: which of the two leaves less of a smooth motion. A step of all places that
is none or two of those about it, while they go on as fast as before, is a row that was read twice or lost.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

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
ABOUT = 3
"""Steps to either side of one, of which all are alike where the motion is smooth."""
ALIKE = 0.35
"""Share by which the means of these may differ."""
OFF = 0.25
"""Rows by which a step may be off none or two of them."""
MOST, CLEAR = 0.9, 4.0
"""Share of the steps of a fast place whose distance from those about them is its noise, and how many times that a step
must be off one row."""
ONWARD, ALSO = 2.0, 1.5
"""`ALIKE` (both go the same way) and `CLEAR` where all channels repeat their values."""
HELD = 1.5
"""Rows that two steps after a row that is read twice are, above which it took another one's place."""


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


def with_sure_times(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """The recording with rows at the times at which its samples were taken, as far as these tell.

    Parameters
    ----------
    recording : Recording
        Of records without long gaps.

    Returns
    -------
    Recording, tuple of str
        Rows that repeat the last one are left out, times behind a row that was lost or written twice are those of an
        uninterrupted clock, and stamps that scatter where the samples do not are even; what was done, in sentences.
    """
    moving = [record for record in recording.records if record.use != "rest"]
    measured = [name for name in recording.channels if name != "time" and not told(name)]
    places = [name for name in measured if recording.channels[name].si_unit in ("m", "rad")]
    notes, found = [], {}
    for record in moving:
        found[record.name], said = _with_its_rows(record, measured, places, sample_period([record]))
        notes += said
    periods = {name: sample_period([record]) for name, record in found.items()}
    odds = sum(_odds_of_even([(r, periods[n]) for n, r in found.items()], channel) for channel in measured)
    if odds > SURE:
        scatter = max(float(np.std(_scatter(record, periods[name]))) for name, record in found.items())
        found = {name: _at(record, record.time - _scatter(record, periods[name])) for name, record in found.items()}
        notes.append(f"stamps scatter by {1e3 * scatter:.2g} ms where the samples do not: these are taken as even")
    records = tuple(found.get(record.name, record) for record in recording.records)
    return (replace(recording, records=records), tuple(notes)) if notes else (recording, ())


def _at(record: Record, time: np.ndarray) -> Record:
    return replace(record, data={**record.data, "time": time})


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


def _with_its_rows(
    record: Record, measured: Sequence[str], places: Sequence[str], period: float
) -> tuple[Record, list[str]]:
    """A record without rows that were read twice, and with its clock put right behind rows that are missing.

    A row that is read twice takes the place of another one (held), or is one more (written). Where its own motion does
    not tell, it is as most of the others are.
    """
    odd = _odd_steps(record, places, period)
    again = {k: odd[k][1] if k in odd and odd[k][0] < 1.0 else np.nan for k in _repeated(record, measured, places)}
    again |= {k: both for k, (step, both) in odd.items() if step < 1.0}
    told_of = [both > HELD for both in again.values() if np.isfinite(both)]
    usually = sum(told_of) >= 0.5 * len(told_of)
    held = {k: both > HELD if np.isfinite(both) else usually for k, both in again.items()}
    lost = [k for k, (step, _) in odd.items() if step > 1.0 and not held.get(k - 1)]
    keep, later = np.ones(len(record.time), dtype=bool), np.zeros(len(record.time))
    for row in held:
        keep[row + 1] = False
        later[row + 1 :] -= 0.0 if held[row] else period
    for row in lost:
        later[row + 1 :] += period
    read = sum(held.values())
    said = {"read twice": read, "written twice": len(held) - read, "lost under a clock that went on": len(lost)}
    notes = [f"{record.name}: {count} rows were {what}" for what, count in said.items() if count]
    moved = {**record.data, "time": record.time + later}
    return replace(record, data={name: values[keep] for name, values in moved.items()}), notes


def _repeated(record: Record, measured: Sequence[str], places: Sequence[str]) -> list[int]:
    """Rows that are followed by the same in all that is measured while a place goes on."""
    same = np.all([np.diff(record.data[name]) == 0.0 for name in measured], axis=0)
    goes_on = [np.isfinite(_advances(record.data[place], ALSO, ONWARD)[0]) for place in places]
    return [int(k) for k in np.flatnonzero(same & np.any(goes_on, axis=0))] if len(measured) > 1 and places else []


def _odd_steps(record: Record, places: Sequence[str], period: float) -> dict[int, tuple[float, float]]:
    """Row -> rows by which the next one is later, and the one after that, where that is none or two.

    All places that tell it say so, and no row is missing by its stamp.
    """
    told_by = [_advances(record.data[place]) for place in places if record.usable(place).all()]
    if not told_by:
        return {}
    by = np.ma.masked_invalid(told_by)
    whole = np.diff(numbers(record.time, period)) == 1.0
    whole[:-1] &= whole[1:]
    found: dict[int, tuple[float, float]] = {}
    for amount in (0.0, 2.0):
        all_say = np.all(np.abs(by[:, 0] - amount) < OFF, axis=0).filled(False)
        found |= {int(k): (amount, float(by[:, 1, k].mean())) for k in np.flatnonzero(all_say & whole)}
    return dict(sorted(found.items()))


def _advances(values: np.ndarray, clear: float = CLEAR, alike: float = ALIKE) -> np.ndarray:
    """Rows by which the next sample of a place is later, and the one after that; NaN where it does not tell [2, T - 1].

    In what the steps about it are in the mean, where the motion is smooth and fast.
    """
    step, found = np.diff(values), np.full((2, len(values) - 1), np.nan)
    count = len(step) - 2 * ABOUT
    if count < 1:
        return found
    sums = np.concatenate([[0.0], np.cumsum(step)])
    means = (sums[ABOUT:] - sums[:-ABOUT]) / ABOUT  # of the steps from each on
    before, after, own = means[:count], means[ABOUT + 1 : ABOUT + 1 + count], step[ABOUT : ABOUT + count]
    usual = 0.5 * (before + after)
    size = np.abs(usual)
    fast = size > FAST * np.max(size)
    spread = float(np.quantile(np.abs(own - usual)[fast], MOST)) if fast.any() else 0.0
    tells = (np.abs(after - before) < alike * size) & fast & (size > clear * spread)
    both = own + step[ABOUT + 1 : ABOUT + 1 + count]
    found[:, ABOUT : ABOUT + count] = np.where(tells, np.stack([own, both]) / np.where(tells, usual, 1.0), np.nan)
    return found
