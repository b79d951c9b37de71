"""ROS bags without ROS: ``.bag`` of ROS 1, folders (or single ``.db3``, ``.mcap``) of ROS 2, by rosbags.

Each channel names topic and field (``position[0]``, ``wrench.force.z``). The messages' own stamps are the times, or,
where a message has none, when the bag received it; the topic of ``time`` gives the rows
(`cable_envs.diagnosis.readers.series`).
Messages are read one after another; what stays in memory are the numbers asked for.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import Chunk, DataSet, Log, RecordSpec, Request, whole
from cable_envs.diagnosis.readers.formats.table import data_set, of_entry
from cable_envs.diagnosis.readers.mapping import load_mapping
from cable_envs.diagnosis.readers.series import Messages, Series, messages_on_one_clock

SUMMARY = "ROS 1 and ROS 2 bags, with --mapping FILE.yaml (topic and field for each channel)"
OPTIONS = ()


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
    yield from whole(messages_on_one_clock(_read(bag, columns, log), columns, log))(log)


def _read(bag: Path, columns: Mapping[str, tuple[str, str]], log: Log) -> Series:
    """Times [s] and fields by topic. Raises ConfigurationError."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise ConfigurationError("ROS bags need rosbags: pip install 'cable-envs[ros]'") from error
    found = Messages(columns, bag.name, log)
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found.require(reader.topics)
            chosen = [c for c in reader.connections if c.topic in found.wanted]
            for connection, received, raw in reader.messages(connections=chosen):
                found.add(connection.topic, reader.deserialize(raw, connection.msgtype), received)
    except ConfigurationError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise ConfigurationError(f"{bag.name} is not whole, or no bag: {error}") from error
    except Exception as error:  # SQLite, MCAP and decompression errors have no common base
        if not type(error).__module__.startswith(("rosbags", "apsw", "lz4", "backports", "struct")):
            raise
        raise ConfigurationError(f"{bag.name} is not whole, or no bag: {type(error).__name__}: {error}") from error
    return found.series()
