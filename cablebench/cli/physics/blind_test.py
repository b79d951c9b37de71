"""``cablebench blind-test``: concealed effects made by independent generators, diagnosed blind, then scored."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import packed_json, require_writable
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.jobs import open_backend
from cablebench.jobs.work import Job

QUICK = {"per_effect": 1, "nothing": 4}
QUICK_CASES = 27
INTERRUPTED = 130


def blind_test(
    context: typer.Context,
    out: Annotated[Path, typer.Option(help="Folder for recordings, keys, verdicts and results.")] = Path(
        "results/proof"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="A sample of a few dozen cases.")] = False,
    cases: Annotated[
        int | None, typer.Option(help="Cases for each effect and system; by default 20 of generator a, 8 of b.", min=1)
    ] = None,
    first: Annotated[int | None, typer.Option(help="Only this many cases; their order is random.", min=1)] = None,
    after: Annotated[int, typer.Option(help="Skip this many cases, to run a proof in parts.", min=0)] = 0,
    join: Annotated[
        list[Path] | None, typer.Option(help="proof.json.xz of a part; repeatable: join the parts, run nothing.")
    ] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(help="Only kind single, pair, nothing, decoy or strange; repeatable."),
    ] = None,
    system: Annotated[list[str] | None, typer.Option(help="Only this system; may be repeated.")] = None,
    generator: Annotated[
        str,
        typer.Option(help="Who makes the cases: a (laboratory logs), or b (other laws; logs as rigs make them)."),
    ] = "a",
    seed: Annotated[int, typer.Option(help="Seed of the cases; calibration uses other seeds.", min=0)] = 5,
    jobs: Annotated[int, typer.Option(help="Recordings at a time.", min=1)] = 1,
    baselines: Annotated[bool, typer.Option(help="Run the simpler methods too.")] = True,
    tool: Annotated[bool, typer.Option(help="Run `cablebench diagnose`; without it only the baselines.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="The whole record on standard output.")] = False,
) -> None:
    """Measure how often the diagnosis is right. Exit code 1 if a limit is exceeded.

    The same command goes on where a stopped one was.
    """
    if quick and cases is not None:
        raise ConfigurationError("--quick and --cases exclude each other")
    if not tool and not baselines:
        raise ConfigurationError("--no-tool and --no-baselines leave nothing to do")
    if join:
        if quick or cases or first or after or kind or system:
            raise ConfigurationError("--join takes finished parts: beside it only --out and --json mean something")
        if _joined(out, join, as_json):
            raise typer.Exit(1)
        return
    command = _tool_command(context) if tool else []
    from cable_envs.proof.cases import KINDS
    from cable_envs.proof.effects import SYSTEMS
    from cable_envs.proof.run import GENERATORS, scored

    require_known("generator", [generator], GENERATORS)
    systems, kinds = tuple(dict.fromkeys(system or SYSTEMS)), tuple(dict.fromkeys(kind or KINDS))
    require_known("system", systems, SYSTEMS)
    require_known("kind", kinds, KINDS)
    asked = _asked(quick, cases, after, first, kinds if kind else (), systems, seed, generator)
    methods = _methods(tool, baselines)
    require_writable(out)
    try:
        wanted = [case for case in _plan(quick, cases, systems, seed, generator) if case.kind in kinds]
        if not wanted:
            raise ConfigurationError(f"no case of kind {', '.join(kinds)} is in this plan")
        if after >= len(wanted):
            raise ConfigurationError(f"--after {after} leaves none of {len(wanted)} cases")
        wanted = wanted[after:][:first]
        manifest = _make(out, wanted, jobs, generator, {"plan": asked, "state": _state()})
        _diagnose(out, manifest, methods, command, jobs)
    except KeyboardInterrupt:
        console(stderr=True).print(f"what is finished is kept in {out}; the same command goes on from there")
        raise typer.Exit(INTERRUPTED) from None
    results = {method: scored(out, manifest, method) for method in methods}
    plan = {"seed": seed, "systems": systems, "cases": cases, "quick": quick, "generator": generator}
    about = {"command": asked, "state": manifest["state"], "plan": plan, **_missing(out, manifest, methods)}
    broken = _report(out, results, about, quick, as_json)
    if (broken and tool) or "missing" in about:
        raise typer.Exit(1)


def _tool_command(context: typer.Context) -> list[str]:
    """How the tool is started. Raises ConfigurationError where this version has none."""
    root = context.find_root()
    if "diagnose" not in root.command.list_commands(root):  # type: ignore[attr-defined]  # a group, as its root
        raise ConfigurationError(
            "there is no command 'cablebench diagnose' in this version, so there is nothing to prove; "
            "--no-tool makes the cases and scores the baselines alone"
        )
    return [sys.executable, "-m", "cablebench.cli", "diagnose"]


def _state() -> str:
    """Of the simulator, the diagnosis and the generators: parts of one proof are by one of them."""
    import cable_envs
    from cable_envs import diagnosis, proof
    from cable_envs.proof.sealing import state_of

    return state_of(cable_envs, diagnosis, proof)


def _methods(tool: bool, baselines: bool) -> list[str]:
    from cable_envs.proof.baselines import BASELINES
    from cable_envs.proof.run import TOOL

    return ([TOOL] if tool else []) + (list(BASELINES) if baselines else [])


def _asked(
    quick: bool, cases: int | None, after: int, first: int | None, kinds: Sequence[str], systems: Sequence[str],
    seed: int, generator: str,
) -> str:  # fmt: skip
    words = ["cablebench", "blind-test"] + (["--quick"] if quick else [])
    words += ["--cases", str(cases)] if cases is not None else []
    words += ["--after", str(after)] if after else []
    words += ["--first", str(first)] if first is not None else []
    for name in kinds:
        words += ["--kind", name]
    for name in systems:
        words += ["--system", name]
    words += ["--generator", generator] if generator != "a" else []
    return shlex.join([*words, "--seed", str(seed)])


def _plan(quick: bool, cases: int | None, systems: Sequence[str], seed: int, generator: str) -> list[Any]:
    if generator == "b":
        from cable_envs.proof.family_b import cases as second

        plan = second.plan(systems, 0.05 if quick else (cases or second.PER_EFFECT) / second.PER_EFFECT, seed)
        return plan[:QUICK_CASES] if quick else plan
    from cable_envs.proof.cases import plan as first

    if quick:
        return first(systems, seed=seed, **QUICK)[:QUICK_CASES]
    return first(systems, seed=seed) if cases is None else first(systems, cases, max(5 * cases, 10), seed)


def _make(
    out: Path, wanted: Sequence[Any], jobs: int, generator: str, about: Mapping[str, Any]
) -> dict[str, Any]:  # fmt: skip
    """Recordings, sealed keys, manifest, which says ``about``."""
    from cable_envs.proof.run import make_one, write_manifest

    lines = {}
    with progress_bar() as update, open_backend("local", jobs) as backend:
        for done in backend.run(
            [Job(c.name, make_one, {"case": c, "out": str(out), "generator": generator}) for c in wanted]
        ):
            lines[done.job.key] = done.value()
            update("recordings", len(lines), len(wanted))
    return write_manifest(out, lines, about)


def _diagnose(out: Path, manifest: dict[str, Any], methods: list[str], command: list[str], jobs: int) -> None:
    from cable_envs.diagnosis import load_recording
    from cable_envs.proof.run import diagnose_one

    for method in methods:
        arguments = {"out": str(out), "method": method, "command": command, "read": load_recording}
        wanted = [Job(f"{method} {n}", diagnose_one, {"name": n, **arguments}) for n in manifest["cases"]]
        with progress_bar() as update, open_backend("local", jobs) as backend:
            for k, done in enumerate(backend.run(wanted), 1):
                done.value()
                update(method, k, len(wanted))


def _missing(out: Path, manifest: dict[str, Any], methods: Sequence[str]) -> dict[str, Any]:
    """What the record says of cases on which a method was killed; nothing where there are none."""
    from cable_envs.proof.run import missing

    killed = {method: missing(out, manifest, method) for method in methods}
    return {"missing": killed} if any(killed.values()) else {}


def _joined(out: Path, parts: Sequence[Path], as_json: bool) -> list[str]:
    """The report of several parts of one proof; the limits that the tool exceeds.

    Raises ConfigurationError for what is no record of a proof, parts of several plans, and cases that are in two parts.
    """
    from cable_envs.proof.report import one_command, parts_of, together
    from cable_envs.proof.run import TOOL

    records = parts_of(parts)
    about = {"command": one_command([record["command"] for record in records]), "plan": records[0]["plan"]}
    about |= {"state": records[0]["state"]} if "state" in records[0] else {}
    killed: dict[str, dict[str, str]] = {}
    for record in records:
        for method, cases in record.get("missing", {}).items():
            killed.setdefault(method, {}).update(cases)
    about |= {"missing": killed} if killed else {}
    results = together(records)
    broken = _report(out, results, about, bool(about["plan"]["quick"]), as_json)
    return broken if TOOL in results else []


def _report(out: Path, results: Mapping[str, Any], about: dict[str, Any], quick: bool, as_json: bool) -> list[str]:
    """Write ``results`` by method; the limits that the first of them exceeds."""
    from cable_envs.core.files import jsonable, write_atomic
    from cable_envs.proof import report
    from cablebench.pages.proof import render

    about = {**about, "cases_total": len(next(iter(results.values()))), "sample": quick}
    whole = jsonable(report.record(results, about))
    text = report.markdown(results, about)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / "proof.json.xz", packed_json(whole))
    write_atomic(out / "proof.md", text)
    write_atomic(out / "proof.html", render(whole))
    for line in report.missing_words(about):
        console(stderr=True).print(f"{line} The same command tries them again.", markup=False)
    if as_json:
        print_json(whole)
    else:
        typer.echo(text)
        console(stderr=True).print(f"wrote proof.json.xz, proof.md and proof.html to {out}", markup=False)
    return list(whole["broken_rules"])
