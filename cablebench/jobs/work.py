"""What is passed around: jobs, what a running job is given, progress, results, errors."""

import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError

REPORT_EVERY = 0.1
"""s between two progress reports that a worker sends; the last of a job is always sent."""

SINGLE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""A worker has one thread: there are as many workers as cores."""


@dataclass(frozen=True)
class Job:
    """``function(context, **arguments)``: a module-level function, so that a worker can import it."""

    key: str
    """unique among the jobs of a run"""
    function: Callable[..., Any]
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """picklable"""
    folders: Mapping[str, Path] = field(default_factory=dict)
    """the caller's folders that the job reads and writes, by the name under which `Context.folders` has them. Where the
    worker does not share the caller's file system, their files travel there and back."""


@dataclass(frozen=True)
class Context:
    """What a running job is given."""

    report: Callable[[int, int, str], None]
    """(done, total, text)"""
    folders: Mapping[str, Path]
    """`Job.folders` where the job runs"""
    attempt: int = 1
    """above 1 where a worker with this job has died"""


@dataclass(frozen=True)
class Progress:
    """What a running job reported."""

    key: str
    done: int
    total: int
    text: str


class Stopped(Exception):
    """The job was stopped before its end, by Ctrl-C as a rule. A job that has kept its work raises it with a result."""

    def __init__(self, result: Any = None):
        super().__init__("stopped")
        self.result = result


class JobError(RuntimeError):
    """A job failed, or its worker died too often; the message says how, with the traceback of its process."""


@dataclass(frozen=True)
class Done:
    """A job that has ended: its result or why there is none."""

    job: Job
    result: Any = None
    error: Exception | None = None
    """ConfigurationError; `Stopped`; from another process every other one as `JobError`"""
    attempts: int = 1

    @property
    def stopped(self) -> bool:
        """Whether it was stopped before its end; what it kept is in `result`."""
        return isinstance(self.error, Stopped)

    def value(self) -> Any:
        """The result; raises the error where there is one."""
        if self.error is not None:
            raise self.error
        return self.result


@dataclass(frozen=True)
class Died:
    """A worker ended without the result of its job."""

    job: Job
    attempt: int
    how: str


Event = Progress | Done | Died


Outcome = tuple[Any, Exception | None]


def perform(job: Job, context: Context) -> Outcome:
    """Run a job here: (result, error). Nothing is raised: Ctrl-C in the job gives `Stopped`."""
    try:
        return job.function(context, **job.arguments), None
    except Stopped as stopped:
        return stopped.result, Stopped()
    except KeyboardInterrupt:
        return None, Stopped()
    except Exception as error:
        return None, error


def portable(error: Exception | None) -> Exception | None:
    """The error in a form that every process can unpickle."""
    if error is None or isinstance(error, (Stopped, JobError)):
        return error
    if isinstance(error, ConfigurationError):
        return ConfigurationError(str(error))
    lines = "".join(traceback.format_exception(error))
    return JobError(f"{type(error).__name__}: {error}\n{lines}")


class Reporter:
    """`Context.report` that passes on one report in `REPORT_EVERY`."""

    def __init__(self, send: Callable[[int, int, str], None]):
        self._send, self._next = send, 0.0

    def __call__(self, done: int, total: int, text: str = "") -> None:
        now = time.monotonic()
        if now >= self._next or done >= total:
            self._next = now + REPORT_EVERY
            self._send(done, total, text)


@contextmanager
def single_thread() -> Iterator[None]:
    """Processes that are started inside, and numerical libraries that are loaded, have one thread."""
    before = {name: os.environ.get(name) for name in SINGLE_THREAD}
    os.environ.update(dict.fromkeys(SINGLE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def interrupt_once() -> None:
    """From now on the first SIGINT of this process raises KeyboardInterrupt; later ones would only disturb saving."""

    def stop(*_: Any) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, stop)
