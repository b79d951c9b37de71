"""The HTML page of a board: figures, bars and table cells for templates/board.html.j2. No network, one file."""

import math
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from cable_envs.core.text import count, number
from cable_envs.drawing import pages
from cable_envs.plants import title_of
from cablebench.board import figures, stress_figures
from cablebench.board.cells import MAIN_METRICS, censored, seed_text
from cablebench.board.learning import Curve
from cablebench.board.scoring import GAP_FLOOR
from cablebench.board.tables import Board, Row, Table
from cablebench.entrants.entrant import BUDGETS, INFORMATION
from cablebench.protocol.metrics import METRICS
from cablebench.protocol.units import shown, unit_of

_SHOWN_TRAJECTORIES = 4
_RAW = tuple(m for m in METRICS if not m.name.endswith("_censored") and m.name not in ("failed", "peak_tension"))


def render_html(
    board: Board, trajectories: Callable[[str], Mapping[str, Any]] | None = None, curves: Sequence[Curve] = ()
) -> str:
    """The page as text. ``trajectories``: run key -> {"median": arrays, "worst": arrays}."""
    from markupsafe import Markup

    style = figures.styles(board)
    content = {
        "board": board,
        "names": board.entrants,
        "style": style,
        "board_name": board.protocol.name,
        "remarks": Markup(_markdown(board.remarks)),
        "tasks": list(dict.fromkeys(t.task for t in board.tables)),
        "tracks": list(dict.fromkeys(t.track for t in board.tables)),
        "classes": [c for c in INFORMATION if any(r.information == c for t in board.tables for r in t.rows)],
        "script": Markup(files("cablebench.board").joinpath("templates/board.js").read_text(encoding="utf-8")),
        "level": f"{100 * board.protocol.level:g}",
        "worst": number(board.protocol.worst_score),
        "floor": number(100 * GAP_FLOOR),
        "papers": ", ".join(f"{name} for {title_of(f)}" for f, name in board.protocol.paper.items()) or "none named",
        "bar_axis": Markup(_bar_axis()),
        "metrics": [{"label": m.label, "unit": m.unit.format(y="y", u="u"), "meaning": m.meaning} for m in METRICS],
        "seeds": seed_text(board.seeds),
        "training_seeds": seed_text(board.training_seeds),
        "matrices": _matrices(board),
        "families": [
            _family(board, f, style, trajectories, curves, Markup)
            for f in dict.fromkeys(t.family for t in board.tables)
        ],
    }
    return pages.render("cablebench.board", "templates/board.html.j2", content)


def _papers(board: Board) -> str:
    """The papers' controllers and their mechanisms, in words."""
    return ", ".join(f"{name} for {title_of(f)}" for f, name in board.protocol.paper.items()) or "none named"


def _anchor(task: str) -> str:
    return "task-" + task.lower()


def _matrices(board: Board) -> list[dict[str, Any]]:
    """For each track the entrants' scores on all tasks, coloured."""
    result = []
    for track in dict.fromkeys(t.track for t in board.tables):
        tables = [t for t in board.tables if t.track == track]
        known = {(t.task, r.entrant): r for t in tables for r in t.rows}
        rows, previous = [], None
        classes = {r.entrant: r.information for t in tables for r in t.rows}
        for name in (n for n in board.entrants if n in classes):
            line = [_shade(known.get((t.task, name))) for t in tables]
            rows.append(
                {
                    "name": name,
                    "information": classes[name],
                    "cells": line,
                    "heading": classes[name] if classes[name] != previous else "",
                }
            )
            previous = classes[name]
        tasks = [{"task": t.task, "anchor": _anchor(t.task), "lines": _lines(t.task)} for t in tables]
        result.append({"name": track, "tasks": tasks, "rows": rows})
    return result


