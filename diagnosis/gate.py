"""Faults of the data, found before any physics is asked about: each names record, channel and row."""

from dataclasses import dataclass

import numpy as np

from cable_envs.errors import ConfigurationError
from diagnosis.recording import Record, Recording

LONGEST_GAP = 5
"""Samples that may be missing in a row; they are left out of every sum."""
_JITTER = 0.25
_MOST_EMPTY = 0.2


@dataclass(frozen=True)
class Fault:
    """Something wrong with one channel of one record; ``row`` counts data rows from 1. ``fatal``: it cannot be used."""

    record: str
    channel: str
    row: int
    text: str
    fatal: bool

    def __str__(self) -> str:
        return f"{self.record}, channel {self.channel}, row {self.row}: {self.text}"


@dataclass(frozen=True)
class Quality:
    """All faults, and the common sampling period, s."""

    faults: tuple[Fault, ...]
    period: float
    visited: dict

    @property
    def notes(self):
        return tuple(str(f) for f in self.faults if not f.fatal)

    def require_usable(self) -> None:
        """ConfigurationError with every fatal fault, one per line."""
        fatal = [str(fault) for fault in self.faults if fault.fatal]
        if fatal:
            raise ConfigurationError("the data cannot be diagnosed:\n  " + "\n  ".join(fatal))


def gate(recording: Recording) -> Quality:
    """Look through ``channels`` of every record. Raises ConfigurationError only where a channel is not there at all."""
    channels = [c for c in recording.channels if c != "time" and not c.endswith(("_command", "_reference"))]
    faults: list[Fault] = []
    period = float(np.median(np.concatenate([np.diff(r.time) for r in recording.records])))
    for record in recording.records:
        faults += _clock(record, period)
        for channel in channels:
            faults += _channel(record, channel)
    return Quality(tuple(faults), period, {})


def _clock(record: Record, period: float) -> list[Fault]:
    steps = np.diff(record.time)
    own = float(np.median(steps))
    if abs(own - period) > 0.01 * period:
        return [
            Fault(record.name, "time", 1, f"sampled every {own:.3g} s, the other records every {period:.3g} s", True)
        ]
    if len(record.time) < 200:
        return [Fault(record.name, "time", len(record.time), "fewer than 200 samples", True)]
    found = []
    late = np.flatnonzero(steps > (LONGEST_GAP + 0.5) * period)
    if len(late):
        gap = steps[late[0]]
        found.append(Fault(record.name, "time", int(late[0]) + 2, f"a gap of {gap:.3g} s; cut the record there", True))
    regular = steps[steps < 1.5 * period]
    if np.std(regular) > _JITTER * period:
        worst = int(np.argmax(np.abs(steps - period)))
        found.append(
            Fault(
                record.name, "time", worst + 2, f"the clock jitters by {np.std(regular) / period:.0%} of its step", True
            )
        )
    return found


def _channel(record: Record, channel: str) -> list[Fault]:
    values, good = record.data[channel], record.usable(channel)
    found = []
    empty = ~good
    if empty.mean() > _MOST_EMPTY:
        row = int(np.argmax(empty)) + 1
        found.append(Fault(record.name, channel, row, f"{empty.mean():.0%} of the samples are empty or in doubt", True))
        return found
    held = values[good]
    if np.ptp(held) == 0.0:
        return [Fault(record.name, channel, 1, f"constant at {held[0]:g}: a dead sensor or the wrong column", True)]
    for level, what in ((held.max(), "highest"), (held.min(), "lowest")):
        start, longest = _longest_run(values == level)
        others = _longest_run(values == np.median(held))[1]
        if longest > max(20, 3 * others) and np.mean(held == level) > 0.02:
            text = f"at its {what} value {level:g} for {longest} samples: saturated"
            found.append(Fault(record.name, channel, start + 1, text, True))
    steps = np.abs(np.diff(held))
    usual = float(np.quantile(steps, 0.99))
    jump = int(np.argmax(steps))
    if usual > 0.0 and steps[jump] > 100.0 * usual:
        row = int(np.flatnonzero(good)[jump + 1]) + 1
        found.append(Fault(record.name, channel, row, f"a jump by {steps[jump]:g}, 100 times any usual step", True))
    return found


def _longest_run(mask: np.ndarray) -> tuple[int, int]:
    """(start, length) of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int)))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    k = int(np.argmax(lengths))
    return int(edges[2 * k]), int(lengths[k])
