"""Compiled kernels on disk, found again by what they really call.

numba's own cache looks at the file that a function is defined in, not at the files that it calls into, and never finds
a function again that was made by `exec` or from another function's code. Here a kernel is filed under a digest of its
closure: its code, the code of every piece that it calls, at any depth, and every number, name and type that they read.
So an edited effect recompiles the kernels that call it and no others, and kernels made at run time (for a plant, for a
user's own effect) are compiled once.

Symbols are named by content too: a piece loaded from disk can never be taken for one of the same name that this
process compiles.
"""

import dis
import hashlib
import logging
import os
import pickle
import shutil
import sys
import time
import types
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.core.types import Type
from numba.core.typing import signature
from numba.misc.appdirs import AppDirs

FOLDER = "kernels"
UNUSED_VERSION, UNUSED_KERNEL = 86_400.0, 30 * 86_400.0
"""Seconds after which an unused folder is deleted: of an older version of the kernel that is stored, of any kernel."""

SAID_AGAIN = 60.0
"""Seconds after which compiling is said again: what one task needs, one line announces."""

LOG = logging.getLogger("cable_envs")
"""Where a program listens to what takes long: level INFO says that something is compiled."""

_PACKAGE = Path(__file__).parents[1]
_said = [-SAID_AGAIN]


class NotStorable(TypeError):
    """Something that a kernel reads has no content that another process could recognise."""


