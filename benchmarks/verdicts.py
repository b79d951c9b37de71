"""What the errors of `benchmarks.headroom` say: scores with intervals, verdicts, and the table of docs/suite.md.

    score = ln(e0 / e) / ln(e0 / e1), at least -1, and -1 where a rule has ended the episode

as `cablebench.score.log_score` has it. e0 is the median error of doing nothing and e1 that of the bound.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from cable_envs.sim.registered import setup_of
from cablebench.score.compare import Pair, kendall, paired, pairs, separated
from cablebench.score.log_score import log_score
from cablebench.score.two_level import Draws, Plan, mean_of_tasks, task_draws

OPEN, ORACLE, NOTHING, CLASSICAL, AGENT = "open-loop", "oracle", "nothing", "classical", "agent"
ENOUGH, WORST, LEVEL = 0.8, -1.0, 0.95
PLAN = Plan("headroom")


@dataclass(frozen=True)
class Row:
    """One entrant on one task: the errors of its episodes, SI (infinite where a rule has ended one), and its part."""

    entrant: str
    part: str
    errors: tuple[float, ...]
    failures: tuple[str, ...]

    @property
    def median(self) -> float:
        """The median error; infinite where half of the episodes have failed."""
        return float(np.median(self.errors))


@dataclass(frozen=True)
class Verdict:
    """What one task says."""

    ends: tuple[float, float]
    """e0 and e1, SI"""
    best: Mapping[str, Row]
    """by part"""
    draws: Mapping[str, Draws]
    """by entrant"""
    pairs: tuple[Pair, ...]
    """of the classical controllers, the agent and the best oracle, with Holm's correction"""
    discriminates: bool | None
    """None where no classical controller enters"""


def ends(rows: list[Row], anchors: tuple[float, float] | None = None) -> tuple[float, float]:
    """e0 and e1: ``anchors``, or the least medians of those that do nothing and of the oracle's sizes."""
    if anchors is not None:
        return anchors
    e0 = min(row.median for row in rows if row.part == NOTHING)
    e1 = min(row.median for row in rows if row.part == ORACLE)
    if not e1 < e0 < math.inf:
        raise ValueError(f"doing nothing has {e0:g}, the oracle {e1:g}: there is nothing to win")
    return e0, e1


def scores(row: Row, between: tuple[float, float]) -> np.ndarray:
    """Scores of the episodes of a row."""
    return np.array([WORST if math.isinf(e) else log_score(e, *between, worst=WORST) for e in row.errors])


def verdict(env_id: str, rows: list[Row], anchors: tuple[float, float] | None = None) -> Verdict:
    """The best of each part, every pair compared, and whether the task discriminates.

    It does where the intervals of the differences between the best classical controller, the agent and the oracle,
    episode by episode, leave out zero, and the better one of the two first is below `ENOUGH`.
    """
    between = ends(rows, anchors)
    draws = {row.entrant: task_draws(row.entrant, env_id, scores(row, between)[None], PLAN) for row in rows}
    best: dict[str, Row] = {}
    for row in rows:
        if row.part not in best or draws[row.entrant].value > draws[best[row.part].entrant].value:
            best[row.part] = row
    ranked = [row for row in rows if row.part in (CLASSICAL, AGENT) or row is best.get(ORACLE)]
    entered = {row.entrant: [draws[row.entrant]] for row in ranked}
    chosen = [best[part].entrant for part in (CLASSICAL, AGENT, ORACLE) if part in best]
    chosen.sort(key=lambda name: draws[name].value)
    steps = [paired(b, [draws[b]], a, [draws[a]], LEVEL) for a, b in pairwise(chosen)]
    others = [draws[best[part].entrant].value for part in (CLASSICAL, AGENT) if part in best]
    clear = all(step.low > 0.0 for step in steps) and max(others, default=1.0) < ENOUGH
    return Verdict(between, best, draws, pairs(entered, LEVEL), clear if CLASSICAL in best else None)


def table(results: Mapping[str, list[Row]], anchors: Mapping[str, tuple[float, float]]) -> str:
    """The results as Markdown: the table, then how the tasks rank against each other."""
    lines = [
        "| task | episodes | doing nothing | best classical | PPO trained for it | bound | pairs | discriminates |",
        "|---|--:|--:|---|---|--:|--:|---|",
    ]
    found = {env_id: verdict(env_id, rows, anchors.get(env_id)) for env_id, rows in results.items()}
    for env_id, one in found.items():
        unit = setup_of(env_id, {}).output_unit
        cells = [str(len(results[env_id][0].errors)), f"{one.ends[0]:.3g} {unit}"]
        cells += [_cell(one, part, unit) for part in (CLASSICAL, AGENT)]
        cells += [f"{one.ends[1]:.3g} {unit}", f"{separated(one.pairs, LEVEL)} of {len(one.pairs)}"]
        says = {True: "yes", False: "no", None: "none enters"}[one.discriminates]
        lines.append(f"| {env_id.split('/')[1].removesuffix('-v1')} | {' | '.join(cells)} | {says} |")
    return "\n".join([*lines, "", *_between(found)])


def _cell(one: Verdict, part: str, unit: str) -> str:
    row = one.best.get(part)
    if row is None:
        return "none"
    known = mean_of_tasks([one.draws[row.entrant]], LEVEL, WORST)
    name = "" if part == AGENT else f"{row.entrant.removesuffix('-suite')} "
    error = f"{row.median:.3g} {unit}" if math.isfinite(row.median) else "failed"
    text = f"{name}{error}, {known.value:.2f} [{known.low:.2f}, {known.high:.2f}]"
    return text + (f", {len(row.failures)} failed" if row.failures else "")


def _between(found: Mapping[str, Verdict]) -> list[str]:
    """Sentences about all tasks together."""
    ranks = {
        env_id: {name: one.draws[name].value for name in one.draws if not name.startswith((ORACLE, NOTHING))}
        for env_id, one in found.items()
    }
    taus = kendall(ranks)
    total = sum(len(one.pairs) for one in found.values())
    apart = sum(separated(one.pairs, LEVEL) for one in found.values())
    said = [f"Over all tasks {apart} of {total} pairs of entrants are separated (Holm's correction within each task)."]
    for title, same in (("of one mechanism", True), ("of different levels of one task", None)):
        kept = [tau for (a, b), tau in taus.items() if _alike(a, b, same)]
        if kept:
            low, middle, high = np.quantile(kept, [0.0, 0.5, 1.0])
            said.append(
                f"Kendall's tau between two tasks {title}: median {middle:.2f}, from {low:.2f} to {high:.2f} "
                f"({len(kept)} pairs of tasks)."
            )
    return said


def _alike(a: str, b: str, same: bool | None) -> bool:
    names = [name.split("/")[1].split("-") for name in (a, b)]
    if same is None:
        return names[0][:2] == names[1][:2]
    return (names[0][0] == names[1][0]) is same


def rows_of(content: Mapping[str, Any]) -> list[Row]:
    """The rows that a file of results holds for one task, on the episodes that all of them have."""
    common = min((len(one["errors"]) for one in content.values() if one["part"] != ORACLE), default=0)
    found = []
    for name, one in content.items():
        errors = tuple(math.inf if e is None else e for e in one["errors"][:common])
        if len(errors) == common:
            found.append(Row(name, one["part"], errors, tuple(one["failures"][: sum(map(math.isinf, errors))])))
    return found
