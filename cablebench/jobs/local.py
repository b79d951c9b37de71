"""Worker processes on this machine, started by spawn: nothing of the caller's threads, locks or loaded libraries."""

import multiprocessing
import os
import pickle
import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from typing import Any

from cablebench.jobs.work import (
    Context,
    Died,
    Done,
    Event,
    Job,
    Progress,
    Reporter,
    interrupt_once,
    perform,
    portable,
    single_thread,
)  # fmt: skip

POSIX = os.name == "posix"
"""Whether there are masks of signals and groups of processes."""

GRACE = 20.0
"""s that workers have to save their work when the caller ends early."""


@dataclass
class _Worker:
    process: Any
    pipe: Any
    job: Job | None = None
    attempt: int = 0
    listens: bool = False
    """whether SIGINT would reach the job now"""


class LocalCrew:
    """Up to ``size`` worker processes, started when they are needed and kept for further jobs."""

    def __init__(self, size: int):
        self._size = size
        self._workers: list[_Worker] = []
        self._stopping = False

    def free(self) -> bool:
        return len(self._workers) < self._size or any(w.job is None for w in self._workers)

    def start(self, job: Job, attempt: int) -> None:
        content = pickle.dumps((job, attempt))
        for worker in [w for w in self._workers if w.job is None]:
            try:
                worker.pipe.send_bytes(content)
            except OSError:  # it died while it had nothing to do
                self._remove(worker)
                continue
            worker.job, worker.attempt = job, attempt
            return
        worker = self._hire()
        worker.job, worker.attempt = job, attempt
        with suppress(OSError):  # `events` finds it dead
            worker.pipe.send_bytes(content)

    def _hire(self) -> _Worker:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        # Ctrl-C in a terminal goes to every process of its group. A worker leaves the group (`_serve`), so that it
        # hears it once and from us; until it has done so the signal is blocked: a child inherits the mask. The start
        # of multiprocessing's tracker would change the mask, so that one comes first.
        if POSIX:
            resource_tracker.ensure_running()
        with _interrupts_blocked(), single_thread():
            process.start()
        theirs.close()
        worker = _Worker(process, ours)
        self._workers.append(worker)
        return worker

    def events(self, timeout: float) -> Iterable[Event]:
        busy: dict[Any, tuple[_Worker, Job]] = {w.pipe: (w, w.job) for w in self._workers if w.job is not None}
        for pipe in connection.wait(list(busy), timeout):
            worker, job = busy[pipe]
            attempt = worker.attempt
            try:
                kind, content = worker.pipe.recv()
            except (EOFError, OSError):
                yield Died(job, attempt, self._remove(worker))
                continue
            if kind == "progress":
                yield Progress(job.key, *content)
            elif kind == "begun":
                worker.listens = True
                if self._stopping:
                    self._signal(worker)
            else:
                worker.job, worker.listens = None, False
                result, error = content
                yield Done(job, result, error, attempt)

    def _remove(self, worker: _Worker) -> str:
        """Forget a worker that has ended; how it ended, in words."""
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join()
        code = worker.process.exitcode
        worker.process.close()
        return f"killed by signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"exit code {code}"

    def interrupt(self) -> None:
        self._stopping = True  # those that begin later hear it then
        for worker in self._workers:
            if worker.listens:
                self._signal(worker)

    @staticmethod
    def _signal(worker: _Worker) -> None:
        with suppress(ProcessLookupError):
            os.kill(worker.process.pid, signal.SIGINT)

    def close(self) -> None:
        self.interrupt()
        for worker in self._workers:
            worker.pipe.close()  # one without a job ends by it
        for worker in self._workers:
            worker.process.join(GRACE)
            worker.process.kill()
            worker.process.join()
            worker.process.close()
        self._workers.clear()


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Within the block Ctrl-C waits. Windows has no masks: there a worker hears what its console hears."""
    if not POSIX:
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _serve(pipe: Any) -> None:
    """Body of a worker: one job after the other until the pipe is closed."""
    if POSIX:
        os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # forgets what came meanwhile
    if POSIX:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        while True:
            content = pipe.recv_bytes()  # SIGINT is ignored here: without a job a worker ends with the pipe
            outcome = _run(content, pipe)
            try:
                pipe.send(("done", outcome))
            except (pickle.PicklingError, TypeError, AttributeError) as error:  # a result that cannot travel
                pipe.send(("done", (None, portable(error))))
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        pass  # the caller has ended, or wants this worker to


def _run(content: bytes, pipe: Any) -> Any:
    def send(*report: Any) -> None:
        try:
            pipe.send(("progress", report))
        except OSError:
            raise KeyboardInterrupt from None  # the caller has gone: the job saves its work

    interrupt_once()
    pipe.send(("begun", None))
    try:
        job, attempt = pickle.loads(content)
    except Exception as failure:  # its module cannot be imported here
        return None, portable(failure)
    result, error = perform(job, Context(Reporter(send), job.folders, attempt))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return result, portable(error)
