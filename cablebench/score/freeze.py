"""Making anchors: doing nothing and the candidates for the bound are run, and their median errors become numbers.

The bound of an episode is the least error that anybody found who knows the true rig: the oracle with several sizes of
its gains, and the commands of `cablebench.bound.upper_bound`. On tasks of suite v1 the oracle has ideal sensors, and
one of the oracles is spared the effects that it is not told of; the search begins from the best commands of oracles and
of the laws in `cablebench.bound.candidates.LAWS`, so that none of these is ahead of the bound.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.provenance import versions
from cable_envs.sim.registered import setup_of
from cablebench.bound import Bound, upper_bound
from cablebench.bound.candidates import oracles, staying, without_effects
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.failures import broken, scored_error
from cablebench.protocol.protocol import Protocol, Task, Track
from cablebench.run.evaluation import Progress, evaluate
from cablebench.score.anchors import Anchor, task_hash

SEARCHED = "upper-bound"
"""Name of `cablebench.bound.upper_bound` among the candidates."""

SPARED = "spared"
"""Before the name of an oracle that plays the rigs without the effects that it is not told of."""

Report = Callable[[Progress], None]


def freeze(
    protocol: Protocol,
    open_loop: Entrant,
    bounds: Sequence[Entrant],
    conditions: Sequence[tuple[Task, Track]],
    episodes: int,
    rounds: int = 0,
    progress: Report | None = None,
    keep: Callable[[Anchor], None] | None = None,
) -> list[Anchor]:
    """Anchors of conditions.

    Parameters
    ----------
    protocol : Protocol
        Says the test seeds; a track's sweeps do not count.
    open_loop : Entrant
        On tasks of suite v1 a drive that stays where it began is run beside it; the better median counts.
    bounds : sequence of Entrant
        Candidates for the bound besides the oracles of `cablebench.bound.candidates`. An episode in which one breaks a
        failure rule counts as infinitely bad.
    conditions : sequence of (Task, Track)
    episodes : int
        Of each condition.
    rounds : int
        Most rounds of `cablebench.bound.upper_bound`; 0: it is not run. On a track with sweeps it never is: there an
        anchor decides only what is survived.
    progress : callable, optional
        As of `cablebench.run.evaluate`.
    keep : callable, optional
        Called with each anchor as soon as it is made.

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
        made.append(_anchor(alone, open_loop, bounds, 0 if track.sweeps else rounds, progress))
        if keep is not None:
            keep(made[-1])
    return made


def _anchor(
    alone: Protocol, open_loop: Entrant, bounds: Sequence[Entrant], rounds: int, progress: Report | None
) -> Anchor:
    """The anchor of a protocol with one task and one track."""
    (task,), (track,) = alone.tasks, alone.tracks
    options = {**task.options, **track.options}
    of_suite = setup_of(task.env, options).conditions is not None
    zeros = _errors(alone, [open_loop, *([staying()] if of_suite else [])], progress)
    if not zeros:
        raise ConfigurationError(f"the open loop '{open_loop.name}' does not enter {task.env}")
    medians = {name: float(np.median(found)) for name, found in zeros.items()}
    least = min(medians, key=lambda name: medians[name])
    errors = _errors(alone, bounds, progress, medians[least])
    found: list[Bound] = []
    if rounds:
        if progress is not None:
            progress(Progress(0, track.episodes, f"{SEARCHED} on {task.short} {track.name}"))
        found = upper_bound(task.env, alone.seeds(track.episodes), options, rounds=rounds)
        errors[SEARCHED] = np.array([bound.rmse for bound in found])
        for name in found[0].starts:  # for a start that the search has not bettered
            errors[name] = np.array([bound.starts[name] for bound in found])
    else:
        errors |= _errors(alone, oracles(task.env, options, alone.oracle), progress, medians[least])
    told = _told(alone)
    if told.tracks != alone.tracks:
        spared = [replace(e, name=f"{SPARED} {e.name}") for e in oracles(task.env, options, alone.oracle)]
        errors |= _errors(told, spared, progress, medians[least])
    if not errors:
        raise ConfigurationError(f"no bound enters {task.env}: {', '.join(b.name for b in (*bounds,)) or alone.oracle}")
    names, table = list(errors), np.array(list(errors.values()))
    each = table.min(axis=0)
    made_by = Counter(names[k] for k in table.argmin(axis=0))
    known = [bound for bound, error in zip(found, each, strict=False) if bound.rmse <= error]
    return Anchor(
        task.env, track.name, _rounded(medians[least]), _rounded(float(np.median(each))),
        setup_of(task.env, options).output_unit, least,
        names[0] if len(names) == 1 else ", ".join(f"{name} {n}" for name, n in made_by.most_common()),
        track.episodes, alone.seeds(1)[0], task_hash(task, track), versions()["source"],
        off=_share([bound.off for bound in known]), spread=_share([bound.spread for bound in known]),
        bounds=tuple(map(_rounded, each)),
    )  # fmt: skip


def _told(alone: Protocol) -> Protocol:
    """The same episodes without the effects that the oracle is not told of."""
    (task,), (track,) = alone.tasks, alone.tracks
    options = without_effects(task.env, {**task.options, **track.options})
    return replace(alone, tracks=(replace(track, options=options),))


def _errors(
    alone: Protocol, entrants: Sequence[Entrant], progress: Report | None, open_loop: float = np.inf
) -> dict[str, np.ndarray]:
    """Errors of the episodes of those who enter, by name; infinite where one breaks a failure rule."""
    (task,), (track,) = alone.tasks, alone.tracks
    options = {**task.options, **track.options}
    applying = [e for e in entrants if e.enters(task.env, options) is not None]
    if not applying:
        return {}
    records = evaluate(alone, applying, progress=progress)
    return {e.name: np.array([_error(r["metrics"], open_loop) for r in records if r["entrant"] == e.name])
            for e in applying}  # fmt: skip


def _error(metrics: Mapping[str, Any], open_loop: float) -> float:
    return np.inf if broken(metrics, open_loop) else scored_error(metrics)


def _share(values: Sequence[float]) -> float:
    return float(f"{np.median(values):.3g}") if values else 0.0


def _rounded(error: float) -> float:
    """Six significant digits: a frozen number that people can read."""
    return float(f"{error:.6g}")
