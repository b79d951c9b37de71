"""The statistics of boards of score version 1: two-level intervals, paired comparisons, places beside the score."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats

from cablebench.board.tables import Row, Table
from cablebench.protocol.failures import RULES
from cablebench.protocol.protocol import Protocol
from cablebench.score import compare, log_score
from cablebench.score.anchors import Anchors
from cablebench.score.statistics import Scores, median, optimality_gap, worst_tenth
from cablebench.score.two_level import Draws, Plan, mean_of_tasks, task_draws, worst_rigs

RANKED = {
    "total_variation": "command travel",
    "peak_tension": "peak tension",
    "rms_tension": "RMS tension",
    "overload": "overload",
    "slack": "slack",
    "inference_us": "time an action",
}
"""Metrics with a place of their own beside the score, by the names that a board shows; less is better in all of them.
The time is that of one core: policies with threads are held to one."""

Record = Mapping[str, Any]


class TwoLevel:
    """How a board of score version 1 sums up what was scored. `cablebench.board.board.Pooled` is version 0's.

    Parameters
    ----------
    protocol : Protocol
    anchors : mapping
        `cablebench.score.anchors.anchors_of` it.
    """

    def __init__(self, protocol: Protocol, anchors: Anchors):
        self.protocol, self._anchors = protocol, anchors
        self._draws: dict[tuple[str, str, str], Draws] = {}

    def failed(self, record: Record) -> bool:
        """Whether an episode breaks a failure rule."""
        return bool(log_score.violations(record, self._anchors))

    def violations(self, records: Sequence[Record]) -> dict[str, int]:
        """How many episodes break each rule; rules that none breaks are absent."""
        names = [name for r in records for name in log_score.violations(r, self._anchors)]
        return {rule.__name__: names.count(rule.__name__) for rule in RULES if rule.__name__ in names}

    def survival(self, record: Record, score: float) -> float:
        """1 where the episode of a sweep was survived, else 0; NaN without a score."""
        if not math.isfinite(score):
            return math.nan
        return float(log_score.survived(record, score, self.protocol, self._anchors))

    def row(self, row: Row, scores: Scores, paper: str, opponent: Scores, track: str) -> Row:
        """The row with the statistics of its scores."""
        plan, flat = self._plan(track), np.concatenate([np.ravel(s) for s in scores.values()])
        better = compare.improvement(row.entrant, scores, paper, opponent, plan) if opponent else None
        return replace(
            row,
            score=mean_of_tasks(self._of(row.entrant, scores, track), plan.level, self.protocol.worst_score),
            median=float(median(flat)),
            optimality_gap=float(np.mean([optimality_gap(np.ravel(s)) for s in scores.values()])),
            worst_tenth=worst_rigs(scores, worst_tenth),
            improvement=None if better is None else better.value,
            improvement_interval=None if better is None else better.ends,
        )

    def table(self, table: Table) -> Table:
        """The table with the places of its rows in `RANKED`, and every two of them compared."""
        scored = [r for r in table.rows if r.score is not None]
        draws = {
            r.entrant: self._of(r.entrant, {k: np.array(v) for k, v in r.scores.items()}, table.track) for r in scored
        }
        level = self.protocol.level
        found = compare.pairs(draws, level)
        rows = table.rows if table.tasks > 1 else _with_places(table.rows)
        return replace(table, rows=rows, pairs=found, separated=compare.separated(found, level), score_version=1)

    def agreement(self, tables: Sequence[Table]) -> tuple[dict[str, Any], ...]:
        """For each track Kendall's tau between the tasks: by pair, and the mean."""
        result = []
        for track in dict.fromkeys(t.track for t in tables):
            scores = {
                t.task: {r.entrant: r.score.value for r in t.rows if r.score is not None}
                for t in tables if t.track == track
            }  # fmt: skip
            tau = compare.kendall(scores)
            if tau:
                listed = [{"tasks": list(pair), "tau": value} for pair, value in tau.items()]
                result.append({"track": track, "mean": float(np.mean(list(tau.values()))), "pairs": listed})
        return tuple(result)

    def _plan(self, track: str) -> Plan:
        p = self.protocol
        return Plan(f"{p.name} {track}", p.bootstrap_seed, p.resamples, p.level)

    def _of(self, entrant: str, scores: Scores, track: str) -> list[Draws]:
        """The resamples of each task, made once."""
        for task, table in scores.items():
            if (entrant, task, track) not in self._draws:
                self._draws[entrant, task, track] = task_draws(entrant, task, table, self._plan(track))
        return [self._draws[entrant, task, track] for task in scores]


def _with_places(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Rows with their places, from 1, in each of `RANKED`; equals share the better one."""
    places: dict[str, dict[str, float]] = {r.entrant: {} for r in rows}
    for name in RANKED:
        known = [r for r in rows if math.isfinite(r.raw.get(name, math.nan))]
        for r, place in zip(known, stats.rankdata([r.raw[name] for r in known], method="min"), strict=True):
            places[r.entrant][name] = float(place)
    return tuple(replace(r, places=places[r.entrant]) for r in rows)


def merged_places(rows: Sequence[Row]) -> dict[str, float]:
    """Of one entrant's rows the mean place in each of `RANKED`, where every task has one."""
    return {
        name: float(np.mean([r.places[name] for r in rows])) for name in RANKED if all(name in r.places for r in rows)
    }


def merged_robustness(rows: Sequence[Row]) -> float | None:
    """The mean robust score of one entrant's rows; None where a task has none."""
    known = [r.robustness for r in rows if r.robustness is not None]
    return float(np.mean(known)) if len(known) == len(rows) else None


def merged_violations(rows: Sequence[Row]) -> dict[str, int]:
    """Episodes that break each rule, of all of one entrant's rows."""
    names = [rule.__name__ for rule in RULES]
    return {n: sum(r.violations.get(n, 0) for r in rows) for n in names if any(n in r.violations for r in rows)}


def robust_scores(sweeps: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], float]:
    """(task, entrant) -> mean over the task's sweeps of the share of their values that was survived."""
    found: dict[tuple[str, str], list[float]] = {}
    for s in sweeps:
        found.setdefault((s["task"], s["entrant"]), []).append(s["robustness"])
    return {key: float(np.mean(values)) for key, values in found.items() if all(map(math.isfinite, values))}
