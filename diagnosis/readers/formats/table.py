"""CSV and Parquet logs of any rig, by a mapping file (`mapping`). They stream: memory does not grow with the file."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.readers.base import CHUNK_ROWS, Chunk, DataSet, Log, RecordSpec, Request, counted, files_at
from cable_envs.diagnosis.readers.mapping import Mapped, load_mapping
from cable_envs.diagnosis.readers.text import read_text

SUMMARY = "CSV, TSV, text and Parquet logs, with --mapping FILE.yaml"
OPTIONS = ()
_TEXT, _PARQUET = (".csv", ".tsv", ".txt", ".log", ".dat"), (".parquet", ".pq")


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every table at ``path`` that the mapping's records name, or all where it names none."""
    require_known("option of table", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "table")
    records = []
    for file in files_at(path, *_TEXT, *_PARQUET):
        if mapped.records and path.is_dir() and not mapped.entry(file.name):
            continue
        kind = _parquet_chunks if file.suffix.lower() in _PARQUET else _text_chunks
        records.append(RecordSpec(file.stem, file.name, partial(kind, file, mapped), **of_entry(mapped, file.name)))
    if not records:
        raise ConfigurationError(f"no file in {path} fits what {mapped.path.name} lists under 'records'")
    return data_set(mapped, records)


def of_entry(mapped: Mapped, file: str) -> dict[str, Any]:
    """What a mapping says of a file, as keyword arguments of `RecordSpec`."""
    entry = mapped.entry(file)
    return {
        "conditions": entry.get("conditions") or {}, "offsets": entry.get("offsets") or {}, "use": entry.get("use"),
    }  # fmt: skip


def data_set(mapped: Mapped, records: Sequence[RecordSpec]) -> DataSet:
    """The set that a mapping describes."""
    general = {"description": "", **mapped.general}
    unlisted = [e["file"] for e in mapped.records if not any(mapped.entry(r.file) is e for r in records)]
    remarks = tuple(f"{mapped.path.name} lists '{name}', which is not there" for name in unlisted)
    return DataSet(
        system=mapped.system, channels=mapped.channels, records=tuple(records), group=mapped.group, remarks=remarks,
        **general,
    )  # fmt: skip


def _text_chunks(file: Path, mapped: Mapped, log: Log) -> Iterator[Chunk]:
    chunks = read_text(file, mapped.layout, mapped.columns, log)
    return counted(chunks, mapped.sample_rate) if mapped.sample_rate else chunks


def _parquet_chunks(file: Path, mapped: Mapped, log: Log) -> Iterator[Chunk]:
    chunks = _parquet(file, mapped.columns)
    return counted(chunks, mapped.sample_rate) if mapped.sample_rate else chunks


def _parquet(file: Path, columns: Mapping[str, Any]) -> Iterator[Chunk]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ConfigurationError(f"{file.name}: Parquet needs pyarrow: pip install 'cable-envs[parquet]'") from error
    try:
        with pyarrow.parquet.ParquetFile(file) as table:
            names = table.schema_arrow.names
            chosen = {channel: _name(file, channel, column, names) for channel, column in columns.items()}
            for channel, name in chosen.items():
                kind = table.schema_arrow.field(name).type
                if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind)):
                    raise ConfigurationError(
                        f"{file.name}, channel {channel}: column '{name}' holds {kind}, no numbers"
                    )
            for batch in table.iter_batches(CHUNK_ROWS, columns=sorted(set(chosen.values()))):
                arrays = {n: batch.column(n).cast(pyarrow.float64()).to_numpy(zero_copy_only=False) for n in
                          batch.schema.names}  # fmt: skip
                yield Chunk({channel: _finite(arrays[name]) for channel, name in chosen.items()})
    except (OSError, pyarrow.ArrowException) as error:
        raise ConfigurationError(f"{file.name} is not whole, or no Parquet file: {error}") from error


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)


def _name(file: Path, channel: str, column: Any, names: Sequence[str]) -> str:
    if isinstance(column, int):
        if not 1 <= column <= len(names):
            raise ConfigurationError(f"{file.name}, channel {channel}: column {column} of {len(names)} does not exist")
        return names[column - 1]
    if column not in names:
        raise ConfigurationError(f"{file.name}, channel {channel}: no column '{column}'; {nearest(column, names)}")
    return column
