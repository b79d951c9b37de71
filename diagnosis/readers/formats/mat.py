"""MATLAB files, version 5 to 7.2 by SciPy and 7.3 by h5py; variables by path, as MATLAB writes them.

``q``, ``data.motor.q``, ``X(:,2)`` (counted from 1), and of several runs in a struct array ``run(3).q``.
"""

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.data.tables import MOST_ROWS
from cable_envs.diagnosis.readers.base import CHUNK_ROWS, Chunk, DataSet, Log, RecordSpec, Request, counted, files_at
from cable_envs.diagnosis.readers.formats.table import data_set, of_entry
from cable_envs.diagnosis.readers.mapping import Mapped, load_mapping
from cable_envs.diagnosis.readers.series import brought, with_clocks

SUMMARY = "MATLAB .mat files, with --mapping FILE.yaml"
OPTIONS = ()
COMPRESSED, LARGEST = 15, 2**32
"""Number of a compressed element in a file of version 5; bytes that all of them may unpack to."""
DEEPEST, WIDEST = 6, 100
"""Levels of structs, and columns of a matrix or runs, that are looked through for vectors."""
ELSEWHERE = "ExternalLink"
"""h5py's class for a link into another file."""
_PART = re.compile(r"(\w+)(?:\((\d+)\))?")
_COLUMN = re.compile(r"(.+)\(:,\s*(\d+)\)")


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every ``.mat`` file at ``path``, by the mapping."""
    require_known("option of mat", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "mat", clocks=True)
    for name, column in mapped.columns.items():
        if not isinstance(column, str):
            raise ConfigurationError(f"{mapped.path.name}: channel {name}: 'column' must be a variable, got {column!r}")
    records = []
    for file in files_at(path, ".mat"):
        chunks = partial(_chunks, file, mapped)
        records.append(RecordSpec(file.stem, file.name, chunks, **of_entry(mapped, file.name)))
    return data_set(mapped, records)


def variables(file: Path, wanted: Mapping[str, str], optional: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Vectors [rows] of a file by channel; ``wanted``: channel -> path. Raises ConfigurationError."""
    with _opened(file) as content:
        found = {}
        for channel, path in wanted.items():
            try:
                found[channel] = _vector(content, path, file, channel)[:]
            except KeyError as error:
                if channel not in optional:
                    raise ConfigurationError(f"{file.name}, channel {channel}: {error.args[0]}") from None
    lengths = {channel: len(values) for channel, values in found.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{channel} {n}" for channel, n in lengths.items())
        raise ConfigurationError(f"{file.name}: variables of different lengths: {listed}")
    return found


def vectors_in(file: Path, least: int) -> dict[str, np.ndarray]:
    """All vectors of ``least`` numbers or more in a file, by the path under which a mapping names each."""
    found = {}
    with _opened(file) as content:
        for path in _paths(content):
            try:
                values = np.asarray(_vector(content, path, file, path)[:], float)
            except (KeyError, ConfigurationError):
                continue
            if len(values) >= least:
                found[path] = values
    return found


def _paths(node: Any, before: str = "", depth: int = 0) -> Iterator[str]:
    """Paths of numbers below a node; of a matrix one for each of its columns."""
    for name in _names(node) if depth < DEEPEST else ():
        inner = node[name] if hasattr(node, "keys") else getattr(node, name)
        path, shape = f"{before}{name}", getattr(inner, "shape", None)
        if _names(inner):
            yield from _paths(inner, f"{path}.", depth + 1)
        elif shape is not None and getattr(inner, "dtype", np.dtype(float)).kind == "O":
            for k, one in enumerate(np.atleast_1d(inner).ravel()[:WIDEST], 1):
                yield from _paths(one, f"{path}({k}).", depth + 1)
        elif shape is not None and len(shape) == 2 and 1 not in shape:
            columns = shape[0] if hasattr(inner, "file") else shape[1]
            yield from (f"{path}(:,{k})" for k in range(1, columns + 1) if columns <= WIDEST)
        else:
            yield path


def _chunks(file: Path, mapped: Mapped, log: Log) -> Iterator[Chunk]:
    """HDF5 is read piece by piece; the older format only as a whole."""
    with _opened(file) as content:
        vectors = {}
        for channel, path in with_clocks(mapped.columns, mapped.clocks).items():
            try:
                vectors[channel] = _vector(content, path, file, channel)
            except KeyError as error:
                raise ConfigurationError(f"{file.name}, channel {channel}: {error.args[0]}") from None
        if mapped.clocks:
            vectors = brought({n: np.asarray(v[:], float) for n, v in vectors.items()}, mapped.clocks, log)
        lengths = {channel: len(v) for channel, v in vectors.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{channel} {n}" for channel, n in lengths.items())
            raise ConfigurationError(f"{file.name}: variables of different lengths: {listed}")
        chunks = _pieces(vectors, next(iter(lengths.values())))
        yield from counted(chunks, mapped.sample_rate) if mapped.sample_rate else chunks


def _pieces(vectors: Mapping[str, Any], rows: int) -> Iterator[Chunk]:
    for first in range(0, rows, CHUNK_ROWS):
        yield Chunk({c: np.asarray(v[first : first + CHUNK_ROWS], float) for c, v in vectors.items()})


def _check_size(file: Path) -> None:
    """ConfigurationError where the compressed variables of a file of version 5 unpack to more than `LARGEST` bytes."""
    total = 0
    with file.open("rb") as stream:
        order = {b"IM": "<", b"MI": ">"}.get(stream.read(128)[126:])
        while order and len(tag := stream.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind != COMPRESSED:
                stream.seek(size, 1)
                continue
            unpacker, rest = zlib.decompressobj(), size
            while rest > 0 and total <= LARGEST and (part := stream.read(min(rest, 1 << 16))):
                rest -= len(part)
                while part and total <= LARGEST:
                    try:
                        total += len(unpacker.decompress(part, 1 << 24))
                    except zlib.error:
                        return  # damaged: the library says how
                    part = unpacker.unconsumed_tail
            if total > LARGEST:
                raise ConfigurationError(f"{file.name} unpacks to more than {LARGEST} bytes: it is no log")


class _opened:
    """The content of a file as a context: a dict of arrays, or an HDF5 file."""

    def __init__(self, file: Path) -> None:
        self._file, self._h5 = file, None

    def __enter__(self) -> Any:
        from scipy.io import loadmat

        if not self._file.is_file():
            raise ConfigurationError(f"cannot read {self._file}: no such file")
        _check_size(self._file)
        try:
            return loadmat(self._file, struct_as_record=False, squeeze_me=True, chars_as_strings=True)
        except NotImplementedError:
            return self._hdf5()
        except Exception as error:  # SciPy raises whatever a damaged file leads it to
            raise ConfigurationError(f"{self._file.name} is not whole, or no MATLAB file: {error}") from error

    def _hdf5(self) -> Any:
        try:
            import h5py
        except ModuleNotFoundError as error:
            raise ConfigurationError("MATLAB 7.3 files need h5py: pip install 'cable-envs[mat]'") from error
        try:
            self._h5 = h5py.File(self._file, "r")
        except OSError as error:
            raise ConfigurationError(f"{self._file.name} is not whole, or no MATLAB file: {error}") from error
        return self._h5

    def __exit__(self, *_: object) -> None:
        if self._h5 is not None:
            self._h5.close()


def _vector(content: Any, path: str, file: Path, channel: str) -> Any:
    """What slices as a vector. KeyError, with what there is, for a path that leads nowhere."""
    column = _COLUMN.fullmatch(path)
    node, path, k = (content, column.group(1), int(column.group(2)) - 1) if column else (content, path, None)
    for part in path.split("."):
        named = _PART.fullmatch(part)
        if not named:
            raise KeyError(f"'{path}' is no path of a variable (data.motor.q, X(:,2))")
        names = _names(node)
        if named.group(1) not in names:
            raise KeyError(f"no variable '{part}' in '{path}'; {nearest(part, names)}")
        if (
            getattr(node, "file", None) is not None
            and type(node.get(named.group(1), getlink=True)).__name__ == ELSEWHERE
        ):
            raise ConfigurationError(
                f"{file.name}, channel {channel}: '{path}' lies in another file, which is not read"
            )
        node = node[named.group(1)] if hasattr(node, "keys") else getattr(node, named.group(1))
        if named.group(2):
            node = np.atleast_1d(node)[int(named.group(2)) - 1]
    return _flat(node, k, f"{file.name}, channel {channel}: '{path}'")


def _names(node: Any) -> list[str]:
    if hasattr(node, "keys"):
        return [n for n in node.keys() if not n.startswith(("__", "#"))]  # noqa: SIM118
    return list(getattr(node, "_fieldnames", ()))


class _Column:
    """Column ``k`` of a MATLAB matrix in HDF5, which holds it transposed."""

    def __init__(self, node: Any, k: int) -> None:
        self._node, self._k = node, k

    def __len__(self) -> int:
        return self._node.shape[1]

    def __getitem__(self, rows: slice) -> np.ndarray:
        return self._node[self._k, rows]


def _flat(node: Any, k: int | None, where: str) -> Any:
    shape, in_hdf5 = getattr(node, "shape", None), hasattr(node, "file")
    if shape is None or getattr(node, "dtype", np.dtype(object)).kind not in "fiub":
        raise ConfigurationError(f"{where} holds no numbers")
    if in_hdf5 and (node.external or node.is_virtual):
        raise ConfigurationError(f"{where} lies in another file, which is not read")
    if max(shape, default=0) > MOST_ROWS:
        raise ConfigurationError(f"{where} has more than {MOST_ROWS} rows; cut it, or average to fewer")
    if k is None:
        if len(shape) == 2 and 1 in shape and in_hdf5:
            return node[()].ravel() if shape[1] == 1 else _Column(node, 0)
        if len(shape) != 1:
            raise ConfigurationError(f"{where} is {' x '.join(map(str, shape))}; name one column, as X(:,2)")
        return node
    columns = shape[0] if in_hdf5 else (shape[1] if len(shape) == 2 else 0)
    if len(shape) != 2 or not 0 <= k < columns:
        raise ConfigurationError(f"{where} has no column {k + 1}")
    return _Column(node, k) if in_hdf5 else node[:, k]
