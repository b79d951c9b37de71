"""A board for people and programs: terminal table, JSON, Markdown, and HTML pages that need no network."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cable_envs.core.files import json_text, write_atomic
from cable_envs.core.text import markdown_code, markdown_text
from cablebench.board.cells import agreement, cells, heading, remarks, seed_text
from cablebench.board.learning import Curve
from cablebench.board.pages.shared import BOARD, TASKS
from cablebench.board.pages.task import board_pages
from cablebench.board.pages.traces import Trajectories
from cablebench.board.tables import SCHEMA, Board
from cablebench.protocol.metrics import METRICS


def write_board(
    board: Board, folder: str | Path, trajectories: Trajectories | None = None, curves: Sequence[Curve] = ()
) -> dict[str, Path]:
    """Write board.json, board.md, board.html and tasks/<task>.html; each replaces its predecessor whole or not at all.

    Parameters
    ----------
    board : Board
    folder : str or Path
        Where to write.
    trajectories : callable, optional
        `ResultStore.trajectories.of` of the store that the board was made from.
    curves : sequence of Curve
        The agents' learning curves.

    Returns
    -------
    dict of Path
        "json", "markdown", "html", and "tasks", the folder of the tasks' pages.
    """
    folder = Path(folder)
    written = {
        "json": write_atomic(folder / "board.json", render_json(board)),
        "markdown": write_atomic(folder / "board.md", render_markdown(board)),
    }
    for address, text in board_pages(board, trajectories, curves):
        write_atomic(folder / address, text)
    return {**written, "html": folder / BOARD, "tasks": folder / TASKS}


def render_json(board: Board) -> str:
    """The whole board as JSON text, SI units, schema-versioned; NaN becomes null."""
    data = {
        "schema": SCHEMA,
        "board": board.protocol.name,
        "version": board.version,
        "metrics": [{"name": m.name, "unit": m.unit, "better": m.better, "meaning": m.meaning} for m in METRICS],
        **asdict(board),
    }
    return json_text(data)


def fitting(head: list[str], body: list[list[str]], width: int) -> list[int]:
    """Columns that fit into ``width`` characters uncut: rank, name, class and score always, then from the left."""
    wide = [2 + max(map(len, column)) for column in zip(head, *body, strict=True)]
    kept, used = [0, 1, 2, 3], sum(wide[:4])
    for k in range(4, len(head)):
        if used + wide[k] <= width:
            kept.append(k)
            used += wide[k]
    return kept


def print_board(board: Board, console: Any) -> None:
    """Print the tables on a ``rich.console.Console``; columns that do not fit its width are in the files only."""
    from rich.markup import escape
    from rich.table import Table as RichTable
    from rich.text import Text

    for table in (*board.overall, *board.tables):
        head, body = cells(table)
        view = RichTable(
            title=heading(table), title_justify="left", title_style="bold", header_style="", box=None, pad_edge=False
        )
        kept = fitting(head, body, console.width)
        for name in (head[k] for k in kept):
            view.add_column(escape(name), justify="left" if name in ("controller", "class") else "right", no_wrap=True)
        previous = ""
        for line, row in zip(body, table.rows, strict=True):
            if previous and previous != row.information:
                view.add_section()
            previous = row.information
            view.add_row(*(Text(line[k]) for k in kept), style="bold" if row.rank == 1 else "")
        console.print(view)
        for remark in remarks(table) if table.score_version else ():
            console.print(remark, style="dim", highlight=False, markup=False)
        console.print()
    for remark in legend(board):
        console.print(remark, style="dim", highlight=False, markup=False)


def legend(board: Board) -> list[str]:
    """The sentences without which the tables cannot be read."""
    lines = _suite_legend(board) if board.protocol.score_version else _linear_legend(board)
    origin = (
        f"Made by the {board.protocol.name} protocol, version {board.version}, configuration {board.configuration}, "
        f"on {board.created}."
    )
    return [*lines, *board.notes, *agreement(board), origin]


def _linear_legend(board: Board) -> list[str]:
    return [
        f"Score: 0 = {board.protocol.open_loop}, 1 = {board.protocol.oracle}. A score is an interquartile mean with "
        f"its {100 * board.protocol.level:g} % interval over training seeds; a star marks a single run, whose interval "
        "is over test episodes. Entrants are ranked within their information class. A failed episode has a score of "
        f"{board.protocol.worst_score:g}.",
        "Other values are medians over completed episodes. '>' before a settling time: it was not reached. "
        f"'> paper': the probability that an episode is better than that of {_papers(board)}.",
    ]


def _suite_legend(board: Board) -> list[str]:
    p = board.protocol
    return [
        f"Score: ln(e_open/e) / ln(e_open/e_bound) of the error e between frozen anchors ('{p.anchors}'): 0 = doing "
        "nothing, 1 = the bound. The error is the priced one, which a restless command adds to, where a task has it, "
        "else the RMSE. A task's score is an interquartile mean, over several tasks their mean, with "
        f"its {100 * p.level:g} % interval over training seeds and rigs; a star marks a single run, whose interval is "
        f"over rigs. A failed episode has a score of {p.worst_score:g}: torn, ended by a rule of the task, runaway (10 "
        "times the open loop's error); on tasks without rules load dropped, a slack cable or an overload for more "
        "than 0.5 % of the time.",
        *_beside(board),
        "Entrants are ranked within their information class. 'worst rigs': mean of the worst tenth. 'robust': share of "
        "the values of disturbance, delay, noise and friction that were survived. '> paper': the probability of a "
        f"higher score than {_papers(board)} on the same rig. Other values are medians over completed episodes, with "
        "the place in the table in brackets (over several tasks the mean place). '>' before a settling time: it was "
        "not reached.",
    ]


def _beside(board: Board) -> list[str]:
    """Which of the board's tasks are not ranked."""
    names = {t.task for t in board.tables}
    found = [task.short for task in board.protocol.tasks if not task.ranked and task.short in names]
    return [f"Shown beside the ranking, in no table over several tasks: {', '.join(found)}."] if found else []


