"""``cablebench replay``: run a row of a board again and say whether the numbers are the same."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.bench.evaluate import entrant_of
from cablebench.cli.bench.leaderboard import protocol_of, results_folder
from cablebench.cli.shared.arguments import resolve_task
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.seals import Seal, unsealed
from cablebench.cli.shared.trust import Trusted, Walls

DIFFERENT = 1
"""Exit code where a number is not as recorded."""


def replay(
    entrant: Annotated[str, typer.Option(help="Name on the board.")],
    env: Annotated[str, typer.Option(help="Environment, by full or short id.")],
    track: Annotated[str, typer.Option(help="Track.")] = "nominal",
    board: Annotated[
        str | None, typer.Option(help="Board: a protocol (quick, full); its folder is boards/NAME.")
    ] = None,
    results: Annotated[Path | None, typer.Option(help="Results folder of the board.")] = None,
    protocol: Annotated[str | None, typer.Option(help="Protocol; default: --board's, or the newest record's.")] = None,
    seal: Seal = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
    traces: Annotated[
        bool, typer.Option("--traces", help="Keep the traces of the median and the worst episode in the folder.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="The comparison as JSON on standard output.")] = False,
) -> None:
    """Run the episodes of a row again; exit code 1 where any number differs from the record. No record is stored.

    --traces keeps the signals that the pages of `cablebench leaderboard` show, where every number is as recorded.

    Replaying a submitted .py file executes it: you are asked before, or say --trust.
    """
    from cable_envs.core.provenance import versions
    from cablebench.board.replay import arguments_of, compare, rows_of
    from cablebench.run.folders import open_store
    from cablebench.run.store import ResultStore

    folder, _ = results_folder(board, results)
    store = open_store(folder, board)
    reading = store.read()
    everything = reading.records
    if reading.left_out:
        console(stderr=True).print(reading.remark, markup=False)
    if not everything:
        raise ConfigurationError(f"no records in {store.path}")
    chosen = unsealed(protocol_of(everything, protocol or board), seal)
    row = rows_of(everything, chosen, entrant, resolve_task(chosen, env), track)
    if traces:
        require_writable(folder)
    again: list[Any] = []
    with TemporaryDirectory() as place:
        new = ResultStore(Path(place) / "records.jsonl") if traces else None
        with progress_bar() as update:
            for words, records in arguments_of(row, store.places).items():
                again += _again(chosen, words, records, update, sandbox, new)
        found = compare(row, again, everything, chosen)
        if new is not None:
            _keep(store, new, row, again, found.same)
    sources = {r["versions"].get("source") for r in row}
    _report(found, as_json, sources - {versions()["source"]})
    if not found.same:
        raise typer.Exit(DIFFERENT)


def _keep(store: Any, new: Any, row: list[Any], again: list[Any], same: bool) -> None:
    """The traces of the replay as those of the row's runs, and what became of them on standard error."""
    from cablebench.board.replay import runs_again

    say = console(stderr=True)
    if not same:
        say.print("the traces are not kept: they are of other numbers than the records", markup=False)
        return
    pairs = runs_again(row, again)
    for run, other in pairs.items():
        store.trajectories.keep(run, new.trajectories.of(other))
    say.print(
        f"kept the traces of {len(pairs)} run{'s' * (len(pairs) > 1)} in {store.trajectories.folder}", markup=False
    )


def _again(protocol: Any, words: str, records: list[Any], update: Any, sandbox: str, store: Any = None) -> list[Any]:
    """The records' episodes run anew by the entrant that the flags name; ``store`` gets them with their traces."""
    from cablebench.run.evaluation import evaluate

    first = records[0]
    entrant = entrant_of(words, first, sandbox)
    return evaluate(
        protocol, (entrant,), (first["env_id"],), (first["track"],), store,
        lambda p: update("episodes", p.done, p.total, p.text),
    )  # fmt: skip


SHOWN = 5


def _report(found: Any, as_json: bool, other_sources: set[Any]) -> None:
    if as_json:
        print_json({
            "same": found.same, "episodes": found.episodes, "recorded_score": found.recorded_score,
            "replayed_score": found.replayed_score, "differences": [vars(d) for d in found.differences],
        })  # fmt: skip
        return
    out = console()
    if other_sources:
        names = ", ".join(sorted(map(str, other_sources)))
        out.print(f"The records were made by another state of the source ({names}).", markup=False)
    if not math.isnan(found.recorded_score):
        out.print(f"score (IQM) recorded {found.recorded_score!r}, replayed {found.replayed_score!r}", markup=False)
    if found.same:
        out.print(f"{found.episodes} episodes: every metric is the same to the last digit", markup=False)
        return
    for d in found.differences[:SHOWN]:
        out.print(
            f"episode {d.seed} ({d.where}): {d.metric} recorded {d.recorded!r}, replayed {d.replayed!r}", markup=False
        )
    episodes = len({(d.seed, d.where) for d in found.differences})
    out.print(f"DIFFERENT: {len(found.differences)} numbers in {episodes} of {found.episodes} episodes", markup=False)