def _lines(task: str) -> tuple[str, str]:
    """``"CableHole-Position-Step"`` as ``("CableHole", "Position Step")``."""
    first, _, rest = task.partition("-")
    return first, rest.replace("-", " ")


def _shade(row: Row | None) -> dict[str, str]:
    """A cell from white (score 0 and below) to blue (1 and above); dark text on light, white on dark."""
    if row is None or row.score is None:
        return {"text": "–", "colour": "#f5f7f8", "ink": "#5b6770"}
    share = min(max(row.score.value, 0.0), 1.0) ** 1.5
    colour = tuple(round(a + (b - a) * share) for a, b in zip((244, 247, 250), (27, 108, 168), strict=True))
    ink = "#a8321f" if row.score.value < -0.05 else "#ffffff" if share > 0.55 else "#1f2933"
    return {
        "text": f"{row.score.value:.2f}".replace("-", "−"),
        "colour": "#{:02x}{:02x}{:02x}".format(*colour),
        "ink": ink,
    }


def _markdown(text: str) -> str:
    """CommonMark with tables as HTML; HTML in the text is shown as text, links to scripts are dropped."""
    if not text.strip():
        return ""
    from markdown_it import MarkdownIt

    return MarkdownIt("commonmark", {"html": False}).enable("table").render(text)


def _family(
    board: Board, family: str, style: figures.Style, trajectories: Any, curves: Sequence[Curve], markup: Any
) -> dict[str, Any]:
    overall = [t for t in board.overall if t.family == family]
    tables = [t for t in board.tables if t.family == family]
    tasks = [
        _task(board, [t for t in tables if t.task == name], style, trajectories, curves, markup)
        for name in dict.fromkeys(t.task for t in tables)
    ]
    scored = [t for t in overall or tables if any(r.score for r in t.rows)]
    return {
        "name": family,
        "title": title_of(family),
        "overall": [_view(t, style, markup) for t in overall],
        "profile": markup(figures.profile(scored, style)) if scored else "",
        "tasks": tasks,
    }


def _task(
    board: Board,
    tables: Sequence[Table],
    style: figures.Style,
    trajectories: Any,
    curves: Sequence[Curve],
    markup: Any,
) -> dict[str, Any]:
    first = tables[0]
    drawn = []
    for table in tables:
        rows, found = _typical(table, trajectories, board)
        if rows:
            drawn.append({"track": table.track, "svg": markup(figures.trajectories(table, rows, found, style))})
    return {
        "task": first.task,
        "name": first.task.replace("-", " · "),
        "anchor": _anchor(first.task),
        "env_id": first.env_id,
        "output_unit": first.output_unit,
        "command_unit": first.command_unit,
        "tables": [_view(t, style, markup) for t in tables],
        "effort": markup(figures.effort(tables, style)),
        "phases": markup(figures.phases(tables, style)),
        "sweeps": markup(figures.sweeps(board, first.task, style)),
        "radar": markup(stress_figures.radar(board, first.task, style)),
        "robustness": _robustness(board, tables),
        "learning": markup(stress_figures.learning(curves, first.task, style)),
        "trajectories": drawn,
        "replay": [
            {"name": r.entrant, "information": r.information, "track": t.track, "command": board.replay(t, r)}
            for t in tables
            for r in t.rows
        ],
    }


def _robustness(board: Board, tables: Sequence[Table]) -> dict[str, Any] | None:
    """The radar's numbers for every entrant: mean score over each sweep, and the lowest in it."""
    values = stress_figures.robustness(board, tables[0].task)
    classes = {r.entrant: r.information for t in tables for r in t.rows}
    sweeps = sorted({sweep for found in values.values() for sweep in found})
    if not sweeps:
        return None

    def cell(found: Mapping[str, tuple[float, float]], sweep: str) -> dict[str, Any]:
        mean, least = found.get(sweep, (math.nan, math.nan))
        text = "–" if math.isnan(mean) else f"{mean:.2f} ({least:.2f})".replace("-", "−")
        return {"text": text, "value": mean}

    rows = [
        {"name": name, "information": classes.get(name, ""), "cells": [cell(found, s) for s in sweeps]}
        for name, found in values.items()
    ]
    return {"sweeps": sweeps, "rows": rows}


