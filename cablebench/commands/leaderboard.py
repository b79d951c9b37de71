"""``cablebench leaderboard``: the board of a results folder as terminal table, JSON, Markdown and HTML."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.errors import ConfigurationError
from cablebench.commands.common import console
from cablebench.commands.evaluate import RECORDS


def leaderboard(
    results: Annotated[Path, typer.Option(help="Folder that `cablebench evaluate --results` wrote to.")],
    protocol: Annotated[str | None, typer.Option(help="Protocol; default: that of the newest record.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for board.json, board.md, board.html; default: --results.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The board as JSON on standard output.")] = False,
) -> None:
    """Rank what a results folder holds and write the board."""
    from cablebench.protocol import load_protocol
    from cablebench.store import ResultStore

    store = ResultStore(results / RECORDS)
    records = store.records()
    if not records:
        raise ConfigurationError(f"no records in {store.path}: run `cablebench evaluate --results {results}` first")
    chosen = load_protocol(protocol or records[-1]["protocol"])
    make_board(chosen, store, records, out or results, as_json)


def make_board(protocol: Any, store: Any, records: list[Any], folder: Path, as_json: bool) -> None:
    """Build the board, write its three files, and show it: as JSON on standard output, or as a table."""
    from cablebench.board import build_board
    from cablebench.report import print_board, render_json, write_board

    board = build_board(protocol, records)
    try:
        paths = write_board(board, folder, store.trajectories)
    except OSError as error:
        raise ConfigurationError(f"cannot write the board to {folder}: {error.strerror or error}") from error
    if as_json:
        typer.echo(render_json(board), nl=False)
    else:
        out = console()
        print_board(board, out)
        out.print()
    for path in paths.values():
        console(stderr=as_json).print(f"wrote {path}", markup=False)
