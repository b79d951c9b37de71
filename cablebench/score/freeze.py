"""Making anchors: open loop and the candidates for the bound are run, and their median errors become fixed numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.provenance import versions
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.failures import broken
from cablebench.protocol.protocol import Protocol, Task, Track
from cablebench.run.evaluation import Progress, evaluate
from cablebench.score.anchors import Anchor, task_hash


def freeze(
    protocol: Protocol,
    open_loop: Entrant,
    bounds: Sequence[Entrant],
    conditions: Sequence[tuple[Task, Track]],
    episodes: int,
    progress: Callable[[Progress], None] | None = None,
) -> list[Anchor]:
    """Anchors of conditions.

    Parameters
    ----------
    protocol : Protocol
        Says the test seeds; a track's sweeps do not count.
    open_loop : Entrant
    bounds : sequence of Entrant
        Of those that enter a task the one with the smallest median error is its bound. An episode in which it breaks
        a failure rule counts as infinitely bad.
    conditions : sequence of (Task, Track)
    episodes : int
        Of each condition.
    progress : callable, optional
        As of `cablebench.run.evaluate`.

    Returns
    -------
    list of Anchor
        In the order of ``conditions``.

    Raises
    ------
    ConfigurationError
        Where open loop or bound do not enter a task, or where the bound is hardly better than the open loop.
    """
    made = []
    for task, track in conditions:
        plain = Track(track.name, track.options, episodes)
        # the references' own episodes: not sealed, without sweeps, scored by nobody
        alone = replace(
            protocol, tasks=(task,), tracks=(plain,), run=(track.name,), seal="", score_version=0, anchors=""
        )
        applying = [b for b in bounds if b.enters(task.env, {**task.options, **track.options}) is not None]
        if not applying:
            raise ConfigurationError(f"no bound enters {task.env}: {', '.join(b.name for b in bounds)}")
        records = evaluate(alone, [open_loop, *applying], progress=progress)
        zero = _median(records, open_loop.name)
        errors = {b.name: _median(records, b.name, zero) for b in applying}
        best = min(errors, key=lambda name: errors[name])
        made.append(Anchor(
            task.env, track.name, _rounded(zero), _rounded(errors[best]), records[0]["output_unit"], open_loop.name,
            best, episodes, alone.seeds(1)[0], task_hash(task, track), versions()["source"],
        ))  # fmt: skip
    return made


def _rounded(error: float) -> float:
    """Six significant digits: a frozen number that people can read."""
    return float(f"{error:.6g}")


def _median(records: Sequence[Mapping[str, Any]], name: str, open_loop: float | None = None) -> float:
    """Median RMSE of an entrant; with the open loop's error, failed episodes count as infinite."""
    own = [r["metrics"] for r in records if r["entrant"] == name]
    if open_loop is None:
        return float(np.median([m["rmse"] for m in own]))
    return float(np.median([np.inf if broken(m, open_loop) else m["rmse"] for m in own]))
