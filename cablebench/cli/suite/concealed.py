"""``cablebench concealed``: control of rigs that have what no simulator of the entrant has."""

from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import jsonable, packed_json, require_writable, write_atomic
from cablebench.cli.shared.output import console, print_json
from cablebench.cli.shared.progress import stages
from cablebench.cli.shared.trust import Trusted

INTERRUPTED = 130
RESULT = "concealed.json.xz"


def concealed(
    out: Annotated[Path, typer.Option(help="Folder for sealed keys, recordings, what is made of them, and scores.")],
    mechanism: Annotated[list[str] | None, typer.Option(help="hole or circuit; repeatable. Default: all.")] = None,
    rigs: Annotated[int, typer.Option(min=1, max=99, help="Hidden rigs of each mechanism.")] = 30,
    row: Annotated[
        list[str] | None, typer.Option(help="Row that is always there; repeatable. Default: all of them.")
    ] = None,
    entrant: Annotated[
        list[Path] | None, typer.Option(help="Python file with prepare(given): an entrant; repeatable.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Test episodes on each hidden rig.")] = 6,
    seed: Annotated[int, typer.Option(min=0, help="Of tuning, training and diagnosis.")] = 0,
    draw: Annotated[
        int | None, typer.Option(min=0, help="Seed of the hidden rigs; without it one is drawn and not kept.")
    ] = None,
    recordings_only: Annotated[
        bool, typer.Option("--recordings-only", help="Seal and record the hidden rigs, and end.")
    ] = False,
    page: Annotated[
        Path | None, typer.Option(help="Markdown page whose marked part gets the tables of these mechanisms.")
    ] = None,
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON on standard output.")] = False,
) -> None:
    """Rank controllers and agents on hidden rigs; they are given recordings, and a simulator without what is hidden.

    What is finished is kept in --out, and the same command goes on from there.
    """
    from cablebench.concealed.entrants import ROWS, row_from_file
    from cablebench.concealed.given import folder_of
    from cablebench.concealed.mechanism import load_mechanism, mechanisms
    from cablebench.concealed.page import require_page, tables, write_tables
    from cablebench.concealed.records import record_hidden
    from cablebench.concealed.track import run, sealed

    names = tuple(dict.fromkeys(mechanism or mechanisms()))
    require_known("mechanism", names, mechanisms())
    require_known("row", row or (), ROWS)
    files = [row_from_file(path) for path in entrant or ()]
    if len({one.name for one in files}) < len(files):
        raise ConfigurationError("two entrants have one name: " + ", ".join(one.name for one in files))
    chosen = [*([ROWS[name] for name in row] if row else [] if files else ROWS.values()), *files]
    require_writable(out)
    if page is not None:
        require_page(page)
    result = {}
    with stages() as (tell, _):
        try:
            for name in names:
                plan, root = load_mechanism(name), out / name
                if recordings_only:
                    for hidden in sealed(plan, root, rigs, draw):
                        tell(f"{name}, rig {hidden.number}: recording")
                        record_hidden(hidden, plan, folder_of(hidden, root) / "recording")
                    continue
                result[name] = run(plan, chosen, root, rigs, episodes, seed, draw, tell)
        except KeyboardInterrupt as stop:
            tell(f"interrupted: what is finished is kept in {out}; the same command goes on from there")
            raise typer.Exit(INTERRUPTED) from stop
    if recordings_only:
        console().print(f"{rigs} rigs of {', '.join(names)} are sealed and recorded in {out}", markup=False)
        return
    write_atomic(out / RESULT, packed_json(jsonable(result)))
    text = tables(result)
    if page is not None:
        write_tables(page, result)
    if as_json:
        print_json(jsonable(result))
        return
    console().print(text, markup=False)
