"""What stands in the cells of a board's tables, the same on the terminal, in Markdown and on the page."""

import math
from collections.abc import Iterable, Mapping

from cable_envs.core.text import count
from cablebench.board.suite import RANKED
from cablebench.board.tables import Board, Row, Table
from cablebench.entrants.entrant import BUDGETS
from cablebench.protocol.metrics import METRICS
from cablebench.protocol.units import shown, unit_of

MAIN_METRICS = {True: ("rmse", "settling_5", "steady_state_error"), False: ("rmse", "max_error", "reversal_error")}
"""Raw metrics beside the score: for step tasks, for others."""

PRICED = ("priced_rmse", "rmse", "max_error")
"""The same for tasks that are scored by the priced error."""


SUITE = "Suite"
"""What a table over the tasks of all mechanisms is called."""


def heading(table: Table) -> str:
    """What a table is about, in words."""
    return f"{table.task or f'{table.family or SUITE}: all {table.tasks} tasks'} ({table.track} track)"


def main_metrics(task: str, raw: Iterable[Mapping[str, float]]) -> tuple[str, ...]:
    """The raw metrics beside the score of a task, by its short name and the metrics of its entrants."""
    if any(math.isfinite(known.get("priced_rmse", math.nan)) for known in raw):
        return PRICED
    return MAIN_METRICS["Step" in task] if task else ()


def interval(row: Row) -> str:
    """As "0.91 [0.88, 0.94]", with * where the interval is over episodes of a single run; a dash without score."""
    if row.score is None:
        return "–"
    s = row.score
    return f"{_two(s.value)} [{_two(s.low)}, {_two(s.high)}]" + ("*" if s.single else "")


def cells(table: Table) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the compact table that terminal and Markdown show."""
    metrics = main_metrics(table.task, (row.raw for row in table.rows))
    if table.score_version:
        return _suite_cells(table, metrics)
    head = ["#", "controller", "class", "score (IQM)", "worst 10 %", "> paper"]
    head += [f"{_label(m)} [{unit_of(m, table)}]" for m in metrics] + ["failed", "env steps", "trials", "ident."]
    body = []
    for row in table.rows:
        line = [
            str(row.rank),
            row.entrant,
            row.information,
            interval(row),
            _two(row.worst_tenth),
            _percent(row.improvement),
        ]
        line += [_value(row, m, table) for m in metrics]
        line += [f"{row.failures}/{row.runs * row.episodes}", *(count(row.charged.get(k, 0)) for k in BUDGETS)]
        body.append(line)
    return head, body


def _suite_cells(table: Table, metrics: tuple[str, ...]) -> tuple[list[str], list[list[str]]]:
    """The same for score version 1."""
    head = ["#", "controller", "class", "score", "worst rigs", "robust", "> paper"]
    head += [f"{_label(m)} [{unit_of(m, table)}]" for m in metrics]
    head += [f"{name} [{unit_of(m, table)}]" if table.task else name for m, name in RANKED.items()]
    head += ["failed", "env steps", "trials", "ident."]
    body = []
    for row in table.rows:
        line = [str(row.rank), row.entrant, row.information, interval(row), _two(row.worst_tenth)]
        line += [_percent(row.robustness), improvement(row)]
        line += [_value(row, m, table) for m in metrics]
        line += [placed(row, m, table) for m in RANKED]
        line += [failures(row), *(count(row.charged.get(k, 0)) for k in BUDGETS)]
        body.append(line)
    return head, body


def improvement(row: Row) -> str:
    """Probability of improvement over the papers' controller in per cent, as "73 % [60, 84]"; a dash without it."""
    if row.improvement is None or row.improvement_interval is None:
        return _percent(row.improvement)
    low, high = row.improvement_interval
    return f"{100 * row.improvement:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def placed(row: Row, metric: str, table: Table) -> str:
    """A raw value with its place in the table in brackets; over several tasks the mean place alone."""
    place = row.places.get(metric)
    if table.tasks > 1:
        return "–" if place is None else f"({place:.1f})"
    text = shown(row.raw[metric], metric, table)
    return text if place is None else f"{text} ({place:.0f})"


def failures(row: Row) -> str:
    """As "12/50 (overload 9, dropped 3)": failed episodes of all, and the rules that they break."""
    broken = ", ".join(f"{name} {n}" for name, n in row.violations.items())
    return f"{row.failures}/{row.runs * row.episodes}" + (f" ({broken})" if broken else "")


def remarks(table: Table) -> list[str]:
    """Sentences below a table: who is not in it, and how many pairs of its rows differ."""
    found = []
    if table.omitted:
        found.append(f"Not in this table because they did not run all tasks: {', '.join(table.omitted)}.")
    if table.pairs:
        found.append(f"Pairs that differ, after Holm's correction: {table.separated} of {len(table.pairs)}.")
    return found


def agreement(board: Board) -> list[str]:
    """For each track a sentence on how alike its tasks rank."""
    found = []
    for track in board.agreement:
        ordered = sorted(track["pairs"], key=lambda p: p["tau"])
        ends = "; ".join(
            f"{word} {p['tau']:.2f}, {' and '.join(p['tasks'])}"
            for word, p in (("lowest", ordered[0]), ("highest", ordered[-1]))
        )
        found.append(
            f"Kendall's tau between the rankings of two tasks, {track['track']} track: mean {track['mean']:.2f} over "
            f"{len(ordered)} pairs of tasks ({ends})."
        )
    return found


def _value(row: Row, metric: str, table: Table) -> str:
    """A raw value; a settling time that most episodes did not reach is a lower bound and marked so."""
    text = shown(row.raw[metric], metric, table)
    return f"> {text}" if censored(row, metric) else text


def censored(row: Row, metric: str) -> bool:
    """Whether the median settling time is a lower bound only."""
    return row.raw.get(f"{metric}_censored", 0.0) >= 0.5


def _label(name: str) -> str:
    return next(m.label for m in METRICS if m.name == name)


def _two(value: float | None) -> str:
    return "–" if value is None else f"{round(value, 2) + 0.0:.2f}"  # never -0.00


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def seed_text(seeds: tuple[int, ...]) -> str:
    """As "2000000-2000009" for a run of seeds, otherwise all of them; "none" for none."""
    if not seeds:
        return "none"
    if len(seeds) > 1 and seeds[-1] - seeds[0] == len(seeds) - 1:
        return f"{seeds[0]}-{seeds[-1]}"
    return ", ".join(map(str, seeds))
