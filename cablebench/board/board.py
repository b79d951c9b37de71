"""From store records to a ranked board."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cablebench.board.history import history, newest_date
from cablebench.board.notes import notes
from cablebench.board.scoring import Record, belonging, episode_key, latest, score_episodes, whole_runs
from cablebench.board.suite import (
    TwoLevel,
    merged_places,
    merged_robustness,
    merged_violations,
    robust_scores,
)
from cablebench.board.tables import Board, Row, Table
from cablebench.entrants.entrant import INFORMATION
from cablebench.protocol.failures import scored_error
from cablebench.protocol.metrics import METRICS
from cablebench.protocol.protocol import Protocol
from cablebench.run.makers import told_apart
from cablebench.score.anchors import anchors_of
from cablebench.score.statistics import (
    Scores,
    bootstrap,
    interquartile_mean,
    median,
    optimality_gap,
    probability_of_improvement,
    worst_tenth,
)


def build_board(
    protocol: Protocol, records: Iterable[Record], remarks: str = "", place: str = "", left_out: str = ""
) -> Board:
    """A ranked board from a store's records.

    Parameters
    ----------
    protocol : Protocol
        Whose board it is; records of other configurations are left out and counted in the notes.
    records : iterable of mapping
        As `ResultStore.records` gives them. Of an episode that was run twice the newer record counts.
    remarks : str
        Shown on the board, Markdown.
    place : str
        Flags of the command line that name the store, for the commands that replay a row.
    left_out : str
        What of the store could not be used (`cablebench.run.store.Reading.remark`); a note on the board.

    Returns
    -------
    Board
        The same one for the same records: its draws come from generators with the protocol's ``bootstrap_seed``.

    Raises
    ------
    ConfigurationError
        When no whole run belongs to the protocol, and when its anchors are of other versions of the tasks.
    """
    everything = list(records)
    configuration = protocol.hash()
    own, foreign = belonging([r for r in everything if r["protocol_hash"] == configuration], protocol)
    reserved = (protocol.open_loop, protocol.oracle, *protocol.paper.values())
    own, incomplete = whole_runs(latest(told_apart(own, reserved)))
    if not own:
        raise ConfigurationError(
            f"the store has no whole run of protocol '{protocol.name}' (configuration {configuration}); "
            "run `cablebench evaluate`"
        )
    anchors = anchors_of(protocol) if protocol.score_version else {}
    summary = TwoLevel(protocol, anchors) if protocol.score_version else Pooled(protocol)
    scored = [(r, s) for r, s in zip(own, score_episodes(own, protocol, anchors), strict=True)]
    sweeps = _sweeps(scored, summary)
    order = {t.short: i for i, t in enumerate(protocol.tasks)}
    tracks = [t.name for t in protocol.tracks]
    groups: dict[tuple[str, str], list[tuple[Record, float]]] = {}
    for record, score in scored:
        if not (protocol.score_version and record.get("sweep")):  # what is survived there is a column, not a table
            groups.setdefault((record["task"], record["track"]), []).append((record, score))
    if not groups:
        raise ConfigurationError(f"the store has records of the sweeps of '{protocol.name}' only: run its other tracks")
    keys = sorted(groups, key=lambda k: (order.get(k[0], len(order)), tracks.index(k[1])))
    robust = robust_scores(sweeps) if protocol.score_version else {}
    tables = tuple(_table(groups[k], protocol, summary, robust) for k in keys)
    if protocol.score_version:
        listed = {(t.task, r.entrant) for t in tables for r in t.rows}
        sweeps = tuple(s for s in sweeps if (s["task"], s["entrant"]) in listed)
    return Board(
        protocol=protocol,
        tables=tables,
        overall=_overall(tables, protocol, summary),
        created=newest_date(own),
        configuration=configuration,
        versions={name: version for r in own for name, version in r["versions"].items()},
        machine=own[-1].get("machine", ""),
        seeds=tuple(sorted({r["seed"] for r in own})),
        training_seeds=tuple(sorted({r["training_seed"] for r in own if r["training_seed"] is not None})),
        episodes=len(own),
        notes=(*notes(everything, own, incomplete, tables, protocol), *_left_out(left_out, foreign)),
        sweeps=sweeps,
        remarks=remarks,
        place=place,
        anchors=tuple(anchors.values()),
        agreement=summary.agreement(tables),
        history=history(own),
    )


class Pooled:
    """How a board of score version 0 sums up what was scored; `cablebench.board.suite.TwoLevel` is version 1's.

    Its intervals draw one after the other from one generator.
    """

    def __init__(self, protocol: Protocol):
        self._protocol, self._rng = protocol, np.random.default_rng(protocol.bootstrap_seed)

    def failed(self, record: Record) -> bool:
        """Whether an episode did not run to its end."""
        return bool(record["metrics"]["failed"])

    def violations(self, records: Sequence[Record]) -> dict[str, int]:
        """Nothing: version 0 has no failure rules."""
        return {}

    def survival(self, record: Record, score: float) -> float:
        """The score itself: robustness is its mean over a sweep."""
        return score

    def row(self, row: Row, scores: Scores, paper: str, opponent: Scores, track: str) -> Row:
        """The row with the statistics of its scores, all episodes pooled."""
        flat = np.concatenate([np.ravel(s) for s in scores.values()])
        improvement = probability_of_improvement(scores, opponent) if opponent else math.nan
        return replace(
            row,
            score=bootstrap(scores, interquartile_mean, self._rng, self._protocol.resamples, self._protocol.level),
            median=float(median(flat)),
            optimality_gap=float(optimality_gap(flat)),
            worst_tenth=float(worst_tenth(flat)),
            improvement=improvement if math.isfinite(improvement) else None,
        )

    def table(self, table: Table) -> Table:
        """The table as it is."""
        return table

    def agreement(self, tables: Sequence[Table]) -> tuple[dict[str, Any], ...]:
        """Nothing: version 0 does not compare tasks."""
        return ()


Summary = Pooled | TwoLevel


def _left_out(remark: str, foreign: int) -> list[str]:
    """What of the store is not on the board because it could not be used."""
    found = [f"{remark}."] if remark else []
    if foreign:
        found.append(f"{foreign} records of episodes that the protocol does not have were left out.")
    return found


def _table(
    scored: list[tuple[Record, float]],
    protocol: Protocol,
    summary: Summary,
    robust: Mapping[tuple[str, str], float],
) -> Table:
    first = scored[0][0]
    by_entrant: dict[str, list[tuple[Record, float]]] = {}
    for record, score in scored:
        by_entrant.setdefault(record["entrant"], []).append((record, score))
    paper = protocol.paper.get(first["family"], "")
    task = first["task"]
    arrays = {name: _score_array(items) for name, items in by_entrant.items()}
    rows = []
    for name in sorted(by_entrant):
        other = {task: arrays[paper]} if paper in arrays and name != paper else {}
        row = _row(name, [r for r, _ in by_entrant[name]], summary, robust.get((task, name)))
        rows.append(_scored(row, {task: arrays[name]}, paper, other, first["track"], summary))
    return summary.table(
        Table(
            first["family"],
            task,
            first["env_id"],
            first["track"],
            first["output_unit"],
            first["command_unit"],
            paper,
            ranked(rows),
        )
    )


def _score_array(items: list[tuple[Record, float]]) -> np.ndarray:
    """Scores [runs, episodes]: runs by training seed, episodes in the same order for every entrant of a table."""
    runs: dict[Any, dict[tuple[str, ...], float]] = {}
    for record, score in items:
        runs.setdefault(record["training_seed"] or 0, {})[tuple(map(str, episode_key(record)))] = score
    return np.array([[runs[k][e] for e in sorted(runs[k])] for k in sorted(runs)])


def _row(name: str, records: list[Record], summary: Summary, robustness: float | None) -> Row:
    complete = [r["metrics"] for r in records if not r["metrics"]["failed"]]
    return Row(
        entrant=name,
        information=records[0]["information"],
        failures=sum(map(summary.failed, records)),
        raw={m.name: _median([c.get(m.name) for c in complete]) for m in METRICS},
        charged=_charged(records),
        replay=records[-1]["replay"],
        trajectory=_typical_run(records),
        robustness=robustness,
        violations=summary.violations(records),
    )


def _scored(row: Row, scores: Scores, paper: str, opponent: Scores, track: str, summary: Summary) -> Row:
    """The row with the statistics of its scores; without them where any episode has none."""
    row = replace(
        row,
        runs=min(s.shape[0] for s in scores.values()),
        episodes=sum(s.shape[1] for s in scores.values()),
        scores={k: tuple(map(tuple, v.tolist())) for k, v in scores.items()},
    )
    if not all(np.all(np.isfinite(s)) for s in scores.values()):
        return row
    return summary.row(row, scores, paper, opponent, track)


def _median(values: list[float | None]) -> float:
    known = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.median(known)) if known else math.nan


def _charged(records: list[Record]) -> dict[str, float]:
    """Budget of one training seed (the largest, where seeds differ)."""
    names = sorted({k for r in records for k in r["charged"]})
    return {k: max(r["charged"].get(k, 0) for r in records) for k in names}


def _typical_run(records: list[Record]) -> str:
    """The run with the median error (upper median); runs with failures come last."""
    runs: dict[str, list[float]] = {}
    for r in records:
        runs.setdefault(r["run"], []).append(math.inf if r["metrics"]["failed"] else scored_error(r["metrics"]))
    ordered = sorted(runs, key=lambda k: float(np.mean(runs[k])))
    return ordered[len(ordered) // 2]


def ranked(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Rows by information class, and within it by interquartile mean score; without scores by raw RMSE.

    Parameters
    ----------
    rows : iterable of Row
        In any order.

    Returns
    -------
    tuple of Row
        With their `rank` within the class, from 1.
    """

    def place(row: Row) -> tuple[float, float, str]:
        rmse = row.raw.get("rmse", math.nan)
        return (-row.score.value if row.score else math.inf, rmse if math.isfinite(rmse) else math.inf, row.entrant)

    result: list[Row] = []
    for information in INFORMATION:
        group = sorted((r for r in rows if r.information == information), key=place)
        result += [replace(r, rank=i) for i, r in enumerate(group, 1)]
    return tuple(result)


