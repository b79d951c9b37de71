"""``cablebench retrain-study``: whether controllers and agents gain from a simulator that a diagnosis has corrected."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.shared.arguments import parse_pairs
from cablebench.cli.shared.output import console, print_json, progress_bar

INTERRUPTED = 130
QUICK = {
    "seeds": (0, 1), "steps": 8192, "trials": 4, "tuning_episodes": 1, "episodes": 2, "duration": 13.0,
    "record_seconds": 13.0,
}  # fmt: skip


def retrain_study(
    out: Annotated[Path, typer.Option(help="Folder for recording, diagnosis, policies, scores and the page.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Small budgets: they show that it runs, and measure nothing.")
    ] = False,
    rig: Annotated[
        list[str] | None, typer.Option(help="Hidden rig: circuit or hole; may be repeated, else both.")
    ] = None,
    seed: Annotated[list[int] | None, typer.Option(min=0, help="Seed of tuning and training; may be repeated.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Environment steps of each training.")] = None,
    trials: Annotated[int | None, typer.Option(min=1, help="Trials of each tuning.")] = None,
    tuning_episodes: Annotated[int | None, typer.Option(min=1, help="Episodes of a trial.")] = None,
    episodes: Annotated[int | None, typer.Option(min=1, help="Episodes on the hidden rig for each seed.")] = None,
    duration: Annotated[float | None, typer.Option(help="Length of an episode, s; default: the rig's.")] = None,
    record_seconds: Annotated[float | None, typer.Option(help="Length of each recorded motion, s.")] = None,
    hide: Annotated[
        list[str] | None, typer.Option(help="Concealed effect of the one --rig, as backlash.gap=0.1; may be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON on standard output.")] = False,
) -> None:
    """Record hidden rigs, diagnose them, and compare training on nominal, corrected and true simulators."""
    from cablebench.cli.physics.retrain_steps import run
    from cablebench.pays.rigs import RIGS
    from cablebench.pays.scores import Study

    asked: dict[str, Any] = {
        "seeds": tuple(seed) if seed else None, "steps": steps, "trials": trials, "tuning_episodes": tuning_episodes,
        "episodes": episodes, "duration": duration, "record_seconds": record_seconds, "hidden": hidden(hide or ()),
    }  # fmt: skip
    given = {name: value for name, value in asked.items() if value is not None}
    rigs = tuple(dict.fromkeys(rig or RIGS))
    if "hidden" in given and len(rigs) > 1:
        raise ConfigurationError("--hide: say which rig has the effect, with one --rig")
    studies = [Study(rig=name, **{**(QUICK if quick else {}), **given}) for name in rigs]
    err = console(stderr=True)
    require_writable(out)
    try:
        with progress_bar() as update:
            result = run(studies, out, quick, lambda text: err.print(text, markup=False), update)
    except KeyboardInterrupt as stop:
        err.print(f"interrupted: what is finished is kept in {out}; the same command goes on from there", markup=False)
        raise typer.Exit(INTERRUPTED) from stop
    if as_json:
        print_json(result)
        return
    console().print((out / "pays.md").read_text(encoding="utf-8"), markup=False)


def hidden(pairs: Any) -> dict[str, dict[str, float]] | None:
    """``["backlash.gap=0.1"]`` as effects; None where none is given. Names are checked by `scores.Study`."""
    found: dict[str, dict[str, float]] = {}
    for name, value in parse_pairs(pairs, "--hide").items():
        effect, dot, parameter = name.partition(".")
        if not dot or isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ConfigurationError(f"--hide expects EFFECT.PARAMETER=NUMBER, got '{name}={value}'")
        found.setdefault(effect, {})[parameter] = float(value)
    return found or None
