"""MCAP files of robots' loggers, by mcap: messages in JSON, Protobuf, or ROS 2 with their definitions in the file.

Each channel names topic and field (``position[0]``, ``wrench.force.z``). Times are the messages' own stamps
(``header.stamp`` or ``timestamp``), or, where a message has none, when the file received it; the topic of ``time``
gives the rows (`cable_envs.diagnosis.readers.series`). A time with a field takes its values from there: a clock of the
log's own. Messages are read one after another; what stays in memory are the numbers asked for.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import Chunk, DataSet, Log, RecordSpec, Request, files_at, whole
from cable_envs.diagnosis.readers.formats.table import data_set, of_entry
from cable_envs.diagnosis.readers.mapping import load_mapping
from cable_envs.diagnosis.readers.series import Messages, Series, messages_on_one_clock

SUMMARY = "MCAP files (JSON, Protobuf, ROS 2), with --mapping FILE.yaml (topic and field for each channel)"
OPTIONS = ()
INSTALL = "pip install 'cable-envs[mcap]'"
_DECODERS = {"mcap_protobuf.decoder": "mcap-protobuf-support", "mcap_ros2.decoder": "mcap-ros2-support"}


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every ``.mcap`` file at ``path``, by the mapping."""
    require_known("option of mcap", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "mcap", topics=True)
    if mapped.sample_rate:
        raise ConfigurationError(f"{mapped.path.name}: channel time: MCAP needs {{topic}}, its messages carry times")
    records = []
    for file in files_at(path, ".mcap"):
        chunks = partial(_chunks, file, mapped.columns)
        records.append(RecordSpec(file.stem, file.name, chunks, **of_entry(mapped, file.name)))
    return data_set(mapped, records)


def _chunks(file: Path, columns: Mapping[str, tuple[str, str]], log: Log) -> Iterator[Chunk]:
    yield from whole(messages_on_one_clock(_read(file, columns, log), columns, log))(log)


class _Json:
    """What mcap asks of a decoder, for messages in JSON."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        """How to read messages of an encoding; None for others."""
        return json.loads if message_encoding == "json" else None


def _decoders() -> tuple[list[Any], list[str]]:
    """(those that are there, packages that would bring more)."""
    found: list[Any] = [_Json()]
    missing = []
    for module, package in _DECODERS.items():
        try:
            found.append(import_module(module).DecoderFactory())
        except ModuleNotFoundError:
            missing.append(package)
    return found, missing


def _read(file: Path, columns: Mapping[str, tuple[str, str]], log: Log) -> Series:
    """Times [s] and fields by topic. Raises ConfigurationError."""
    try:
        from mcap.reader import make_reader
    except ModuleNotFoundError as error:
        raise ConfigurationError(f"MCAP files need mcap: {INSTALL}") from error
    decoders, missing = _decoders()
    found = Messages(columns, file.name, log)
    try:
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=decoders)
            summary = reader.get_summary()
            if summary is None:
                raise ValueError("it has no summary, as one that was cut off")
            found.require({channel.topic for channel in summary.channels.values()})
            for channel in summary.channels.values():
                if channel.topic in found.wanted:
                    _require_decoder(file, channel, summary.schemas.get(channel.schema_id), decoders, missing)
            for _, channel, message, content in reader.iter_decoded_messages(topics=list(found.wanted)):
                found.add(channel.topic, content, message.log_time)
    except ConfigurationError:
        raise
    except Exception as error:  # errors of MCAP, of decompression and of three decoders have no common base
        raise ConfigurationError(
            f"{file.name} is not whole, or no MCAP file: {error or type(error).__name__}"
        ) from error
    return found.series()


def _require_decoder(file: Path, channel: Any, schema: Any, decoders: Sequence[Any], missing: Sequence[str]) -> None:
    """ConfigurationError that names the encoding which nothing here reads."""
    if any(decoder.decoder_for(channel.message_encoding, schema) for decoder in decoders):
        return
    kind = f"'{channel.message_encoding}'" + (f" with '{schema.encoding}' definitions" if schema else "")
    more = f" ({' and '.join(missing)} may: {INSTALL})" if missing else "; JSON, Protobuf and ROS 2 are read"
    raise ConfigurationError(f"{file.name}: topic {channel.topic} is in {kind}, which nothing here decodes{more}")
