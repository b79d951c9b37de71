"""Files that are whole at any time, values as JSON has them, and Python files of somebody's: the one place for each."""

import json
import lzma
import math
import os
import re
import tempfile
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError

try:
    import fcntl
except ModuleNotFoundError:  # not on Windows: there nothing is locked, and what a killed process leaves stays
    fcntl = None  # type: ignore[assignment]

Gate = Callable[[Path, bytes], None]
"""Asked with path and content before a Python file is executed; raises ConfigurationError where it shall not be."""

_gates: list[Gate] = []


@contextmanager
def guarded(gate: Gate) -> Iterator[None]:
    """Within the block every Python file is executed only after ``gate`` was asked; the command line does so.

    Without a gate no question is asked: a file that a program of the user's own names is trusted as that program is.

    Parameters
    ----------
    gate : Gate
    """
    _gates.append(gate)
    try:
        yield
    finally:
        _gates.remove(gate)


def permit(path: Path, content: bytes) -> None:
    """Ask the gate, where there is one, whether a Python file with that content may be executed.

    Parameters
    ----------
    path : Path
        What the question calls it.
    content : bytes
        What would be executed: what is on disk may be another by then.

    Raises
    ------
    ConfigurationError
        Where it may not.
    """
    for gate in _gates:
        gate(path, content)


def read_python(path: str | Path) -> bytes:
    """The content of a Python file of somebody's; ConfigurationError where it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from None


def run_python(path: str | Path, name: str, content: bytes | None = None) -> types.ModuleType:
    """Execute a Python file of somebody's, after the gate was asked: the one way in which this project does so here.

    Controllers are executed in a process of their own (`cablebench.entrants.apart`), after the same question.

    Parameters
    ----------
    path : str or Path
        The file.
    name : str
        Of the module.
    content : bytes, optional
        What `read_python` gave, where the caller has to know just what is run.

    Returns
    -------
    ModuleType
        A module of its own, which no import finds.

    Raises
    ------
    ConfigurationError
        Where the file cannot be read, may not be executed, or fails.
    """
    path = Path(path)
    content = read_python(path) if content is None else content
    permit(path, content)
    module = types.ModuleType(name)
    module.__file__ = str(path)
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)
    except Exception as error:
        raise ConfigurationError(f"{path} does not load: {type(error).__name__}: {error}") from error
    return module


_PART = re.compile(r"\..+\.[a-z0-9_]{8}\.cable\.tmp")
"""Names of the files that `write_atomic` writes to before they take their name."""


class CannotWrite(ConfigurationError, OSError):
    """A file or folder that cannot be written: one line that names it and the reason."""

    @classmethod
    def of(cls, path: str | Path, error: OSError) -> "CannotWrite":
        """The error for a path, with the system's reason; one that is of this kind already stays as it is."""
        return error if isinstance(error, cls) else cls(f"cannot write {path}: {error.strerror or error}")


def write_atomic(path: str | Path, content: str | bytes) -> Path:
    """Write a file so that its name holds either the old or the whole new content, whatever happens in between.

    The content goes to a temporary file in the same folder (its name begins with a dot), is flushed to disk, and takes
    the name by `os.replace`. Folders that are missing are made. Temporary files that a killed process has left in the
    folder are removed.

    Parameters
    ----------
    path : str or Path
        File to write or to replace.
    content : str or bytes
        Text is encoded as UTF-8, line ends as they are.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    CannotWrite
        Where the folder cannot be written to, or the disk is full; the temporary file is removed. It is a
        ConfigurationError and an OSError.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_atomic(folder / "runs" / "first.txt", "done").read_text()
    'done'
    """
    path = Path(path)
    made = [folder for folder in path.parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(path.parent)
        _replace(path, content.encode() if isinstance(content, str) else content)
    except OSError as error:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise CannotWrite.of(path, error) from None
    return path


def _replace(path: Path, content: bytes) -> None:
    handle, temporary = _part(path)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(temporary, 0o666 & ~mask)  # mkstemp makes it private; results are ordinary files
            os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    flush_folder(path.parent)


def _part(path: Path) -> tuple[int, str]:
    """An open temporary file beside ``path`` and its name, locked so that nobody takes it for abandoned."""
    while True:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:200]}.", suffix=".cable.tmp")
        if fcntl is None:
            return handle, name
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:  # another process was quicker, and removes it
            os.close(handle)
            continue
        except OSError:  # a file system without locks: there nobody removes anything
            return handle, name
        if os.fstat(handle).st_nlink:
            return handle, name
        os.close(handle)


def flush_folder(folder: Path) -> None:
    """Put the names in a folder on disk, so that a power cut does not take back a rename. Where it cannot, it is not.

    Parameters
    ----------
    folder : Path
        One that is there.
    """
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def held(path: Path) -> Iterator[bool]:
    """Whether a file or folder, locked meanwhile, is held by no other process. The system frees what a dead one held.

    Parameters
    ----------
    path : Path
        One that is there.

    Yields
    ------
    bool
        False also where it has gone, and where its file system has no locks.
    """
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        yield False
        return
    try:
        yield _locked(handle)
    finally:
        os.close(handle)


