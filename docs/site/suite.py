"""A page for each task of suite v1: its levels, what is drawn, sensors, rules and prices, from its file."""

from collections.abc import Mapping
from typing import Any

from cable_envs import SUITE_IDS
from cable_envs.plants import title_of
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cable_envs.sim.suite.levels import SPLITS
from cable_envs.sim.tasks import SUITE
from docs.site.environments import FOLDER, sections, slug
from docs.site.markdown import page, table, unit


def pages() -> dict[str, str | bytes]:
    """One page for each task."""
    return {f"{FOLDER}/{slug(task)}.md": _page([i for i in SUITE_IDS if f"/{task}-" in i]) for task in SUITE}


def _page(ids: list[str]) -> str:
    setup = setup_of(ids[0], {})
    task = setup.task
    return page(
        f"# {task.name}",
        f"A task of [suite v1](../suite.md). {' '.join(task.description.split())}",
        f"Mechanism: [{title_of(task.name.split('-')[0])}](../plants/{setup.rig.plant.replace('_', '-')}.md), rig "
        f"`{setup.rig.name}`, plant `{setup.plant.name}`. Output: `{task.output}` [{setup.output_unit}]. Action: one "
        f"number from -1 to 1, which is {setup.low:g} to {setup.high:g} {setup.action_mode.unit} "
        f"(`{setup.action_mode.name}`). Episode: {setup.steps} steps of {setup.control_period:g} s; the first "
        f"{task.homing:g} s are not scored.",
        "## Levels",
        _levels(ids),
        "## Drawn for each episode",
        *(_drawn(env_id) for env_id in ids),
        "## Observation space",
        _observed(setup),
        "## Rewards and rules",
        sections()["Rewards"],
        f"Here `error_scale` is {task.error_scale:g} {setup.output_unit} and `limit` {_conditions(setup).activity:g} "
        "of the command's range.",
        _rules(setup),
    )


def _conditions(setup: Setup) -> Any:
    assert setup.conditions is not None
    return setup.conditions


def _levels(ids: list[str]) -> str:
    rows: list[tuple[str, ...]] = []
    before = ""
    for env_id in ids:
        setup = setup_of(env_id, {})
        reference = signal(setup.reference)
        shown, before = ("as above" if reference == before else reference), reference
        late = f"{setup.sensor_delay} steps" if setup.sensor_delay else "–"
        observed = "output" if setup.output_observed else "drive"
        rows.append((f"`{env_id}`", shown, signal(setup.disturbance), observed, late))
    return table(("id", "reference (SI, s, Hz)", "disturbance", "observed", "sensors late by"), rows)


def signal(spec: Mapping[str, Any]) -> str:
    """A signal for people: its kind with its numbers and ranges.

    Examples
    --------
    >>> signal({"kind": "sine", "amplitude": [0.1, 0.2], "frequency": 1.0})
    'sine: amplitude 0.1 to 0.2, frequency 1'
    """
    if "one_of" in spec:
        return "one of:<br>" + "<br>".join(map(signal, spec["one_of"]))
    if dict(spec) == {"kind": "constant"}:
        return "–"
    shown = (f"{name} {_number(value)}" for name, value in spec.items() if name != "kind")
    return f"{spec['kind']}: {', '.join(shown)}"


def _number(value: Any) -> str:
    return f"{value[0]:g} to {value[1]:g}" if isinstance(value, list) else f"{value:g}"


def _drawn(env_id: str) -> str:
    setups = {split: setup_of(env_id, {"split": split}) for split in SPLITS}
    ranges = {split: {n: f"{low:g} to {high:g}" for n, low, high in one.randomize} for split, one in setups.items()}
    names = list(dict.fromkeys(name for one in ranges.values() for name in one))
    known = setups["train"].plant.table
    rows = [(f"`{n}`", unit(known[n].unit), *(ranges[split].get(n, "–") for split in SPLITS)) for n in names]
    conditions = _conditions(setups["train"])
    low, high = conditions.start
    told = f"`{env_id}`: the output begins {low:g} to {high:g} beside its reference"
    for name, reach in conditions.unhomed.items():
        told += f", and the zero of `{name}` is anywhere within {reach:g}"
    cables = (_conditions(setups["test"]).cables.shape[1]) if _conditions(setups["test"]).cable_rows else 0
    told += f". The test rigs have one of {cables} other cables of Table A1." if cables else "."
    return page(told, table(("parameter", "unit", "train", "test"), rows) if rows else "The rig is that of its file.")


def _observed(setup: Setup) -> str:
    sensors, rows = _conditions(setup).sensors, []
    for k, channel in enumerate(setup.channels):
        one = sensors.get(channel.name)
        noise = setup.noise[setup.plant.row(channel.name)] if channel.measured else 0.0
        said = [f"noise {noise:g}"] if noise and not (one and one.of) else []
        if one is not None:
            said += [f"difference of `{one.of}`, filter {one.filter:g} s"] if one.of else []
            said += [f"steps of {one.quantum:g}"] if one.quantum else []
            said += [f"every {one.period:g} s"] if one.period else []
            said += [f"{one.latency:g} s late"] if one.latency else []
        if channel.name == "reference_acceleration":
            said = ["0 without `preview`"]
        rows.append((f"{k}", f"`{channel.name}`", unit(channel.unit), f"{channel.scale:g}", "; ".join(said) or "–"))
    return table(("entry", "channel", "unit", "scale", "sensor (SI)"), rows, numbers=(0, 3))


def _rules(setup: Setup) -> str:
    rows = [
        (f"{k + 1}", rule.name, f"`{rule.signal}`", f"{rule.low:g}", f"{rule.high:g}", f"{rule.longer_than:g} s")
        for k, rule in enumerate(_conditions(setup).rules)
    ]
    return table(("failure", "rule", "signal", "from", "to", "ends the episode after"), rows, numbers=(3, 4))
