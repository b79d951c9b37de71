"""What the scores of `benchmarks.headroom` say: intervals, verdicts, and the table of docs/suite.md."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cable_envs.sim.registered import setup_of
from cablebench.score.compare import Pair, kendall, paired, pairs, separated
from cablebench.score.two_level import Draws, Plan, mean_of_tasks, task_draws

NOTHING, CLASSICAL, AGENT, BOUND = "nothing", "classical", "agent", "bound"
ENOUGH, WORST, LEVEL = 0.8, -1.0, 0.95
PLAN = Plan("suite-v1 test", 20261125)
"""The draws of the board, so that both show the same intervals."""


@dataclass(frozen=True)
class Row:
    """One entrant on one task: errors (SI) and scores of its episodes, [training seeds, rigs], and its part."""

    entrant: str
    part: str
    errors: np.ndarray
    scores: np.ndarray

    @property
    def failed(self) -> int:
        """How many episodes broke a rule, or came as low as if they had."""
        return int(np.sum(self.scores <= WORST))

    @property
    def median(self) -> float:
        """The median error of the episodes that broke no rule; NaN where all did."""
        kept = self.errors[self.scores > WORST]
        return float(np.median(kept)) if kept.size else float("nan")


@dataclass(frozen=True)
class Verdict:
    """What one task says."""

    best: Mapping[str, Row]
    """by part"""
    draws: Mapping[str, Draws]
    """by entrant"""
    pairs: tuple[Pair, ...]
    """of the classical controllers, the agent and the bound, with Holm's correction"""
    discriminates: bool | None
    """None where no classical controller enters"""


def verdict(env_id: str, rows: list[Row]) -> Verdict:
    """The best of each part, every pair compared, and whether the task discriminates.

    It does where the intervals of the differences between the best classical controller, the agent and the bound leave
    out zero, and the better one of the two first is below `ENOUGH`.
    """
    draws = {row.entrant: task_draws(row.entrant, env_id, row.scores, PLAN) for row in rows}
    best: dict[str, Row] = {}
    for row in rows:
        if row.part not in best or draws[row.entrant].value > draws[best[row.part].entrant].value:
            best[row.part] = row
    ranked = [row for row in rows if row.part != NOTHING]
    entered = {row.entrant: [draws[row.entrant]] for row in ranked}
    chosen = [best[part].entrant for part in (CLASSICAL, AGENT, BOUND) if part in best]
    chosen.sort(key=lambda name: draws[name].value)
    steps = [paired(b, [draws[b]], a, [draws[a]], LEVEL) for a, b in pairwise(chosen)]
    others = [draws[best[part].entrant].value for part in (CLASSICAL, AGENT) if part in best]
    clear = all(step.low > 0.0 for step in steps) and max(others, default=1.0) < ENOUGH
    return Verdict(best, draws, pairs(entered, LEVEL), clear if CLASSICAL in best else None)


def table(results: Mapping[str, list[Row]], anchors: Mapping[str, tuple[float, float]]) -> str:
    """The results as Markdown: the table, then how the tasks rank against each other.

    ``anchors``: median errors of doing nothing and of the bound.
    """
    lines = [
        "| task | doing nothing | best classical | PPO trained for it | bound | pairs | discriminates |",
        "|---|--:|---|---|--:|--:|---|",
    ]
    found = {env_id: verdict(env_id, rows) for env_id, rows in results.items()}
    for env_id, one in found.items():
        unit = setup_of(env_id, {}).output_unit
        nothing, bound = (f"{error:.3g} {unit}" for error in anchors[env_id])
        cells = [nothing, *(_cell(one, part, unit) for part in (CLASSICAL, AGENT)), bound]
        cells.append(f"{separated(one.pairs, LEVEL)} of {len(one.pairs)}")
        says = {True: "yes", False: "no", None: "none enters"}[one.discriminates]
        lines.append(f"| {env_id.split('/')[1].removesuffix('-v1')} | {' | '.join(cells)} | {says} |")
    return "\n".join([*lines, "", *_between(found)])


def _cell(one: Verdict, part: str, unit: str) -> str:
    row = one.best.get(part)
    if row is None:
        return "none"
    known = mean_of_tasks([one.draws[row.entrant]], LEVEL, WORST)
    name = "" if part == AGENT else f"{row.entrant.removesuffix('-suite')} "
    error = f"{row.median:.3g} {unit}" if np.isfinite(row.median) else "failed"
    seeds = f", {len(row.scores)} seeds" if part == AGENT else ""
    text = f"{name}{error}, {known.value:.2f} [{known.low:.2f}, {known.high:.2f}]{seeds}"
    return text + (f", {row.failed} of {row.scores.size} failed" if row.failed else "")


def _between(found: Mapping[str, Verdict]) -> list[str]:
    """Sentences about all tasks together."""
    ranks = {
        env_id: {name: draws.value for name, draws in one.draws.items() if name != BOUND}
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
