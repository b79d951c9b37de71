"""``cablebench diagnose``: what physics a recording shows that its simulator leaves out."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.files import require_writable
from cablebench.cli.shared.output import console, print_json
from cablebench.cli.shared.progress import stages
from cablebench.cli.shared.trust import Trusted
from cablebench.pages.diagnosis_words import lines

INTERRUPTED = 130


def diagnose(
    recording: Annotated[Path, typer.Argument(help="A recording's YAML file, or the folder that holds it.")],
    out: Annotated[Path | None, typer.Option(help="Folder for diagnosis.json, augmented.yaml and report.html.")] = None,
    add: Annotated[
        list[Path] | None, typer.Option(help="Further records of the same rig, as of the next experiment: a recording.")
    ] = None,
    effects: Annotated[
        str | None, typer.Option(help="Look for these effects only: names, with commas between.")
    ] = None,
    without: Annotated[
        str | None, typer.Option(help="Do not look for these effects: names, with commas between.")
    ] = None,
    effect_file: Annotated[Path | None, typer.Option(help="An effect of your own, looked for as well.")] = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig file whose numbers and effects replace the recording's.")
    ] = None,
    variant: Annotated[
        str,
        typer.Option(
            help="Model of a circuit: chain, or analytic, the closed form; default as its rig says, else chain."
        ),
    ] = "",
    simulator: Annotated[
        str | None,
        typer.Option(help="A simulator of your own for a recording of system own: FILE.py:NAME, which is executed."),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes that share the runs of --simulator.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws behind p-values.")] = 0,
    device: Annotated[str, typer.Option(help="Where refits run: cpu, or cuda (an NVIDIA GPU).")] = "cpu",
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="The verdict as JSON on standard output.")] = False,
) -> None:
    """Find, name and model the physics that a simulator leaves out.

    Nominal parameters are refitted first; only what they cannot absorb counts. Models with and without each effect, and
    with a part that nothing explains, are compared by their evidence. Answers: named, equivalence_class, partly_named,
    unknown, data_fault, or no_detectable_mismatch.
    """
    from cable_envs.diagnosis.data.joined import joined
    from cable_envs.diagnosis.data.recording import load_recording
    from cable_envs.diagnosis.engine import diagnose as run
    from cable_envs.diagnosis.fit.rounds import heard
    from cable_envs.sim.replay import replays_on

    own = None
    if simulator is not None:
        from cable_envs.diagnosis.simulators.base import load_simulator

        own = load_simulator(simulator)
        own.workers = workers
    err = console(stderr=True)
    if out is not None:
        require_writable(out)
        out.mkdir(parents=True, exist_ok=True)
    loaded = joined(load_recording(recording), [load_recording(path) for path in add or ()])
    try:
        with stages() as (tell, hear), heard(hear), replays_on(device):
            found = run(
                loaded, effects=_names(effects), without=_names(without) or (), effect_file=effect_file, rig=rig,
                variant=variant, simulator=own, seed=seed, out=out, tell=tell,
            )  # fmt: skip
    except KeyboardInterrupt:
        kept = f"finished steps are kept in {out}; the same command goes on from there" if out else "nothing is kept"
        err.print(f"interrupted: {kept}", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    record = found.as_json()
    if out is not None:
        found.write(out)
        _write_report(out, record, found.traces)
    if as_json:
        print_json(record)
        return
    for line in lines(record):
        console().print(line, markup=False)
    if out is not None:
        err.print(f"wrote diagnosis.json, {found.augmented_rig} and report.html to {out}", markup=False)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def _write_report(out: Path, record: dict[str, Any], traces: Any) -> None:
    from cable_envs.core.files import jsonable, write_atomic
    from cablebench.pages.diagnosis import render

    write_atomic(out / "report.html", render(jsonable(record), traces))
