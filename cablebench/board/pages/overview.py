"""The page of a board: its story, all tasks at a glance, tables over several tasks, method, when rows were made."""

from typing import Any

from cable_envs.core.text import number
from cable_envs.drawing import pages
from cable_envs.plants import title_of
from cablebench.board.cells import agreement, seed_text
from cablebench.board.pages import figures
from cablebench.board.pages.rankings import ranking
from cablebench.board.pages.shared import PACKAGE, common, task_address
from cablebench.board.scoring import GAP_FLOOR
from cablebench.board.story import story
from cablebench.board.tables import Board, Row
from cablebench.protocol.failures import RULES
from cablebench.protocol.metrics import METRICS


def render_board(board: Board) -> str:
    """The page as text; it links to the pages of the tasks (`cablebench.board.pages.task`) in a folder beside it.

    Parameters
    ----------
    board : Board

    Returns
    -------
    str
        HTML.
    """
    from markupsafe import Markup

    style = figures.styles(board)
    content = {
        **common(board, style),
        "story": story(board),
        "remarks": Markup(_markdown(board.remarks)),
        "worst": number(board.protocol.worst_score),
        "floor": number(100 * GAP_FLOOR),
        "papers": ", ".join(f"{name} for {title_of(f)}" for f, name in board.protocol.paper.items()) or "none named",
        "metrics": [{"label": m.label, "unit": m.unit.format(y="y", u="u"), "meaning": m.meaning} for m in METRICS],
        "seeds": seed_text(board.seeds),
        "training_seeds": seed_text(board.training_seeds),
        "matrices": _matrices(board),
        "history": _history(board),
        "whole": [ranking(t, style, Markup) for t in board.overall if not t.family],
        "agreement": agreement(board),
        "rules": [{"name": r.__name__, "meaning": r.__doc__} for r in RULES],
        "families": [
            _family(board, f, style, Markup) for f in dict.fromkeys(t.family for t in board.overall if t.family)
        ],
    }
    return pages.render(PACKAGE, "templates/board.html.j2", content)


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
        tasks = [{"task": t.task, "address": task_address(t.task), "lines": _lines(t.task)} for t in tables]
        result.append({"name": track, "tasks": tasks, "rows": rows})
    return result


def _history(board: Board) -> list[dict[str, Any]]:
    """Lines of the table of when rows were made; the entrant's class is for the filter."""
    classes = {r.entrant: r.information for t in board.tables for r in t.rows}
    return [
        {
            "name": made.entrant,
            "information": classes[made.entrant],
            "first": made.first or "–",
            "last": made.last or "–",
            "version": made.version,
            "source": made.source,
            "rankings": made.rankings,
            "episodes": made.episodes,
        }
        for made in board.history
        if made.entrant in classes
    ]


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


def _family(board: Board, family: str, style: figures.Style, markup: Any) -> dict[str, Any]:
    overall = [t for t in board.overall if t.family == family]
    scored = [t for t in overall if any(r.score for r in t.rows)]
    return {
        "name": family,
        "title": title_of(family),
        "overall": [ranking(t, style, markup) for t in overall],
        "profile": markup(figures.profile(scored, style)) if scored else "",
    }
