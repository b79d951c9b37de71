"""Named columns of numbers from CSV and Parquet files, with errors that name the cell."""

import csv
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np

from cable_envs.core.config import require_file
from cable_envs.core.errors import ConfigurationError, nearest

_DELIMITERS = (",", ";", "\t")
CHUNK, MOST_ROWS = 50_000, 20_000_000
"""Rows of text held at a time; rows whose numbers are (160 MB for each channel)."""
LONGEST_LINE = 1_000_000
"""Characters of a header: a file without line ends is no table."""
_EMPTY = ("", "nan", "na", "n/a", "null")


def read_columns(path: Path, columns: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Columns of a file as float64 [rows], by the name of the channel that ``columns`` maps to each. Empty cells: NaN.

    Raises ConfigurationError that names the file, and the channel, column and data row (1 is the first) at fault.
    """
    if path.suffix.lower() in (".parquet", ".pq", ".csv", ".tsv", ".txt"):
        require_file(path)
    if path.suffix.lower() in (".parquet", ".pq"):
        return _read_parquet(path, columns)
    if path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        raise ConfigurationError(f"{path.name}: expected a CSV (.csv, .tsv, .txt) or Parquet (.parquet) file")
    return _read_csv(path, columns)


def _find(columns: Mapping[str, str], header: list[str], path: Path) -> dict[str, int]:
    """Position of every channel's column; ConfigurationError for one that is absent or there twice."""
    places = {}
    for channel, column in columns.items():
        if column not in header:
            raise ConfigurationError(f"{path.name}, channel {channel}: no column '{column}'; {nearest(column, header)}")
        if header.count(column) > 1:
            raise ConfigurationError(f"{path.name}, channel {channel}: column '{column}' appears twice")
        places[channel] = header.index(column)
    return places


def _read_csv(path: Path, columns: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Streamed: of a long file only the wanted numbers are held, and `CHUNK` rows of text."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline(LONGEST_LINE)
            if len(first) == LONGEST_LINE:
                raise ConfigurationError(f"{path.name}: its first line is longer than {LONGEST_LINE} characters")
            file.seek(0)
            rows = (row for row in csv.reader(file, delimiter=max(_DELIMITERS, key=first.count)) if row)
            header = [cell.strip() for cell in next(rows, ())]
            if not header:
                raise ConfigurationError(
                    f"{path.name}: the file is empty; expected a header row with {', '.join(columns.values())}"
                )
            places = _find(columns, header, path)
            found: dict[str, list[np.ndarray]] = {channel: [] for channel in places}
            done = 0
            while chunk := list(islice(rows, CHUNK)):
                for k, row in enumerate(chunk, done + 1):
                    if len(row) != len(header):
                        raise ConfigurationError(
                            f"{path.name}, row {k}: {len(row)} cells where the header has {len(header)}"
                        )
                for channel, place in places.items():
                    where = f"{path.name}, channel {channel} (column '{header[place]}')"
                    found[channel].append(_numbers([row[place] for row in chunk], where, done))
                done += len(chunk)
                if done > MOST_ROWS:
                    raise ConfigurationError(f"{path.name}: more than {MOST_ROWS} rows; cut it, or average to fewer")
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"{path.name} is not a text table: {error}") from error
    return {channel: np.concatenate(parts) if parts else np.empty(0) for channel, parts in found.items()}


def _numbers(cells: list[str], where: str, before: int) -> np.ndarray:
    """``before``: data rows above the first cell."""
    try:
        values = np.array(cells, dtype=float) if cells else np.empty(0)
    except ValueError:
        values = np.array([_number(cell, f"{where}, row {k}") for k, cell in enumerate(cells, before + 1)])
    infinite = np.isinf(values)
    if infinite.any():
        raise ConfigurationError(f"{where}, row {before + 1 + int(np.argmax(infinite))}: not a finite number")
    return values


def _number(cell: str, where: str) -> float:
    text = cell.strip()
    if text.lower() in _EMPTY:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        hint = " (decimal comma?)" if text.replace(",", "", 1).replace("-", "", 1).isdigit() and "," in text else ""
        raise ConfigurationError(f"{where}: '{text}' is not a number{hint}") from None


def _read_parquet(path: Path, columns: Mapping[str, str]) -> dict[str, np.ndarray]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ConfigurationError(f"{path.name}: Parquet needs pyarrow: pip install 'cable-envs[parquet]'") from error
    try:
        rows = pyarrow.parquet.read_metadata(path).num_rows
        if rows > MOST_ROWS:
            raise ConfigurationError(f"{path.name}: {rows} rows, more than {MOST_ROWS}; cut it, or average to fewer")
        table = pyarrow.parquet.read_table(path)
    except (OSError, pyarrow.ArrowException) as error:
        raise ConfigurationError(f"{path.name} is not a Parquet file: {error}") from error
    places = _find(columns, table.column_names, path)
    found = {}
    for channel, place in places.items():
        where, column = f"{path.name}, channel {channel} (column '{columns[channel]}')", table.column(place)
        if not (pyarrow.types.is_integer(column.type) or pyarrow.types.is_floating(column.type)):
            raise ConfigurationError(f"{where}: expected numbers, found {column.type}")
        values = column.cast(pyarrow.float64()).to_numpy()
        found[channel] = np.array(values, dtype=float)
        if np.isinf(found[channel]).any():
            raise ConfigurationError(
                f"{where}, row {1 + int(np.argmax(np.isinf(found[channel])))}: not a finite number"
            )
    return found