def _overall(tables: tuple[Table, ...], protocol: Protocol, summary: Summary) -> tuple[Table, ...]:
    """For each track one table over all tasks of a mechanism, of those who ran every one, if any.

    In score version 1 there is one over all tasks of the suite before them. Tasks that the protocol does not rank are
    in none of them.
    """
    result = []
    beside = {task.short for task in protocol.tasks if not task.ranked}
    tables = tuple(t for t in tables if t.task not in beside)
    groups = [(t.family, t.track) for t in tables]
    if protocol.score_version and len({t.family for t in tables}) > 1:
        groups = [*(("", t.track) for t in tables), *groups]
    for family, track in dict.fromkeys(groups):
        group = [t for t in tables if t.track == track and family in ("", t.family)]
        if len(group) < 2:
            continue
        rows: dict[str, list[Row]] = {}
        for table in group:
            for row in table.rows:
                rows.setdefault(row.entrant, []).append(row)
        whole = {n: r for n, r in rows.items() if len(r) == len(group)}
        if not whole:
            continue
        scores = {n: {k: np.array(v) for row in r for k, v in row.scores.items()} for n, r in whole.items()}
        paper = protocol.paper.get(family, "")
        merged = [
            _scored(_merge(whole[n]), scores[n], paper, scores.get(paper, {}) if n != paper else {}, track, summary)
            for n in sorted(whole)
        ]
        omitted = tuple(sorted(set(rows) - set(whole)))
        table = Table(family, "", "", track, "", "", paper, ranked(merged), len(group), omitted)
        result.append(summary.table(table))
    return tuple(result)


