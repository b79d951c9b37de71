"""What an export does that brings samples from another clock by straight lines.

Lines cut corners off a motion, x (1 - x) P^2 / 2 of its acceleration at the share x between two samples that are P
apart, which beats as the two clocks do. `cable_envs.diagnosis.data.clocks.beats` finds the other clock.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import savgol_filter
from scipy.sparse import csr_matrix, identity

from cable_envs.diagnosis.data.clocks.even import numbers
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

SMOOTH, CUBIC = 9, 3
"""Samples about each of a command of which a polynomial says how it bends, and its order."""
TAPS = 6
"""Samples of a prediction from which its value between them is taken."""

BENT, JUMP, NEAR = 4, 5.0, 3
"""Order of the differences by which a jump between samples is told, over their usual size, and how many samples before
and behind it are not told between samples either."""


@dataclass(frozen=True)
class Lines:
    """Whether samples came from another clock by straight lines, and from which.

    Parameters
    ----------
    odds : float
        Log odds, by the noise of the samples, over that there was no other clock; 0 where no channel shows noise of
        its own, because it moves too fast or is rounded too coarsely.
    ratio : float
        Of the recording's period to that of the other clock, where the odds are above `SURE`; else 0.
    phases : mapping of str to float
        Record -> where on the other clock, counted in its samples from one of them, the record's clock has its 0.
    clocks : mapping of str to tuple
        Record -> (time of its 0, its period), s.
    """

    odds: float
    ratio: float = 0.0
    phases: Mapping[str, float] = field(default_factory=dict)
    clocks: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Of the other clock, s; 0 where there is none."""
        return float(np.mean([p for _, p in self.clocks.values()])) / self.ratio if self.ratio else 0.0

    def of(self, record: str, time: np.ndarray) -> csr_matrix | None:
        """What straight lines make of samples at even times [T] of a record [T, T]; None where that is not known."""
        if record not in self.phases or not self.ratio:
            return None
        begin, period = self.clocks[record]
        if len(time) < TAPS or np.any(np.diff(numbers(time, float(np.median(np.diff(time))))) != 1.0):
            return None
        return _by_lines(len(time), self.ratio, self.phases[record] + self.ratio * np.round((time[0] - begin) / period))


NO_LINES = Lines(0.0)


def without_lines_in_commands(recording: Recording, lines: Lines) -> Recording:
    """The recording with its commands and references as they were between the samples of the other clock.

    Nothing measured them: what straight lines took off a smooth one is put back.

    Parameters
    ----------
    recording : Recording
        As it was read.
    lines : Lines
        The clock that it came from.
    """
    names = [name for name in recording.channels if name != "time" and told(name)]
    return replace(recording, records=tuple(_with_commands(record, names, lines) for record in recording.records))


def near_jumps(measured: np.ndarray) -> np.ndarray:
    """Samples near jumps, as of a cable's tension where friction turns round.

    A jump is at an instant between two samples that neither shows, and where the other clock took a sample beside it
    the value is not told.

    Parameters
    ----------
    measured : ndarray, shape (T,)
        Even samples.

    Returns
    -------
    ndarray of bool, shape (T,)
    """
    if len(measured) <= BENT:
        return np.zeros(len(measured), dtype=bool)
    bends = np.abs(np.diff(np.pad(measured, BENT // 2, mode="edge"), BENT))
    usual = np.median(bends[bends > 0.0]) / 0.6745 if bends.any() else 0.0
    jumps = bends > JUMP * usual if usual else np.zeros(len(measured), dtype=bool)
    return np.convolve(jumps, np.ones(2 * NEAR + 1), "same") > 0.5


def _with_commands(record: Record, names: Sequence[str], lines: Lines) -> Record:
    if record.name not in lines.phases:
        return record
    begin, period = lines.clocks[record.name]
    count = np.round((record.time[0] - begin) / period) + numbers(record.time, period)
    whole = np.arange(count[0], count[-1] + 1.0)
    by = lines.of(record.name, begin + period * whole)
    if by is None or len(whole) < SMOOTH:
        return record
    lost, rows, data = by - identity(len(whole)), (count - count[0]).astype(int), dict(record.data)
    for name in names:
        series = np.interp(whole, count, record.data[name])
        data[name] = record.data[name] - (lost @ savgol_filter(series, SMOOTH, CUBIC))[rows]
    return replace(record, data=data)


def _by_lines(count: int, ratio: float, phase: float) -> csr_matrix:
    """Samples 0, 1 .. as straight lines give them between those of another clock, at phase + ratio * k of it."""
    place = phase + ratio * np.arange(count)
    behind = np.floor(place)
    x = place - behind
    found = csr_matrix((count, count))
    for knot, weight in ((behind, 1.0 - x), (behind + 1.0, x)):
        at = np.clip((knot - phase) / ratio, 0.0, count - 1.0)
        first = np.clip(np.floor(at).astype(int) - TAPS // 2 + 1, 0, count - TAPS)
        taps = np.arange(TAPS)
        shares = weight[:, None] * _lagrange(at - first)
        where = (np.repeat(np.arange(count), TAPS), (first[:, None] + taps).ravel())
        found = found + csr_matrix((shares.ravel(), where), shape=(count, count))
    return found


def _lagrange(at: np.ndarray) -> np.ndarray:
    """Weights of values at 0, 1 .. `TAPS` - 1 in that of their polynomial at places [n]; [n, TAPS]."""
    weights = np.ones((len(at), TAPS))
    for j in range(TAPS):
        for k in range(TAPS):
            if k != j:
                weights[:, j] *= (at - k) / (j - k)
    return weights
