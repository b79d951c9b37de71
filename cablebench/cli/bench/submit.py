"""``cablebench submit``: anyone's controller or policy, checked, evaluated, and put on a board."""

import hashlib
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import permit
from cablebench.cli.bench.evaluate import evaluate_on
from cablebench.cli.bench.leaderboard import make_board
from cablebench.cli.learn.train import ADDRESS_HELP, BACKEND_HELP, JOBS_HELP
from cablebench.cli.shared.arguments import resolve_task
from cablebench.cli.shared.output import console
from cablebench.cli.shared.recipes import NamedEntrant, named
from cablebench.cli.shared.seals import Seal, unsealed
from cablebench.cli.shared.trust import Trusted, Walls, say_sandboxes


def submit(
    path: Annotated[
        Path, typer.Argument(help="A .py file, a policy .zip (or folder), an .onnx, or a YAML naming one.")
    ],
    board: Annotated[str | None, typer.Option(help="Board: a protocol (quick, full). Default: quick.")] = None,
    results: Annotated[
        Path | None, typer.Option(help="Folder for its records and the board; default: results/submitted-NAME.")
    ] = None,
    publish: Annotated[
        bool, typer.Option("--publish", help="Put the row on the published board itself: writes to boards/NAME.")
    ] = False,
    protocol: Annotated[str | None, typer.Option(help="Protocol, if not --board's: a name or a YAML file.")] = None,
    name: Annotated[str | None, typer.Option(help="Name on the board, instead of the file's own.")] = None,
    maker: Annotated[str | None, typer.Option(help="A phrase that only you know: with it you add to your row.")] = None,
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; repeatable.")] = None,
    track: Annotated[list[str] | None, typer.Option(help="Only this track; repeatable.")] = None,
    seal: Seal = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
    check_only: Annotated[bool, typer.Option("--check-only", help="Check and try it; evaluate nothing.")] = False,
    jobs: Annotated[int | None, typer.Option(min=1, help=JOBS_HELP)] = None,
    backend: Annotated[str, typer.Option(help=BACKEND_HELP)] = "local",
    ray_address: Annotated[str | None, typer.Option(help=ADDRESS_HELP)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The board as JSON on standard output.")] = False,
) -> None:
    """Check a controller or policy, run the protocol, and rank it against the published board.

    Its records, and a board with its row among the published ones, go to a folder of their own; what is published is
    read, not written, unless --publish asks for it. Of the board, the tables with its row are printed.

    The row is its maker's: without --maker, only the same files can be submitted again under the same name.
    """
    from cablebench.entrants.admission import check_name, check_training, read_submission
    from cablebench.entrants.dry_run import dry_run
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import board_folder, open_store, rank_against
    from cablebench.run.makers import maker_key

    if publish and results:
        raise ConfigurationError("--publish writes to boards/NAME, --results to another folder: give one of them")
    chosen = unsealed(load_protocol(protocol or board or "quick", "protocol" if protocol else "board"), seal)
    if chosen.seal and not chosen.secret and not check_only:
        chosen.seeds(1)  # says what is missing
    folder = board_folder(chosen.name) if publish else results or Path("results") / f"submitted-{chosen.name}"
    place = f"--results {shlex.quote(str(folder))}" + (f" --protocol {shlex.quote(protocol)}" if protocol else "")
    flags = f"--board {chosen.name}" if publish else place
    tasks = tuple(resolve_task(chosen, e) for e in env or ())
    submission = read_submission(path, name or "")
    if submission.executes:
        permit(path.parent / submission.executes, submission.files[submission.executes])
    say = console(stderr=True)
    store = open_store(folder, chosen.name)
    records = store.read().records  # what is left out of it is said with the board
    _say_against(say, store, chosen)
    with _tried(submission, path, bool(name)) as tried_at:
        entrant = _recipe(submission.flag, tried_at, sandbox)()
        key = maker_key(maker, entrant.name) if maker else submission.hash()
        entrant = replace(entrant, maker=key)
        tried = dry_run(entrant, chosen, tasks)
        of_protocol, own = (
            [r for r in found if r["protocol_hash"] == chosen.hash()]
            for found in (records, [] if publish else type(store)(store.path).read().records)
        )
        check_training(entrant, chosen)
        check_name(entrant, of_protocol, _reserved(), own, folder)
    say_sandboxes([entrant])
    for t in tried:
        beyond = f", {100 * t.clipped:.0f} % of the commands beyond the drive's range" if t.clipped else ""
        say.print(f"{entrant.title} on {t.env_id}: {1e6 * t.seconds:.0f} µs an answer{beyond}", markup=False)
    if check_only:
        say.print(f"{path} can be submitted: {entrant.title}, {entrant.information}", markup=False)
        return
    try:
        kept = submission.keep(folder)
        if store.base:
            rank_against(folder, chosen.name)
    except OSError as error:
        raise ConfigurationError(f"cannot copy {path} to {folder}: {error.strerror or error}") from error
    recipe = replace(_recipe(submission.flag, kept, sandbox), maker=key)
    entrant = recipe()
    entered = tuple(t.env_id for t in tried)
    recipes = (*_missing(chosen, records, entered, track), recipe)
    # what the store holds is skipped: an interrupted submission goes on where it was when it is given again
    evaluate_on(backend, jobs, ray_address, chosen, recipes, (entered, tuple(track or ()), store), resume=True)
    made = make_board(chosen, store, store.read(), folder, as_json, place=flags, of=entrant.name)
    _place(made, entrant, say)


def _say_against(say: Any, store: Any, protocol: Any) -> None:
    """Which rows the newcomer is ranked against."""
    base = store.base
    if base is None:
        return
    digest = hashlib.sha256((base.packed if base.packed.is_file() else base.path).read_bytes()).hexdigest()[:12]
    count = sum(r["protocol_hash"] == protocol.hash() for r in base.read().records)
    if count:
        say.print(f"ranked against the published board '{protocol.name}': {count} records, hash {digest}", markup=False)
    else:
        say.print(
            f"the published board '{protocol.name}' (hash {digest}) is of another version of this protocol: "
            "ranked against references that are evaluated here", markup=False,
        )  # fmt: skip


@contextmanager
def _tried(submission: Any, path: Path, renamed: bool) -> Iterator[Path]:
    """Where to try it out: as handed in, or renamed in a temporary folder; what is refused leaves nothing behind."""
    if not renamed and path.is_file():
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="cablebench-") as folder:
        yield submission.keep(Path(folder))


