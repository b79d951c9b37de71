"""A few steps of a newcomer on each task it enters, before hours are spent on it: it must answer, finite, in time."""

import signal
import statistics
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.protocol import Protocol

STEPS = 50
"""Control steps tried on each task: half a second at 100 Hz, with a reset before and one in between."""

HANGS = 20.0
"""s after which an answer counts as never coming (the first one may compile)."""


@dataclass(frozen=True)
class Tried:
    """What was seen on one task: median seconds of an answer, and the share of commands beyond the drive's range."""

    env_id: str
    seconds: float
    clipped: float


def dry_run(entrant: Entrant, protocol: Protocol, tasks: Sequence[str] = ()) -> tuple[Tried, ...]:
    """Try the entrant on each of the protocol's (or the named) tasks that it enters.

    Raises ConfigurationError where it enters none, where an answer is not finite, never comes, or takes longer (in the
    median) than a control period: such a controller could not run at this rate.
    """
    track = (protocol.run or tuple(t.name for t in protocol.tracks))[0]
    found: list[Tried] = []
    for cell in protocol.cells(tuple(tasks), (track,)):
        options = entrant.enters(cell.task.env, cell.environment_options())
        if options is not None and cell.task.env not in {t.env_id for t in found}:
            found.append(_try(entrant, cell.task.env, options, protocol.tune.first))
    if not found:
        ids = ", ".join(tasks or [t.env for t in protocol.tasks])
        raise ConfigurationError(f"'{entrant.title}' enters none of the tasks: {ids}")
    return tuple(found)


def _try(entrant: Entrant, env_id: str, options: Mapping[str, Any], seed: int) -> Tried:
    env = gym.make(env_id, disable_env_checker=True, **options)
    core: Any = env.unwrapped
    spent, clipped = [], 0
    tried_in = _Named(f"on {env_id} (observe: {options.get('observe') or core.setup.task.observe})")
    try:
        with within(HANGS, f"'{entrant.title}' on {env_id}: not ready after {HANGS:g} s"), tried_in:
            actor = entrant.make(core.setup)
        for episode in range(2):
            observation, info = env.reset(seed=seed + episode)
            with within(HANGS, f"'{entrant.title}' on {env_id}: reset() has not ended after {HANGS:g} s"), tried_in:
                actor.start(core)
            for _ in range(STEPS // 2):
                at = f"'{entrant.title}' on {env_id}, t = {info['time']:g} s"
                with within(HANGS, f"{at}: no answer within {HANGS:g} s"), tried_in:
                    before = time.perf_counter()
                    action = actor.act(observation, info["time"])
                    spent.append(time.perf_counter() - before)
                if not np.all(np.isfinite(action)):
                    raise ConfigurationError(f"{at}: the answer is not finite ({np.ravel(action)[0]})")
                clipped += bool(np.any(np.abs(action) > 1.0 + 1e-6))
                observation, _, terminated, truncated, info = env.step(action)
                if terminated or truncated:
                    break
    finally:
        env.close()
    median = statistics.median(spent)
    if median > core.setup.control_period:
        raise ConfigurationError(
            f"'{entrant.title}' on {env_id}: an answer takes {1e3 * median:.3g} ms (median of {len(spent)}); the "
            f"control period is {1e3 * core.setup.control_period:g} ms"
        )
    return Tried(env_id, median, clipped / len(spent))


class _Named:
    """A block, to be entered any number of times, whose errors begin with a place."""

    def __init__(self, place: str):
        self._place = place

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ConfigurationError):
            raise ConfigurationError(f"{self._place}: {error}") from None


@contextmanager
def within(seconds: float, message: str) -> Iterator[None]:
    """Interrupt the block after ``seconds`` by ConfigurationError(message), on the main thread of a POSIX system."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def expired(*_: object) -> None:
        raise _Expired

    old = signal.signal(signal.SIGALRM, expired)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except _Expired:
        raise ConfigurationError(message) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, old)


class _Expired(BaseException):
    """No `Exception`: the code under test must not swallow it."""
