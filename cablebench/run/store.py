"""The results store: append-only JSON Lines, one record for each episode. A crash leaves it readable."""

import gzip
import io
import json
import os
import warnings
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable, write_atomic

SCHEMA = 1
"""Version of the record format; a store written by a newer version is refused, not misread."""


class StoreWarning(UserWarning):
    """A line of a results store that could not be read and was skipped."""


def _parse(path: Path, number: int, line: bytes) -> dict[str, Any] | None:
    """The record in a line; None, with a warning, where there is none."""
    try:
        record = json.loads(line)
    except ValueError:  # JSON and UTF-8 errors both are
        record = None
    if not isinstance(record, dict):
        warnings.warn(f"{path}:{number}: not a whole record, skipped", StoreWarning, stacklevel=3)
        return None
    schema = record.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        raise ConfigurationError(
            f"{path}:{number}: schema {schema!r}; this version reads up to {SCHEMA}. Upgrade cable-envs."
        )
    return record


class ResultStore:
    """Records in one ``.jsonl`` file: appended, never rewritten.

    Reading skips a line that cannot be parsed and says so (`StoreWarning`); a torn last line, as a crash leaves it, is
    closed with a newline before the next record is appended, so it never swallows that record.

    A compressed part, ``<path>.gz``, may hold older records: it is read first, and only `pack` writes it.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.packed = self.path.with_name(self.path.name + ".gz")
        """the compressed part, for committing"""
        self.folder = self.path.with_suffix("")
        """where the trajectories of median and worst episodes lie, one file for each run"""

    def append(self, records: Mapping[str, Any] | Iterable[Mapping[str, Any]]) -> None:
        """Add records; they are on disk when this returns.

        Parameters
        ----------
        records : mapping or iterable of mappings
            One record, or several. NaN and infinities become null.
        """
        batch = [records] if isinstance(records, Mapping) else list(records)
        if not batch:
            return
        lines = "".join(
            json.dumps(jsonable({"schema": SCHEMA, **r}), allow_nan=False, separators=(",", ":")) + "\n" for r in batch
        )
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "ab+") as file:
            if file.tell() and not self._ends_line(file):
                lines = "\n" + lines
            file.write(lines.encode())
            file.flush()
            os.fsync(file.fileno())

    @staticmethod
    def _ends_line(file: Any) -> bool:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"

    def records(self) -> list[dict[str, Any]]:
        """All readable records, oldest first.

        Returns
        -------
        list of dict

        Raises
        ------
        ConfigurationError
            When a record has a schema newer than this program knows, and when the compressed part is damaged.

        Warns
        -----
        StoreWarning
            For each line that cannot be read.
        """
        found: list[dict[str, Any]] = []
        for path, content in ((self.packed, self._unpacked()), (self.path, self._plain())):
            for number, line in enumerate(content.split(b"\n"), start=1):
                if line.strip() and (record := _parse(path, number, line)) is not None:
                    found.append(record)
        return found

    def pack(self) -> Path:
        """Move everything into the compressed part, whole or not at all; returns its path.

        Repeated lines are kept once, lines that cannot be read are left out (`StoreWarning`). The same records give the
        same bytes. A crash in between leaves records in both parts, which the next `pack` puts right.
        """
        lines: dict[str, None] = {}
        for record in self.records():
            lines[json.dumps(record, allow_nan=False, separators=(",", ":"))] = None
        content = "".join(line + "\n" for line in lines).encode()
        path = write_atomic(self.packed, gzip.compress(content, 9, mtime=0))
        self.path.unlink(missing_ok=True)
        return path

    def _plain(self) -> bytes:
        return self.path.read_bytes() if self.path.exists() else b""

    def _unpacked(self) -> bytes:
        if not self.packed.exists():
            return b""
        try:
            return gzip.decompress(self.packed.read_bytes())
        except (OSError, EOFError, zlib.error) as error:
            raise ConfigurationError(f"{self.packed} is damaged ({error}): restore it from version control") from None

    def keep_trajectories(self, run: str, episodes: Mapping[str, Mapping[str, np.ndarray]]) -> Path:
        """Save the trajectories of a run; they replace what was there.

        Parameters
        ----------
        run : str
            Key of the run, as in its records.
        episodes : mapping
            "median" and "worst" -> arrays by name.

        Returns
        -------
        Path
            The compressed file.
        """
        buffer = io.BytesIO()
        flat: dict[str, Any] = {
            f"{kind}/{name}": array for kind, arrays in episodes.items() for name, array in arrays.items()
        }
        np.savez_compressed(buffer, **flat)
        return write_atomic(self.folder / f"{run}.npz", buffer.getvalue())

    def forget_trajectories(self, but: Collection[str]) -> int:
        """Remove the trajectories of all runs but those; returns how many runs lost theirs. Records are untouched."""
        lost = [path for path in self.folder.glob("*.npz") if path.stem not in but]
        for path in lost:
            path.unlink()
        return len(lost)

    def thin_trajectories(self, runs: Collection[str], keep: Callable[[str], bool]) -> None:
        """Of the trajectories of ``runs`` keep only the signals whose name ``keep`` says yes to."""
        for run in runs:
            found = self.trajectories(run)
            if any(not keep(name) for arrays in found.values() for name in arrays):
                self.keep_trajectories(
                    run, {kind: {n: a for n, a in arrays.items() if keep(n)} for kind, arrays in found.items()}
                )

    def trajectories(self, run: str) -> dict[str, dict[str, np.ndarray]]:
        """What `keep_trajectories` saved for that run; empty where there is nothing."""
        path = self.folder / f"{run}.npz"
        if not run or not path.exists():
            return {}
        found: dict[str, dict[str, np.ndarray]] = {}
        with np.load(path, allow_pickle=False) as data:
            for key in data.files:
                kind, _, name = key.partition("/")
                found.setdefault(kind, {})[name] = data[key]
        return found
