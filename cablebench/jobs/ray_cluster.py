"""Jobs on a Ray cluster: one core each, on any node, with or without a shared file system.

A job's folders exist twice: the caller's, and a temporary copy on the node where it runs. While it runs, files that
have changed go to a mailbox on the caller's node every few seconds, and the caller writes them to its own folders. So
the caller's folders always hold the newest checkpoint; where a worker or its whole node dies, the job is sent out again
with those files. The files of a job that ends come back with its result.
"""

import logging
import os
import pickle
import signal
import tempfile
import threading
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.core.provenance import source_hash
from cablebench.jobs.work import Context, Died, Done, Event, Job, Progress, Reporter, interrupt_once, perform, portable

HEARTBEAT = 0.5
"""s between two messages of a running job."""

UPLOAD_EVERY = 10.0
"""s between two looks at its folders for changed files."""

Files = dict[tuple[str, str], bytes | None]
"""(name of the folder, path in it) -> content; None: removed"""


class RayCrew:
    """Up to ``size`` jobs at a time (default: the cores of the cluster) as tasks of a Ray cluster.

    Raises ConfigurationError where nothing answers at ``address``.
    """

    def __init__(self, size: int | None = None, address: str | None = None, upload_every: float = UPLOAD_EVERY):
        self._ours = not ray.is_initialized()
        if self._ours:
            _connect(address, size)
        self._size = size or max(int(ray.cluster_resources().get("CPU", 1)), 1)
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        self._mailbox: Any = (
            ray.remote(_Mailbox).options(num_cpus=0, scheduling_strategy=here, max_concurrency=1).remote()
        )
        # tries are counted and files collected by the driver: Ray itself must not repeat a task
        self._task = ray.remote(_remote).options(num_cpus=1, max_retries=0)
        self._source, self._upload_every = source_hash(), upload_every
        self._running: dict[Any, tuple[Job, int]] = {}

    def free(self) -> bool:
        return len(self._running) < self._size

    def start(self, job: Job, attempt: int) -> None:
        work = pickle.dumps((job.function, dict(job.arguments)))  # modules are imported there once threads are set
        files: Files = {}
        for name, folder in job.folders.items():
            files |= {(name, path): content for path, content in _read(folder, {}).items()}
        reference = self._task.remote(
            job.key, attempt, work, tuple(job.folders), files, self._mailbox, self._source, self._upload_every
        )
        self._running[reference] = (job, attempt)

    def events(self, timeout: float) -> Iterable[Event]:
        ready, _ = ray.wait(list(self._running), timeout=timeout)
        yield from self._collect()
        for reference in ready:
            job, attempt = self._running.pop(reference)
            try:
                result, error, files = ray.get(reference)
            except ray.exceptions.RayError as failure:
                yield Died(job, attempt, str(failure).splitlines()[0])
                continue
            self._write(job, files)
            yield Done(job, result, error, attempt)

    def _collect(self) -> Iterable[Event]:
        """Empty the mailbox. What a task sent that was given up since is dropped."""
        current = {(job.key, attempt): job for job, attempt in self._running.values()}
        for key, attempt, report, files in ray.get(self._mailbox.collect.remote()):
            job = current.get((key, attempt))
            if job is not None:
                self._write(job, files)
                if report is not None:
                    yield Progress(key, *report)

    @staticmethod
    def _write(job: Job, files: Files) -> None:
        for (name, path), content in files.items():
            if content is None:
                (job.folders[name] / path).unlink(missing_ok=True)
            else:
                write_atomic(job.folders[name] / path, content)

    def interrupt(self) -> None:
        ray.get(self._mailbox.stop.remote())

    def close(self) -> None:
        if self._running:
            self.interrupt()
            ray.wait(list(self._running), num_returns=len(self._running), timeout=20.0)
            with suppress(ray.exceptions.RayError):
                list(self._collect())
            for reference in self._running:
                ray.cancel(reference, force=True)
            self._running.clear()
        ray.kill(self._mailbox)
        if self._ours:
            ray.shutdown()


def _connect(address: str | None, size: int | None) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # a benchmark calls nobody
    quiet: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False}
    wanted = address or os.environ.get("RAY_ADDRESS")
    try:
        ray.init(address=wanted or "auto", **quiet)
    except (ConnectionError, ValueError, RuntimeError) as error:
        if wanted:
            raise ConfigurationError(f"no Ray cluster answers at {wanted}: {str(error).splitlines()[0]}") from error
        ray.init(address="local", num_cpus=size, include_dashboard=False, **quiet)


