"""Delimited text in chunks: what the layout is, and every line that does not fit it, by its number."""

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.diagnosis.readers.base import CHUNK_ROWS, Chunk, Log

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "|": "|", "space": " "}
"""Names in a mapping file -> character; "space" is any white space."""
ENCODINGS = ("utf-8-sig", "latin-1")
"""That are tried where none is given."""
_EMPTY = ("", "nan", "na", "n/a", "null", "none", "-")
_HEAD_LINES = 200
_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """How a file is written; None means detect, and say so. ``header_line`` counts from 1, 0 is none at all.

    ``sheet``: of a spreadsheet, the one to read.
    """

    delimiter: str | None = None
    decimal: str | None = None
    header_line: int | None = None
    comment: str = ""
    encoding: str | None = None
    sheet: str | None = None


@dataclass(frozen=True)
class _Plan:
    delimiter: str
    decimal: str
    comment: str
    encoding: str
    first: int  # line of the first row of numbers, from 1
    cells: int
    places: Mapping[str, int]
    names: Mapping[str, str]


Opened = Callable[[str], TextIO]
"""(encoding) -> the text, from its start."""


def read_text(
    path: Path, layout: Layout, columns: Mapping[str, str | int], log: Log, opened: Opened | None = None
) -> Iterator[Chunk]:
    """Chunks of the columns (by header name, or by position from 1) that each channel is given in.

    Faults go to ``log``: a header or comment in the middle, a row of another width, a cell that is no number, a last
    row that was cut off. Rows of the first kinds are left out, cells become NaN. Raises ConfigurationError where the
    file as a whole cannot be read. ``opened`` gives the text where the file itself is none.
    """
    opened = opened or _opener(path)
    plan = _plan(path, layout, columns, log, opened)
    try:
        with opened(plan.encoding) as file:
            for _ in islice(file, plan.first - 1):
                pass
            number, lines = plan.first, list(islice(file, CHUNK_ROWS))
            while lines:
                following = list(islice(file, CHUNK_ROWS))
                if not following and not lines[-1].endswith(("\n", "\r")):
                    log.say("the last line has no end: its last number may be cut off")
                yield _parse(lines, number, plan, log, last=not following)
                number, lines = number + len(lines), following
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path.name}: not {plan.encoding} text: {error}") from error


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without the blanks around them."""
    line = line.rstrip("\r\n")
    if delimiter == " ":
        return line.split()
    cells = next(csv.reader([line], delimiter=delimiter)) if '"' in line else line.split(delimiter)
    return [cell.strip() for cell in cells]


def _plan(path: Path, layout: Layout, columns: Mapping[str, str | int], log: Log, opened: Opened) -> _Plan:
    head, encoding = head_of(path, layout.encoding, log, opened)
    named = [c for c in columns.values() if isinstance(c, str)]
    body = [(k, line) for k, line in enumerate(head, 1) if not _is_comment(line, layout.comment) and line.strip()]
    if not body:
        raise ConfigurationError(f"{path.name}: the file holds no rows")
    row = next((line for _, line in reversed(body[: len(body) - 1] or body)), "")
    delimiter = layout.delimiter or _delimiter(row, body, named)
    if layout.delimiter is None:
        log.say(f"delimiter {_name(delimiter)} (detected)")
    header, first = _header(path, body, named, delimiter, layout, log)
    rows = [split(line, delimiter) for k, line in body if k >= first]
    if not rows:
        raise ConfigurationError(f"{path.name}: no rows of numbers follow the header")
    decimal = layout.decimal or _decimal(rows, delimiter)
    if decimal == "," and layout.decimal is None:
        log.say("decimal commas (detected)")
    cells = len(header) if header else len(rows[0])
    if header and len(rows[0]) == cells + 1 and rows[0][-1] == "" and delimiter != " ":
        cells += 1  # rows end in a delimiter, the header does not
    if delimiter == "," and len(rows[0]) >= 2 * cells - 1 > 1:
        raise ConfigurationError(
            f"{path.name}, line {first}: {len(rows[0])} cells where the header has {cells}: decimal commas in a file "
            "delimited by commas cannot be told apart; export it again with ';' or with decimal points"
        )
    places = {channel: _place(path, channel, column, header, cells) for channel, column in columns.items()}
    return _Plan(
        delimiter, decimal, layout.comment, encoding, first, cells, places, {n: str(c) for n, c in columns.items()}
    )


def _opener(path: Path) -> Opened:
    return lambda encoding: path.open(encoding=encoding, newline="")


def head_of(path: Path, encoding: str | None, log: Log, opened: Opened | None = None) -> tuple[list[str], str]:
    """(the first lines of a text, its encoding, which is detected where it is None). Raises ConfigurationError."""
    opened = opened or _opener(path)
    for attempt in (encoding,) if encoding else ENCODINGS:
        try:
            with opened(attempt) as file:
                lines = list(islice(file, _HEAD_LINES))
        except OSError as error:
            raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
        except UnicodeDecodeError as error:
            if encoding:
                raise ConfigurationError(f"{path.name}: not {encoding} text: {error}") from error
            continue
        except LookupError as error:
            raise ConfigurationError(f"{path.name}: {error}") from error
        if any("\0" in line for line in lines):
            raise ConfigurationError(f"{path.name} is not a text table: it holds null characters")
        if attempt == "latin-1" and not encoding:
            log.say("encoding latin-1 (detected)")
        return lines, attempt
    raise AssertionError("latin-1 reads anything")


def _is_comment(line: str, comment: str) -> bool:
    return bool(comment) and line.lstrip().startswith(comment)


def _name(delimiter: str) -> str:
    return next(f"'{name}'" for name, character in DELIMITERS.items() if character == delimiter)


def _delimiter(row: str, body: list[tuple[int, str]], named: list[str]) -> str:
    """The one that cuts out the wanted names; without names, the one that occurs most in a row of numbers."""
    for character in (";", "\t", "|", ",", " "):
        if named and any(set(named) <= set(split(line, character)) for _, line in body):
            return character
    for character in (";", "\t", "|"):
        if character in row:
            return character
    return "," if "," in row else " " if " " in row.strip() else ","


def _header(
    path: Path, body: list[tuple[int, str]], named: list[str], delimiter: str, layout: Layout, log: Log
) -> tuple[list[str], int]:
    """(names of the columns, line of the first row); a preamble before and a row of units after are passed over."""
    if layout.header_line == 0 or not named:
        numeric = (k for k, line in body if k > (layout.header_line or 0) and _some_number(split(line, delimiter)))
        first = next(numeric, None)
        if first is None:
            raise ConfigurationError(f"{path.name}: no row of numbers in the first {_HEAD_LINES} lines")
        return [], first
    if layout.header_line is not None:
        at = next((k for k, (line, _) in enumerate(body) if line == layout.header_line), None)
    else:
        at = next((k for k, (_, line) in enumerate(body) if set(named) <= set(split(line, delimiter))), None)
    if at is None:
        best = max((split(line, delimiter) for _, line in body), key=lambda c: len(set(named) & set(c)))
        best = best if set(named) & set(best) else split(body[0][1], delimiter)
        missing = next((n for n in named if n not in best), named[0])
        raise ConfigurationError(f"{path.name}: no column '{missing}'; {nearest(missing, filter(None, best))}")
    line, text = body[at]
    header = split(text, delimiter)
    if line > 1 and layout.header_line is None:
        log.say(f"{line - 1} line{'s' if line > 2 else ''} before the header passed over")
    if at + 1 < len(body) and not _some_number(split(body[at + 1][1], delimiter)):
        log.say(f"line {body[at + 1][0]} passed over as a row of units: {body[at + 1][1].strip()[:60]}")
        at += 1
    return header, body[at + 1][0] if at + 1 < len(body) else line + 1


def _place(path: Path, channel: str, column: str | int, header: list[str], cells: int) -> int:
    if isinstance(column, int):
        if not 1 <= column <= cells:
            raise ConfigurationError(f"{path.name}, channel {channel}: column {column} of {cells} does not exist")
        return column - 1
    if column not in header:
        raise ConfigurationError(f"{path.name}, channel {channel}: no column '{column}'; {nearest(column, header)}")
    if header.count(column) > 1:
        raise ConfigurationError(f"{path.name}, channel {channel}: column '{column}' appears twice")
    return header.index(column)


def _decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    cells = [cell for row in rows[:50] for cell in row]
    commas = delimiter != "," and any(_COMMA_NUMBER.fullmatch(cell) for cell in cells)
    return "," if commas and not any(re.fullmatch(r"[-+]?\d*\.\d+", cell) for cell in cells) else "."


def _some_number(cells: list[str]) -> bool:
    return any(re.fullmatch(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?", cell) for cell in cells)


def _parse(lines: list[str], number: int, plan: _Plan, log: Log, last: bool) -> Chunk:
    """The quick way where every line fits; else line by line."""
    clean = [line.rstrip("\r\n") for line in lines]
    while last and clean and not clean[-1].strip():
        clean.pop()
    uniform = plan.delimiter == " " or {line.count(plan.delimiter) for line in clean} <= {plan.cells - 1}
    if uniform and clean:
        text = [line.replace(",", ".") for line in clean] if plan.decimal == "," else clean
        order = sorted(set(plan.places.values()))
        try:
            table = np.loadtxt(
                text, delimiter=None if plan.delimiter == " " else plan.delimiter, usecols=order, comments=None, ndmin=2
            )
            if len(table) == len(clean) and np.isfinite(table).all():
                columns = {channel: table[:, order.index(place)] for channel, place in plan.places.items()}
                return Chunk(columns, range(number, number + len(clean)))
        except ValueError:
            pass
    return _parse_slowly(clean, number, plan, log, last)


def _parse_slowly(lines: list[str], number: int, plan: _Plan, log: Log, last: bool) -> Chunk:
    kept: dict[str, list[float]] = {channel: [] for channel in plan.places}
    numbers = []
    for k, line in enumerate(lines):
        place = f"line {number + k}"
        if not line.strip():
            continue
        cells = split(line, plan.delimiter)
        if _is_comment(line, plan.comment) or (len(cells) > 1 and not _some_number(cells) and any(cells)):
            log.add("dropped", "a header or remark among the rows of numbers", place=place, structural=True)
            continue
        if len(cells) != plan.cells:
            cut = "; the file ends here, in the middle of a row" if last and k == len(lines) - 1 else ""
            text = f"{len(cells)} cells where there should be {plan.cells}{cut}"
            log.add("dropped", text, place=place, structural=True)
            continue
        numbers.append(number + k)
        for channel, column in plan.places.items():
            kept[channel].append(_cell(cells[column], channel, place, plan, log))
    return Chunk({channel: np.array(values, float) for channel, values in kept.items()}, numbers)


def _cell(text: str, channel: str, place: str, plan: _Plan, log: Log) -> float:
    if text.lower() in _EMPTY:
        return float("nan")
    try:
        value = float(text.replace(",", ".") if plan.decimal == "," else text)
        if np.isfinite(value):
            return value
    except ValueError:
        pass
    hint = " (decimal comma? declare decimal: ',')" if _COMMA_NUMBER.fullmatch(text) else ""
    message = f"'{text}' in column '{plan.names[channel]}' is not a finite number{hint}"
    log.add("missing", message, channel=channel, place=place, structural=True)
    return float("nan")
