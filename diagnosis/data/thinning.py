"""Long recordings on a slower clock: each new sample is the mean of the rows around it, and the models average as well.

A mean of N rows has 1 / sqrt(N) of their white noise, and N times as many levels. Of a motion it takes a little,
(pi f P)^2 / 6 of a wave of frequency f at a period P; therefore what a model predicts of such a record is averaged over
the same span (`Record.over`), and nothing is lost but what is faster than the new clock.

What was asked for is no measurement and is kept as it acted: a command that is held is what acted from the row on, on
a clock whose rows fall on the command's steps, and other commands and references are read at the moment.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, gcd

import numpy as np
from scipy.signal import periodogram

from cable_envs.diagnosis.data.clocks.even import sample_period, zero
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.readings import weights_of_mean
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

ENOUGH = 12_000
"""Samples of the records that a model compares, from which on they are averaged: two minutes at 100 Hz."""
SLOWEST = 0.01
"""s, the longest new period: that of the blind proof, whose recordings show every effect of the library."""
IN_A_WAVE = 20
"""Samples, at least, in a wave of the fastest motion."""
OF_MOTION = 1e-4
"""Share of a motion's power that may be faster than what counts as its fastest: 1 % of its size."""
AT_REST = 2000
"""Samples that a record at rest keeps: fewer do not tell the colour of the noise."""
SHORTEST = 400
"""Samples that every other record keeps."""
FULL = 0.5
"""Share of the rows of a mean that must be usable, for it to be."""


@dataclass(frozen=True)
class Thinning:
    """How a recording is averaged.

    Parameters
    ----------
    every : int
        Rows in a new period; 1: nothing is averaged.
    period : float
        s, of the rows.
    fastest : float
        Hz, below which all but `OF_MOTION` of the power of the motion lies.
    steps : int
        Rows, 1 or a multiple, after which a held command may change.
    """

    every: int
    period: float
    fastest: float
    steps: int = 1


def thinning(recording: Recording, places: Sequence[str]) -> Thinning:
    """How many rows of a recording make a sample.

    Parameters
    ----------
    recording : Recording
        As it was loaded.
    places : sequence of str
        Channels that say where the rig is; of a recording that has none, all that were measured.

    Returns
    -------
    Thinning
        With ``every`` of 1 where the samples are few, or slow.
    """
    period = sample_period(recording.records)
    moving = [r for r in recording.records if r.use != "rest"]
    rows = sum(len(r.time) for r in moving)
    if rows <= ENOUGH or 2.0 * period > SLOWEST:
        return Thinning(1, period, 0.0)
    known = [c for c in recording.channels if c in places] or [
        c for c in recording.channels if c != "time" and not told(c)
    ]
    fastest = max(_fastest(r.time, r.data[c], r.usable(c), period) for r in moving for c in known)
    most = min(SLOWEST, 1.0 / (IN_A_WAVE * max(fastest, 1e-9))) / period
    most = min(most, *(len(r.time) / (AT_REST if r.use == "rest" else SHORTEST) for r in recording.records))
    every = max(min(ceil(rows / ENOUGH), int(most + 1e-9)), 1)
    steps = _steps(recording, period)
    shares = [n for n in range(1, every + 1) if steps % n == 0]
    if steps > 1 and 2 * shares[-1] >= every:  # else a command changes within a sample, whatever is taken
        every = shares[-1]
    return Thinning(every, period, fastest, steps)


def thinned(recording: Recording, how: Thinning) -> Recording:
    """The recording with one sample for each ``how.every`` rows; the noise that it states falls by the averaging."""
    if how.every == 1:
        return recording
    channels = {
        name: replace(c, noise_std=c.noise_std * noise_left(how.every)) if c.noise_std and not told(name) else c
        for name, c in recording.channels.items()
    }
    records = tuple(_averaged(record, recording, how) for record in recording.records)
    return replace(recording, channels=channels, records=records)


def noise_left(every: int) -> float:
    """Standard deviation of the mean of so many rows over that of one, for noise that is white."""
    weights = weights_of_mean(every)
    return float(np.sqrt(np.sum(weights**2)) / np.sum(weights))


def statement(before: Recording, after: Recording, how: Thinning) -> str:
    """What was averaged and why, in a sentence; empty where nothing was."""
    if how.every == 1:
        return ""
    rows, samples = (sum(len(r.time) for r in one.records if r.use != "rest") for one in (before, after))
    return (
        f"{rows} rows, one every {1e3 * how.period:.4g} ms, were averaged to {samples} samples, one every "
        f"{1e3 * how.every * how.period:.4g} ms (the mean of {how.every} rows; commands as they acted): the motion "
        f"has all but {OF_MOTION:.2%} of its power below {how.fastest:.2g} Hz, and more samples take longer and show "
        "no more"
    )


