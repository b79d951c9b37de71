"""``cablebench try``: an entrant on one task within a minute, scored between the frozen anchors; nothing is stored."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.bench.run import choose_entrant
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.trust import Trusted, Walls, say_sandboxes

POLICIES = (".zip", ".onnx")
"""Endings of files of trained policies; what has another one is a controller."""


def try_(
    entrant: Annotated[
        str, typer.Argument(help="A controller (name, .yaml or .py file) or a policy (.zip, .onnx, .yaml or folder).")
    ],
    task: Annotated[str, typer.Option(help="Environment of the protocol, by full or short id.")],
    protocol: Annotated[str, typer.Option(help="Protocol of score version 1: a name, or a YAML file.")] = "suite-v1",
    track: Annotated[
        list[str] | None, typer.Option(help="Track; repeatable. Default: all of the protocol that have no sweeps.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each track at most.")] = 10,
    seconds: Annotated[float, typer.Option(min=0.0, help="No episode is begun after this time, but one a track.")] = 50,
    sandbox: Walls = "auto",
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything in SI units as JSON on standard output.")] = False,
) -> None:
    """Try an entrant on one task: its score between the frozen anchors, raw values, and the rules that it breaks.

    The episodes are those for tuning, not the test's. To run all tasks: `cablebench submit FILE --board suite-v1`.
    """
    from cablebench.protocol.files import load_protocol
    from cablebench.score.anchors import anchors_of

    chosen = load_protocol(protocol)
    if not chosen.anchors:
        raise ConfigurationError(f"'{chosen.name}' has no frozen anchors; `cablebench run` scores one episode of it")
    one = chosen.task(task)
    names = tuple(track or (t.name for t in chosen.tracks if not t.sweeps))
    anchors = anchors_of(chosen, (one,))
    for name in names:
        if (one.env, chosen.track(name).name) not in anchors:
            raise ConfigurationError(f"{one.env} ({name}) has no anchors: `cablebench anchors --protocol {protocol}`")
    path = Path(entrant)
    policy = path.suffix in POLICIES or path.is_dir() or _names_policy(path)
    made = choose_entrant(None if policy else entrant, entrant if policy else None, (), sandbox)
    say_sandboxes([made])
    with progress_bar() as update:
        records, unit = _run(chosen, made, one, names, episodes, seconds, update)
    found = {name: _summary([r for r in records if r["track"] == name], chosen, anchors) for name in names}
    if as_json:
        print_json({"entrant": made.name, "task": one.env, "units": unit, "anchors": {
            name: vars(anchors[one.env, name]) for name in names}, "tracks": found})  # fmt: skip
        return
    _print(made, one, found, anchors, records[0])


def _names_policy(path: Path) -> bool:
    """Whether a path is that of a policy file."""
    from cable_envs.core.config import read_yaml
    from cablebench.entrants.policy_files import SCHEMA

    return path.suffix in (".yaml", ".yml") and path.is_file() and read_yaml(path).get("schema") == SCHEMA


def _run(
    protocol: Any, entrant: Any, task: Any, names: tuple[str, ...], episodes: int, seconds: float, update: Any
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Records with what a score needs, and the units of the metrics; the tracks take turns until the time is over."""
    import gymnasium as gym

    from cablebench.cli.shared.arguments import options_for
    from cablebench.protocol.metrics import METRICS, measure
    from cablebench.run.evaluation import core_of, run_episode

    cells = protocol.cells((task.env,), names)
    turns = [(k, cell) for k in range(episodes) for cell in cells if k < cell.episodes]
    begun, records = time.monotonic(), []
    for done, (k, cell) in enumerate(turns):
        if k > 0 and time.monotonic() - begun > seconds:
            break
        update("trying", done, len(turns), cell.key)
        options = options_for(entrant, task.env, cell.environment_options())
        env = gym.make(task.env, disable_env_checker=True, **options)
        try:
            setup = core_of(env).setup
            episode = run_episode(env, entrant.make(setup), protocol.tune.seed(k), cell.reset_options(setup))
        finally:
            env.close()
        records.append({
            "env_id": task.env, "track": cell.track.name, "sweep": cell.sweep and cell.sweep.name,
            "metrics": measure(episode), "output_unit": episode.output_unit, "command_unit": episode.command_unit,
        })  # fmt: skip
    first = records[0]
    units = {m.name: m.unit_of(first["output_unit"], first["command_unit"]) for m in METRICS}
    return records, units


