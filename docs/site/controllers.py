"""The page of the reference controllers, from their classes."""

import inspect

from cable_envs.baselines import CONTROLLERS
from cable_envs.baselines.base import Controller
from docs.site.markdown import of_docstring, page, table, unit


def pages() -> dict[str, str | bytes]:
    """The page."""
    rows = [
        (f"[`{name}`](#{name})", kind.information, ", ".join(_plants(kind)), _first(kind))
        for name, kind in CONTROLLERS.items()
    ]
    head = page(
        "# Reference controllers",
        "Controllers are told different things of the rig and are ranked within what they were told: *model-free* "
        "nothing, *nominal* its nominal parameters, *identified* what an identification found, *oracle* everything.",
        table(("controller", "told", "made for", "what it does"), rows),
        "`cablebench run ID --controller NAME` runs one; a [controller of one's own](add-your-controller.md) is one "
        "file. `cablebench tune` finds gains.",
    )
    return {"controllers.md": page(head, *(_section(name, kind) for name, kind in CONTROLLERS.items()))}


def _plants(kind: type[Controller]) -> list[str]:
    return [*kind.plants, *(("every plant that names its drive and its output",) if kind.general else ())]


def _first(kind: type[Controller]) -> str:
    return (inspect.getdoc(kind) or "").splitlines()[0]


def _section(name: str, kind: type[Controller]) -> str:
    parts = [f"## {name}", of_docstring(inspect.getdoc(kind) or "")]
    rows = [
        (plant, mode, task, f"`{p.name}`", f"{p.default:g}", unit(p.unit), p.meaning)
        for (plant, mode, task), gains in kind.gain_tables.items()
        for p in gains
    ]
    head = ("plant", "action mode", "task", "gain", "default", "unit", "meaning")
    return page(*parts, table(head, rows, numbers=(4,)) if rows else "It has no gains.")
