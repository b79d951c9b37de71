"""The page of one task of a board: rankings, traces of episodes, figures, and commands that replay a row."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.drawing import pages
from cablebench.board.learning import Curve
from cablebench.board.pages import figures, stress_figures
from cablebench.board.pages.overview import render_board
from cablebench.board.pages.rankings import ranking
from cablebench.board.pages.shared import BOARD, PACKAGE, common, script, task_address
from cablebench.board.pages.traces import Trajectories, chosen, viewer
from cablebench.board.tables import Board, Row, Table


def board_pages(
    board: Board, trajectories: Trajectories | None = None, curves: Sequence[Curve] = ()
) -> Iterator[tuple[str, str]]:
    """All pages of a board, one after the other.

    Parameters
    ----------
    board : Board
    trajectories : callable, optional
        `cablebench.run.trajectories.Trajectories.of` of the store that the board was made from.
    curves : sequence of Curve
        The agents' learning curves.

    Yields
    ------
    (str, str)
        Where the page lies, as ``"tasks/CableHole-Track-Hard.html"``, and its HTML; the board's own comes last, so that
        no link of it leads nowhere.
    """
    for task in dict.fromkeys(t.task for t in board.tables):
        yield task_address(task), render_task(board, task, trajectories, curves)
    yield BOARD, render_board(board)


def render_task(board: Board, task: str, trajectories: Trajectories | None = None, curves: Sequence[Curve] = ()) -> str:
    """The page of a task as text.

    Parameters
    ----------
    board : Board
    task : str
        Its short name.
    trajectories, curves
        As of `board_pages`.

    Returns
    -------
    str
        HTML.

    Raises
    ------
    ConfigurationError
        Where the board has no such task.
    """
    from jinja2.utils import htmlsafe_json_dumps
    from markupsafe import Markup

    style = figures.styles(board)
    tables = [t for t in board.tables if t.task == task]
    if not tables:
        known = ", ".join(dict.fromkeys(t.task for t in board.tables))
        raise ConfigurationError(f"the board has no task '{task}'; it has {known}")
    traces = viewer(board, tables, trajectories, style)
    names = list(dict.fromkeys(t.task for t in board.tables))
    place = names.index(task)
    around = (names[place - 1] if place else None, names[place + 1] if place + 1 < len(names) else None)
    present = {r.entrant for t in tables for r in t.rows}
    content = {
        **common(board, style),
        "task": task,
        "tracks": list(dict.fromkeys(t.track for t in tables)),
        "env_id": tables[0].env_id,
        "output_unit": tables[0].output_unit,
        "command_unit": tables[0].command_unit,
        "overview": f"../{BOARD}",
        "around": [name and {"name": name, "address": f"../{task_address(name)}"} for name in around],
        "tables": [ranking(t, style, Markup) for t in tables],
        "profile": Markup(_profile(tables, style)),
        "effort": Markup(figures.effort(tables, style)),
        "phases": Markup(figures.phases(tables, style)),
        "sweeps": Markup(figures.sweeps(board, task, style)),
        "radar": Markup(stress_figures.radar(board, task, style)),
        "robustness": _robustness(board, tables),
        "learning": Markup(stress_figures.learning(curves, task, style)),
        "traces": traces,
        "missing_command": traces is not None and _missing_command(traces),
        "episodes": "" if traces is None else htmlsafe_json_dumps(traces, _compact),
        "viewer": Markup(script("traces.js", "viewer.js")),
        "keep": board.place and board.replay(tables[0], _replayed(tables[0], board)),
        "again": f"cablebench leaderboard {board.place}",
        "entrants": len(present),
        "replay": [
            {"name": r.entrant, "information": r.information, "track": t.track, "command": board.replay(t, r)}
            for t in tables
            for r in t.rows
        ],
    }
    return pages.render(PACKAGE, "templates/task.html.j2", content)


def _compact(data: Any, **more: Any) -> str:
    return json.dumps(data, separators=(",", ":"), **more)


def _missing_command(traces: Mapping[str, Any]) -> bool:
    """Whether no episode has the signal of the command, as in a board that was packed before it was kept."""
    episodes = (e for track in traces["tracks"] for who in track["entrants"] for e in who["episodes"].values())
    return all(e["command"] is None for e in episodes)


def _replayed(table: Table, board: Board) -> Row:
    """The row whose replay is the example: one that needs no policy, where there is one."""
    rows = chosen(table, board) or table.rows
    return next((r for r in rows if not r.charged.get("environment_steps")), rows[0])


def _profile(tables: Sequence[Table], style: figures.Style) -> str:
    scored = [t for t in tables if any(r.score for r in t.rows)]
    return figures.profile(scored, style) if scored else ""


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
