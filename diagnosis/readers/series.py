"""Signals that come with times of their own: fields of messages, their stamps, and the rows of one table for all."""

import re
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.diagnosis.data.clocks.one_clock import means
from cable_envs.diagnosis.readers.base import Log

HOLE_INTERVALS = 5.0
"""Intervals of a signal behind which nothing is interpolated."""
_STEP = re.compile(r"([^.\[\]]+)(?:\[(\d+)\])?")
FASTER = 2.0
"""Times as many samples, from which on a signal is averaged around the rows that it is brought to."""
_EPOCH = 946_684_800
_SECONDS, _NANOSECONDS = ("sec", "seconds", "secs"), ("nanosec", "nsec", "nanos", "nsecs")
"""What ROS 2, ROS 1, Protobuf and Foxglove call the two parts of a stamp."""

Series = Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]]
"""Topic -> (times, s [n], field -> values [n])."""


class Messages:
    """Times and fields of messages, met one after another; ``columns``: channel -> (topic, field).

    What stays in memory are the numbers asked for. ``file`` is what errors call the source.
    """

    def __init__(self, columns: Mapping[str, tuple[str, str]], file: str, log: Log) -> None:
        self._file, self._log = file, log
        self.wanted: dict[str, dict[str, str]] = {}
        for name, (topic, field) in columns.items():
            self.wanted.setdefault(topic, {}).update({field: name} if field else {})
        self._series: dict[str, tuple[array, dict[str, array]]] = {}

    def require(self, topics: Any) -> None:
        """ConfigurationError for a topic that is wanted and not there, naming the nearest."""
        missing = next((topic for topic in self.wanted if topic not in topics), None)
        if missing:
            raise ConfigurationError(f"{self._file}: no topic '{missing}'; {nearest(missing, topics)}")

    def add(self, topic: str, message: Any, received: int) -> None:
        """One message; ``received``: ns since 1970, its time where it has no stamp."""
        fields = self.wanted[topic]
        at, values = self._series.setdefault(topic, (array("d"), {field: array("d") for field in fields}))
        at.append(stamp(message, received, topic, self._log))
        for field, name in fields.items():
            values[field].append(field_of(message, field, f"{self._file}, channel {name}: {topic}"))

    def series(self) -> Series:
        """All of them. Raises ConfigurationError for a topic without a message."""
        empty = next((topic for topic in self.wanted if topic not in self._series), None)
        if empty:
            raise ConfigurationError(f"{self._file}: topic {empty} holds no message")
        return {
            topic: (np.array(at), {field: np.array(values) for field, values in fields.items()})
            for topic, (at, fields) in self._series.items()
        }


