"""The HTML page of a board: figures, bars and table cells for templates/board.html.j2. No network, one file."""

import math
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from cable_envs.core.text import number
from cable_envs.drawing import pages
from cable_envs.plants import title_of
from cablebench.board import figures, stress_figures
from cablebench.board.cells import agreement, seed_text
from cablebench.board.learning import Curve
from cablebench.board.page_tables import bar_axis, ranking
from cablebench.board.scoring import GAP_FLOOR
from cablebench.board.tables import Board, Row, Table
from cablebench.entrants.entrant import INFORMATION
from cablebench.protocol.failures import RULES
from cablebench.protocol.metrics import METRICS

_SHOWN_TRAJECTORIES = 4


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
        "bar_axis": Markup(bar_axis()),
        "metrics": [{"label": m.label, "unit": m.unit.format(y="y", u="u"), "meaning": m.meaning} for m in METRICS],
        "seeds": seed_text(board.seeds),
        "training_seeds": seed_text(board.training_seeds),
        "matrices": _matrices(board),
        "suite": board.protocol.score_version > 0,
        "whole": [ranking(t, style, Markup) for t in board.overall if not t.family],
        "agreement": agreement(board),
        "rules": [{"name": r.__name__, "meaning": r.__doc__} for r in RULES],
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
    """A cell from white (score 0 and below) to blue (1 and above); black text on light, white on dark.

    Both have a contrast of at least 4.5 where one gives way to the other (WCAG 2.2, 1.4.3).
    """
    if row is None or row.score is None:
        return {"text": "–", "colour": "#f5f7f8", "ink": "#5b6770"}
    share = min(max(row.score.value, 0.0), 1.0) ** 1.5
    colour = tuple(round(a + (b - a) * share) for a, b in zip((244, 247, 250), (27, 108, 168), strict=True))
    ink = "#a8321f" if row.score.value < -0.05 else "#ffffff" if share > 0.89 else "#000000"
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
        "overall": [ranking(t, style, markup) for t in overall],
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
        "tables": [ranking(t, style, markup) for t in tables],
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
    return {row.trajectory for table in board.tables for row in _drawn_rows(table, board)}


def _drawn_rows(table: Table, board: Board) -> list[Row]:
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
    """The rows to draw of which trajectories were kept, and those."""
    if trajectories is None:
        return [], []
    pairs = {row.entrant: trajectories(row.trajectory) for row in _drawn_rows(table, board)}
    rows = [row for row in table.rows if pairs.get(row.entrant)]
    return rows, [pairs[row.entrant] for row in rows]