def _locked(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (OSError, AttributeError):
        return False
    return True


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary files that killed processes have left in a folder.

    Parameters
    ----------
    folder : Path
        Where `write_atomic` has written.
    """
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(entry.path) for entry in entries if _PART.fullmatch(entry.name)]:
            with suppress(OSError), held(path) as free:
                if free:
                    path.unlink()


def require_writable(folder: str | Path) -> None:
    """Check that files can be written to a folder, before the work whose results go there. Nothing stays of the check.

    Parameters
    ----------
    folder : str or Path
        One that is there or is to be made.

    Raises
    ------
    CannotWrite
        Where it is no folder, may not be written to, or its disk is full.

    Examples
    --------
    >>> import tempfile
    >>> require_writable(Path(tempfile.mkdtemp()) / "results")
    """
    folder = Path(folder)
    folder = folder if folder.parts else folder.absolute()
    try:
        near = next(p for p in (folder, *folder.absolute().parents) if p.exists())
        if not near.is_dir():
            raise CannotWrite(f"cannot write to {folder}: {near} is a file")
        with tempfile.TemporaryFile(dir=near) as file:
            file.write(bytes(4096))
            file.flush()
            os.fsync(file.fileno())
    except CannotWrite:
        raise
    except OSError as error:
        raise CannotWrite(f"cannot write to {folder}: {error.strerror or error}") from None


def jsonable(value: Any) -> Any:
    """A value with JSON types only.

    Parameters
    ----------
    value : Any
        Mappings, sequences, arrays, dataclasses, numbers, paths, nested as deep as wanted.

    Returns
    -------
    Any
        The same with dict, list, str, int, float, bool and None: arrays and tuples become lists, dataclasses mappings
        of their fields, NaN and infinities null, paths text. What is none of these stays what it is.

    Examples
    --------
    >>> jsonable({"gain": np.float64(2.0), "rms": (0.5, math.nan), "file": Path("a/b")})
    {'gain': 2.0, 'rms': [0.5, None], 'file': 'a/b'}
    """
    if is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


LARGEST_JSON = 2**30
"""Bytes that a compressed JSON file may unpack to."""

PACKED = ".xz"
"""How the names of compressed files end."""

# text has no alignment that the position bits could use; columns of numbers are shorter without literal context
_PACKINGS = [
    [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": 2**25, "pb": 0, "lc": context}]
    for context in (3, 0)
]
_LARGEST_WINDOW = 2**27  # bytes of memory that reading may take for what it looks back at


def read_json(path: str | Path) -> Any:
    """The content of a JSON file.

    Parameters
    ----------
    path : str or Path
        A ``.json`` file, or ``.json.xz``: by its name, what ends in ``.xz`` is compressed.

    Returns
    -------
    Any
        What ``json.loads`` makes of it.

    Raises
    ------
    OSError
        Where the file cannot be read.
    ValueError
        Where it is damaged, no text, or no JSON.
    """
    content = Path(path).read_bytes()
    return json.loads(unpacked(content, LARGEST_JSON) if Path(path).suffix == PACKED else content)


def packed(content: bytes) -> bytes:
    """Content of a ``.xz`` file: the same content gives the same bytes, as no time is in them."""
    return min((lzma.compress(content, filters=one) for one in _PACKINGS), key=len)


def unpacked(content: bytes, largest: int) -> bytes:
    """What `packed` was given.

    Parameters
    ----------
    content : bytes
        Of a ``.xz`` file.
    largest : int
        Bytes that it may unpack to: a few kilobytes of zeros must not fill the memory.

    Returns
    -------
    bytes
        The content before it was packed.

    Raises
    ------
    ValueError
        Where it is damaged, cut off, or larger.
    """
    decoder = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_LARGEST_WINDOW)
    try:
        whole = decoder.decompress(content, largest + 1)
    except (lzma.LZMAError, EOFError) as problem:
        raise ValueError(f"damaged: {problem}") from None
    if len(whole) > largest:
        raise ValueError(f"damaged: it unpacks to more than {largest} bytes")
    if not decoder.eof:
        raise ValueError("damaged: its end is missing")
    return whole


def json_text(value: Any) -> str:
    """A value as the text of a JSON file, for people to read.

    Parameters
    ----------
    value : Any
        As of `jsonable`: NaN and infinities become null.

    Returns
    -------
    str
        Indented by one, with a line's end.

    Examples
    --------
    >>> print(json_text({"rms": math.nan}), end="")
    {
     "rms": null
    }
    """
    return json.dumps(jsonable(value), indent=1, allow_nan=False) + "\n"


def packed_json(value: Any) -> bytes:
    """A value as compressed JSON: the same value gives the same bytes.

    Parameters
    ----------
    value : Any
        Of JSON types only (`jsonable` makes them).

    Returns
    -------
    bytes
        Content of a ``.json.xz`` file, without the time it was made.

    Raises
    ------
    ValueError
        For NaN and infinities.

    Examples
    --------
    >>> packed_json({"rms": 0.5}) == packed_json({"rms": 0.5})
    True
    """
    return packed((json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n").encode())
