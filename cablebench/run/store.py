"""The results store: append-only JSON Lines, one record for each episode. A crash leaves it readable."""

import json
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import PACKED, CannotWrite, flush_folder, jsonable, packed, unpacked, write_atomic
from cablebench.run.columns import from_columns, to_columns
from cablebench.run.schema import SCHEMA, wrong_with
from cablebench.run.trajectories import Trajectories

LARGEST = 2**31
"""Bytes that a compressed part may unpack to: a few kilobytes of zeros must not fill the memory."""

PATIENCE = 600.0
"""s that a writer waits for the others; packing a million records takes minutes."""

SHOWN = 5
"""Lines that are named one by one where some are left out."""


class StoreWarning(UserWarning):
    """Lines of a results store that were left out."""


@dataclass(frozen=True)
class Reading:
    """What a store holds: the records that can be used, and what was left out, as "file:line: why"."""

    records: list[dict[str, Any]]
    left_out: tuple[str, ...] = ()

    @property
    def remark(self) -> str:
        """What was left out, in one sentence; empty where nothing was."""
        if not self.left_out:
            return ""
        count, more = len(self.left_out), len(self.left_out) - SHOWN
        lines = "1 line of the store was" if count == 1 else f"{count} lines of the store were"
        rest = f"; and {more} more" if more > 0 else ""
        return f"{lines} left out: {'; '.join(self.left_out[:SHOWN])}{rest}"