class Digests:
    """Digests of functions with all that they call.

    Parameters
    ----------
    seed : bytes
        What every digest begins with.

    Attributes
    ----------
    functions : dict
        Digest of every function that was met.
    """

    def __init__(self, seed: bytes = b""):
        self.seed = seed
        self.functions: dict[types.FunctionType, str] = {}
        self._open: set[types.FunctionType] = set()

    def of(self, function: Any) -> str:
        """The digest of a plain function and its closure, 64 hexadecimal digits.

        Raises
        ------
        NotStorable
            Where the function reads something that cannot be told apart by its content.
        """
        if function in self.functions:
            return self.functions[function]
        if function in self._open:
            return f"recursion into {function.__name__}"
        self._open.add(function)
        digest = hashlib.sha256(self.seed)
        for part in self._parts(function):
            digest.update(part.encode())
            digest.update(b"\0")
        self._open.discard(function)
        self.functions[function] = digest.hexdigest()
        return self.functions[function]

    def _parts(self, function: types.FunctionType) -> Iterator[str]:
        code = function.__code__
        yield from self._code(code, function.__doc__)
        yield self._value(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            yield f"{name}={self._value(value)}"
        for cell in function.__closure__ or ():
            yield self._value(cell.cell_contents)
        for name, attributes in names_read(code).items():
            if name not in function.__globals__:
                continue
            value = function.__globals__[name]
            if isinstance(value, types.ModuleType) and is_ours(value):
                for asked in attributes:
                    yield f"{name}.{asked}={self._value(getattr(value, asked, None))}"
            else:
                yield f"{name}={self._value(value)}"

    def _code(self, code: types.CodeType, doc: str | None = None) -> Iterator[str]:
        yield code.co_code.hex()
        yield repr((code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_flags))
        yield repr((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount))
        for k, value in enumerate(code.co_consts):
            if k == 0 and doc is not None and isinstance(value, str):
                continue  # the docstring
            yield "".join(self._code(value)) if isinstance(value, types.CodeType) else self._value(value)

    def _value(self, value: Any) -> str:
        """What stands for a value that compiled code may read."""
        if isinstance(value, type) and hasattr(value, "_fields"):
            return f"namedtuple {value.__name__} {value._fields!r}"
        for kinds, said in _SAID:
            if isinstance(value, kinds):
                return f"{type(value).__name__} {said(self, value)}"
        raise NotStorable(f"{type(value).__name__} {value!r:.80}")


def _function(digests: Digests, function: types.FunctionType) -> str:
    """A plain function among the globals: ours by content, a library's by name."""
    return digests.of(function) if is_ours(function) else f"{function.__module__}.{function.__name__}"


def _array(digests: Digests, array: np.ndarray) -> str:
    return f"{array.dtype} {array.shape} {hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()}"


_SAID: tuple[tuple[Any, Callable[[Digests, Any], str]], ...] = (
    ((type(None), bool, int, float, complex, str, bytes, np.generic), lambda digests, value: repr(value)),
    ((tuple, list), lambda digests, value: ", ".join(digests._value(v) for v in value)),
    (frozenset, lambda digests, value: ", ".join(sorted(digests._value(v) for v in value))),
    (np.ndarray, _array),
    (Dispatcher, lambda digests, value: f"{sorted(value.targetoptions.items())!r} {digests.of(value.py_func)}"),
    (_Intrinsic, lambda digests, value: digests.of(value._defn)),
    (types.ModuleType, lambda digests, value: value.__name__),
    ((Type, np.dtype), lambda digests, value: str(value)),
    (types.FunctionType, _function),
    ((types.BuiltinFunctionType, type, np.ufunc), lambda digests, value: f"{_module_of(value)} {value.__name__}"),
)
"""How a value of each kind is written for a digest."""


def _module_of(value: Any) -> str:
    return str(getattr(value, "__module__", ""))


@cache
def names_read(code: types.CodeType) -> dict[str, list[str]]:
    """Global names that code reads, that of functions within it too, each with the attributes asked of it."""
    found: dict[str, list[str]] = {}
    last = None
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            last = found.setdefault(step.argval, [])
        else:
            if last is not None and step.opname in ("LOAD_ATTR", "LOAD_METHOD"):
                last.append(step.argval)
            last = None
    for value in code.co_consts:
        if isinstance(value, types.CodeType):
            for name, asked in names_read(value).items():
                found.setdefault(name, []).extend(asked)
    return found


def is_ours(thing: Any) -> bool:
    """Whether a function or module is no part of Python or of an installed library."""
    name = (thing.__name__ if isinstance(thing, types.ModuleType) else thing.__module__) or ""
    package = name.split(".")[0]
    return package not in sys.stdlib_module_names and package not in ("numpy", "numba", "llvmlite", "scipy")


def _folders() -> Iterator[Path]:
    """Where compiled kernels may lie; the first that can be written to is taken."""
    asked = getattr(config, "CACHE_DIR", "")  # numba sets its options when it is imported
    if asked:
        yield Path(asked) / FOLDER
    else:
        yield _PACKAGE / "__pycache__" / FOLDER
        yield Path(AppDirs(appname="cable_envs", appauthor=False).user_cache_dir) / FOLDER


def _made(folder: Path) -> bool:
    """Make a folder that can be written to, and mark it as used; False where that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _tidy(root: Path, name: str) -> None:
    """Delete what has not been used for long: older versions of the kernel ``name``, kernels that are gone."""
    now = time.time()
    for old in root.iterdir():
        try:
            age = now - old.stat().st_mtime
        except OSError:
            continue  # another process has just deleted it
        if age > (UNUSED_VERSION if old.name.rpartition("-")[0] == name else UNUSED_KERNEL):
            shutil.rmtree(old, ignore_errors=True)


def _announce(kernel: str, folder: Path | None) -> None:
    """Say once for all that a task needs that compiling begins, and that it will not be so the next time."""
    now = time.monotonic()
    level = logging.DEBUG if now - _said[0] < SAID_AGAIN else logging.INFO
    kept = "once in each process, since no folder can be written to" if folder is None else "only once on this machine"
    where = "" if folder is None else f"; kept in {folder.parent}"
    if level == logging.INFO:
        _said[0] = now
    LOG.log(
        level, "compiling the equations of motion, beginning with '%s': %s, up to half a minute for a plant%s",
        kernel, kept, where,
    )  # fmt: skip


class KernelCache(_Cache):
    """The compiled versions of one kernel, one for each signature, each in a file of its own.

    Nothing is looked at before the kernel's first call: what it calls may be defined later than itself. A file is named
    after signature and processor and comes into being by a rename, so that processes need not wait for each other.
    """

    def __init__(self, dispatcher: Dispatcher):
        self._function = dispatcher.py_func
        self._enabled = True
        self._folder: Path | None = None
        self._ready = False

    @property
    def cache_path(self) -> str | None:
        """The folder of this kernel, or None where nothing is stored."""
        self._prepare()
        return None if self._folder is None else str(self._folder)

    def enable(self) -> None:
        """Look on disk, and store there."""
        self._enabled = True

    def disable(self) -> None:
        """Leave the disk alone."""
        self._enabled = False

    def flush(self) -> None:
        """Forget what is stored of this kernel."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            _made(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled version for a signature, or None."""
        self._prepare()
        if self._folder is None or not self._enabled:
            _announce(self._function.__name__, None)
            return None
        target_context.refresh()
        try:
            reduced = pickle.loads(self._file(sig, target_context.codegen()).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError):
            _announce(self._function.__name__, self._folder)
            return None
        found = CompileResult._rebuild(target_context, *reduced)
        # a named tuple's class comes back from the file as another one: the next call would not find what was loaded
        args, _ = normalize_signature(sig)
        return found._replace(signature=signature(found.signature.return_type, *args))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled version for a signature."""
        if self._folder is None or not self._enabled:
            return
        if data.library.has_dynamic_globals or any(not lifted.can_cache for lifted in data.lifted):
            return
        file = self._file(sig, data.codegen)
        part = file.with_suffix(f".{uuid.uuid4().hex[:12]}")
        try:
            part.write_bytes(dumps(data._reduce()))
            part.replace(file)
        except OSError:  # a full disk, or the folder has just gone: compiled all the same
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def _file(self, sig: Any, codegen: Any) -> Path:
        key = hashlib.sha256(repr((sig, codegen.magic_tuple())).encode()).hexdigest()
        assert self._folder is not None
        return self._folder / f"{key[:24]}.bin"

    def _prepare(self) -> None:
        """Name everything by its content, and find the kernel's folder."""
        if self._ready:
            return
        self._ready = True
        digests = Digests(repr((numba.__version__, sys.version_info[:2], llvm.get_host_cpu_name())).encode())
        try:
            digest = digests.of(self._function)
        except NotStorable:
            return
        for function, own in digests.functions.items():
            function.__qualname__ = f"{function.__name__}_{own[:16]}"
            function.__module__ = __name__  # numba imports it when it loads: that of a piece made at run time is gone
        name = self._function.__name__
        found = [root / f"{name}-{digest[:24]}" for root in _folders()]
        # where nothing may be written, as in the sandbox of a stranger's file, what is there is read all the same
        self._folder = next((folder for folder in found if folder.is_dir()), None)
        for root in _folders():
            new = not (root / f"{name}-{digest[:24]}").is_dir()
            if _made(root / f"{name}-{digest[:24]}"):
                self._folder = root / f"{name}-{digest[:24]}"
                if new:
                    _tidy(root, name)
                return


def kept(dispatcher: Dispatcher) -> Dispatcher:
    """The same compiled function, with its versions kept on disk."""
    setattr(dispatcher, "_cache", KernelCache(dispatcher))  # noqa: B010 - where numba keeps the one of cache=True
    return dispatcher
