"""What stands in the cells of a board's tables, the same on the terminal, in Markdown and on the page."""

from cable_envs.core.text import count
from cablebench.board.tables import Row, Table
from cablebench.entrants.entrant import BUDGETS
from cablebench.protocol.metrics import METRICS
from cablebench.protocol.units import shown, unit_of

MAIN_METRICS = {True: ("rmse", "settling_5", "steady_state_error"), False: ("rmse", "max_error", "reversal_error")}
"""Raw metrics beside the score: for step tasks, for others."""


def heading(table: Table) -> str:
    """What a table is about, in words."""
    return f"{table.task or f'{table.family}: all {table.tasks} tasks'} ({table.track} track)"


def interval(row: Row) -> str:
    """As "0.91 [0.88, 0.94]", with * where the interval is over episodes of a single run; a dash without score."""
    if row.score is None:
        return "–"
    s = row.score
    return f"{s.value:.2f} [{s.low:.2f}, {s.high:.2f}]" + ("*" if s.unit == "episodes" else "")


def cells(table: Table) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the compact table that terminal and Markdown show."""
    metrics = MAIN_METRICS["Step" in table.task] if table.task else ()
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
    return "–" if value is None else f"{value:.2f}"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def seed_text(seeds: tuple[int, ...]) -> str:
    """As "2000000-2000009" for a run of seeds, otherwise all of them; "none" for none."""
    if not seeds:
        return "none"
    if len(seeds) > 1 and seeds[-1] - seeds[0] == len(seeds) - 1:
        return f"{seeds[0]}-{seeds[-1]}"
    return ", ".join(map(str, seeds))