def _summary(records: Sequence[Mapping[str, Any]], protocol: Any, anchors: Any) -> dict[str, Any]:
    """Score, failed episodes, broken rules, and the median of every metric, of one track's episodes."""
    import numpy as np

    from cablebench.protocol.failures import RULES
    from cablebench.protocol.metrics import METRICS
    from cablebench.score.log_score import score_records, survived, violations
    from cablebench.score.statistics import interquartile_mean

    scores = score_records(records, protocol, anchors)
    broken = [violations(r, anchors) for r in records]
    known = {m.name: np.array([r["metrics"][m.name] for r in records], float) for m in METRICS}
    swept = [survived(r, s, protocol, anchors) for r, s in zip(records, scores, strict=True) if r["sweep"]]
    return {
        "episodes": len(records),
        "score": float(interquartile_mean(np.array(scores))),
        "lowest": min(scores),
        "survived": float(np.mean(swept)) if swept else None,
        "failed": sum(map(bool, broken)),
        "violations": {rule.__name__: n for rule in RULES if (n := sum(rule.__name__ in names for names in broken))},
        "metrics": {name: float(np.median(v[np.isfinite(v)])) for name, v in known.items() if np.isfinite(v).any()},
    }


def _print(entrant: Any, task: Any, found: Mapping[str, Any], anchors: Any, record: Mapping[str, Any]) -> None:
    from types import SimpleNamespace

    from rich.table import Table
    from rich.text import Text

    from cablebench.board.cells import main_metrics
    from cablebench.board.suite import RANKED
    from cablebench.protocol.metrics import metric
    from cablebench.protocol.units import shown, unit_of

    out, units = console(), SimpleNamespace(**{k: record[k] for k in ("output_unit", "command_unit")})
    out.print(f"{entrant.title} ({entrant.information}) on {task.env}", markup=False)
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for name in found:
        table.add_column(name, justify="right")
    table.add_column("unit")

    def line(label: str, cells: Sequence[str], unit: str = "") -> None:
        table.add_row(Text(label), *map(Text, cells), Text(unit))

    rows = found.items()
    line("score (IQM): 0 open loop, 1 bound", [f"{f['score']:.2f}" for _, f in rows])
    line("lowest score", [f"{f['lowest']:.2f}" for _, f in rows])
    if any(f["survived"] is not None for _, f in rows):
        line("survived", ["–" if f["survived"] is None else f"{100 * f['survived']:.0f}" for _, f in rows], "%")
    line("episodes", [str(f["episodes"]) for _, f in rows])
    line("failed", [f"{f['failed']}" for _, f in rows])
    for rule in dict.fromkeys(rule for _, f in rows for rule in f["violations"]):
        line(f"  {rule}", [str(f["violations"].get(rule, 0)) for _, f in rows])
    for label, key in (("error of doing nothing (anchor)", "open_loop"), ("error of the bound (anchor)", "bound")):
        errors = [getattr(anchors[task.env, name], key) for name in found]
        line(label, [shown(e, "rmse", units) for e in errors], unit_of("rmse", units))
    for name in dict.fromkeys([*main_metrics(task.short, [record["metrics"]]), "command_ripple", *RANKED]):
        values = [f["metrics"].get(name) for _, f in rows]
        line(RANKED.get(name, metric(name).label), [shown(v, name, units) for v in values], unit_of(name, units))
    out.print(table)
