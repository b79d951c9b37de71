"""Columns of a file as they stand: text of any dialect, spreadsheets, Parquet, MATLAB."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.readers.base import Log
from cable_envs.diagnosis.readers.formats import mat, table
from cable_envs.diagnosis.readers.guess.words import unit_of
from cable_envs.diagnosis.readers.text import DELIMITERS, ENCODINGS, Layout, head_of, read_text, split

MOST = 200_000
"""Rows that are looked at."""
FEWEST = 20
"""Rows that a column has at least."""
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
_STAMP = re.compile(r"(?:.*[ T])?(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+))?Z?")
_COMMENTS = ("#", "%", "//")
_RATE = re.compile(r"(?<![\w.,])(\d+(?:[.,]\d+)?)\s*(k?)Hz\b", re.IGNORECASE)


@dataclass(frozen=True)
class Column:
    """A column: what a mapping calls it, its header, the unit beside that, its numbers [rows], stamps as s [rows]."""

    place: str | int
    name: str
    unit: str
    values: np.ndarray
    stamps: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Raw:
    """The columns of a file, what a mapping's ``layout`` says of it, and the rate that stands above them, Hz, or 0."""

    file: Path
    columns: tuple[Column, ...]
    layout: Mapping[str, Any] = field(default_factory=dict)
    said: tuple[str, ...] = ()
    rate: float = 0.0


def columns_in(file: Path, form: str) -> Raw:
    """Columns of a file of a format ("table", "mat"). Raises ConfigurationError where it has none."""
    if form == "mat":
        vectors = mat.vectors_in(file, FEWEST)
        lengths = [len(v) for v in vectors.values()]
        if not lengths:
            raise ConfigurationError(f"{file.name} holds no vector of {FEWEST} numbers or more")
        longest = mode(lengths)
        columns = tuple(Column(path, path, "", v[:MOST]) for path, v in vectors.items() if len(v) == longest)
        others = [path for path, v in vectors.items() if len(v) != longest]
        said = (f"of another length, and left out: {', '.join(others)}",) if others else ()
        return Raw(file, columns, {}, said)
    if file.suffix.lower() in table.PARQUET:
        return Raw(file, tuple(Column(n, n, "", v[:MOST]) for n, v in table.parquet_columns(file).items()))
    opened = table.opener(file, Layout())
    return _of_text(file, opened)


def _of_text(file: Path, opened: Any) -> Raw:
    lines, encoding = head_of(file, None, Log(file.name), opened)
    body = [(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    if len(body) < 2:
        raise ConfigurationError(f"{file.name}: the file holds no rows")
    delimiter = _delimiter([line for _, line in body])
    cells = [split(line, delimiter) for _, line in body]
    wide = mode(len(row) for row in cells[len(cells) // 3 :])
    first = _first(cells, wide)
    if first is None:
        raise ConfigurationError(f"{file.name}: no rows of numbers in the first {len(lines)} lines")
    names, units, at, comment = _header(body, cells, first, wide, delimiter)
    sample = cells[first : first + 50]
    decimal = "," if delimiter != "," and _commas(sample) else "."
    trailing = all(len(row) == wide and row[-1] == "" for row in sample)
    named = at is not None and not comment
    line = at if named and at is not None else body[first][0] - 1
    layout = Layout(delimiter, decimal, line, comment, encoding)
    places: dict[str, str | int] = {str(k): k + 1 for k in range(wide - trailing)}
    log, parts, rows = Log(file.name), [], 0
    for chunk in read_text(file, layout, places, log, opened):
        parts.append(chunk.columns)
        rows += len(chunk.columns["0"])
        if rows >= MOST:
            break
    columns = []
    for k in range(wide - trailing):
        name = names[k] if k < len(names) else ""
        values = np.concatenate([part[str(k)] for part in parts])
        usable = named and name and names.count(name) == 1
        stamps = np.array([_seconds(row[k]) for row in cells[first:] if len(row) > k])
        columns.append(Column(name if usable else k + 1, name, units[k] if k < len(units) else "", values, stamps))
    said: dict[str, Any] = {"delimiter": _called(delimiter), "decimal": decimal, "header_line": line}
    if encoding != ENCODINGS[0]:
        said["encoding"] = encoding
    if comment:
        said["comment"] = comment
    if table.is_sheet(file):
        said = {"header_line": line}
    return Raw(file, tuple(columns), said, rate=_rate([text for _, text in body[:first]]))


def _rate(above: Sequence[str]) -> float:
    """The one rate that the lines above a table give, Hz; 0 where they give none or several."""
    said = {
        float(number.replace(",", ".")) * (1e3 if kilo else 1.0)
        for line in above for number, kilo in _RATE.findall(line)
    }  # fmt: skip
    return said.pop() if len(said) == 1 else 0.0


def _called(delimiter: str) -> str:
    return next(name for name, character in DELIMITERS.items() if character == delimiter)


def _like_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell) or _STAMP.fullmatch(cell)) or cell.lower() in ("", "nan")


def _delimiter(lines: Sequence[str]) -> str:
    """The one that cuts most rows into equally many cells that are numbers."""
    best, score = ",", (-1.0, 0)
    for character in (";", "\t", "|", ",", " "):
        rows = [split(line, character) for line in lines[len(lines) // 3 :]]
        wide = mode(len(row) for row in rows)
        right = [sum(map(_like_number, row)) / wide if len(row) == wide else 0.0 for row in rows]
        found = (round(float(np.mean(right)), 2), wide)
        if wide > 1 and found > score:
            best, score = character, found
    return best


def _first(cells: Sequence[Sequence[str]], wide: int) -> int | None:
    """Number of the first of three rows (or of all that follow) that are mostly numbers."""
    good = [len(row) == wide and 2 * sum(map(_like_number, row)) > wide and any(row) for row in cells]
    return next((k for k in range(len(cells)) if good[k] and all(good[k : k + 3])), None)


def _header(
    body: Sequence[tuple[int, str]], cells: Sequence[list[str]], first: int, wide: int, delimiter: str
) -> tuple[list[str], list[str], int | None, str]:
    """(names, units, line of the names, comment mark) of what stands above the first row of numbers."""

    def row(k: int) -> tuple[list[str], str]:
        text = body[k][1].strip()
        mark = next((m for m in _COMMENTS if text.startswith(m)), "")
        found = split(text.removeprefix(mark).strip(), delimiter) if mark else cells[k]
        return (found if wide - 1 <= len(found) <= wide and any(found) else []), mark

    if first == 0:
        return [], [], None, ""
    names, mark = row(first - 1)
    units: list[str] = []
    if names and first > 1:
        above, its = row(first - 2)
        filled = [cell for cell in names if cell]
        if above and sum(unit_of(cell) is not None for cell in filled) > 0.5 * len(filled):
            names, units, mark, first = above, names, its, first - 1
    return names, units, body[first - 1][0] if names else None, mark if names else ""


def _commas(rows: Sequence[Sequence[str]]) -> bool:
    cells = [cell for row in rows for cell in row if _NUMBER.fullmatch(cell)]
    return any("," in cell for cell in cells) and not any("." in cell for cell in cells)


def _seconds(cell: str) -> float:
    """s of a time of day; NaN of anything else."""
    found = _STAMP.fullmatch(cell)
    if not found:
        return float("nan")
    h, m, s, part = found.groups()
    return 3600.0 * int(h) + 60.0 * int(m) + int(s) + (float(f"0.{part}") if part else 0.0)
