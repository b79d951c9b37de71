"""The caller's side, the same for every backend: hands out jobs, takes what comes back, tries again where workers died.

After Ctrl-C no further job starts, those that run are asked to stop and to keep their work, what they end with is still
yielded, and then `Backend.run` raises KeyboardInterrupt. A second Ctrl-C does not wait for them.
"""

import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from cable_envs.core.errors import ConfigurationError, require_known
from cablebench.jobs.work import Context, Died, Done, Event, Job, JobError, Progress, Reporter, Stopped, perform

BACKENDS = ("local", "ray")

RETRIES = 3
"""How often a job is tried again after its worker died."""

POLL = 0.2
"""s that the caller waits for news at most, before it looks whether Ctrl-C was pressed."""

ProgressReport = Callable[[Progress], None]


class Crew(Protocol):
    """The workers of a backend."""

    def free(self) -> bool:
        """Whether `start` would begin a job now."""

    def start(self, job: Job, attempt: int) -> None:
        """Begin a job."""

    def events(self, timeout: float) -> Iterable[Event]:
        """What has happened; waits up to ``timeout`` s for something to happen."""

    def interrupt(self) -> None:
        """Ask every running job to stop and to keep its work."""

    def close(self) -> None:
        """End: jobs that still run are stopped."""


class Backend(Protocol):
    """Runs jobs. A context manager."""

    def run(self, jobs: Iterable[Job], progress: ProgressReport | None = None) -> Generator[Done, None, None]:
        """Yield jobs as they end, in any order, each exactly once; ``progress`` hears what running jobs report.

        Raises KeyboardInterrupt after Ctrl-C, ValueError where two jobs have the same key.
        """

    def __enter__(self) -> "Backend": ...

    def __exit__(self, *_: object) -> None: ...


def open_backend(name: str, jobs: int | None = None, address: str | None = None) -> Backend:
    """The backend of that name with up to ``jobs`` jobs at a time.

    local: processes on this machine; by default, and with ``jobs`` 1, this process itself.
    ray: a Ray cluster at ``address`` (default: RAY_ADDRESS or the one that runs here, else one is started); by default
        as many jobs as it has cores.

    Raises ConfigurationError for an unknown name and where the cluster cannot be reached.
    """
    require_known("backend", [name], BACKENDS)
    if address is not None and name != "ray":
        raise ConfigurationError(f"--ray-address {address} needs --backend ray")
    if name == "ray":
        from cablebench.jobs.ray_cluster import RayCrew

        return CrewBackend(RayCrew(jobs, address))
    if jobs is None or jobs == 1:
        return Here()
    from cablebench.jobs.local import LocalCrew

    return CrewBackend(LocalCrew(jobs))


class Here:
    """One job after the other in this process."""

    def __enter__(self) -> "Here":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, jobs: Iterable[Job], progress: ProgressReport | None = None) -> Generator[Done, None, None]:
        for job in unique(jobs):

            def send(done: int, total: int, text: str, key: str = job.key) -> None:
                if progress is not None:
                    progress(Progress(key, done, total, text))

            result, error = perform(job, Context(Reporter(send), job.folders))
            yield Done(job, result, error)
            if isinstance(error, Stopped):
                raise KeyboardInterrupt


class CrewBackend:
    """Jobs on the workers of a `Crew`."""

    def __init__(self, crew: Crew, retries: int = RETRIES):
        self._crew, self._retries = crew, retries

    def __enter__(self) -> "CrewBackend":
        return self

    def __exit__(self, *_: object) -> None:
        self._crew.close()

    def run(self, jobs: Iterable[Job], progress: ProgressReport | None = None) -> Generator[Done, None, None]:
        queue: deque[tuple[Job, int]] = deque((job, 1) for job in unique(jobs))
        running, stopping = 0, False
        with _ctrl_c() as asked:
            while queue or running:
                if asked.is_set() and not stopping:
                    stopping = True
                    queue.clear()
                    self._crew.interrupt()
                while queue and self._crew.free():
                    self._crew.start(*queue.popleft())
                    running += 1
                for event in self._crew.events(POLL) if running else ():
                    if isinstance(event, Progress):
                        if progress is not None:
                            progress(event)
                        continue
                    running -= 1
                    if isinstance(event, Done) and event.stopped and not asked.is_set():
                        event = Died(event.job, event.attempts, "stopped by a signal that did not come from here")
                    done = event if isinstance(event, Done) else self._again(event, queue, asked.is_set())
                    if done is not None:
                        yield done
        if stopping:
            raise KeyboardInterrupt

    def _again(self, died: Died, queue: deque[tuple[Job, int]], stopping: bool) -> Done | None:
        """Put the job of a dead worker back into the queue; what it ends with where it is not tried again."""
        if stopping:
            return Done(died.job, error=Stopped(), attempts=died.attempt)
        if died.attempt <= self._retries:
            queue.appendleft((died.job, died.attempt + 1))
            return None
        error = JobError(f"'{died.job.key}': its worker died {died.attempt} times, at last: {died.how}")
        return Done(died.job, error=error, attempts=died.attempt)


def unique(jobs: Iterable[Job]) -> list[Job]:
    """The jobs; ValueError where a key appears twice."""
    found = list(jobs)
    keys = [job.key for job in found]
    if len(set(keys)) < len(keys):
        raise ValueError(f"two jobs have the same key: {sorted(k for k in set(keys) if keys.count(k) > 1)}")
    return found


@contextmanager
def _ctrl_c() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets, so that it never tears what the caller is doing; the second one raises.

    Outside the main thread there is nothing to catch: Python delivers signals to that thread only.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def stop(*_: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)
