"""Job functions for the tests: workers import them by name."""

import os
import signal
import time
from dataclasses import replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cablebench.cli.shared.training import RUN, train_here
from cablebench.jobs import Stopped


def double(context, number):
    context.report(1, 1, f"doubling {number}")
    return 2 * number


def fail(context, kind):
    raise ConfigurationError("no such gain") if kind == "configuration" else RuntimeError("it broke")


def unpicklable(context):
    return lambda: None


def environment(context):
    return os.environ["OMP_NUM_THREADS"], os.environ["NUMBA_NUM_THREADS"], os.getpid()


def always_dies(context):
    os.kill(os.getpid(), signal.SIGKILL)


def count(context, to, die_at=0, wait=0.0):
    """Counts to ``to``, keeping the count in its folder; dies at ``die_at`` in its first attempt, ``wait`` s later."""
    file = context.folders[RUN] / "count"
    first = number = int(file.read_text()) if file.exists() else 0
    while number < to:
        number += 1
        write_atomic(file, str(number))
        context.report(number, to, "counting")
        if number == die_at and context.attempt == 1:
            time.sleep(wait)
            os.kill(os.getpid(), signal.SIGKILL)
    return {"first": first, "last": number, "attempt": context.attempt}


def patient(context):
    """Goes on until it is stopped, and keeps what it has."""
    number = 0
    try:
        while True:
            number += 1
            context.report(number, 10**9, "waiting")
            time.sleep(0.01)
    except KeyboardInterrupt:
        raise Stopped({"kept": number}) from None


def parabola(context, x, y):
    """Loss of a toy search."""
    context.report(1, 1, "")
    return (x - 0.3) ** 2 + (y - 20.0) ** 2 / 400.0


def sometimes_fails(context, x, y):
    if x < 0.5:
        raise RuntimeError("too small")
    return x


def killed_training(context, wait=0.0, **arguments):
    """`train_here`, killed at the start of its third rollout; the next attempt writes down its first report.

    A checkpoint is written at the start of a rollout, after the report: the one that is found holds one rollout, and
    the first report comes after the next.
    """
    folder = context.folders[RUN]

    def report(done, total, text):
        context.report(done, total, text)
        if context.attempt == 1:
            if done >= 2 * 8192:
                time.sleep(wait)
                os.kill(os.getpid(), signal.SIGKILL)
        elif not (folder / "resumed").exists():
            write_atomic(folder / "resumed", str(done))

    return train_here(replace(context, report=report), **arguments)