def _merge(rows: list[Row]) -> Row:
    """One entrant over several tasks. Raw errors of different units are not averaged: dimensionless metrics stay."""
    common = [m.name for m in METRICS if m.unit in ("1", "us")]
    return Row(
        entrant=rows[0].entrant,
        information=rows[0].information,
        failures=sum(r.failures for r in rows),
        raw={name: _median([r.raw[name] for r in rows]) for name in common},
        charged={k: sum(r.charged.get(k, 0) for r in rows) for k in sorted({k for r in rows for k in r.charged})},
        replay=rows[0].replay,
        robustness=merged_robustness(rows),
        places=merged_places(rows),
        violations=merged_violations(rows),
    )


def _sweeps(scored: list[tuple[Record, float]], summary: Summary) -> tuple[dict[str, Any], ...]:
    """RMSE and score against the swept value for every task, sweep and entrant of a stress track.

    RMSE is NaN where all episodes failed; a failed episode has its worst score.
    """
    found: dict[tuple[str, str, str, str], dict[float, list[tuple[float, float, float]]]] = {}
    for r, score in scored:
        if r.get("sweep"):
            key = (r["task"], r["sweep"], r.get("sweep_unit", "1"), r["entrant"])
            rmse = math.nan if r["metrics"]["failed"] else r["metrics"]["rmse"]
            found.setdefault(key, {}).setdefault(r["sweep_value"], []).append((rmse, score, summary.survival(r, score)))
    result = []
    for (task, sweep, unit, entrant), points in sorted(found.items()):
        values = sorted(points)
        means, survival = ([float(np.mean([p[k] for p in points[v]])) for v in values] for k in (1, 2))
        result.append({
            "task": task, "sweep": sweep, "unit": unit, "entrant": entrant, "values": values,
            "rmse": [_median([p[0] for p in points[v]]) for v in values],
            "score": means, "robustness": float(np.mean(survival)),
        })  # fmt: skip
    return tuple(result)
