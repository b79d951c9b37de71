"""Processes that are killed: at a moment of time, or as they are about to change a file for the n-th time.

Commands run in forks of one process that has imported everything, so that a moment drawn over a run's duration falls
into its work and not into its imports. The moments that count, between two changes of files, are rarely hit by drawing
a time: a fork therefore counts the files that it opens for writing, renames, removes and flushes, and can kill itself
just before the n-th.
"""

import mmap
import os
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CHANGES = {"os.rename": 0, "os.remove": 0, "os.rmdir": 0, "os.mkdir": 0, "os.truncate": 0, "os.chmod": 0}
"""Audit events that change files, with the argument that names the file."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT

PATIENCE = 60.0
"""s that the workers of a killed process have to end by themselves."""


@dataclass(frozen=True)
class Ended:
    """How a process ended: exit code (negative: a signal), changes of files seen, s, what it said, what it left."""

    code: int
    changes: int
    seconds: float
    out: str
    err: str
    told: tuple[str, ...]
    """What it had reported as saved, a line each."""
    orphans: int
    """Processes of it that had to be ended."""


class Counter:
    """Counts a process's changes of files below a folder, and kills the process before number ``last``."""

    def __init__(self, root: Path, shared: mmap.mmap, last: int = 0):
        self._root, self._shared, self._last = str(root.resolve()), shared, last
        self.seen = 0

    def start(self) -> None:
        """Listen from now on, in this process, as long as it lives."""
        sys.addaudithook(self._hear)
        flush = os.fsync

        def fsync(handle: Any) -> None:
            self.count()
            flush(handle)
            self.count()

        os.fsync = fsync
        with suppress(ImportError):
            from sqlalchemy import event
            from sqlalchemy.engine import Engine

            event.listen(Engine, "commit", lambda connection: self.count())

    def count(self) -> None:
        """One more change."""
        self.seen += 1
        self._shared[:8] = struct.pack("q", self.seen)
        if self.seen == self._last:
            os.kill(os.getpid(), signal.SIGKILL)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if isinstance(flags, int) and flags & WRITING and self._ours(path):
                self.count()
        elif event in CHANGES and self._ours(arguments[CHANGES[event]]):
            self.count()

    def _ours(self, path: Any) -> bool:
        if not isinstance(path, (str, bytes, os.PathLike)):
            return False
        return os.path.abspath(os.fsdecode(path)).startswith(self._root)


def run(
    body: Callable[[Callable[[str], None]], None], folder: Path, at_change: int = 0, after: float | None = None
) -> Ended:
    """Run ``body`` in a fork with ``folder`` as its working folder; wait until it and all that it started has ended.

    ``at_change``: kill it before its so-manieth change of a file below ``folder``; ``after``: kill it after so many
    seconds. ``body`` is given a function that reports a line as saved.
    """
    logs = folder.parent / f"{folder.name}-logs"
    logs.mkdir(exist_ok=True)
    shared, began = mmap.mmap(-1, 8), time.monotonic()
    for name in ("out", "err", "told"):
        (logs / name).write_bytes(b"")
    child = os.fork()
    if child == 0:
        _work(body, folder, logs, Counter(folder, shared, at_change))
    code = _wait(child, None if after is None else began + after)
    took = time.monotonic() - began
    orphans = _orphans(child)
    out, err, told = ((logs / name).read_text(encoding="utf-8", errors="replace") for name in ("out", "err", "told"))
    return Ended(code, struct.unpack("q", shared[:8])[0], took, out, err, tuple(told.splitlines()), orphans)


def _work(body: Callable[[Callable[[str], None]], None], folder: Path, logs: Path, counter: Counter) -> None:
    """All that the fork does; it does not come back."""
    code = 70
    try:
        os.setsid()
        os.chdir(folder)
        for number, name in ((1, "out"), (2, "err")):
            handle = os.open(logs / name, os.O_WRONLY | os.O_APPEND)
            os.dup2(handle, number)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        told = os.open(logs / "told", os.O_WRONLY | os.O_APPEND)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        counter.start()
        body(lambda line: os.write(told, f"{line}\n".encode()) and None)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _wait(child: int, until: float | None) -> int:
    while True:
        done, status = os.waitpid(child, 0 if until is None else os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if until is not None and time.monotonic() >= until:
            os.kill(child, signal.SIGKILL)
            until = None
        else:
            time.sleep(0.002)


def _orphans(session: int) -> int:
    """How many processes of a session do not end by themselves; they are ended."""
    until = time.monotonic() + PATIENCE
    while (found := _of_session(session)) and time.monotonic() < until:
        time.sleep(0.05)
    for pid in found:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return len(found)


def _of_session(session: int) -> list[int]:
    found = []
    for place in Path("/proc").iterdir():
        if place.name.isdecimal():
            with suppress(OSError, ValueError, IndexError):
                fields = (place / "stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(place.name))
    return found


def command(*words: str) -> Callable[[Callable[[str], None]], None]:
    """``cablebench`` with these words, as `run` takes it."""

    def body(tell: Callable[[str], None]) -> None:
        from cablebench.cli import main

        main(list(words))

    return body


def leftovers(folder: Path) -> list[str]:
    """Files that only a running process should have: temporary ones, journals."""
    return sorted(
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.name.endswith((".tmp", "-journal")) or path.name.startswith(".writing-") or path.name == ".steps"
    )