def stamp(message: Any, received: int, topic: str, log: Log) -> float:
    """s since 2000, which leaves a double a resolution of 0.2 us; a zero stamp was never set."""
    for node in (_part(_part(message, "header"), "stamp"), _part(message, "timestamp")):
        seconds, nanoseconds = (_first(node, names) for names in (_SECONDS, _NANOSECONDS))
        if seconds or nanoseconds:
            return (seconds - _EPOCH) + nanoseconds * 1e-9
    log.say(f"{topic}: no stamps; times are those of reception, which jitter")
    return (received // 10**9 - _EPOCH) + received % 10**9 * 1e-9


def _part(node: Any, name: str) -> Any:
    return node.get(name) if isinstance(node, Mapping) else getattr(node, name, None)


def _first(node: Any, names: tuple[str, ...]) -> int:
    """The first of the parts that is a whole number; 0 where none is."""
    found = (_part(node, name) for name in names)
    return next((int(value) for value in found if isinstance(value, (int, np.integer))), 0)


def field_of(message: Any, path: str, where: str) -> float:
    """A number in a message, by its path ``position[0]`` or ``wrench.force.z``; what is null is a gap (NaN).

    Raises ConfigurationError that names ``where`` and the nearest field.
    """
    node = message
    for part in path.split("."):
        step = _STEP.fullmatch(part)
        names = _names(node)
        if not step or step.group(1) not in names:
            raise ConfigurationError(f"{where}: no field '{part}'; {nearest(part, names)}")
        node = _part(node, step.group(1))
        if step.group(2) is not None:
            if not hasattr(node, "__len__") or isinstance(node, (str, Mapping)):
                raise ConfigurationError(f"{where}: '{part}': {step.group(1)} holds no values to count")
            if int(step.group(2)) >= len(node):
                raise ConfigurationError(f"{where}: '{part}': there are {len(node)} values, counted from 0")
            node = node[int(step.group(2))]
    if node is None:
        return float("nan")
    try:
        if isinstance(node, str):
            raise TypeError
        return float(node)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{where}: '{path}' is {type(node).__name__}, no number") from None


def _names(node: Any) -> list[str]:
    """Fields of a message of JSON, of rosbags, of Protobuf, and of mcap's decoder of ROS 2."""
    if isinstance(node, Mapping):
        return list(map(str, node))
    if hasattr(node, "DESCRIPTOR"):
        return [field.name for field in node.DESCRIPTOR.fields]
    names: Any = getattr(node, "__dataclass_fields__", None) or getattr(node, "__slots__", ())
    return [name for name in names if not name.startswith("__")]


def on_one_clock(series: Series, columns: Mapping[str, tuple[str, str]], log: Log) -> dict[str, np.ndarray]:
    """Channels on the rows of the topic of ``time``: the times of its messages, or its field where one is named.

    Other topics are interpolated onto these rows, never over a hole of more than `HOLE_INTERVALS` of their intervals.
    """
    base, field = columns["time"]
    at, fields = series[base]
    table = {"time": fields[field] if field else at}
    for name, (topic, field) in columns.items():
        if name != "time":
            values = series[topic][1][field]
            table[name] = values if topic == base else onto(at, series[topic][0], values)
            if topic != base:
                log.say(f"channel {name}: {topic} interpolated onto the times of {base}")
    return table


def messages_on_one_clock(
    series: Series, columns: Mapping[str, tuple[str, str]], log: Log
) -> dict[str, np.ndarray]:  # fmt: skip
    """`on_one_clock` of messages, whose stamps count from the first row."""
    table = on_one_clock(series, columns, log)
    base, field = columns["time"]
    if not field:
        table["time"] = table["time"] - table["time"][0]
        log.say(f"time counts from the first message of {base}")
    return table


OWN = "clock of "
"""How what is read as a channel's own times is called, before the channel's name."""


def with_clocks(columns: Mapping[str, Any], clocks: Mapping[str, Any]) -> dict[str, Any]:
    """Columns to read, with those of the channels' own times (`brought`)."""
    return {**columns, **{f"{OWN}{name}": column for name, column in clocks.items()}}


def brought(table: Mapping[str, np.ndarray], clocks: Mapping[str, Any], log: Log) -> dict[str, np.ndarray]:
    """Channels [rows] with times of their own on the rows of the time; rows without a time are the clocks' alone."""
    kept = np.isfinite(table["time"])
    times = table["time"][kept]
    found = {}
    for name, values in table.items():
        if name.startswith(OWN):
            continue
        if name not in clocks:
            found[name] = values[kept] if len(values) == len(kept) else values
            continue
        at = table[f"{OWN}{name}"]
        both = min(len(at), len(values))
        good = np.isfinite(at[:both]) & np.isfinite(values[:both])
        found[name] = onto(times, at[:both][good], values[:both][good])
        log.say(f"channel {name}: brought from the clock {clocks[name]} onto the rows of the time")
    return found


def onto(times: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """``values`` at ``times``; NaN outside, and in holes. Of what is twice as fast or more, means around them."""
    order = np.argsort(at, kind="stable")
    at, values = at[order], values[order]
    found = np.interp(times, at, values, left=np.nan, right=np.nan)
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if len(at) > 2 and period >= FASTER * float(np.median(np.diff(at))) > 0.0:
        mean = means(at, values, times, period)
        found = np.where(np.isnan(found) | np.isnan(mean), found, mean)
    if len(at) > 2:
        k = np.clip(np.searchsorted(at, times), 1, len(at) - 1)
        found[at[k] - at[k - 1] > HOLE_INTERVALS * np.median(np.diff(at))] = np.nan
    return found
