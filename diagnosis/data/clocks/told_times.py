"""What a smooth command says of the times at which its rows were read.

A command that moves smoothly has no noise. A row whose value is not the one that its neighbours make likely was read
earlier or later than an even clock has it, by that over the command's slope, and so was every other channel of the row.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from cable_envs.diagnosis.data.clocks.even import runs
from cable_envs.diagnosis.data.record import Record

WIDTHS = (7, 9, 11, 15, 21, 31, 45, 65, 95)
"""Samples over which a command may be smoothed, by polynomials of the degree `DEGREE`."""
DEGREE = 5
FAST = 0.3
"""Of a command's greatest slope, from which the scatter of the times is estimated."""
SLOW = 0.03
"""The same, up to which what is taken away is none of the times'."""
CORNER = 5.0
"""Standard deviations beyond which a command has a corner and is not smooth."""
MOST = 0.4
"""Of a period: no row is moved by more."""


def told_times(
    records: Sequence[tuple[Record, float]], channel: str, stamped: Sequence[np.ndarray]
) -> list[np.ndarray] | None:
    """By how much each row was read late against an even clock, as a command tells it.

    Parameters
    ----------
    records : sequence of (Record, float)
        All that move, each with the period of its clock, s.
    channel : str
        The command.
    stamped : sequence of ndarray
        By how much each stamp is late against an even clock [T], s.

    Returns
    -------
    list of ndarray, or None
        Of every record [T], s: what the command says where it moves, and what the stamps say where it rests, by the
        share of them that it confirms elsewhere. None where the command does not tell.
    """
    command = _Command(records, channel)
    even = [np.zeros(len(own)) for own in stamped]
    best = min(WIDTHS, key=lambda width: _spread(command.late(width, even)[0]))
    late, fast = command.late(best, even)
    if np.count_nonzero(fast) < max(WIDTHS):
        return None
    share = _confirmed(late, np.concatenate(stamped)[fast])
    found = [share * own for own in stamped]
    rough = [np.ones(len(own), dtype=bool) for own in stamped]
    for width in (w for w in reversed(WIDTHS) if w <= best):  # where it has a corner, a shorter piece may have none
        for k, (beyond, smooth) in enumerate(command.beyond(width, [share * own for own in stamped])):
            found[k] = np.where(rough[k] & smooth, share * stamped[k] + beyond, found[k])
            rough[k] &= ~smooth
    return [np.clip(own, -MOST * period, MOST * period) for own, (_, period) in zip(found, records, strict=True)]


class _Command:
    """A command of several records, smoothed."""

    def __init__(self, records: Sequence[tuple[Record, float]], channel: str):
        self._values = [record.data[channel] for record, _ in records]
        self._periods = [period for _, period in records]
        self._runs = [runs(record, period, record.usable(channel)) for record, period in records]
        self._step = max(record.reading(channel).step for record, _ in records)

    def _taken(self, width: int, late: Sequence[np.ndarray]) -> list[np.ndarray]:
        """What a curve through the other samples is off by, of rows that are so late, and its slope [T, 2]."""
        found = [np.zeros((len(values), 2)) for values in self._values]
        for one, values, parts, period, own in zip(found, self._values, self._runs, self._periods, late, strict=True):
            for rows in (rows for rows in parts if len(rows) > width):
                slope = savgol_filter(values[rows], width, DEGREE, deriv=1, delta=period)
                given = values[rows] - slope * own[rows]
                one[rows, 0] = (given - savgol_filter(given, width, DEGREE)) / _own(width)
                one[rows, 1] = slope
        return found

    def late(self, width: int, given: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """(how late rows are beyond what is given, s, of those where the command goes fast; which these are)."""
        return self._late(self._taken(width, given))

    @staticmethod
    def _late(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        taken, slope = np.concatenate(parts).T
        fast = np.abs(slope) > FAST * np.max(np.abs(slope))
        return taken[fast] / slope[fast], fast

    def beyond(self, width: int, given: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
        """(how late each row is beyond what is given [T], s, as likely as it is; where the command is smooth)."""
        parts, own = self._taken(width, given), _own(width)
        spread = _spread(self._late(parts)[0]) * np.sqrt(own)  # the rest is of the curve through the others
        taken, slope = np.concatenate(parts).T
        slow = _spread(taken[np.abs(slope) <= SLOW * np.max(np.abs(slope))])
        found = []
        for taken, slope in (part.T for part in parts):
            scale = np.maximum(np.hypot(np.hypot(slow, self._step / np.sqrt(12.0)), spread * slope), 1e-300)
            rough = np.abs(taken) * np.sqrt(own) > CORNER * scale
            found.append((own * taken * slope * (spread / scale) ** 2, maximum_filter1d(rough.astype(int), width) == 0))
        return found


def _own(width: int) -> float:
    """Share of a sample that smoothing takes away, if its neighbours stay."""
    return 1.0 - float(savgol_coeffs(width, DEGREE)[width // 2])


def _confirmed(late: np.ndarray, stamped: np.ndarray) -> float:
    """Share of what stamps say that a command confirms."""
    near = np.abs(late) <= CORNER * _spread(late)
    return float(np.clip(late[near] @ stamped[near] / max(float(stamped[near] @ stamped[near]), 1e-300), 0.0, 1.0))


def _spread(values: np.ndarray) -> float:
    """Standard deviation by the median of the sizes: few corners do not count."""
    return float(np.median(np.abs(values))) / 0.6745 if len(values) else 0.0
