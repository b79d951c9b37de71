"""What the page of a board and those of its tasks share: names, addresses, and what their templates and script need."""

import re
from importlib.resources import files
from typing import Any

from cablebench.board.pages.figures import Style
from cablebench.board.pages.rankings import bar_axis
from cablebench.board.tables import Board
from cablebench.entrants.entrant import INFORMATION

PACKAGE = "cablebench.board.pages"
"""Holds the templates."""

BOARD = "board.html"
TASKS = "tasks"
"""Folder of the tasks' pages, beside the board's."""


def task_address(task: str) -> str:
    """Where a task's page lies, from the board's page.

    Examples
    --------
    >>> task_address("CableHole-Track-Hard")
    'tasks/CableHole-Track-Hard.html'
    """
    return f"{TASKS}/{re.sub(r'[^A-Za-z0-9-]', '_', task)}.html"


def script(*names: str) -> str:
    """The text of scripts in ``templates/``, one after the other."""
    place = files(PACKAGE).joinpath("templates")
    return "\n".join(place.joinpath(name).read_text(encoding="utf-8") for name in names)


def common(board: Board, style: Style) -> dict[str, Any]:
    """What both templates show."""
    from markupsafe import Markup

    return {
        "board": board,
        "names": board.entrants,
        "style": style,
        "board_name": board.protocol.name,
        "tracks": list(dict.fromkeys(t.track for t in board.tables)),
        "classes": [c for c in INFORMATION if any(r.information == c for t in board.tables for r in t.rows)],
        "script": Markup(script("board.js")),
        "level": f"{100 * board.protocol.level:g}",
        "bar_axis": Markup(bar_axis()),
        "suite": board.protocol.score_version > 0,
    }