def _papers(board: Board) -> str:
    return ", ".join(f"{name} ({family})" for family, name in board.protocol.paper.items()) or "the papers' controller"


def _replays(board: Board) -> list[str]:
    """How to run the rows again: one command for all of them where the board's place is known."""
    if board.place:
        command = f"cablebench replay {board.place} --entrant NAME --env TASK --track TRACK"
        return [f"With the controller, task and track of a row: {markdown_code(command)}"]
    return [
        f"- {t.task}, {t.track}, {markdown_text(r.entrant)}: {markdown_code(board.replay(t, r))}"
        for t in board.tables
        for r in t.rows
    ]


def _row(found: Sequence[str]) -> str:
    """A row of a table, without spaces about its bars: a board has thousands of cells."""
    return f"|{'|'.join(found)}|"


def render_markdown(board: Board) -> str:
    """The board as Markdown: every table, the legend, the replay commands and the provenance."""
    out = [f"# {board.protocol.title}", ""]
    out += [f"- {line}" for line in legend(board)]
    if board.remarks:
        out += ["", board.remarks.strip()]
    for table in (*board.overall, *board.tables):
        head, body = cells(table)
        out += ["", f"## {heading(table)}", ""]
        left = {"controller", "class"}
        out += [_row(head), "|" + "|".join(":--" if h in left else "--:" for h in head) + "|"]
        out += [_row([line[0], markdown_text(line[1]), *line[2:]]) for line in body]
        for remark in remarks(table):
            out += ["", markdown_text(remark)]
    out += ["", "## Replay", "", *_replays(board), "", "## Provenance", ""]
    out += [f"- test seeds: {seed_text(board.seeds)}", f"- training seeds: {seed_text(board.training_seeds)}"]
    versions = ", ".join(markdown_text(f"{k} {v}") for k, v in board.versions.items())
    out += [f"- versions: {versions}", f"- machine: {markdown_text(board.machine)}"]
    return "\n".join(out) + "\n"
