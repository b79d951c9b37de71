"""Scores of episodes, and which records make a row: score version 0; `cablebench.score.log_score` has version 1.

In version 0, 0 is the open loop and 1 the oracle, both on the same episode:

    score = (rmse_open_loop - rmse) / max(rmse_open_loop - rmse_oracle, GAP_FLOOR x their median distance)

A failed episode gets the protocol's worst score, and no episode gets less. Where a reference failed on an episode, its
mean over the completed episodes of the same condition stands in.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cablebench.protocol.protocol import Protocol
from cablebench.run.makers import content_of
from cablebench.score.anchors import Anchors, anchors_of
from cablebench.score.log_score import score_records

GAP_FLOOR = 0.5
"""Least denominator, as a share of the median distance between open loop and oracle in the condition: an open loop that
is lucky on one episode must not blow up everyone's score there."""

Record = Mapping[str, Any]


def latest(records: Iterable[Record]) -> list[Record]:
    """Each episode of each entrant, training seed and content once: where it was run again, the newest counts."""
    return list({(r["entrant"], r["training_seed"], content_of(r), *episode_key(r)): r for r in records}.values())


def newest(records: Iterable[Record]) -> list[Record]:
    """Of each entrant, training seed, task and track only what its newest record is of: contents are never mixed."""
    given = list(records)
    content = {_run_of(r): content_of(r) for r in given}
    return [r for r in given if content[_run_of(r)] == content_of(r)]


def _run_of(record: Record) -> tuple[Any, ...]:
    return record["task"], record["track"], record["entrant"], record["training_seed"]


def whole_runs(records: list[Record]) -> tuple[list[Record], list[str]]:
    """Records of whole runs, and the names of the runs that lack episodes.

    An evaluation that was stopped leaves such a run; ranking it on fewer episodes would compare unlike things.

    Parameters
    ----------
    records : list of mapping
        Each episode once (`latest`).

    Returns
    -------
    records : list of mapping
        Of runs that have every episode their task and track was run on; where an entrant was run with several contents,
        those of the newest.
    names : list of str
        Of the others, with how much there is.
    """
    episodes: dict[tuple[str, str], set[tuple[Any, ...]]] = {}
    runs: dict[tuple[Any, ...], list[Record]] = {}
    for r in records:
        episodes.setdefault((r["task"], r["track"]), set()).add(episode_key(r))
        runs.setdefault((*_run_of(r), content_of(r)), []).append(r)
    short = {k: run for k, run in runs.items() if len(run) < len(episodes[k[:2]])}
    names = [
        f"{entrant}{'' if seed is None else f' seed {seed}'} on {task} {track} "
        f"({len(run)} of {len(episodes[task, track])} episodes)"
        for (task, track, entrant, seed, _), run in short.items()
    ]
    whole = {id(r) for k, run in runs.items() if k not in short for r in run}
    return newest(r for r in records if id(r) in whole), names


def belonging(records: Iterable[Record], protocol: Protocol) -> tuple[list[Record], int]:
    """Records of episodes that the protocol has, and how many are of others.

    A seed or track that is not the protocol's would make everybody else's runs look incomplete.

    Parameters
    ----------
    records : iterable of mapping
        All with the protocol's hash.
    protocol : Protocol

    Returns
    -------
    records : list of mapping
        Those whose task, track, swept value and seed are the protocol's.
    others : int
        How many were left out.
    """
    seeds: dict[tuple[Any, ...], frozenset[int]] = {}
    for cell in protocol.cells(tracks=tuple(t.name for t in protocol.tracks)):
        sweep = (cell.sweep.name, cell.value) if cell.sweep else (None, None)
        seeds[(cell.task.env, cell.track.name, *sweep)] = frozenset(protocol.seeds(cell.episodes))
    given = list(records)
    kept = [r for r in given if r["seed"] in seeds.get(episode_key(r)[:-1], ())]
    return kept, len(given) - len(kept)


def episode_key(record: Record) -> tuple[Any, ...]:
    """What two records share when they are the same episode run by different entrants."""
    return record["env_id"], record["track"], record.get("sweep"), record.get("sweep_value"), record["seed"]


def score_episodes(records: list[Record], protocol: Protocol, anchors: Anchors | None = None) -> list[float]:
    """The score of each record, by the version of the score that the protocol says.

    Parameters
    ----------
    records : list of mapping
        In version 0 with those of both references.
    protocol : Protocol
        Says the version and the worst score, and names references or anchors.
    anchors : mapping, optional
        Of version 1; by default `cablebench.score.anchors.anchors_of` the protocol.

    Returns
    -------
    list of float
        NaN where, in version 0, a reference is missing or the oracle's median advantage is not positive; in version 1
        where the condition has no anchor.
    """
    if protocol.score_version:
        return score_records(records, protocol, anchors_of(protocol) if anchors is None else anchors)
    worst = _reference_errors([r for r in records if r["entrant"] == protocol.open_loop])
    best = _reference_errors([r for r in records if r["entrant"] == protocol.oracle])
    gaps: dict[tuple[Any, ...], list[float]] = {}
    for episode in worst.keys() & best.keys():
        gaps.setdefault(episode[:-1], []).append(worst[episode] - best[episode])
    floor = {condition: GAP_FLOOR * float(np.median(g)) for condition, g in gaps.items()}
    return [_score(r, worst, best, floor, protocol.worst_score) for r in records]


def _score(record: Record, worst: Mapping, best: Mapping, floor: Mapping, lowest: float) -> float:
    episode = episode_key(record)
    least = floor.get(episode[:-1], math.nan)
    if not (episode in worst and episode in best and least > 0.0):
        return math.nan
    if record["metrics"]["failed"] or record["metrics"]["rmse"] is None:
        return lowest
    gap = max(worst[episode] - best[episode], least)
    return max((worst[episode] - record["metrics"]["rmse"]) / gap, lowest)


def _reference_errors(records: list[Record]) -> dict[tuple[Any, ...], float]:
    """RMSE by episode; a failed episode takes the mean over the completed ones of its condition."""
    done: dict[tuple[Any, ...], list[float]] = {}
    for r in records:
        if not r["metrics"]["failed"]:
            done.setdefault(episode_key(r)[:-1], []).append(r["metrics"]["rmse"])
    errors = {}
    for r in records:
        condition = done.get(episode_key(r)[:-1])
        if condition:
            errors[episode_key(r)] = float(np.mean(condition)) if r["metrics"]["failed"] else r["metrics"]["rmse"]
    return errors
