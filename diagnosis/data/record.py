"""One record of a recording: its samples, and what is said of it alone."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.data.description import Channel, told
from cable_envs.diagnosis.data.entries import UNUSABLE, Doubt, read_conditions, read_doubts, read_offsets
from cable_envs.diagnosis.data.readings import Reading, resolution

USES = ("fit", "heldout", "rest")
_RECORD_KEYS = ("data", "use", "conditions", "offsets", "quality")
LARGEST = 1e30
"""Largest number in SI units that is taken for a measurement: squares of it can still be added."""
AT_ONCE = 1e-9
"""s by which a sample may come before a cut and still count as behind it: clocks are rounded."""

Read = Callable[[str, Mapping[str, Channel]], Mapping[str, np.ndarray]]
"""(what stands under "data", channels) -> raw numbers [samples] by channel."""


@dataclass(frozen=True)
class Record:
    """One run of a rig: arrays [samples] in SI by channel. Gaps (empty cells) are NaN, except in time.

    Parameters
    ----------
    name : str
        Its file's name, or what it is called in memory.
    use : str
        "fit", "heldout" or "rest".
    data : Mapping of str to ndarray
        [samples] by channel.
    conditions, offsets : Mapping
        In SI too; the offsets are in the data already.
    units : Mapping of str to str
        SI unit of every condition that was given with a unit.
    quality : tuple of Doubt
        Spans of time that are no measurements.
    over : float
        s around each sample of which it is the mean (`cable_envs.diagnosis.data.thinning`); 0: it is of the moment.
    counts : mapping of str to Reading
        How the channels were read whose samples are means of readings.
    repeated : tuple of int
        Rows of the table that are the row before once more, its time included; they are not in the data.
    """

    name: str
    use: str
    data: Mapping[str, np.ndarray]
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    quality: tuple[Doubt, ...] = ()
    over: float = 0.0
    units: Mapping[str, str] = field(default_factory=dict)
    repeated: tuple[int, ...] = ()
    counts: Mapping[str, Reading] = field(default_factory=dict)

    @property
    def time(self) -> np.ndarray:
        """s, strictly increasing [samples]."""
        return self.data["time"]

    def reading(self, channel: str) -> Reading:
        """How the samples of a channel were read."""
        return self.counts.get(channel) or Reading(resolution(self.data[channel][self.usable(channel)]))

    def read_as_means(self, channels: Iterable[str], rows: int) -> dict[str, Reading]:
        """How means of so many rows of it will have been read, by channel; of those that are measured."""
        read = {name: self.reading(name) for name in channels if name != "time" and not told(name)}
        return {name: Reading(one.step, one.rows * rows) for name, one in read.items()}

    def usable(self, channel: str) -> np.ndarray:
        """Whether each sample of a channel is a measurement: neither empty nor stuck nor saturated [samples]."""
        good = ~np.isnan(self.data[channel])
        for doubt in self.quality:
            if doubt.kind in UNUSABLE and doubt.channel in (channel, None):
                good &= (self.time < doubt.start) | (self.time > doubt.end)
        return good

    def as_entry(self) -> dict[str, Any]:
        """What stands under ``records`` of a recording besides the file: numbers in SI, offsets are in the data."""
        entry: dict[str, Any] = {"use": self.use}
        conditions = {
            n: {"value": v, "unit": self.units[n]} if n in self.units else v for n, v in self.conditions.items()
        }
        more = (("conditions", conditions), ("quality", [doubt.as_entry() for doubt in self.quality]))
        return entry | {key: value for key, value in more if value}


def read_record(entry: Any, index: int, channels: Mapping[str, Channel], read: Read, origin: str) -> Record:
    """The record of an entry under ``records``, whose numbers ``read`` gives; ``index`` counts from 0.

    Raises ConfigurationError that names the record, and where it applies the channel, its column and the row.
    """
    where = f"{origin}: record {index + 1}"
    if not isinstance(entry, Mapping) or "data" not in entry:
        raise ConfigurationError(f"{where}: expected {{data: FILE, use: fit or heldout}}, got {entry!r}")
    require_known(f"key in {where}", entry, _RECORD_KEYS)
    use, name = str(entry.get("use", "fit")), str(entry["data"])
    if use not in USES:
        raise ConfigurationError(f"{where}: use '{use}' is unknown; {nearest(use, USES)}")
    raw = read(name, channels)
    data = {n: channel.to_si(raw[n]) for n, channel in channels.items()}
    offsets = read_offsets(entry.get("offsets"), channels, where)
    conditions, units = read_conditions(entry.get("conditions"), where)
    quality = read_doubts(entry.get("quality"), channels, where)
    again = _check_samples(data, name, channels)
    data = {n: values[~again] + offsets.get(n, 0.0) for n, values in data.items()}
    repeated = tuple(int(k) + 1 for k in np.flatnonzero(again))
    return Record(name, use, data, conditions, offsets, quality, units=units, repeated=repeated)


def _again(data: Mapping[str, np.ndarray]) -> np.ndarray:
    """Whether each row is the row before once more, its time included: a logger wrote it twice [samples]."""
    again = ~np.isnan(data["time"])
    again[:1] = False
    for values in data.values():
        again[1:] &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    return again


def _check_samples(data: Mapping[str, np.ndarray], name: str, channels: Mapping[str, Channel]) -> np.ndarray:
    """Which rows are the row before once more [samples].

    Raises ConfigurationError for times that are missing or do not increase, and for a channel without a value.
    """
    again = _again(data)
    _check_time(data["time"], _place(name, channels["time"]), again)
    for n, values in data.items():
        if np.isnan(values).all():
            raise ConfigurationError(f"{_place(name, channels[n])}: no values")
        huge = np.abs(values) > LARGEST
        if huge.any():
            row = int(np.argmax(huge))
            raise ConfigurationError(
                f"{_place(name, channels[n])}, row {row + 1}: {values[row]:g} in SI units is no measurement"
            )
    return again


def _place(record: str, channel: Channel) -> str:
    """Where a number stands, for errors; a column that is called as its channel is not named twice."""
    column = "" if channel.column == channel.name else f" (column '{channel.column}')"
    return f"{record.rpartition('/')[2]}, channel {channel.name}{column}"


def _check_time(time: np.ndarray, where: str, again: np.ndarray) -> None:
    if len(time) < 2:
        raise ConfigurationError(f"{where}: a record needs at least two samples, found {len(time)}")
    if np.isnan(time).any():
        raise ConfigurationError(f"{where}, row {1 + int(np.argmax(np.isnan(time)))}: no time")
    falling = (np.diff(time) <= 0) & ~again[1:]
    if falling.any():
        row = 2 + int(np.argmax(falling))
        raise ConfigurationError(
            f"{where}, row {row}: time must increase, {time[row - 2]:g} s is followed by {time[row - 1]:g} s"
        )


def behind(time: np.ndarray, start: float, after: float) -> np.ndarray:
    """Whether each sample, s, comes ``after`` seconds or later behind the record's start [samples]."""
    return time - start >= after - AT_ONCE


def cut(record: Record, after: float, channels: Mapping[str, Channel]) -> tuple[Record, ...]:
    """A record, and what lies ``after`` seconds behind its start as a held-out one; a record at rest is never cut.

    Raises ConfigurationError where a part lacks a channel's values.
    """
    later = behind(record.time, record.time[0], after)
    if record.use == "rest" or np.count_nonzero(later) < 2:
        return (record,)
    first = replace(record, data={n: values[~later] for n, values in record.data.items()})
    rest = replace(
        record, name=f"{record.name}_after", use="heldout", data={n: v[later] for n, v in record.data.items()},
        conditions={**record.conditions, "continues": record.name}, repeated=(),
    )  # fmt: skip
    for part in (first, rest):
        _check_samples(part.data, part.name, channels)
    return first, rest
