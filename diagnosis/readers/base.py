"""What a format says of a data set, and how faults in it are told."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import to_si
from cable_envs.diagnosis.data.description import si_unit

CHUNK_ROWS = 65_536
"""Rows that are held at once: some 10 MB of text."""
LISTED = 20
"""Faults of one record that are kept with their place; further ones are counted."""


@dataclass(frozen=True)
class Request:
    """What the user asked for. ``mapping``: path of a mapping file; ``strict``: refuse what cannot be read."""

    mapping: Path | None = None
    strict: bool = True
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ChannelSpec:
    """A channel as it is written: the quantity in ``unit`` is ``scale`` times the raw number plus ``offset``.

    A sign that was turned is in the scale, and ``note`` says so. ``every``: of the time, the period of the one clock
    for all records, in its unit.
    """

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    noise_std: float | None = None
    offset_free: str | None = None
    hold: str | None = None
    note: str = ""
    column: str = ""
    every: float | None = None

    @property
    def header(self) -> str:
        """Name of the column in the written table."""
        return self.column or self.name

    def factor(self, system: str) -> float:
        """SI for one raw unit."""
        return self.scale * to_si(1.0, self.unit, si_unit(system, self.name, self.unit), self.name)


@dataclass(frozen=True)
class Chunk:
    """Rows of raw numbers by channel [rows]; ``lines`` are their lines in the file, from 1, where it has lines."""

    columns: Mapping[str, np.ndarray]
    lines: Sequence[int] | None = None


@dataclass(frozen=True)
class Fault:
    """Something wrong in a record. Structural faults make numbers wrong or unknown; the others are doubts."""

    file: str
    kind: str
    text: str
    channel: str | None = None
    place: str = ""
    structural: bool = False
    start: float | None = None
    end: float | None = None

    def __str__(self) -> str:
        where = ", ".join(part for part in (self.file, self.place, self.channel and f"channel {self.channel}") if part)
        return f"{where}: {self.text}"


@dataclass
class Log:
    """Faults and remarks of one record, in the order in which they are met."""

    file: str
    faults: list[Fault] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, kind: str, text: str, **details: Any) -> None:
        """Note a fault; after `LISTED` of a kind it is only counted."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if self.counts[kind] <= LISTED:
            self.faults.append(Fault(self.file, kind, text, **details))

    def say(self, remark: str) -> None:
        """Note what was detected or assumed, once."""
        if remark not in self.remarks:
            self.remarks.append(remark)

    def stop_if_strict(self, strict: bool) -> None:
        """ConfigurationError that names the first structural faults."""
        found = [fault for fault in self.faults if fault.structural]
        if not strict or not found:
            return
        total = sum(n for kind, n in self.counts.items() if any(f.kind == kind for f in found))
        more = f"; and {total - 3} more" if total > 3 else ""
        raise ConfigurationError(
            "; ".join(map(str, found[:3])) + more + " (--lenient leaves such rows and cells out and says so)"
        )


@dataclass(frozen=True)
class RecordSpec:
    """One record of a set. ``chunks(log)`` yields raw numbers of every channel, time included."""

    name: str
    file: str
    chunks: Callable[[Log], Iterator[Chunk]]
    conditions: Mapping[str, Any] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    use: str | None = None
    doubts: tuple[Fault, ...] = ()


@dataclass(frozen=True)
class DataSet:
    """What a format found: the records, and what the recording's YAML says about all of them.

    ``heldout``: the split where the user asks for none, as for `split.parse`; ``after``: s from which on a record's
    rest is held out. ``group``: the condition that names which records are of one tool or session.
    """

    system: str
    description: str
    channels: tuple[ChannelSpec, ...]
    records: tuple[RecordSpec, ...]
    source: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, Any] = field(default_factory=dict)
    nominal: Mapping[str, Any] = field(default_factory=dict)
    rig: str | None = None
    heldout: tuple[str, ...] = ()
    after: float | None = None
    group: str | None = None
    remarks: tuple[str, ...] = ()


@contextmanager
def foreign(name: str) -> Iterator[None]:
    """What a file of others leads a library to raise, as ConfigurationError of one line that names the file."""
    try:
        yield
    except ConfigurationError:
        raise
    except Exception as error:  # struct.error, KeyError, OverflowError, MemoryError: whatever damage comes to
        said = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise ConfigurationError(f"{name} is damaged, or of another format ({said})") from error


def guarded(chunks: Iterator[Chunk], name: str) -> Iterator[Chunk]:
    """The chunks of a file, read as `foreign` says."""
    while True:
        with foreign(name):
            chunk = next(chunks, None)
        if chunk is None:
            return
        yield chunk


def files_at(path: Path, *suffixes: str, skip: Sequence[str] = ()) -> list[Path]:
    """The file ``path``, or the files in the folder (and one level below) with one of the suffixes, by name.

    Raises ConfigurationError where there is none.
    """
    with foreign(repr(str(path))):  # a zero byte in the name, links that go round
        if path.is_file():
            return [path]
    if not path.is_dir():
        raise ConfigurationError(f"cannot read {path}: no such file or folder")
    found = [p for pattern in ("*", "*/*") for p in path.glob(pattern) if p.suffix.lower() in suffixes and p.is_file()]
    found = sorted(p for p in found if p.name not in skip)
    if not found:
        raise ConfigurationError(f"{path} holds no file that ends in {', '.join(suffixes)}")
    return found


def whole(columns: Mapping[str, np.ndarray]) -> Callable[[Log], Iterator[Chunk]]:
    """``chunks`` of arrays that are in memory already."""

    def chunks(log: Log) -> Iterator[Chunk]:
        rows = len(next(iter(columns.values())))
        for first in range(0, rows, CHUNK_ROWS):
            yield Chunk({n: np.asarray(v[first : first + CHUNK_ROWS], float) for n, v in columns.items()})

    return chunks


def counted(chunks: Iterator[Chunk], rate: float) -> Iterator[Chunk]:
    """Chunks with times counted at ``rate``, Hz, by line of the file: a row that was left out stays a gap."""
    first, rows = None, 0
    for chunk in chunks:
        size = len(next(iter(chunk.columns.values())))
        numbers = np.arange(rows, rows + size) if chunk.lines is None else np.asarray(chunk.lines)
        first = numbers[0] if first is None and size else first
        yield Chunk({**chunk.columns, "time": (numbers - (first or 0)) / rate}, chunk.lines)
        rows += size


def measured_frequency(time: np.ndarray, motion: np.ndarray) -> float:
    """Hz of a motion to and fro, by its crossings of the middle; NaN where it makes less than one cycle."""
    good = np.isfinite(time) & np.isfinite(motion)
    time, motion = time[good], motion[good]
    if len(motion) < 3:
        return float("nan")
    middle, quarter = (motion.max() + motion.min()) / 2, (motion.max() - motion.min()) / 4
    outside = np.abs(motion - middle) > quarter
    turns = np.flatnonzero(np.diff(np.sign(motion[outside] - middle)) != 0)
    at = time[outside][turns]
    return float((len(at) - 1) / 2 / (at[-1] - at[0])) if len(at) > 2 else float("nan")