class _Mailbox:
    """An actor beside the caller: holds what running jobs have sent until the caller collects it."""

    def __init__(self) -> None:
        self._reports: dict[tuple[str, int], tuple[int, int, str] | None] = {}
        self._files: dict[tuple[str, int], Files] = {}
        self._stop = False

    def put(self, key: str, attempt: int, report: tuple[int, int, str] | None, files: Files) -> bool:
        """Leave a report and changed files; whether the job shall stop."""
        self._reports[key, attempt] = report or self._reports.get((key, attempt))
        self._files.setdefault((key, attempt), {}).update(files)  # of several versions the newest counts
        return self._stop

    def collect(self) -> list[tuple[str, int, tuple[int, int, str] | None, Files]]:
        """Everything that has come since the last time."""
        found = [(*which, report, self._files.get(which, {})) for which, report in self._reports.items()]
        self._reports, self._files = {}, {}
        return found

    def stop(self) -> None:
        """Tell every job that reports from now on to stop."""
        self._stop = True


def _remote(
    key: str, attempt: int, work: bytes, folders: tuple[str, ...], files: Files, mailbox: Any, source: str, every: float
) -> tuple[Any, Exception | None, Files]:
    """Body of a task: (result, error, files that the caller does not have yet)."""
    os.environ.update({"NUMBA_NUM_THREADS": "1"})  # Ray sets the others
    if source_hash() != source:
        text = f"this node has another version of cable-envs (source {source_hash()}) than the caller ({source})"
        return None, ConfigurationError(text), {}
    with tempfile.TemporaryDirectory(prefix="cablebench-") as root:
        places = {name: Path(root) / name for name in folders}
        for name, path in files:
            content = files[name, path]
            assert content is not None, "nothing is removed before a job has begun"
            write_atomic(places[name] / path, content)
        heart = _Heart(key, attempt, places, mailbox, every)
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # forgets what came meanwhile
        mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # Ray starts its workers with it blocked
        try:
            interrupt_once()
            heart.start()
            function, arguments = pickle.loads(work)
            job = Job(key, function, arguments)
            result, error = perform(job, Context(Reporter(heart.report), places, attempt))
        except Exception as failure:  # its module cannot be imported here
            result, error = None, failure
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            heart.end()
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            signal.signal(signal.SIGINT, before)
        return result, portable(error), heart.changed()


class _Heart(threading.Thread):
    """Beside a running job: sends its progress and changed files, and hears whether it shall stop."""

    def __init__(self, key: str, attempt: int, folders: Mapping[str, Path], mailbox: Any, every: float):
        super().__init__(daemon=True)
        self._which, self._folders, self._mailbox = (key, attempt), folders, mailbox
        self._looks = max(round(every / HEARTBEAT), 1)
        self._known: dict[str, dict[str, tuple[int, int]]] = {name: {} for name in folders}
        self._report: tuple[int, int, str] | None = None
        self._ended = threading.Event()
        self.changed()  # what came with the job is known to the caller

    def report(self, done: int, total: int, text: str) -> None:
        self._report = (done, total, text)

    def changed(self) -> Files:
        """Files that are new or other than at the last look."""
        found: Files = {}
        for name, folder in self._folders.items():
            found |= {(name, path): content for path, content in _read(folder, self._known[name]).items()}
        return found

    def run(self) -> None:
        beats, told = 0, False
        while not self._ended.wait(HEARTBEAT):
            beats += 1
            report, self._report = self._report, None
            files = self.changed() if beats % self._looks == 0 else {}
            try:
                stop = ray.get(self._mailbox.put.remote(*self._which, report, files))
            except ray.exceptions.RayError:
                stop = True  # the caller has gone
            if stop and not told:
                told = True
                os.kill(os.getpid(), signal.SIGINT)  # handled by the main thread, where the job runs

    def end(self) -> None:
        self._ended.set()
        self.join()
        if self._report is not None:  # a short job ends between two beats
            with suppress(ray.exceptions.RayError):
                ray.get(self._mailbox.put.remote(*self._which, self._report, {}))


def _read(folder: Path, known: dict[str, tuple[int, int]]) -> dict[str, bytes | None]:
    """Files below ``folder`` whose (time, size) differ from ``known``, which is brought up to date; None: it is gone.

    Files that are being written have names that begin with a dot (`store.write_atomic`); they are left out.
    """
    found: dict[str, bytes | None] = {}
    present = set()
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")):
        with suppress(FileNotFoundError):
            about, name = path.stat(), path.relative_to(folder).as_posix()
            if known.get(name) != (about.st_mtime_ns, about.st_size):
                found[name] = path.read_bytes()
                known[name] = (about.st_mtime_ns, about.st_size)
            present.add(name)
    for name in known.keys() - present:
        found[name] = None
        del known[name]
    return found
