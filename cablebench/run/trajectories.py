"""The trajectories of median and worst episodes beside a results store: one file a run, or all of them in one."""

import io
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from cable_envs.core.files import PACKED, packed, unpacked, write_atomic

LARGEST = 2**31
"""Bytes that a file of arrays may unpack to: a few kilobytes of zeros must not fill the memory."""

DIGITS = 11
"""Binary digits of the range of what is kept for pictures: a pixel of 1000 is twice as much."""

Episodes = dict[str, dict[str, np.ndarray]]
"""Kind of episode ("median", "worst") -> signal -> values."""


class Trajectories:
    """Trajectories by run.

    Each run's lie in a file ``<folder>/<run>.npz``, which a run that is done again replaces. `pack` moves all of them
    into one compressed file, ``<folder>.npz.xz``, for version control: arrays of many runs together take a third of
    the room, since they share their times and references.

    Parameters
    ----------
    folder : Path
        Beside the records.
    base : Trajectories, optional
        Of another store: read where this one has nothing, and never written.
    """

    def __init__(self, folder: Path, base: "Trajectories | None" = None):
        self.folder = folder
        self.base = base
        self.packed = folder.with_name(folder.name + ".npz" + PACKED)
        """the file that `pack` writes"""
        self._seen: tuple[tuple[int, int], dict[str, Episodes]] | None = None
        """(time and size of that file, what it holds), so that it is read once"""

    def keep(self, run: str, episodes: Mapping[str, Mapping[str, np.ndarray]]) -> Path:
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
        flat = {f"{kind}/{name}": array for kind, arrays in episodes.items() for name, array in arrays.items()}
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **flat)  # type: ignore[arg-type]
        return write_atomic(self.folder / f"{run}.npz", buffer.getvalue())

    def of(self, run: str) -> Episodes:
        """What `keep` saved for that run; empty where there is nothing, or a damaged file."""
        if not run:
            return {}
        path = self.folder / f"{run}.npz"
        if path.exists():
            return _nested(_arrays(_read(path)))
        found = self._packed().get(run, {})
        return found or (self.base.of(run) if self.base else {})

    def forget(self, but: Collection[str]) -> int:
        """Remove the trajectories of all runs but those; returns how many runs lost theirs. Records are untouched."""
        apart = [path for path in self.folder.glob("*.npz") if path.stem not in but]
        for path in apart:
            path.unlink()
        together = self._packed()
        lost = set(together) - set(but)
        if lost:
            self._write({run: episodes for run, episodes in together.items() if run not in lost})
        return len(lost | {path.stem for path in apart})

    def thin(self, runs: Collection[str], keep: Callable[[str], bool], points: int) -> None:
        """Of the trajectories of ``runs`` keep about ``points`` of the signals whose name ``keep`` says yes to.

        They are for pictures, and are rounded to `DIGITS` binary digits of the range of each signal.
        """
        for run in runs:
            found = self.of(run)
            thin = {
                k: {n: _rounded(_thinned(a, points)) for n, a in arrays.items() if keep(n)}
                for k, arrays in found.items()
            }
            if not _alike(thin, found):
                self.keep(run, thin)

    def pack(self) -> Path:
        """Move every run's into the one compressed file, whole or not at all; returns its path.

        The same trajectories give the same bytes. A run of its own file replaces what was packed of it. A crash in
        between leaves files that the next `pack` takes in.
        """
        apart = sorted(self.folder.glob("*.npz"))
        found = {path.stem: _nested(_arrays(_read(path))) for path in apart}
        together = {**self._packed(), **{run: episodes for run, episodes in found.items() if episodes}}
        if apart:
            self._write(together)
            for path in apart:
                path.unlink()
            if not any(self.folder.iterdir()):
                self.folder.rmdir()
        return self.packed

    def _packed(self) -> dict[str, Episodes]:
        """Runs in the one file; none where there is no such file, or a damaged one."""
        try:
            status = self.packed.stat()
            state = (status.st_mtime_ns, status.st_size)
            if self._seen and self._seen[0] == state:
                return self._seen[1]
            content = unpacked(self.packed.read_bytes(), LARGEST)
        except (OSError, ValueError):
            return {}
        runs: dict[str, dict[str, np.ndarray]] = {}
        for key, array in _arrays(content).items():
            run, _, rest = key.partition("/")
            runs.setdefault(run, {})[rest] = array
        self._seen = state, {run: _nested(flat) for run, flat in runs.items()}
        return self._seen[1]

    def _write(self, runs: Mapping[str, Episodes]) -> None:
        flat = {f"{run}/{key}": array for run in sorted(runs) for key, array in _flat(runs[run])}
        buffer = io.BytesIO()
        np.savez(buffer, **flat)  # type: ignore[arg-type]
        write_atomic(self.packed, packed(buffer.getvalue()))


def _flat(episodes: Episodes) -> Iterator[tuple[str, np.ndarray]]:
    for kind, arrays in episodes.items():
        for name, array in arrays.items():
            yield f"{kind}/{name}", array


def _nested(flat: Mapping[str, np.ndarray]) -> Episodes:
    found: Episodes = {}
    for key, array in flat.items():
        kind, _, name = key.partition("/")
        found.setdefault(kind, {})[name] = array
    return found


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _arrays(content: bytes) -> dict[str, np.ndarray]:
    """Arrays of the content of an .npz file; none where it is damaged: a picture less, and no board less."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as data:
            if sum(entry.file_size for entry in data.zip.infolist()) > LARGEST:
                return {}
            return {key: data[key] for key in data.files}
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zlib.error):
        return {}


def _thinned(values: np.ndarray, points: int) -> np.ndarray:
    """Every second, third, ... of them and the last, so that about ``points`` are left."""
    every = max(len(values) // points, 1) if values.ndim else 1
    return values if every == 1 else np.append(values[:-1:every], values[-1])


def _rounded(values: np.ndarray) -> np.ndarray:
    """The numbers [T] to `DIGITS` binary digits of their range, in their own type; what is so rounded stays."""
    seen = values[np.isfinite(values)] if values.dtype.kind == "f" else np.empty(0)
    span = float(np.ptp(seen)) if seen.size else 0.0
    if span == 0.0:
        return values
    step = 2.0 ** (np.ceil(np.log2(span)) - DIGITS)
    if np.all(np.remainder(seen, 0.5 * step) == 0.0):  # the range may have been rounded, too
        return values
    return (np.round(values / step) * step).astype(values.dtype)


def _alike(one: Episodes, other: Episodes) -> bool:
    flat, others = dict(_flat(one)), dict(_flat(other))
    return flat.keys() == others.keys() and all(
        np.array_equal(a, others[key], equal_nan=a.dtype.kind == "f") for key, a in flat.items()
    )
