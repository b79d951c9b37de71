"""Records of different rates on one clock: the slowest of theirs, or a stated one.

A record that is faster is averaged: each new sample is the mean, over the new period around it, of straight lines
through its usable rows. The models average what they predict of it over the same span (`Record.over`). Commands are
kept as they acted, and gaps stay gaps, as in `cable_envs.diagnosis.data.thinning`.
"""

from dataclasses import replace

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

ALIKE = 0.01
"""Share by which periods may differ and still be of one clock."""
FULL = 0.5
"""Share of a mean's span that measurements must cover."""
HOLE = 1.5
"""Own periods of a record between two rows from which on a stretch is no measurement."""


def on_one_clock(recording: Recording) -> tuple[Recording, str]:
    """The recording with all records on one clock, and what was done, in a sentence; empty where nothing was.

    Parameters
    ----------
    recording : Recording
        Its ``time`` channel may state the period (``every``); else it is that of the slowest record.

    Returns
    -------
    Recording, str
        Records that are on the clock already are as they were.

    Raises
    ------
    ConfigurationError
        Where a clock is stated that is faster than a record: what lies between its rows nobody measured.
    """
    periods = {record.name: sample_period([record]) for record in recording.records}
    slowest = max(periods, key=lambda name: periods[name])
    stated = recording.channels["time"].every
    period = stated or periods[slowest]
    if stated and stated < (1.0 - ALIKE) * periods[slowest]:
        raise ConfigurationError(
            f"{recording.path}: time: every: {stated:.4g} s is stated, and {slowest} is sampled every "
            f"{periods[slowest]:.4g} s; state that or more"
        )
    faster = [name for name, own in periods.items() if own < (1.0 - ALIKE) * period]
    if not faster:
        return recording, ""
    records = tuple(
        _averaged(record, recording, periods[record.name], period) if record.name in faster else record
        for record in recording.records
    )
    left = float(np.sqrt(max(min(own / period, 1.0) for own in periods.values())))
    channels = {
        name: replace(c, noise_std=c.noise_std * left) if c.noise_std and not told(name) else c
        for name, c in recording.channels.items()
    }
    return replace(recording, records=records, channels=channels), _statement(periods, faster, period, bool(stated))


def _statement(periods: dict[str, float], faster: list[str], period: float, stated: bool) -> str:
    rates = ", ".join(f"{name} (every {1e3 * periods[name]:.4g} ms)" for name in faster)
    whose = "the stated one" if stated else "that of the slowest record"
    return f"records of different rates were brought to one clock, {1e3 * period:.4g} ms, {whose}, by means: {rates}"


def _averaged(record: Record, recording: Recording, own: float, period: float) -> Record:
    first, last = record.time[0] + 0.5 * period, record.time[-1] - 0.5 * period
    held = [name for name in recording.channels if recording.holds(name)]
    last -= 0.5 * period if held else 0.0  # a row's command acts over the period behind it
    time = first + period * np.arange(max(int(np.floor((last - first) / period + 1e-6)) + 1, 0))
    if len(time) < 2:
        raise ConfigurationError(f"{record.name} is shorter than three periods of {period:.4g} s: leave it out")
    near = np.clip(np.searchsorted(record.time, time), 1, len(record.time) - 1)
    time = time[record.time[near] - record.time[near - 1] < max(HOLE * own, period)]
    data = {"time": time}
    for name in recording.channels:
        if name == "time":
            continue
        good = record.usable(name)
        at, values = record.time[good], record.data[name][good]
        if name in held:
            data[name] = _acted(at, values, time, period)
        elif told(name):
            data[name] = np.where(_covered(at, time - own, time + own, own) > FULL, np.interp(time, at, values), np.nan)
        else:
            data[name] = means(at, values, time, period)
    counts = record.read_as_means(recording.channels, max(round(period / own), 1))
    return replace(record, data=data, over=period, counts=counts)


def means(at: np.ndarray, values: np.ndarray, time: np.ndarray, period: float) -> np.ndarray:
    """Means of straight lines through samples, over a period around each time; NaN where samples are missing.

    Parameters
    ----------
    at, values : ndarray
        Times [n], increasing, and samples [n].
    time : ndarray
        [T], in the middle of the means.
    period : float
        Length of each mean.

    Returns
    -------
    ndarray
        [T].

    Examples
    --------
    >>> at = np.arange(0.0, 1.01, 0.1)
    >>> means(at, 2.0 * at, np.array([0.5]), 0.4)
    array([1.])
    """
    if len(at) < 2:
        return np.full(len(time), np.nan)
    own = float(np.median(np.diff(at)))
    ends = (time - 0.5 * period, time + 0.5 * period)
    low, high = (_integral(at, values, np.clip(end, at[0], at[-1])) for end in ends)
    span = np.clip(ends[1], at[0], at[-1]) - np.clip(ends[0], at[0], at[-1])
    good = (ends[0] > at[0] - 0.1 * own) & (ends[1] < at[-1] + 0.1 * own)  # half a mean is one of another moment
    good &= _covered(at, *ends, own) > FULL
    return np.where(good, (high - low) / np.where(good, span, 1.0), np.nan)


def _integral(at: np.ndarray, values: np.ndarray, until: np.ndarray) -> np.ndarray:
    """Integral of straight lines through samples, from the first one to each time."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(at))])
    k = np.clip(np.searchsorted(at, until, side="right") - 1, 0, len(at) - 2)
    part, step = until - at[k], at[k + 1] - at[k]
    return total[k] + part * (values[k] + 0.5 * part / step * (values[k + 1] - values[k]))


def _covered(at: np.ndarray, low: np.ndarray, high: np.ndarray, own: float) -> np.ndarray:
    """Share of each span in which no two samples lie further apart than `HOLE` periods."""
    if len(at) < 2:
        return np.zeros(len(low))
    steps = np.diff(at)
    total = np.concatenate([[0.0], np.cumsum(np.where(steps < HOLE * own, steps, 0.0))])
    return (np.interp(high, at, total) - np.interp(low, at, total)) / (high - low)


def _acted(at: np.ndarray, values: np.ndarray, time: np.ndarray, period: float) -> np.ndarray:
    """Mean of a held command over the period that begins at each time."""
    total = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(at))])

    def until(moments: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(at, moments, side="right") - 1, 0, len(at) - 1)
        return total[k] + values[k] * (moments - at[k])

    return (until(time + period) - until(time)) / period
