"""A page for each task, as Gymnasium's environments have: from the registry, the setup, and `CableEnv`'s docstring."""

import inspect
import re
from functools import partial
from itertools import groupby
from typing import Any

import gymnasium as gym

from cable_envs import FIRST_IDS
from cable_envs.envs import CableEnv
from cable_envs.plants import title_of
from cable_envs.sim.setup import Setup, make_setup
from cable_envs.sim.tasks import LEVELS
from cable_envs.spaces import make_spaces
from cablebench.protocol.files import load_protocol
from docs.site.cache import kept
from docs.site.films import best_controller, film, last, small
from docs.site.markdown import linked_pages, page, picture, table, unit, whole_picture
from docs.site.reports import BOARDS

FOLDER = "environments"


def pages() -> dict[str, str | bytes]:
    """The list, and a page with a moving picture for each task."""
    made: dict[str, str | bytes] = {f"{FOLDER}/index.md": _list()}
    for task, ids in tasks().items():
        made[f"{FOLDER}/{slug(task)}.md"] = _page(task, ids)
        sine = next(env_id for env_id in ids if "-Sine-" in env_id)
        controller = best_controller(task, "sine")
        whole = made[f"{FOLDER}/{slug(task)}.webp"] = kept(f"{slug(task)}.webp", partial(film, sine, controller))
        plant = _setup(sine).rig.plant
        made[f"{FOLDER}/small-{slug(task)}.webp"] = kept(f"small-{slug(task)}.webp", partial(_small, whole, plant))
    return made


def _small(whole: bytes, plant: str) -> bytes:
    return small(last(whole), plant)


def tasks() -> dict[str, list[str]]:
    """The ids of each task.

    Examples
    --------
    >>> len(tasks()["CableHole-Tension"])
    2
    """
    return {task: list(ids) for task, ids in groupby(FIRST_IDS, key=lambda env_id: gym.spec(env_id).kwargs["task"])}


def slug(task: str) -> str:
    """Address of a task: "CableHole-Position" is at "cable-hole-position"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", task).lower()


def sections() -> dict[str, str]:
    """What `CableEnv`'s docstring says for all environments, by its headings; tables with one line a row."""
    text = inspect.getdoc(CableEnv) or ""
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    return {head.strip(): _whole_rows(body.strip()) for head, body in zip(parts[1::2], parts[2::2], strict=True)}


def _whole_rows(text: str) -> str:
    """Rows that the docstring breaks over several lines, whose first cell then is empty, joined."""
    lines: list[str] = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and not cells[0] and lines:
            before = [cell.strip() for cell in lines.pop().strip("|").split("|")]
            line = f"| {' | '.join(' '.join(pair).strip() for pair in zip(before, cells, strict=True))} |"
        lines.append(line)
    return "\n".join(lines)


def _list() -> str:
    rows = []
    for task, ids in tasks().items():
        setup = _setup(ids[0])
        link = f"[{task}]({slug(task)}.md)"
        image = f"[{picture(f'small-{slug(task)}.webp', task, 'thumb')}]({slug(task)}.md)"
        rows.append((image, link, setup.task.description, f"{setup.task.output} [{setup.output_unit}]"))
    return page(
        "# Environments",
        f"{len(tasks())} tasks on {len({_setup(i).rig.plant for i in FIRST_IDS})} mechanisms, each with a step and "
        "with a sine as its reference. All are Gymnasium environments with one continuous action, or two; the class "
        "`cable_envs.envs.CableEnv` is the same for all of them.",
        table(("", "task", "what it asks for", "output"), rows),
        "`import cable_envs` registers the ids, and `cablebench envs` lists them in a terminal.",
    )


def _setup(env_id: str, **options: Any) -> Setup:
    return make_setup(**gym.spec(env_id).kwargs, **options)


def _page(task: str, ids: list[str]) -> str:
    setup = _setup(ids[0])
    said = sections()
    controller = best_controller(task, "sine")
    return page(
        f"# {task}",
        whole_picture(f"{slug(task)}.webp", f"{task}: the mechanism under {controller}, following its sine"),
        f"*The sine reference, followed by the reference controller `{controller}`.*",
        setup.task.description,
        _summary(ids, setup),
        "## Description",
        f"{title_of(task.split('-')[0])}: its equations and parameters are on the page of the "
        f"[plant](../plants/{setup.rig.plant.replace('_', '-')}.md).",
        "## Action space",
        _actions(setup),
        "## Observation space",
        _observations(ids[0]),
        "## Reward",
        _reward(setup),
        "## Starting state",
        said["Starting State"],
        "## Episode end",
        said["Episode End"],
        _limits(setup),
        "## References and thresholds",
        _references(ids),
        "## Sensor noise and randomisation",
        _randomised(setup),
        "## Arguments",
        said["Arguments"],
        "## Info",
        said["Info"],
        "## Vectorized environment",
        said["Vectorized environment"],
        "## Version history",
        said["Version History"],
    )


