"""``cablebench envs``: what there is to control, with units."""

from typing import Annotated, Any

import typer

from cablebench.cli.shared.arguments import resolve_env, short_name
from cablebench.cli.shared.output import console, print_json


def envs(
    env: Annotated[str | None, typer.Argument(help="One environment, by full or short id; all when left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON on standard output.")] = False,
) -> None:
    """List environments: output, reference, action modes, observation channels with units; and the rigs."""
    from cable_envs import FIRST_IDS, SUITE_IDS

    chosen = [resolve_env(env, every_version=True)] if env else [*FIRST_IDS, *SUITE_IDS]
    listing = [describe(env_id) for env_id in chosen]
    rigs = describe_rigs({e["plant"] for e in listing})
    if as_json:
        print_json({"environments": listing, "rigs": rigs})
        return
    out = console()
    if env:
        _print_one(listing[0], out)
    else:
        _print_all(listing, out)
    _print_rigs(rigs, out)


def describe(env_id: str) -> dict[str, Any]:
    """One environment as JSON types: units, action modes with their ranges, observation channels by level."""
    import gymnasium as gym

    from cable_envs.core.errors import ConfigurationError
    from cable_envs.sim.setup import make_setup
    from cable_envs.sim.tasks import LEVELS

    arguments = gym.spec(env_id).kwargs
    setup = make_setup(**arguments)
    values = setup.rig.values

    def seen(level: str) -> Any:
        """The channels of a level, with ideal sensors where the task has none for it."""
        try:
            return make_setup(**arguments, observe=level).channels
        except ConfigurationError:
            return make_setup(**arguments, observe=level, sensors="ideal").channels

    channels = {level: seen(level) for level in LEVELS}

    def ranged(m: Any) -> dict[str, Any]:
        return {
            "name": m.name,
            "unit": m.unit,
            "low": 0.0 if m.one_sided else -values[m.bound],
            "high": values[m.bound],
        }

    return {
        "id": env_id,
        "description": setup.task.description,
        "plant": setup.rig.plant,
        "rig": setup.rig.name,
        "output": setup.task.output,
        "unit": setup.output_unit,
        "reference": dict(setup.reference),
        "duration_s": setup.steps * setup.control_period,
        "control_period_s": setup.control_period,
        "substeps": setup.substeps,
        "action_mode": setup.action_mode.name,
        "action_modes": [
            ranged(m) | ({"second": ranged(m.commands[1])} if len(m.commands) > 1 else {})
            for m in setup.plant.action_modes
        ],
        "observe": next(level for level, those in channels.items() if those == setup.channels),
        "channels": {
            level: [{"name": c.name, "unit": c.unit, "scale": c.scale} for c in those]
            for level, those in channels.items()
        },
        "error_scale": setup.task.error_scale,
        "success_error": setup.task.success_error,
    }


def describe_rigs(plants: set[str]) -> list[dict[str, Any]]:
    """The presets in configs/rigs that belong to ``plants``."""
    from cable_envs.core.config import config_root
    from cable_envs.sim.rigs import load_rig

    rigs = [load_rig(path.stem) for path in sorted((config_root() / "rigs").glob("*.yaml"))]
    return [
        {"name": r.name, "plant": r.plant, "holes": r.holes, "description": " ".join(r.description.split())}
        for r in rigs
        if r.plant in plants
    ]


def _reference(spec: dict[str, Any]) -> str:
    if "one_of" in spec:
        return "one of " + "; ".join(map(_reference, spec["one_of"]))
    rest = ", ".join(f"{k} {_number(v)}" for k, v in spec.items() if k != "kind")
    return f"{spec['kind']} ({rest})"


def _number(value: Any) -> str:
    """A number, or the range that it is drawn from."""
    return f"{value[0]:g} to {value[1]:g}" if isinstance(value, list) else f"{value:g}"


def _print_all(listing: list[dict[str, Any]], out: Any) -> None:
    from rich.table import Table

    table = Table(title="Environments (cable_envs/...)", title_justify="left", box=None, pad_edge=False)
    longest = max(len(short_name(e["id"])) for e in listing)
    table.add_column("id", no_wrap=True, min_width=longest)  # it is typed: on a narrow terminal the others are folded
    for name in ("output", "unit", "action modes", "observes"):
        table.add_column(name, overflow="fold")
    for e in listing:
        modes = sorted(e["action_modes"], key=lambda m: m["name"] != e["action_mode"])
        action = ", ".join(m["name"] for m in modes if "second" not in m)
        action += " *" if any("second" in m for m in modes) else ""
        table.add_row(short_name(e["id"]), e["output"], e["unit"], action, e["observe"])
    out.print(table)
    out.print(
        "The first action mode is the default. *: there are modes with a second action. `cablebench envs ID` shows "
        "ranges, reference and observation channels; --json gives everything.\n",
        style="dim",
    )


def _print_one(e: dict[str, Any], out: Any) -> None:
    from rich.table import Table

    out.print(f"{e['id']}\n{e['description']}\n", markup=False)
    out.print(f"output     {e['output']} [{e['unit']}], success within {e['success_error']:g}", markup=False)
    out.print(f"reference  {_reference(e['reference'])}")
    episode = f"{e['duration_s']:g} s in control steps of {e['control_period_s']:g} s, {e['substeps']} substeps each"
    out.print(f"episode    {episode}")
    for m in e["action_modes"]:
        mark = "default" if m["name"] == e["action_mode"] else ""
        more = m.get("second")
        more = f" and {more['low']:g}..{more['high']:g} {more['unit']}" if more else ""
        out.print(f"action     -1..1 is {m['low']:g}..{m['high']:g} {m['unit']}{more} ({m['name']}) {mark}")
    table = Table(title=f"\nObservation (default: {e['observe']})", title_justify="left", box=None, pad_edge=False)
    for name in ("channel", "unit", "scale", "in levels"):
        table.add_column(name)
    for c in e["channels"]["full"]:
        levels = [level for level, channels in e["channels"].items() if c in channels]
        table.add_row(c["name"], c["unit"], f"{c['scale']:g}", ", ".join(levels))
    out.print(table)
    out.print()


def _print_rigs(rigs: list[dict[str, Any]], out: Any) -> None:
    from rich.table import Table

    table = Table(title="Rigs", title_justify="left", box=None, pad_edge=False)
    for name in ("name", "plant", "description"):
        table.add_column(name, overflow="fold")
    for r in rigs:
        table.add_row(r["name"], r["plant"], r["description"])
    out.print(table)