def shown_runs(board: Board) -> set[str]:
    """Keys of the runs whose trajectories the page draws."""
    return {row.trajectory for table in board.tables for row in _worth_drawing(table, board)}


def _worth_drawing(table: Table, board: Board) -> list[Row]:
    """Up to four rows: the papers' controller, the best of each class, then the rest by rank."""
    wanted = [r for r in table.rows if r.entrant == table.paper]
    wanted += [r for r in table.rows if r.rank == 1]
    wanted += [r for r in table.rows if r.charged.get("environment_steps")]
    wanted += [r for r in table.rows if r.entrant != board.protocol.open_loop]
    chosen: dict[str, Row] = {}
    for row in wanted:
        if len(chosen) < _SHOWN_TRAJECTORIES:
            chosen.setdefault(row.entrant, row)
    return list(chosen.values())


def _typical(table: Table, trajectories: Any, board: Board) -> tuple[list[Row], list[Mapping[str, Any]]]:
    """The rows worth drawing of which trajectories were kept, and those."""
    if trajectories is None:
        return [], []
    pairs = {row.entrant: trajectories(row.trajectory) for row in _worth_drawing(table, board)}
    rows = [row for row in table.rows if pairs.get(row.entrant)]
    return rows, [pairs[row.entrant] for row in rows]


def _view(table: Table, style: figures.Style, markup: Any) -> dict[str, Any]:
    """A table for the template: columns with units, rows by information class, cells with text and sorting value."""
    metrics = MAIN_METRICS["Step" in table.task] if table.task else ()
    columns = [
        {"key": "runs", "label": "runs", "unit": "seeds", "title": "training seeds"},
        {"key": "score", "label": "score", "unit": "IQM", "title": "interquartile mean"},
        {"key": "median", "label": "median", "unit": "", "title": "median score"},
        {"key": "gap", "label": "gap", "unit": "", "title": "optimality gap: mean shortfall below 1"},
        {
            "key": "worst_tenth",
            "label": "worst 10\N{NO-BREAK SPACE}%",
            "unit": "CVaR",
            "title": "mean of the lowest tenth of the scores",
        },
        {
            "key": "improvement",
            "label": "better than",
            "unit": "paper, %",
            "title": "probability of improvement over the papers' controller",
        },
        *({"key": m, "label": _label(m), "unit": unit_of(m, table), "title": _meaning(m)} for m in metrics),
        {"key": "failed", "label": "failed", "unit": "episodes", "title": "episodes that did not run to their end"},
        {"key": "environment_steps", "label": "env", "unit": "steps", "title": "environment steps charged"},
        {"key": "tuning_trials", "label": "tuning", "unit": "trials", "title": "tuning trials charged"},
        {
            "key": "identification_samples",
            "label": "ident.",
            "unit": "samples",
            "title": "identification samples charged",
        },
    ]
    groups = [
        {"name": name, "rows": [_row(r, table, metrics, style, markup) for r in table.rows if r.information == name]}
        for name in INFORMATION
        if any(r.information == name for r in table.rows)
    ]
    raw = [m for m in _RAW if any(math.isfinite(r.raw.get(m.name, math.nan)) for r in table.rows)]
    caption = f"{max(r.episodes for r in table.rows)} test episodes in a run; a run is one training seed."
    if table.omitted:
        caption += f" Left out, because they did not run all {table.tasks} tasks: {', '.join(table.omitted)}."
    return {
        "track": table.track,
        "task": table.task,
        "tasks": table.tasks,
        "caption": caption,
        "columns": columns,
        "groups": groups,
        "raw_columns": [
            {"key": m.name, "label": _label(m.name), "unit": unit_of(m.name, table), "title": m.meaning} for m in raw
        ],
        "raw_rows": [
            {"name": r.entrant, "information": r.information, "cells": [_cell(r, m.name, table) for m in raw]}
            for r in table.rows
        ],
    }


