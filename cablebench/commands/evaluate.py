"""``cablebench evaluate``: controllers and policies over a protocol's episodes, into a results store."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.errors import ConfigurationError
from cablebench.commands.common import (
    console,
    parse_gains,
    policy_entrant,
    print_json,
    progress_bar,
    require_ours,
    resolve_env,
)

RECORDS = "records.jsonl"
"""The results store in a results folder."""


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
    as_json: Annotated[bool, typer.Option("--json", help="All records as JSON on standard output.")] = False,
) -> None:
    """Evaluate controllers (default: all references) and trained policies over the protocol's test episodes."""
    from cablebench import evaluate as evaluation
    from cablebench.protocol import load_protocol
    from cablebench.store import ResultStore

    if resume and results is None:
        raise ConfigurationError("--resume needs --results: it skips what those already hold")
    chosen = load_protocol(protocol)
    tasks = tuple(resolve_env(name) for name in env or ())
    entrants = choose_entrants(controller or (), gain or (), policy or ())
    store = None if results is None else ResultStore(results / RECORDS)
    with progress_bar() as update:
        records = evaluation.evaluate(
            chosen,
            entrants,
            tasks,
            tuple(track or ()),
            store,
            lambda p: update("episodes", p.done, p.total, p.text),
            resume,
        )
    if as_json:
        print_json(records)
        return
    out = console()
    print_summary(records, out)
    if store is not None:
        out.print(f"{len(records)} records added to {store.path}", markup=False)
    else:
        out.print("Nothing was stored: --results FOLDER keeps the records.", style="dim")


def choose_entrants(controllers: Iterable[str], gains: Iterable[str], policies: Iterable[str]) -> tuple[Any, ...]:
    """The entrants that the flags name: all references when they name none."""
    require_ours("baselines")
    from cablebench.entrants import named_entrant, reference_entrants

    names, given = list(controllers), list(gains)
    agents = tuple(policy_entrant(path) for path in policies)
    if given and len(names) != 1:
        raise ConfigurationError("--gain needs exactly one --controller")
    if given:
        return (named_entrant(names[0], parse_gains(given)), *agents)
    return (reference_entrants(names) if names or not agents else ()) + agents


def print_summary(records: list[Mapping[str, Any]], out: Any) -> None:
    """Median RMSE of every entrant on every task and track."""
    import numpy as np
    from rich.table import Table
    from rich.text import Text

    from cablebench.units import number

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
        table.add_row(task, track, entrant, str(len(group)), str(len(group) - len(complete)), rmse, Text(unit))
    out.print(table)
