"""``cablebench next-experiment``: the motion to run next, so that its record settles what an answer leaves open."""

from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json, require_writable
from cablebench.cli.shared.output import console, print_json
from cablebench.cli.shared.progress import stages


def next_experiment(
    recording: Annotated[Path, typer.Argument(help="The recording that was diagnosed, or its folder.")],
    answer: Annotated[Path, typer.Option(help="Its answer: diagnosis.json, or the folder that holds it.")],
    out: Annotated[Path | None, typer.Option(help="Folder for reference.csv and experiment.json.")] = None,
    between: Annotated[
        str | None,
        typer.Option(help="Effects to tell apart, with commas; default: what the answer leaves open."),
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="Length of the motion, s; default: the longest record.")] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(help="low=, high=, speed=, acceleration=, frequency= of the drive, SI; default: as recorded."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="What of the rig can be set for it, SI: load_mass=8, or several at once with commas; repeat."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the motions that are drawn.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="The experiment as JSON on standard output.")] = False,
) -> None:
    """Compute the motion whose record would settle what a diagnosis leaves open: a class, an unknown, a wide interval.

    Motions within the limits of the drive are simulated under every model that is left, and the one is chosen by which
    the true model is expected to lead by most. Run reference.csv, import its log with the mapping of the others, and
    give it to `cablebench diagnose RECORDING --add NEW`.
    """
    from cable_envs.diagnosis.data.recording import load_recording
    from cable_envs.diagnosis.experiment.design import next_experiment as design
    from cable_envs.diagnosis.model.verdict import from_json

    if out is not None:
        require_writable(out)
    found = from_json(read_json(answer / "diagnosis.json" if answer.is_dir() else answer))
    with stages() as (tell, _):
        plan = design(
            load_recording(recording), found, between=None if between is None else _names(between), seconds=seconds,
            limits=_numbers("--limit", limit or [], "speed=0.05"), seed=seed, tell=tell,
            settings=[_numbers("--set", _names(one), "load_mass=8") for one in set_ or []],
        )  # fmt: skip
    if out is not None:
        plan.write(out)
    if as_json:
        print_json(plan.as_json())
        return
    for line in plan.lines():
        console().print(line, markup=False)
    if out is not None:
        console(stderr=True).print(f"wrote reference.csv and experiment.json to {out}", markup=False)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _numbers(option: str, given: list[str], example: str) -> dict[str, float]:
    found = {}
    for entry in given:
        name, _, number = entry.partition("=")
        try:
            found[name.strip()] = float(number)
        except ValueError:
            raise ConfigurationError(f"{option} {entry}: expected a name and a number, as {example}") from None
    return found