def _label(name: str) -> str:
    return next(m.label for m in METRICS if m.name == name).replace(" %", "\N{NO-BREAK SPACE}%")


def _meaning(name: str) -> str:
    return next(m.meaning for m in METRICS if m.name == name)


def _cell(row: Row, name: str, table: Table) -> dict[str, Any]:
    text = shown(row.raw[name], name, table)
    return {"text": f"> {text}" if censored(row, name) else text, "value": row.raw[name], "bad": False}


def _row(row: Row, table: Table, metrics: Sequence[str], style: figures.Style, markup: Any) -> dict[str, Any]:
    def score(value: float | None) -> dict[str, Any]:
        text = "–" if value is None else f"{value:.2f}".replace("-", "−")
        return {"text": text, "value": "nan" if value is None else value, "bad": value is not None and value < 0}

    better = math.nan if row.improvement is None else 100 * row.improvement
    return {
        "name": row.entrant,
        "information": row.information,
        "rank": row.rank,
        "bar": markup(_bar(row, style[row.entrant]["color"])),
        "cells": [
            {"text": str(row.runs), "value": row.runs, "bad": False},
            score(row.score.value if row.score else None),
            score(row.median),
            score(row.optimality_gap),
            score(row.worst_tenth),
            {"text": "–" if math.isnan(better) else f"{better:.0f}", "value": better, "bad": False},
            *(_cell(row, m, table) for m in metrics),
            {"text": f"{row.failures}/{row.runs * row.episodes}", "value": row.failures, "bad": row.failures > 0},
            *({"text": count(row.charged.get(k, 0)), "value": row.charged.get(k, 0), "bad": False} for k in BUDGETS),
        ],
    }


_BAR = (-1.0, 1.25, 180, 20)
"""Axis of the interval bars: lowest and highest score, width and height in pixels."""


def _bar_x(score: float) -> float:
    low, high, width, _ = _BAR
    return round(8 + (width - 16) * (min(max(score, low), high) - low) / (high - low), 1)


def _bar_axis() -> str:
    """The axis of the bars, for the table's head."""
    width = _BAR[2]
    labels = "".join(
        f'<text x="{_bar_x(v)}" y="10" text-anchor="middle" font-size="10" fill="#5b6770">{t}</text>'
        for v, t in ((-1, "−1"), (0, "0"), (1, "1"))
    )
    return f'<svg width="{width}" height="13" viewBox="0 0 {width} 13" aria-hidden="true">{labels}</svg>'


def _bar(row: Row, colour: str) -> str:
    """The interval as a line with its point; hollow where it is over episodes of a single run."""
    if row.score is None:
        return ""
    s, (_, _, width, height), x = row.score, _BAR, _bar_x
    ticks = "".join(
        f'<line x1="{x(v)}" x2="{x(v)}" y1="1" y2="{height - 1}" stroke="{"#b9c1c7" if v in (0, 1) else "#e6eaed"}"/>'
        for v in (-1, -0.5, 0, 0.5, 1)
    )
    fill = "#ffffff" if s.unit == "episodes" else colour
    middle = height // 2
    return (
        f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{s.value:.2f}, interval {s.low:.2f} to {s.high:.2f}, over {s.unit}">{ticks}'
        f'<line x1="{x(s.low)}" x2="{x(s.high)}" y1="{middle}" y2="{middle}" stroke="{colour}" stroke-width="3" '
        f'stroke-linecap="round"/>'
        f'<circle cx="{x(s.value)}" cy="{middle}" r="4" fill="{fill}" stroke="{colour}" stroke-width="2"/></svg>'
    )