def _parse(line: bytes) -> tuple[Any, str]:
    """(the record in a line, what is wrong with it)."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):  # JSON and UTF-8 errors both are ValueError
        return None, "not a whole record"
    return record, wrong_with(record)


class ResultStore:
    """Records in one ``.jsonl`` file: appended, never rewritten.

    Every line is checked by `cablebench.run.schema` before it is used: a line that is no record, or a malformed one, is
    left out and said (`StoreWarning`), so that one bad line costs nobody else's rows. A torn last line, as a crash
    leaves it, is closed with a newline before the next record is appended, so it never swallows that record.

    A compressed part, ``<path>.xz``, may hold older records, as lines or as columns (`cablebench.run.columns`): it is
    read first, and only `pack` writes it.

    Any number of processes may write at once: whoever appends or packs holds the lock ``<path>.lock``, which the
    system takes from a process that dies. Reading needs no lock.

    Records of another store, ``base``, are read before its own, and never written.
    """

    def __init__(self, path: str | Path, base: "ResultStore | None" = None):
        self.path = Path(path)
        self.base = base
        self.packed = self.path.with_name(self.path.name + PACKED)
        """the compressed part, for committing"""
        self.trajectories: Trajectories = Trajectories(self.path.with_suffix(""), base.trajectories if base else None)
        """those of median and worst episodes, by run"""

    @property
    def places(self) -> tuple[Path, ...]:
        """Folders in which files that the records name may lie: its own, and the base's."""
        return (self.path.parent, *(self.base.places if self.base else ()))

    def append(self, records: Mapping[str, Any] | Iterable[Mapping[str, Any]]) -> None:
        """Add records; they are on disk when this returns.

        Parameters
        ----------
        records : mapping or iterable of mappings
            One record, or several. NaN and infinities become null.

        Raises
        ------
        ConfigurationError
            For a record that a reader would leave out, and where the file cannot be written, as on a full disk; then
            none is added.
        """
        batch = [jsonable({"schema": SCHEMA, **r}) for r in ([records] if isinstance(records, Mapping) else records)]
        if not batch:
            return
        for record in batch:
            if wrong := wrong_with(record):
                raise ConfigurationError(f"{self.path}: a record that is to be added: {wrong}")
        lines = "".join(json.dumps(r, allow_nan=False, separators=(",", ":")) + "\n" for r in batch)
        with self.locked():
            try:
                self._add(lines.encode())
            except OSError as error:
                raise CannotWrite.of(self.path, error) from None

    def _add(self, lines: bytes) -> None:
        """Lines at the end of the file; where that fails, the file is as it was."""
        with open(self.path, "ab+", buffering=0) as file:
            before = file.tell()
            if before and not self._ends_line(file):
                lines = b"\n" + lines
            try:
                while lines:
                    lines = lines[file.write(lines) :]
                os.fsync(file.fileno())
            except OSError:
                os.ftruncate(file.fileno(), before)
                raise
        if not before:
            flush_folder(self.path.parent)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Nobody else writes meanwhile; the folder is made where it is missing.

        Raises ConfigurationError where another process keeps the store for longer than `PATIENCE`, and where the folder
        cannot be written to.
        """
        lock = FileLock(self.path.with_name(self.path.name + ".lock"), timeout=PATIENCE, poll_interval=0.01)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except Timeout:
            raise ConfigurationError(
                f"{self.path} has been held by another process for {PATIENCE:g} s: end it, or wait for it"
            ) from None
        except OSError as error:
            raise CannotWrite.of(self.path, error) from None
        try:
            yield
        finally:
            lock.release()

    @staticmethod
    def _ends_line(file: Any) -> bool:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"

    def records(self) -> list[dict[str, Any]]:
        """All records that can be used, oldest first.

        Returns
        -------
        list of dict

        Raises
        ------
        ConfigurationError
            When the compressed part is damaged.

        Warns
        -----
        StoreWarning
            Names the lines that were left out, and why.
        """
        reading = self.read()
        if reading.left_out:
            warnings.warn(reading.remark, StoreWarning, stacklevel=2)
        return reading.records

    def read(self, strict: bool = False) -> Reading:
        """The records, and what was left out.

        Parameters
        ----------
        strict : bool
            Whether a line that would be left out is an error.

        Returns
        -------
        Reading
            Records oldest first.

        Raises
        ------
        ConfigurationError
            When the compressed part is damaged; with ``strict``, for lines that are no records or malformed ones.
        """
        records, left_out = [], []
        for place, _, record, wrong in (*(self.base._lines() if self.base else ()), *self._lines()):
            if wrong:
                left_out.append(f"{place}: {wrong}")
            else:
                records.append(record)
        reading = Reading(records, tuple(left_out))
        if strict and left_out:
            raise ConfigurationError(reading.remark.replace("left out", "refused", 1))
        return reading

    def _lines(self) -> Iterator[tuple[str, bytes, Any, str]]:
        """(file and number, content, record, what is wrong with it) of every line, the compressed part's first."""
        plain = self._plain()  # read first: what `pack` moves in between is then seen twice, not never
        for path, content in ((self.packed, self._unpacked()), (self.path, plain)):
            for number, line in enumerate(content.split(b"\n"), start=1):
                if line.strip():
                    yield f"{path}:{number}", line, *_parse(line)

    def pack(self) -> Path:
        """Move everything into the compressed part, whole or not at all; returns its path.

        Repeated lines are kept once; a malformed record is kept as it is, for people to look at, and only what is no
        JSON object (a torn line) is dropped. The same records give the same bytes. A crash in between leaves records in
        both parts, which the next `pack` puts right.
        """
        with self.locked():
            path = write_atomic(self.packed, packed(to_columns(self._whole())))
            self.path.unlink(missing_ok=True)
        return path

    def _whole(self) -> bytes:
        """Every record once, and the malformed ones as they are."""
        lines: dict[bytes, None] = {}
        for _, line, record, wrong in self._lines():
            if not wrong:
                lines[json.dumps(record, allow_nan=False, separators=(",", ":")).encode()] = None
            elif isinstance(record, dict):
                lines[line.strip()] = None
        return b"".join(line + b"\n" for line in lines)

    def _plain(self) -> bytes:
        return self.path.read_bytes() if self.path.exists() else b""

    def _unpacked(self) -> bytes:
        if not self.packed.exists():
            return b""
        try:
            return from_columns(unpacked(self.packed.read_bytes(), LARGEST))
        except ValueError as error:
            raise ConfigurationError(f"{self.packed} is {error}: restore it from version control") from None