def _fastest(time: np.ndarray, values: np.ndarray, good: np.ndarray, period: float) -> float:
    """Hz below which all but `OF_MOTION` of the power of a channel [T] lies; 0 of one that does not move.

    Noise does not count, as far as it is white: its power is that of the upper half of the spectrum.
    """
    if good.sum() < SHORTEST:
        return 0.0
    even = np.interp(np.arange(time[0], time[-1], period), time[good], values[good])
    f, power = periodogram(even, 1.0 / period, window="hann", detrend="linear")
    total = np.cumsum(power - power[len(power) // 2 :].mean())
    return float(f[int(np.argmax(total >= (1.0 - OF_MOTION) * total[-1]))]) if total[-1] > 0.0 else 0.0


def _changes(record: Record, channel: str, period: float) -> np.ndarray:
    """Numbers on the clock at which a held command changes."""
    usable = record.usable(channel)
    return _numbers(record, period)[usable][1:][np.diff(record.data[channel][usable]) != 0.0]


def _numbers(record: Record, period: float) -> np.ndarray:
    """Number of each row on the recording's clock, which the record's own may drift against."""
    return np.maximum(np.round((record.time - zero(record.time, period)) / period), 0.0).astype(int)


def _held(recording: Recording) -> list[str]:
    return [name for name in recording.channels if recording.holds(name)]


def _steps(recording: Recording, period: float) -> int:
    """Rows of which every time between two changes of a held command is a multiple; 1 where there is none."""
    between = [
        int(step)
        for record in recording.records
        for name in _held(recording)
        for step in np.diff(_changes(record, name, period))
    ]
    return max(gcd(*between), 1)


def _averaged(record: Record, recording: Recording, how: Thinning) -> Record:
    counted, start = _numbers(record, how.period), zero(record.time, how.period)
    rows, half = counted[-1] + 1, how.every // 2
    first = half
    if how.steps > 1:
        phases = [int(c[0]) for name in _held(recording) if len(c := _changes(record, name, how.period))]
        first = half + (phases[0] - half) % how.every if phases else half
    ahead = how.every - 1 if _held(recording) else half
    centres = np.arange(first, rows - ahead, how.every)
    time = start + how.period * centres
    data = {"time": time}
    for name in recording.channels:
        if name == "time":
            continue
        if recording.holds(name):
            data[name] = _acted(record, name, time, how)
        elif told(name):
            data[name] = _read(record, name, time, how.period)
        else:
            data[name] = _means(record, name, counted, centres, how)
    counts = record.read_as_means(recording.channels, how.every)
    return replace(record, data=data, over=how.every * how.period, counts=counts)


def _acted(record: Record, channel: str, time: np.ndarray, how: Thinning) -> np.ndarray:
    """Mean of a held command over the new period that begins at each time [K]."""
    usable = record.usable(channel)
    stamps, values = record.time[usable], record.data[channel][usable]
    at = time[:, None] + how.period * (np.arange(how.every) + 0.5)
    acted = values[np.maximum(np.searchsorted(stamps, at) - 1, 0)]
    return acted[:, 0] + (acted - acted[:, :1]).mean(axis=1)  # to the bit where one acted all the time


def _read(record: Record, channel: str, time: np.ndarray, period: float) -> np.ndarray:
    """A command that goes in straight lines, at each time [K]; NaN within gaps."""
    usable = record.usable(channel)
    stamps, values = record.time[usable], record.data[channel][usable]
    after = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    near = stamps[after] - stamps[after - 1] < 1.5 * period
    return np.where(near, np.interp(time, stamps, values), np.nan)


def _means(record: Record, channel: str, counted: np.ndarray, centres: np.ndarray, how: Thinning) -> np.ndarray:
    """Values [K] at the centres of straight lines through the usable rows around them; NaN where these are few.

    Where all rows are there and the clock is even, that is their mean.
    """
    half, count = how.every // 2, counted[-1] + 1
    values, late, good = np.zeros(count), np.zeros(count), np.zeros(count, dtype=bool)
    usable = record.usable(channel)
    values[counted[usable]] = record.data[channel][usable]
    late[counted] = record.time - zero(record.time, how.period) - how.period * counted
    good[counted[usable]] = True
    rows = centres[:, None] + np.arange(-half, half + 1)
    weights = weights_of_mean(how.every) * good[rows]
    at = how.period * np.arange(-half, half + 1) + late[rows]
    total, mean = weights.sum(axis=1), np.zeros(len(centres))
    enough = total >= FULL * how.every
    middle = np.zeros(len(centres))
    middle[enough] = (weights * at).sum(axis=1)[enough] / total[enough]
    mean[enough] = (weights * values[rows]).sum(axis=1)[enough] / total[enough]
    away = at - middle[:, None]
    spread, along = (weights * away**2).sum(axis=1), (weights * away * values[rows]).sum(axis=1)
    slope = np.where(spread > 0.0, along / np.where(spread > 0.0, spread, 1.0), 0.0)
    return np.where(enough, mean - slope * middle, np.nan)
