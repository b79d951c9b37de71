"""`python -m benchmarks.agents`: every learning algorithm on the ranked tasks of suite v1, as a table of its board."""

import argparse
from collections.abc import Mapping
from pathlib import Path

from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cablebench.board.board import build_board
from cablebench.board.tables import Board, Row
from cablebench.protocol.files import load_protocol
from cablebench.run.folders import open_store

COLUMNS: Mapping[str, str] = {
    "suite-references": "reference", "suite-residual-ppo": "residual PPO", "suite-ppo": "PPO", "suite-sac": "SAC",
    "suite-crossq": "CrossQ", "suite-tqc": "TQC", "suite-td3": "TD3", "suite-recurrent-ppo": "recurrent PPO",
}  # fmt: skip
"""Entrant of the board -> head of its column."""

TRACK = "test"
BEGIN, END = "<!-- begin: python -m benchmarks.agents -->", "<!-- end: agents -->"


def table(board: Board) -> str:
    """Tasks by algorithms: score, its 95 % interval, and the number of training seeds; means over the mechanisms.

    Parameters
    ----------
    board : Board

    Returns
    -------
    str
        Markdown. A mean is given where an algorithm has every ranked task of the mechanism.
    """
    ranked = [task.short for task in board.protocol.tasks if task.ranked]
    rows = {t.task: {r.entrant: r for r in t.rows} for t in board.tables if t.track == TRACK and t.task in ranked}
    shown = [name for name in COLUMNS if any(name in of for of in rows.values())]
    lines = [
        "| task | " + " | ".join(COLUMNS[name] for name in shown) + " |",
        "|---|" + "--:|" * len(shown),
        *(f"| {task} | " + " | ".join(_cell(rows[task].get(name)) for name in shown) + " |" for task in ranked),
    ]
    for over in (t for t in board.overall if t.track == TRACK):
        means = {r.entrant: r for r in over.rows}
        heading = f"{over.family or 'all'}, {over.tasks} tasks"
        lines.append(f"| **{heading}** | " + " | ".join(_cell(means.get(name)) for name in shown) + " |")
    return "\n".join(lines)


def _cell(row: Row | None) -> str:
    if row is None or row.score is None:
        return "–"
    failed = f", {row.failures} failed" if row.failures else ""
    return f"{row.score.value:.2f} [{row.score.low:.2f}, {row.score.high:.2f}] ({row.runs}{failed})"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.agents", description=__doc__)
    parser.add_argument("--results", type=Path, default=Path("boards/suite-v1"), help="folder of the board")
    parser.add_argument("--page", type=Path, help="a page whose marked part gets the table")
    arguments = parser.parse_args()
    board = build_board(load_protocol("suite-v1"), open_store(arguments.results).read().records, "", "")
    text = table(board)
    print(text)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        write_atomic(arguments.page, between_marks(page, BEGIN, END, text))


if __name__ == "__main__":
    main()
