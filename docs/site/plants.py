"""A page for each mechanism that has tasks, and a list of the rigs of published recordings: all from their folders."""

import inspect
import io
import re
import sys
from collections.abc import Iterable
from functools import partial

from PIL import Image

from cable_envs.core.config import config_names
from cable_envs.core.params import Parameter
from cable_envs.plants import families, plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.family import Family
from cable_envs.sim.rigs import load_rig
from docs.site.cache import kept
from docs.site.environments import slug, tasks
from docs.site.films import best_controller, played, small, still, webp
from docs.site.markdown import linked_pages, page, picture, table, unit, whole_picture

FOLDER = "plants"
STILL_AT = 2.0
"""Time into an episode at which the mechanism is drawn, s."""


def pages() -> dict[str, str | bytes]:
    """The list, and a page for each family of plants."""
    made: dict[str, str | bytes] = {f"{FOLDER}/index.md": _list()}
    for family in families().values():
        made[f"{FOLDER}/{address(family)}.md"] = _page(family)
        name = f"{address(family)}.webp"
        whole = made[f"{FOLDER}/{name}"] = kept(name, partial(_picture_of, family))
        made[f"{FOLDER}/small-{name}"] = kept(f"small-{name}", partial(_small, family, whole))
    return made


def _picture_of(family: Family) -> bytes:
    return webp(_drawing(family))


def address(family: Family) -> str:
    """Name of a family's page.

    Examples
    --------
    >>> address(families()["cable_hole"])
    'cable-hole'
    """
    return family.name.replace("_", "-")


def _small(family: Family, whole: bytes) -> bytes:
    return small(Image.open(io.BytesIO(whole)), family.name)


def _drawing(family: Family) -> Image.Image:
    if not family.tasks:
        return played(family.name)
    task, ids = _tasks(family)[0]
    env_id = next(one for one in ids if "-Sine-" in one)
    return still(env_id, best_controller(task, "sine"), STILL_AT)


def _tasks(family: Family) -> list[tuple[str, list[str]]]:
    return [(task, ids) for task, ids in tasks().items() if family.tasks and task.startswith(f"{family.tasks}-")]


def _list() -> str:
    rows = []
    for family in sorted(families().values(), key=lambda one: not one.tasks):
        link = f"[{family.title}]({address(family)}.md)"
        image = f"[{picture(f'small-{address(family)}.webp', family.title, 'thumb')}]({address(family)}.md)"
        rows.append((image, link, _head(_plants(family)[0]), "yes" if family.tasks else ""))
    return page(
        "# Plants",
        "A plant is what a mechanism does, as equations with parameters; a rig is a plant with numbers. Those without "
        "tasks are rigs of published recordings, for the diagnosis.",
        table(("", "plant", "what it is", "tasks"), rows),
        "The symbols and the derivations are on the page about the [physics](../physics.md).",
    )


def _plants(family: Family) -> list[Plant]:
    return [plant_for(family.name, variant) for variant in family.variants]


def _doc(plant: Plant) -> str:
    """What the module of a plant says of it."""
    return inspect.getdoc(sys.modules[plant.solve.__module__]) or ""


def _head(plant: Plant) -> str:
    return _doc(plant).splitlines()[0]


def _page(family: Family) -> str:
    image = whole_picture(f"{address(family)}.webp", f"{family.title}, drawn at work")
    uses = [f"[{task}](../environments/{slug(task)}.md)" for task, _ in _tasks(family)]
    parts = [f"# {family.title}", image, f"In rig files it is `plant: {family.name}`."]
    parts += [f"Tasks: {', '.join(uses)}."] if uses else ["It has no tasks; recordings of it are diagnosed."]
    for plant in _plants(family):
        parts += [f"## Equations: `{plant.name}`", _equations(plant)]
    first = _plants(family)[0]
    parts += ["## Parameters and their ranges", _parameters(first.parameters)]
    parts += ["## Signals", _signals(_plants(family))]
    parts += ["## Effects that act on it", _effects(_plants(family))]
    return page(*parts, *_rigs(family))


def _equations(plant: Plant) -> str:
    """The module's text; a block of equations is set as such, and a table as a table."""
    text = re.sub(r"(?m)^(?=\S)(.*\S)\n(?= {4}\S)", r"\1\n\n", _doc(plant))
    text = re.sub(r"(?m)^((?:\w|,|'|\*| )+\|.*\n-+ \|)", r"\n\1", text)
    return text.replace("--------", "---")


def _parameters(parameters: Iterable[Parameter]) -> str:
    rows = [
        (f"`{p.name}`", f"{p.default:g}", f"{p.low:g} to {p.high:g}", unit(p.unit), p.meaning, linked_pages(p.source))
        for p in parameters
    ]
    return table(("parameter", "default", "range", "unit", "meaning", "source of the default"), rows, numbers=(1,))


def _signals(plants: list[Plant]) -> str:
    found = {signal.name: signal for plant in plants for signal in plant.signals}
    rows = [(f"`{s.name}`", unit(s.unit), s.meaning) for s in found.values()]
    return table(("signal", "unit", "meaning"), rows)


def _effects(plants: list[Plant]) -> str:
    names = [name for plant in plants for name, effect in plant.effects.effects.items() if effect.parameters]
    return ", ".join(f"[`{name}`](../effects.md#{name})" for name in dict.fromkeys(names)) + "."


def _rigs(family: Family) -> list[str]:
    rigs = [rig for rig in map(load_rig, config_names("rigs")) if rig.plant == family.name]
    rows = [(f"`{rig.name}`", linked_pages(" ".join(rig.description.split()))) for rig in rigs]
    return ["## Rigs", table(("preset", "what it is"), rows)] if rows else []
