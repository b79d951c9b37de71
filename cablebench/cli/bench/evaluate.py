"""``cablebench evaluate``: controllers and policies over a protocol's episodes, into a results store."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.learn.train import ADDRESS_HELP, BACKEND_HELP, JOBS_HELP
from cablebench.cli.shared.arguments import resolve_task
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.recipes import entrant_recipes
from cablebench.cli.shared.seals import Seal, unsealed
from cablebench.cli.shared.trust import Trusted, Walls, say_sandboxes
from cablebench.jobs import open_backend


def evaluate(
    protocol: Annotated[str, typer.Option(help="Protocol: a name in configs/protocols, or a YAML file.")] = "quick",
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; repeatable.")] = None,
    track: Annotated[list[str] | None, typer.Option(help="Only this track; repeatable.")] = None,
    controller: Annotated[list[str] | None, typer.Option(help="Reference controller; repeatable.")] = None,
    gain: Annotated[
        list[str] | None, typer.Option(help="Gain of the one --controller, NAME=NUMBER; repeatable.")
    ] = None,
    policy: Annotated[list[str] | None, typer.Option(help="Trained policy: its file or folder; repeatable.")] = None,
    results: Annotated[Path | None, typer.Option(help="Results folder to add the records to.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Skip episodes that the results already hold.")] = False,
    seal: Seal = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
    jobs: Annotated[int | None, typer.Option(min=1, help=JOBS_HELP)] = None,
    backend: Annotated[str, typer.Option(help=BACKEND_HELP)] = "local",
    ray_address: Annotated[str | None, typer.Option(help=ADDRESS_HELP)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All records as JSON on standard output.")] = False,
) -> None:
    """Evaluate controllers (default: all references) and trained policies over the protocol's test episodes."""
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import open_store

    if resume and results is None:
        raise ConfigurationError("--resume needs --results: it skips what those already hold")
    chosen = unsealed(load_protocol(protocol), seal)
    if results is not None:
        require_writable(results)  # before an hour of episodes
    tasks = tuple(resolve_task(chosen, name) for name in env or ())
    recipes = entrant_recipes(controller or (), gain or (), policy or (), sandbox)
    if not controller and not policy:  # all references: those that the tasks are for
        recipes = _entering(recipes, chosen, tasks, tuple(track or ()))
    store = None if results is None else open_store(results)
    conditions = (tasks, tuple(track or ()), store)
    records = evaluate_on(backend, jobs, ray_address, chosen, recipes, conditions, resume)
    if as_json:
        print_json(records)
        return
    out = console()
    print_summary(records, out)
    if store is not None:
        out.print(f"{len(records)} records added to {store.path}", markup=False)
    else:
        out.print("Nothing was stored: --results FOLDER keeps the records.", style="dim")


def _entering(
    recipes: Iterable[Any], protocol: Any, tasks: tuple[str, ...], tracks: tuple[str, ...]
) -> tuple[Any, ...]:
    """The recipes whose entrants apply to at least one of the tasks."""
    from cablebench.entrants.named import entering

    made = {recipe: recipe() for recipe in recipes}
    kept = entering(made.values(), protocol, tasks, tracks)
    return tuple(recipe for recipe, entrant in made.items() if any(entrant is one for one in kept))


def evaluate_on(
    backend: str,
    jobs: int | None,
    ray_address: str | None,
    protocol: Any,
    recipes: Any,
    conditions: tuple[tuple[str, ...], tuple[str, ...], Any],
    resume: bool,
) -> list[dict[str, Any]]:
    """Evaluate what the recipes make, in this process or as jobs of a backend, under a progress bar; the new records.

    conditions: tasks, tracks, store, as `cablebench.run.evaluate.evaluate` takes them.
    """
    with progress_bar() as update:

        def report(p: Any) -> None:
            update("episodes", p.done, p.total, p.text)

        if backend == "local" and jobs in (None, 1) and ray_address is None:
            from cablebench.run.evaluation import evaluate as run

            entrants = [recipe() for recipe in recipes]
            say_sandboxes(entrants)
            return run(protocol, entrants, *conditions, report, resume)
        from cablebench.run.jobs import evaluate_in_jobs

        with open_backend(backend, jobs, ray_address) as workers:
            return evaluate_in_jobs(protocol, recipes, workers, *conditions, report, resume)


def choose_entrants(
    controllers: Iterable[str], gains: Iterable[str], policies: Iterable[str], sandbox: str = "auto"
) -> tuple[Any, ...]:
    """The entrants that the flags name: all references when they name none."""
    return tuple(recipe() for recipe in entrant_recipes(list(controllers), list(gains), list(policies), sandbox))


def entrant_of(words: str, record: Mapping[str, Any], sandbox: str = "auto") -> Any:
    """The entrant behind a record, made from the flags of its replay command, with the record's name and seed.

    Where its settings or its file differ from what was recorded, that is said on standard error.
    """
    given: dict[str, list[str]] = {"--controller": [], "--gain": [], "--policy": []}
    parts = shlex.split(words)
    for flag, value in zip(parts[::2], parts[1::2], strict=True):
        given[flag].append(value)
    made = choose_entrants(given["--controller"], given["--gain"], given["--policy"], sandbox)[0]
    say_sandboxes([made])
    if dict(made.settings) and dict(made.settings) != record.get("settings", {}):
        console(stderr=True).print(
            f"note: {words} is not as it was recorded: its settings or file differ", markup=False
        )
    return replace(made, name=record["entrant"], training_seed=record["training_seed"])


def print_summary(records: Sequence[Mapping[str, Any]], out: Any) -> None:
    """Median RMSE of every entrant on every task and track."""
    import numpy as np
    from rich.table import Table
    from rich.text import Text

    from cable_envs.core.text import number

    table = Table(box=None, pad_edge=False)
    for name in ("task", "track", "entrant", "episodes", "failed", "median RMSE", "unit"):
        table.add_column(name, justify="right" if name in ("episodes", "failed", "median RMSE") else "left")
    groups: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for r in records:
        at = f" {r['sweep']}={r['sweep_value']:g}" if r["sweep"] else ""
        seed = "" if r["training_seed"] is None else f" (seed {r['training_seed']})"
        groups.setdefault((r["task"], r["track"] + at, r["entrant"] + seed, r["output_unit"]), []).append(r)
    for (task, track, entrant, unit), group in groups.items():
        complete = [r["metrics"]["rmse"] for r in group if not r["metrics"]["failed"]]
        rmse = number(float(np.median(complete))) if complete else "–"
        table.add_row(task, track, Text(entrant), str(len(group)), str(len(group) - len(complete)), rmse, Text(unit))
    out.print(table)
