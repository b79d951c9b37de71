"""Compiled kernels on disk, found again by what they really call.

numba's own cache looks at the file that a function is defined in, not at the files that it calls into, and never finds
a function again that was made by `exec` or from another function's code. Here a kernel is filed under a digest of its
closure: its code, the code of every piece that it calls, at any depth, and every number, name and type that they read.
So an edited effect recompiles the kernels that call it and no others, and kernels made at run time (for a plant, for a
user's own effect) are compiled once.

Symbols are named by content too: a piece loaded from disk can never be taken for one of the same name that this
process compiles.
"""

import gc
import hashlib
import logging
import os
import pickle
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property, wraps
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.core.typing import signature
from numba.misc.appdirs import AppDirs

from cable_envs.core.compiling import ahead
from cable_envs.core.compiling.digests import Digests, NotStorable

FOLDER = "kernels"
UNUSED_VERSION, UNUSED_KERNEL = 86_400.0, 30 * 86_400.0
"""Seconds after which an unused folder is deleted: of an older version of the kernel that is stored, of any kernel."""

SAID_AGAIN = 60.0
"""Seconds after which compiling is said again: what one task needs, one line announces."""

LOG = logging.getLogger("cable_envs")
"""Where a program listens to what takes long: level INFO says that something is compiled."""

_PACKAGE = Path(__file__).parents[2]
_said = [-SAID_AGAIN]


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
    What is not there yet is made from what the installation brought (`cable_envs.core.compiling.ahead`), if it did.
    """

    def __init__(self, dispatcher: Dispatcher):
        self._function = dispatcher.py_func
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        """The folder of this kernel, or None where nothing is stored."""
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
        target_context.refresh()
        reduced = self._reduced(sig, target_context.codegen()) if self._enabled else None
        if reduced is None:
            _announce(self._function.__name__, self._folder if self._enabled else None)
            return None
        found = CompileResult._rebuild(target_context, *reduced)
        # a named tuple's class comes back from the file as another one: the next call would not find what was loaded
        args, _ = normalize_signature(sig)
        return found._replace(signature=signature(found.signature.return_type, *args))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled version for a signature."""
        if self._enabled and is_storable(data):
            self._store(self._file(sig, data.codegen), data._reduce())

    def _reduced(self, sig: Any, codegen: Any) -> tuple | None:
        """What a compiled version is rebuilt from: as an earlier process left it, else from what was brought."""
        if self.name is None:
            return None
        file = self._file(sig, codegen)
        if file is not None:
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                return pickle.loads(file.read_bytes())
        brought = ahead.machine_code(ahead.file_of(self.name, sig, codegen), codegen)
        if brought is not None:
            LOG.debug("machine code of '%s' made from what the installation brought", self._function.__name__)
            self._store(file, brought)
        return brought

    def _store(self, file: Path | None, reduced: tuple) -> None:
        if file is None:
            return
        part = file.with_suffix(f".{uuid.uuid4().hex[:12]}")
        try:
            part.write_bytes(dumps(reduced))
            part.replace(file)
        except OSError:  # a full disk, or the folder has just gone: compiled all the same
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def _file(self, sig: Any, codegen: Any) -> Path | None:
        key = hashlib.sha256(repr((sig, codegen.magic_tuple())).encode()).hexdigest()
        return None if self._folder is None else self._folder / f"{key[:24]}.bin"

    @cached_property
    def name(self) -> str | None:
        """What the kernel is filed under, or None where nobody could recognise it; every piece gets a name too."""
        versions = numba.__version__, llvmlite.__version__, sys.version_info[:2]
        digests = Digests(repr(versions).encode())
        try:
            digest = digests.of(self._function)
        except NotStorable:
            return None
        for function, own in digests.functions.items():
            function.__qualname__ = f"{function.__name__}_{own[:16]}"
            function.__module__ = __name__  # numba imports it when it loads: that of a piece made at run time is gone
        return f"{self._function.__name__}-{digest[:24]}"

    @cached_property
    def _folder(self) -> Path | None:
        """Where this kernel is kept."""
        if self.name is None:
            return None
        found = [root / self.name for root in _folders()]
        for folder in found:
            new = not folder.is_dir()
            if _made(folder):
                if new:
                    _tidy(folder.parent, self._function.__name__)
                return folder
        # where nothing may be written, as in the sandbox of a stranger's file, what is there is read all the same
        return next((folder for folder in found if folder.is_dir()), None)


def is_storable(data: Any) -> bool:
    """Whether another process could use a compiled version: it holds no address of this one."""
    return not data.library.has_dynamic_globals and all(lifted.can_cache for lifted in data.lifted)


def _uncollected(compile_: Callable) -> Callable:
    """``compile_`` without Python's garbage collector, which is as it was before when that returns or raises.

    What a compilation makes is needed until its end: to search it for garbage takes a tenth of the time.
    """

    @wraps(compile_)
    def compiled(sig: Any) -> Any:
        running = gc.isenabled()
        gc.disable()
        try:
            return compile_(sig)
        finally:
            if running:
                gc.enable()

    return compiled


def kept(dispatcher: Dispatcher) -> Dispatcher:
    """The same compiled function, with its versions kept on disk."""
    setattr(dispatcher, "compile", _uncollected(dispatcher.compile))  # noqa: B010 - mypy knows no such assignment
    setattr(dispatcher, "_cache", KernelCache(dispatcher))  # noqa: B010 - where numba keeps the one of cache=True
    return dispatcher