def _recipe(flag: str, path: Path, sandbox: str) -> NamedEntrant:
    return named(flag.removeprefix("--"), str(path), sandbox=sandbox)


def _reserved() -> tuple[str, ...]:
    from cable_envs.baselines import CONTROLLERS

    return tuple(CONTROLLERS)


def _missing(
    protocol: Any, records: list[Any], entered: tuple[str, ...], tracks: list[str] | None
) -> tuple[NamedEntrant, ...]:
    """References without which a row cannot be judged and that the store lacks on some task and track.

    Frozen anchors stand for open loop and oracle where the protocol has them.
    """
    ends = () if protocol.anchors else (protocol.open_loop, protocol.oracle)
    known = {(r["env_id"], r["track"], r["entrant"]) for r in records if r["protocol_hash"] == protocol.hash()}
    wanted = {(c.task.env, c.track.name, c.task.family) for c in protocol.cells(entered, tuple(tracks or ()))}
    names = {
        name
        for env_id, track, family in wanted
        for name in (*ends, protocol.paper.get(family, ""))
        if name in _reserved() and (env_id, track, name) not in known
    }
    return tuple(named("controller", name) for name in sorted(names))


def _place(board: Any, entrant: Any, say: Any) -> None:
    """Say in one line for each table where the newcomer stands."""
    from cablebench.board.cells import heading, interval

    for table in board.tables:
        for row in table.rows:
            if row.entrant == entrant.name:
                of = sum(r.information == row.information for r in table.rows)
                say.print(
                    f"{heading(table)}: {interval(row)}, place {row.rank} of {of} ({row.information})", markup=False
                )
