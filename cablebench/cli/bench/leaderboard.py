"""``cablebench leaderboard``: the board of a results folder as terminal table, JSON, Markdown and HTML."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.shared.output import console, progress_bar
from cablebench.cli.shared.seals import Seal, unsealed


def leaderboard(
    board: Annotated[
        str | None, typer.Option(help="Board: a protocol (quick, full); its folder is boards/NAME.")
    ] = None,
    results: Annotated[Path | None, typer.Option(help="Results folder, as of `cablebench evaluate --results`.")] = None,
    protocol: Annotated[str | None, typer.Option(help="Protocol; default: --board's, or the newest record's.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for board.json, board.md, board.html and tasks/; default: the results."),
    ] = None,
    traces: Annotated[
        bool, typer.Option("--traces", help="Run the episodes whose traces the pages would show and that are not kept.")
    ] = False,
    policies: Annotated[
        Path | None, typer.Option(help="Folder with the trained policies of the rows, for learning curves and traces.")
    ] = None,
    pack: Annotated[bool, typer.Option("--pack", help="Make the folder small, to commit it.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse a store with malformed records.")] = False,
    seal: Seal = None,
    as_json: Annotated[bool, typer.Option("--json", help="The board as JSON on standard output.")] = False,
) -> None:
    """Rank what a results folder holds and write the board. NOTES.md in the folder is shown on it.

    A malformed record is left out; the board says so, with file and line. --strict refuses it instead.

    --traces simulates the median and the worst episode of up to four entrants of each task again, and keeps their
    traces where the numbers are as recorded. Policies whose files are gone are left out, and files of Python are run.

    --pack compresses the records (to records.jsonl.xz), drops what the pages do not show of the trajectories, and
    thins what they show; it keeps the learning curves of policies apart from these. board.json, board.html and the
    tasks' pages are no part of a packed folder: this command makes them again from what is there.
    """
    from cablebench.run.folders import open_store

    folder, flags = results_folder(board, results, protocol)
    store = open_store(folder, board)
    reading = store.read(strict)
    records = reading.records
    if not records:
        command = f"cablebench evaluate --protocol {board or 'quick'} --results {folder}"
        left = f" ({reading.remark})" if reading.left_out else ""
        raise ConfigurationError(f"no records in {store.path}{left}: run `{command}` first")
    chosen = unsealed(protocol_of(records, protocol or board), seal)
    require_writable(out or folder)
    trained = [policies] if policies else []
    made = make_board(chosen, store, reading, out or folder, as_json, place=flags, trained=trained)
    if traces:
        _trace(chosen, made, store, records, trained)
        _write(made, store, reading, out or folder, trained)
    if pack:
        _pack(store, made, records, trained)
        _write(made, store, reading, out or folder)  # drawn from what is kept, as the next time


def _trace(protocol: Any, board: Any, store: Any, records: list[Any], trained: list[Path]) -> None:
    """Traces for the pages, of runs that have none; what became of them on standard error."""
    from cablebench.board.again import keep_traces, without_traces
    from cablebench.cli.bench.evaluate import entrant_of

    with progress_bar() as update:
        runs = without_traces(board, records, store.trajectories)
        count = keep_traces(
            protocol, runs, store.trajectories, [*store.places, *trained], entrant_of,
            lambda done, total, text: update("runs", done, total, text),
        )  # fmt: skip
    text = ", ".join(f"{number} {kind}" for kind, number in count.items() if number or kind == "kept")
    console(stderr=True).print(f"traces of {len(runs)} runs: {text}", markup=False)


def _pack(store: Any, board: Any, records: list[Any], trained: list[Path]) -> None:
    """Make the results folder small: records compressed, of the trajectories only what the pages show."""
    from cablebench.board.learning import pack_curves
    from cablebench.board.pages.traces import DRAWN_POINTS, is_drawn, shown_runs

    path, shown = store.pack(), shown_runs(board)
    store.trajectories.forget(shown)
    store.trajectories.thin(shown, is_drawn, DRAWN_POINTS)
    store.trajectories.pack()
    pack_curves(path.parent, [*store.places, *trained], records)
    console(stderr=True).print(f"{len(records)} records in {path}, {path.stat().st_size} bytes", markup=False)


def results_folder(board: str | None, results: Path | None, protocol: str | None = None) -> tuple[Path, str]:
    """(results folder, the flags that name it and the protocol). ConfigurationError when nothing names a folder."""
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import board_folder

    if board is None and results is None:
        raise ConfigurationError("name a board (--board quick) or a results folder (--results DIR)")
    given = {"--board": board, "--results": results, "--protocol": protocol}
    flags = " ".join(f"{flag} {shlex.quote(str(value))}" for flag, value in given.items() if value is not None)
    return results or board_folder(load_protocol(str(board), "board").name), flags


def protocol_of(records: list[Any], name: str | None) -> Any:
    """The protocol of that name, or that of the newest record: one of ours, as records never lead to another file."""
    from cable_envs.core.config import config_names
    from cablebench.protocol.files import load_protocol

    if name is None:
        name, known = str(records[-1].get("protocol")), config_names("protocols")
        if name not in known:
            raise ConfigurationError(
                f"the newest record is of protocol '{name}', which is none of {', '.join(known)}: "
                "give its file with --protocol"
            )
    return load_protocol(name)


def _write(board: Any, store: Any, reading: Any, folder: Path, trained: Sequence[Path] = ()) -> dict[str, Path]:
    """Write the board's three files, and return their paths. ConfigurationError where that fails."""
    from cablebench.board.learning import learning_curves
    from cablebench.board.report import write_board
    from cablebench.run.makers import told_apart

    own = told_apart(r for r in reading.records if r["protocol_hash"] == board.protocol.hash())
    try:
        curves = learning_curves([*store.places, *trained], own)
        return write_board(board, folder, store.trajectories.of, curves)
    except OSError as error:
        raise ConfigurationError(f"cannot write the board to {folder}: {error.strerror or error}") from error


def _with_tables_of(board: Any, entrant: str) -> Any:
    overall, tables = (
        tuple(t for t in found if any(row.entrant == entrant for row in t.rows))
        for found in (board.overall, board.tables)
    )
    return replace(board, overall=overall, tables=tables)


def make_board(
    protocol: Any,
    store: Any,
    reading: Any,
    folder: Path,
    as_json: bool,
    place: str = "",
    show: bool = True,
    of: str = "",
    trained: Sequence[Path] = (),
) -> Any:
    """Build the board, write its files and pages, and show it: as JSON on standard output, or as a table.

    ``reading``: the store's `Reading`; what it left out is said on standard error and on the board.

    ``place``: the flags that name the results folder, for replay commands; without them a row shows the command that
    evaluated it.

    ``trained``: folders in which policies are looked for, besides the store's own.

    ``of``: an entrant; of the tables only those that it is in are printed.
    """
    from cablebench.board.board import build_board
    from cablebench.board.notes import REMARKS
    from cablebench.board.report import print_board, render_json

    remarks = next((place / REMARKS for place in store.places if (place / REMARKS).is_file()), None)
    text = remarks.read_text(encoding="utf-8") if remarks else ""
    if reading.left_out:
        console(stderr=True).print(reading.remark, markup=False)
    board = build_board(protocol, reading.records, text, place, reading.remark)
    paths = _write(board, store, reading, folder, trained)
    if as_json and show:
        typer.echo(render_json(board), nl=False)
    elif show:
        out = console()
        print_board(_with_tables_of(board, of) if of else board, out)
        out.print()
    for path in paths.values():
        console(stderr=as_json).print(f"wrote {path}", markup=False)
    return board
