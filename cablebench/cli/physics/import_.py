"""``cablebench import``: a published data set, or any rig's log, as a recording that the diagnosis reads."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.shared.arguments import parse_pairs
from cablebench.cli.shared.output import console, print_json
from cablebench.cli.shared.trust import Trusted

SHOWN = 30
"""Doubts and remarks on the terminal; all of them are in the YAML file and in --json."""


def import_(
    form: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT",
            help="da-vinci-jaw, band-brake, emps, coupled-drives, servo-pendulum, table, mat, mdf, rosbag, mcap, or a "
            ".py file with open_dataset.",
        ),
    ],
    path: Annotated[Path, typer.Argument(help="A file, or a folder of them.")],
    out: Annotated[
        Path,
        typer.Option(help="Folder for recording.yaml and one table for each record; with --guess the mapping file."),
    ],
    mapping: Annotated[
        Path | None, typer.Option(help="table, mat, mdf, rosbag, mcap: YAML that says which column is which channel.")
    ] = None,
    guess: Annotated[
        bool, typer.Option("--guess", help="table, mat: propose a mapping, with the reason behind each line.")
    ] = False,
    select: Annotated[
        list[str] | None, typer.Option(help="Only these records: a pattern of names, or CONDITION=VALUE; repeatable.")
    ] = None,
    heldout: Annotated[
        list[str] | None, typer.Option(help="Hold these records out, as --select; repeatable. Default: the format's.")
    ] = None,
    after: Annotated[
        float | None, typer.Option(min=0.0, help="Hold out what lies this many seconds after a record's first row.")
    ] = None,
    fit_all: Annotated[bool, typer.Option("--fit-all", help="Hold nothing out.")] = False,
    table: Annotated[str, typer.Option(help="csv or parquet.")] = "csv",
    strict: Annotated[
        bool, typer.Option("--strict/--lenient", help="Refuse unreadable rows, or leave them out and say so.")
    ] = True,
    option: Annotated[
        list[str] | None, typer.Option("--option", "-o", help="Option of the format, KEY=VALUE; repeatable.")
    ] = None,
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="What was written, as JSON on standard output.")] = False,
) -> None:
    """Turn a data set as its authors publish it into a recording, and say what is wrong with it."""
    if guess:
        _propose(form, path, out, as_json)
        return
    from cable_envs.diagnosis.data.writing import check_table
    from cable_envs.diagnosis.readers import reader
    from cable_envs.diagnosis.readers.base import Request, foreign
    from cable_envs.diagnosis.readers.writer import write_data_set

    check_table(table)
    if fit_all and (heldout or after is not None):
        raise ConfigurationError("--fit-all excludes --heldout and --after")
    _check_out(path, out)
    require_writable(out)
    asked = Request(mapping, strict, parse_pairs(option or (), "--option"))
    with foreign(str(path)):
        data = reader(form).open_dataset(path, asked)
    done = write_data_set(
        data, out, table=table, strict=strict, chosen=select or (), after=after,
        heldout=[] if fit_all else heldout or None,
        command=_command(form, path, mapping, select, heldout, after, option),
    )  # fmt: skip
    if as_json:
        print_json({"path": str(done.path), "rows": done.rows, "uses": done.uses, "doubts": done.faults,
                    "remarks": done.remarks})  # fmt: skip
    else:
        _print(done)


def _propose(form: str, path: Path, out: Path, as_json: bool) -> None:
    """Write a proposed mapping, and say what must be confirmed."""
    from cable_envs.core.files import write_atomic
    from cable_envs.diagnosis.readers.base import foreign
    from cable_envs.diagnosis.readers.guess.proposal import propose

    if out.suffix not in (".yaml", ".yml"):
        raise ConfigurationError(f"--guess writes a mapping: --out must name a file that ends in .yaml, got {out}")
    if out.exists():
        raise ConfigurationError(f"{out} is there already; nothing is overwritten")
    require_writable(out.parent)
    with foreign(str(path)):
        found = propose(path, form)
    write_atomic(out, found.text)
    if as_json:
        systems = [{"system": m.system, "fits": m.fits, "missing": m.missing} for m in found.matches]
        print_json({"path": str(out), "system": found.system, "confirm": found.open, "systems": systems})
        return
    show = console()
    show.print(found.text, markup=False, highlight=False, soft_wrap=True, end="")
    if found.open:
        show.print(f"confirm: {', '.join(found.open)}", markup=False)
    for one in found.matches:
        needs = "" if one.fits else f", needs {one.needs}"
        show.print(f"{one.system}: {'fits' if one.fits else 'does not fit'}{needs}", markup=False)
    then = shlex.join(["cablebench", "import", form, str(path), "--mapping", str(out), "--out", out.stem])
    show.print(f"wrote {out}; then: {then}", markup=False)


def _check_out(path: Path, out: Path) -> None:
    source = path if path.is_dir() else path.parent
    if out.resolve() == source.resolve():
        raise ConfigurationError(f"--out {out} is the data's own folder; name another one")


def _command(form: str, path: Path, mapping: Path | None, select, heldout, after: float | None, option) -> str:
    words = ["cablebench", "import", form, str(path)]
    words += ["--mapping", str(mapping)] if mapping else []
    for flag, values in (("--select", select), ("--heldout", heldout), ("--option", option)):
        for value in values or ():
            words += [flag, value]
    words += ["--after", f"{after:g}"] if after is not None else []
    return shlex.join(words)


def _print(done) -> None:
    from cable_envs.diagnosis.data.record import USES

    out = console()
    for kind in USES:
        files = [name for name, use in done.uses.items() if use == kind]
        if kind == "rest" and not files:
            continue
        rows = sum(done.rows[name] for name in files)
        out.print(f"{kind}: {len(files)} records, {rows} rows", markup=False)
    for title, lines in (("in doubt", done.faults), ("remarks", done.remarks)):
        for line in lines[:SHOWN]:
            out.print(f"{title}: {line}", markup=False)
        if len(lines) > SHOWN:
            out.print(f"{title}: {len(lines) - SHOWN} more, see {done.path}", markup=False)
    out.print(f"wrote {done.path}", markup=False)