def _summary(ids: list[str], setup: Setup) -> str:
    observed, action = make_spaces(setup)
    rows = [
        ("ids", "<br>".join(f"`{env_id}`" for env_id in ids)),
        ("action space", f"`{action}`"),
        ("observation space", f"`{observed}` at the level `{setup.task.observe}`"),
        ("output", f"`{setup.task.output}` [{setup.output_unit}]"),
        ("rig", f"`{setup.rig.name}`: {linked_pages(' '.join(setup.rig.description.split()))}"),
        ("episode", f"{setup.steps} steps of {setup.control_period:g} s, {setup.substeps} integration steps in each"),
        ("success", f"error within {setup.task.success_error:g} {setup.output_unit} over the last fifth"),
        ("boards", _boards(ids)),
        ("make", f'`gymnasium.make("{ids[-1]}")`'),
    ]
    return table(("", ""), rows)


def _boards(ids: list[str]) -> str:
    """The published boards that rank entrants on a task."""
    names = [name for name in BOARDS if set(ids) & {task.env for task in load_protocol(name).tasks}]
    return f"[{' and '.join(names)}](../boards.md)" if names else "on no board yet"


def _actions(setup: Setup) -> str:
    rows = []
    for mode in setup.plant.action_modes:
        bound = setup.rig.values[mode.bound]
        low = 0.0 if mode.one_sided else -bound
        default = " (default)" if mode == setup.action_mode else ""
        meaning = setup.plant.parameters[mode.bound].meaning
        rows.append((f"`{mode.name}`{default}", mode.unit, f"{low:g}", f"{bound:g}", f"`{mode.bound}`: {meaning}"))
        for second in mode.commands[1:]:
            bound = setup.rig.values[second.bound]
            low, meaning = 0.0 if second.one_sided else -bound, setup.plant.parameters[second.bound].meaning
            rows.append(("and the second", second.unit, f"{low:g}", f"{bound:g}", f"`{second.bound}`: {meaning}"))
    two = any(len(mode.commands) > 1 for mode in setup.plant.action_modes)
    return page(
        "One number from -1 to 1, linear over the range of the action mode; a value beyond is clipped."
        + (" Modes with `_and_` in their name take two numbers." if two else ""),
        table(("action mode", "unit", "at -1", "at 1", "set by the rig's"), rows, numbers=(2, 3)),
    )


def _observations(env_id: str) -> str:
    levels = {level: _setup(env_id, observe=level) for level in LEVELS}
    default = _setup(env_id).task.observe
    known = {signal.name: signal.meaning for signal in levels["full"].plant.signals}
    general = dict(re.findall(r"^\| *\d+ *\| *(\w+) *\| *(.*?) *\|$", sections()["Observation Space"], re.MULTILINE))
    places = {level: [c.name for c in setup.channels] for level, setup in levels.items()}
    rows = []
    for channel in levels["full"].channels:
        where = [str(names.index(channel.name)) if channel.name in names else "–" for names in places.values()]
        meaning = known.get(channel.name) if channel.measured else general[channel.name]
        rows.append((*where, f"`{channel.name}`", unit(channel.unit), f"{channel.scale:g}", meaning or ""))
    marked = [f"{level} (default)" if level == default else level for level in LEVELS]
    return page(
        "Entry k is the SI value over its scale, limited to ±100. The first columns are the place of a channel at each "
        "level `observe`.",
        table((*marked, "channel", "unit", "scale", "meaning"), rows, numbers=(0, 1, 2, 5)),
    )


def _reward(setup: Setup) -> str:
    return page(
        sections()["Rewards"],
        f"Here `error_scale` is {setup.task.error_scale:g} {setup.output_unit} and `effort_weight` is "
        f"{setup.task.effort_weight:g}.",
    )


def _limits(setup: Setup) -> str:
    rows = [
        (f"`{name}`", f"{setup.rig.values[name]:g}", setup.plant.parameters[name].unit)
        for name in ("breaking_tension", "tension_limit")
        if setup.plant.tears
    ]
    if not rows:
        return "Nothing of this mechanism tears."
    return table(("of this rig", "value", "unit"), rows, numbers=(1,))


def _references(ids: list[str]) -> str:
    rows = []
    for env_id in ids:
        setup, spec = _setup(env_id), gym.spec(env_id)
        shape = ", ".join(f"{key} {value:g}" for key, value in setup.reference.items() if key != "kind")
        task, reference = spec.kwargs["task"], spec.kwargs["reference"]
        rows.append(
            (f"`{env_id}`", f"{setup.reference['kind']}: {shape}", f"{setup.steps}", f"{spec.reward_threshold:g}",
             f"`{best_controller(task, reference)}`")
        )  # fmt: skip
    head = ("id", "reference (SI, s, Hz)", "steps", "reward threshold", "reached by")
    return table(head, rows, numbers=(2, 3))


def _randomised(setup: Setup) -> str:
    noise = [(f"`{name}`", f"{std:g}", setup.plant.signals[setup.plant.row(name)].unit)
             for name, std in setup.task.sensor_noise.items()]  # fmt: skip
    drawn = make_setup(setup.task.name, "sine", randomize=True).randomize
    ranges = [
        (f"`{name}`", f"{setup.rig.values[name]:g}", f"{low:g} to {high:g}", unit(setup.plant.table[name].unit),
         setup.plant.table[name].meaning)
        for name, low, high in drawn
    ]  # fmt: skip
    return page(
        "`sensor_noise=True` adds white noise with these standard deviations:",
        table(("signal", "standard deviation", "unit"), noise, numbers=(1,)),
        "`randomize=True` draws these parameters anew at every reset, evenly from their ranges:",
        table(("parameter", "nominal", "range", "unit", "meaning"), ranges, numbers=(1,)),
    )
