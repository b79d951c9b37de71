"""The clock of records: its period, the number of each sample on it, and what the samples say of their own times.

All channels of a row are read at one moment. A time that is off by d moves each of them by its slope times d, more than
their noise where the rig is fast. How far a stamp is from an even clock is known, so that the samples tell whether they
were taken when their stamps say or evenly: which of the two leaves less of a smooth motion.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from math import comb

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter
from scipy.special import i0e, logsumexp

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
ROUNDING = 1e-12
"""Of a value, by which a computer may change it."""
OTHERS = (0.5, 5.0)
"""Period of another clock from which straight lines may have brought samples, over that of the recording."""
DIFFERENCES = (2, 3)
"""Orders of differences of samples in which noise is looked for: the first in which a channel's motion is not seen."""
FEW, SPARSE, ABOUT = 500, 4, 48
"""Differences by which noise is told, numbers for one sample beyond which a record has too long gaps; values of a
spectrum about a line by which it is held against the others."""


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


def odds_of_lines(recording: Recording) -> float:
    """Log odds, by the noise of all samples, that an export brought them from another clock by straight lines.

    Between two samples a and b of independent noise a straight line has (1 - x) a + x b, whose variance is
    (1 - x)^2 + x^2 of that of either: the noise swells and fades as the two clocks beat, with 1/P seen by the clock of
    the recording, for a period P of the other one. Squares of differences of the samples, in which no motion is left,
    show this as a line of a known size in their spectrum. All channels have it at the same frequency.

    Parameters
    ----------
    recording : Recording
        Its samples as they were read.

    Returns
    -------
    float
        Over that there was no other clock, for all P of `OTHERS` alike beforehand; 0 where no channel shows noise of
        its own, because it moves too fast or is rounded too coarsely.
    """
    moving = [(r, sample_period([r])) for r in recording.records if r.use != "rest"]
    longest = max((float(numbers(r.time, period)[-1]) for r, period in moving), default=0.0)
    ratios = np.linspace(1.0 / OTHERS[1], 1.0 / OTHERS[0], int(2.0 * longest) + 2)
    odds, seen = np.zeros(len(ratios)), False
    for channel in (name for name in recording.channels if name != "time" and not told(name)):
        for order in DIFFERENCES:
            squares = _squares(moving, channel, order)
            if squares:
                share = np.interp(ratios, *_swelling(order))
                odds += sum(_odds_of_line(k, square, ratios, share) for k, square in squares)
                seen = True
                break
    return float(logsumexp(odds) - np.log(len(odds))) if seen else 0.0


def _squares(records: Sequence[tuple[Record, float]], channel: str, order: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of every record (numbers of samples, squares of differences over their mean, less 1); empty without noise.

    Noise has as much in differences of two orders more, a motion less.
    """
    ahead = order + 2
    found, spread = [], []
    for record, period in records:
        count, good = numbers(record.time, period), record.usable(channel)
        if len(count) <= ahead or count[-1] > SPARSE * len(count):
            continue
        rows = np.flatnonzero(np.convolve(~good, np.ones(ahead + 1), "valid") < 0.5)
        rows = rows[count[rows + ahead] - count[rows] == ahead]
        own = [np.diff(record.data[channel], n) for n in (order, order + 2)]
        found.append((count[rows], own[0][rows]))
        spread.append(np.column_stack([np.abs(d[rows]) for d in own]))
    values = np.concatenate([np.zeros((0, 2)), *spread])
    if len(values) < FEW:
        return []
    noise, beyond = np.median(values, axis=0) / 0.6745 / np.sqrt([comb(2 * n, n) for n in (order, order + 2)])
    step = _least(np.concatenate([r.data[channel][r.usable(channel)] for r, _ in records]))
    if beyond < 0.5 * noise or noise < 2.0 * step / np.sqrt(12.0):
        return []
    top = 9.0 * noise**2 * comb(2 * order, order)  # three standard deviations: a jump is one sample
    parts = [(k, np.minimum(d**2, top)) for k, d in found if len(d)]
    return [(k, square / max(float(np.mean(square)), 1e-300) - 1.0) for k, square in parts]


def _least(values: np.ndarray) -> float:
    """The least difference between values, beyond rounding of a computer."""
    steps = np.diff(np.sort(values))
    return float(np.min(steps[steps > ROUNDING * float(np.max(np.abs(values)))], initial=np.inf))


def _odds_of_line(count: np.ndarray, squares: np.ndarray, ratios: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Log odds of one record for every ratio of its period to that of another clock: Rice's law over Rayleigh's."""
    long = 1 << int(np.ceil(np.log2(count[-1] + 1.0)) + 2)
    series = np.zeros(long)
    series[count.astype(int)] = squares
    power = np.abs(np.fft.rfft(series)) ** 2
    about = median_filter(power, 4 * ABOUT + 1, mode="reflect") / np.log(2.0)
    turns = ratios % 1.0
    at = np.round(np.minimum(turns, 1.0 - turns) * long).astype(int)
    line = len(squares) * share
    both = 2.0 * np.sqrt(power[at]) * line / about[at]
    return np.log(i0e(both)) + both - line**2 / about[at]


@cache
def _swelling(order: int) -> tuple[np.ndarray, np.ndarray]:
    """(ratios of periods, share of the mean square of differences that turns once a period of the other clock)."""
    ratios, phases = np.linspace(1.0 / OTHERS[1], 1.0 / OTHERS[0], 400), np.arange(200) / 200
    shares, taps = [], np.diff(np.eye(order + 1), order, axis=0)[0]
    for ratio in ratios:
        places = phases[:, None] + ratio * np.arange(order + 1)
        knots = np.arange(int(places.max()) + 2)
        weights = np.maximum(1.0 - np.abs(places[:, :, None] - knots), 0.0)  # of every sample of the other clock
        power = np.sum((taps[:, None] * weights).sum(axis=1) ** 2, axis=1)
        shares.append(abs(np.mean(power * np.exp(-2j * np.pi * phases))) / power.mean())
    return ratios, np.array(shares)
