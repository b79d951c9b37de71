"""Threads for large batches: each takes its share of the columns of a kernel that holds no lock of the interpreter.

Plain threads, not numba's ``prange``: its waiting threads spin, so that on a machine whose cores others use too a step
of a tenth of a millisecond takes a time slice of the scheduler, a hundred times as long. And they would not get along
with torch's own threads.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

WORTHWHILE = 256
"""Environments a thread should have: with fewer, waking it takes longer than it saves."""


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Team:
    """``size`` threads, the caller's own one of them: each calls ``kernel(*arguments, lo, hi)`` on a part of ``n``."""

    def __init__(self, kernel: Callable[..., None], arguments: tuple, n: int, size: int, multiple: int):
        share = -(-n // (size * multiple)) * multiple  # parts end at multiples: no cache line has two writers
        bounds = [*range(0, n, share), n]
        self._kernel, self._arguments = kernel, arguments
        self._own, *self._others = pairwise(bounds)
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def __call__(self) -> None:
        """Run the kernel over all columns; every thread has ended when it returns."""
        if self._process != os.getpid():  # the first call, or the first in a forked process: threads are not forked
            self._pool = ThreadPoolExecutor(max(len(self._others), 1), "cable_envs")
            self._process = os.getpid()
        assert self._pool is not None
        waiting = [self._pool.submit(self._kernel, *self._arguments, lo, hi) for lo, hi in self._others]
        self._kernel(*self._arguments, *self._own)
        for part in waiting:
            part.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None and self._process == os.getpid():
            self._pool.shutdown()
        self._pool, self._process = None, 0
