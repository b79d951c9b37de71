"""ROS bags without ROS: ``.bag`` of ROS 1, folders (or single ``.db3``, ``.mcap``) of ROS 2, by rosbags.

Each channel names topic and field (``position[0]``, ``wrench.force.z``). The messages' own stamps are the times, or,
where a message has none, when the bag received it; the topic of ``time`` gives the rows, and other topics are
interpolated onto them, never over a hole of more than five of their intervals. Messages are read one after another;
what stays in memory are the numbers asked for.
"""

import re
from array import array
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from diagnosis.readers.base import Chunk, DataSet, Log, RecordSpec, Request, whole
from diagnosis.readers.formats.table import data_set, of_entry
from diagnosis.readers.mapping import load_mapping

SUMMARY = "ROS 1 and ROS 2 bags, with --mapping FILE.yaml (topic and field for each channel)"
OPTIONS = ()
HOLE_INTERVALS = 5.0
_STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")


def open_dataset(path: Path, asked: Request) -> DataSet:
    """The bag at ``path``, or every bag in that folder."""
    require_known("option of rosbag", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "rosbag", topics=True)
    if mapped.sample_rate:
        raise ConfigurationError(f"{mapped.path.name}: channel time: a bag needs {{topic}}, its messages carry times")
    records = []
    for bag in _bags(path):
        chunks = partial(_chunks, bag, mapped.columns)
        records.append(RecordSpec(bag.stem, bag.name, chunks, **of_entry(mapped, bag.name)))
    return data_set(mapped, records)


def _bags(path: Path) -> list[Path]:
    if path.is_file() and path.suffix in (".db3", ".mcap") and (path.parent / "metadata.yaml").is_file():
        return [path.parent]
    if path.is_file() or (path / "metadata.yaml").is_file():
        return [path]
    if not path.is_dir():
        raise ConfigurationError(f"cannot read {path}: no such file or folder")
    found = sorted([*path.glob("*.bag"), *(p.parent for p in path.glob("*/metadata.yaml"))])
    if not found:
        raise ConfigurationError(f"{path} holds no bag: a .bag file, or a folder with metadata.yaml")
    return found


def _chunks(bag: Path, columns: Mapping[str, tuple[str, str]], log: Log) -> Iterator[Chunk]:
    series = _read(bag, columns, log)
    base = columns["time"][0]
    times = series[base][0]
    origin = times[0]
    log.say(f"time counts from the first message of {base}")
    table = {"time": times - origin}
    for name, (topic, field) in columns.items():
        if name != "time":
            at, values = series[topic][0], series[topic][1][field]
            table[name] = values if topic == base else _onto(times, at, values)
            if topic != base:
                log.say(f"channel {name}: {topic} interpolated onto the times of {base}")
    yield from whole(table)(log)


def _onto(times: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """``values`` at ``times``; NaN outside, and in holes."""
    order = np.argsort(at, kind="stable")
    at, values = at[order], values[order]
    found = np.interp(times, at, values, left=np.nan, right=np.nan)
    if len(at) > 2:
        k = np.clip(np.searchsorted(at, times), 1, len(at) - 1)
        found[at[k] - at[k - 1] > HOLE_INTERVALS * np.median(np.diff(at))] = np.nan
    return found


def _read(
    bag: Path, columns: Mapping[str, tuple[str, str]], log: Log
) -> dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times [s] and fields by topic. Raises ConfigurationError."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise ConfigurationError("ROS bags need rosbags: pip install 'cable-envs[ros]'") from error
    wanted = _wanted(columns)
    series: dict[str, tuple[array, dict[str, array]]] = {}
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            missing = next((t for t in wanted if t not in reader.topics), None)
            if missing:
                raise ConfigurationError(f"{bag.name}: no topic '{missing}'; {nearest(missing, reader.topics)}")
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, received, raw in reader.messages(connections=chosen):
                message = reader.deserialize(raw, connection.msgtype)
                topic = connection.topic
                series.setdefault(topic, (array("d"), {field: array("d") for field in wanted[topic]}))
                series[topic][0].append(_stamp(message, received, topic, log))
                for field, name in wanted[topic].items():
                    series[topic][1][field].append(_field(message, field, f"{bag.name}, channel {name}: {topic}"))
    except ConfigurationError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise ConfigurationError(f"{bag.name} is not whole, or no bag: {error}") from error
    except Exception as error:  # SQLite, MCAP and decompression errors have no common base
        if not type(error).__module__.startswith(("rosbags", "apsw", "lz4", "backports", "struct")):
            raise
        raise ConfigurationError(f"{bag.name} is not whole, or no bag: {type(error).__name__}: {error}") from error
    empty = next((t for t in wanted if t not in series), None)
    if empty:
        raise ConfigurationError(f"{bag.name}: topic {empty} holds no message")
    return {t: (np.array(at), {f: np.array(v) for f, v in fields.items()}) for t, (at, fields) in series.items()}


def _wanted(columns: Mapping[str, tuple[str, str]]) -> dict[str, dict[str, str]]:
    """Topic -> field -> the channel that it is."""
    wanted: dict[str, dict[str, str]] = {}
    for name, (topic, field) in columns.items():
        wanted.setdefault(topic, {}).update({field: name} if field else {})
    return wanted


def _stamp(message: Any, received: int, topic: str, log: Log) -> float:
    """s since 2000, which leaves a double a resolution of 0.2 us; a zero stamp was never set."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds, nanoseconds = getattr(stamp, "sec", 0), getattr(stamp, "nanosec", 0)
    if seconds == 0 and nanoseconds == 0:
        log.say(f"{topic}: no stamps; times are those of reception, which jitter")
        return (received // 10**9 - _EPOCH) + received % 10**9 * 1e-9
    return (seconds - _EPOCH) + nanoseconds * 1e-9


_EPOCH = 946_684_800


def _field(message: Any, path: str, where: str) -> float:
    node = message
    for part in path.split("."):
        step = _STEP.fullmatch(part)
        if not step or not hasattr(node, step.group(1)):
            names = [n for n in getattr(node, "__dataclass_fields__", ()) if not n.startswith("__")]
            raise ConfigurationError(f"{where}: no field '{part}'; {nearest(part, names)}")
        node = getattr(node, step.group(1))
        if step.group(2) is not None:
            if int(step.group(2)) >= len(node):
                raise ConfigurationError(f"{where}: '{part}': there are {len(node)} values, counted from 0")
            node = node[int(step.group(2))]
    try:
        return float(node)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{where}: '{path}' is {type(node).__name__}, no number") from None
