"""CSV and Parquet logs, and spreadsheets, of any rig, by a mapping file (`mapping`).

Text and Parquet stream: memory does not grow with the file. Of a spreadsheet the sheet is read that the layout names,
or the one with the most numbers.
"""

import datetime
import fnmatch
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.readers.base import (
    CHUNK_ROWS,
    Chunk,
    DataSet,
    Log,
    RecordSpec,
    Request,
    counted,
    files_at,
    foreign,
    whole,
)
from cable_envs.diagnosis.readers.mapping import Mapped, load_mapping
from cable_envs.diagnosis.readers.series import brought, with_clocks
from cable_envs.diagnosis.readers.text import Layout, Opened, read_text

SUMMARY = "CSV, TSV, text and Parquet logs and spreadsheets, with --mapping FILE.yaml"
OPTIONS = ()
TEXT, PARQUET = (".csv", ".tsv", ".txt", ".log", ".dat"), (".parquet", ".pq")
SHEETS = (".xlsx", ".xlsm", ".xls", ".ods")
LARGEST = 2**28
"""Bytes of a spreadsheet that is read: it is held in memory whole."""


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every table at ``path`` that the mapping's records name, or all where it names none."""
    require_known("option of table", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "table", clocks=True)
    records = []
    for file in tables_at(path, tuple(entry["file"] for entry in mapped.records)):
        if mapped.records and path.is_dir() and not mapped.entry(file.name):
            continue
        kind = _parquet_chunks if file.suffix.lower() in PARQUET else _text_chunks
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
    layout = replace(mapped.layout, delimiter="\t", decimal=".") if is_sheet(file) else mapped.layout
    columns = with_clocks(mapped.columns, mapped.clocks)
    return _clocked(read_text(file, layout, columns, log, opener(file, mapped.layout)), mapped, log)


def _clocked(chunks: Iterator[Chunk], mapped: Mapped, log: Log) -> Iterator[Chunk]:
    """With times that are counted; and, from the whole file, channels that have times of their own."""
    if mapped.sample_rate:
        return counted(chunks, mapped.sample_rate)
    if not mapped.clocks:
        return chunks
    parts = list(chunks)
    table = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    return whole(brought(table, mapped.clocks, log))(log)


def tables_at(path: Path, listed: Sequence[str] = ()) -> list[Path]:
    """The tables at a path; spreadsheets beside text or Parquet only where they are listed, as a name or pattern."""
    found = files_at(path, *TEXT, *PARQUET, *SHEETS)
    chosen = [f for f in found if not is_sheet(f) or any(fnmatch.fnmatchcase(f.name, name) for name in listed)]
    return chosen or found


def is_sheet(file: Path) -> bool:
    """Whether a file is a spreadsheet, by the end of its name."""
    return file.suffix.lower() in SHEETS


def opener(file: Path, layout: Layout) -> Opened | None:
    """What `read_text` opens instead of a spreadsheet: its rows with tabs between cells; None where it is text."""
    if not is_sheet(file):
        return None
    lines = "".join("\t".join(map(_cell, row)) + "\n" for row in _rows(file, layout.sheet))
    return lambda encoding: io.StringIO(lines)


def _rows(file: Path, wanted: str | None) -> Sequence[Sequence[Any]]:
    """Rows of the sheet that is wanted, or of the one with the most numbers."""
    try:
        from python_calamine import CalamineWorkbook
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"{file.name}: spreadsheets need python-calamine: pip install 'cable-envs[sheets]', or save it as CSV"
        ) from error
    if file.stat().st_size > LARGEST:
        raise ConfigurationError(f"{file.name} has more than {LARGEST} bytes: save it as CSV")
    with foreign(file.name):
        book = CalamineWorkbook.from_path(str(file))
        if wanted is not None and wanted not in book.sheet_names:
            raise ConfigurationError(f"{file.name}: no sheet '{wanted}'; {nearest(wanted, book.sheet_names)}")
        names = [wanted] if wanted is not None else book.sheet_names
        sheets = [book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names]
    if not sheets:
        raise ConfigurationError(f"{file.name} holds no sheet")
    return max(sheets, key=lambda rows: sum(isinstance(cell, (int, float)) for row in rows for cell in row))


def _cell(value: Any) -> str:
    """A cell as text: times as seconds, what would break a row left out."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime.datetime):
        return value.isoformat(" ")
    if isinstance(value, datetime.time):
        return repr(value.hour * 3600.0 + value.minute * 60.0 + value.second + value.microsecond * 1e-6)
    return " ".join(str(value).split()).replace('"', "'")


def parquet_columns(file: Path) -> dict[str, np.ndarray]:
    """Numbers [rows] of the columns of a Parquet file that hold such."""
    parts: dict[str, list[np.ndarray]] = {}
    for chunk in _parquet(file, None):
        for name, values in chunk.columns.items():
            parts.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in parts.items()}


def _parquet_chunks(file: Path, mapped: Mapped, log: Log) -> Iterator[Chunk]:
    return _clocked(_parquet(file, with_clocks(mapped.columns, mapped.clocks)), mapped, log)


def _parquet(file: Path, columns: Mapping[str, Any] | None) -> Iterator[Chunk]:
    """Chunks of the columns by channel; None: of all that hold numbers, by their names."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ConfigurationError(f"{file.name}: Parquet needs pyarrow: pip install 'cable-envs[parquet]'") from error
    try:
        with pyarrow.parquet.ParquetFile(file) as table:
            names = table.schema_arrow.names
            if columns is None:
                kinds = {n: table.schema_arrow.field(n).type for n in names}
                columns = {
                    n: n for n, k in kinds.items() if pyarrow.types.is_integer(k) or pyarrow.types.is_floating(k)
                }
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
