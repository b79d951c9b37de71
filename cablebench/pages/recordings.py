"""The HTML page of the real recordings, from the JSON and SVG files that each set has left in a folder."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import packed_json, read_json
from cable_envs.diagnosis.model.verdict import local_groups
from cable_envs.drawing import pages

FIGURES = "figures"
PAGE, SUMMARY = "index.html", "README.md"
JAW = "da-vinci-jaw"
FILES = {JAW: "davinci"}
"""Sets whose file of numbers has another name."""
_SAID = {
    "load_dependent_friction": "load-dependent friction", "presliding_hysteresis": "pre-sliding",
    "sensor_rectification": "rectifying sensor", "actuator_lag": "lag of the drive",
    "sensor_delay.speed_reading": "delay of the sensor", "detector_power": "nonlinear sensor",
    "coulomb_friction": "Coulomb friction", "stribeck_friction": "Stribeck friction",
    "position_dependent_load": "position-dependent load", "gear_friction": "gear friction",
    "supply_sag": "supply sag", "torque_saturation": "saturation of the torque",
    "command_delay": "delay of the command",
}  # fmt: skip
_SHOWN = {"m": ("um", 1e6), "rad": ("deg", 57.29577951308232)}


def write_set(out: Path, name: str, numbers: Mapping[str, Any], figures: Mapping[str, str]) -> None:
    """Leave a set's numbers as compressed JSON (`numbers_of`) and its figures as ``figures/NAME-FIGURE.svg``."""
    from cable_envs.core.files import jsonable, write_atomic

    (out / FIGURES).mkdir(parents=True, exist_ok=True)
    write_atomic(numbers_of(out, name), packed_json(jsonable(numbers)))
    for figure, text in figures.items():
        write_atomic(out / FIGURES / f"{name}-{figure}.svg", text.rstrip() + "\n")


def numbers_of(out: Path, name: str) -> Path:
    """The file of a set's numbers."""
    return out / f"{FILES.get(name, name)}.json.xz"


def render(out: Path, names: Sequence[str]) -> str:
    """The page from what `write_set` left in ``out``; sets that are not there are said to be missing."""
    from markupsafe import Markup

    from cablebench.pages.recordings_jaw import figures_of

    sets = _sets(out, names)
    jaw = figures_of(sets[JAW]) if JAW in sets else {}  # the jaw's numbers hold the curves

    def drawn(name: str, which: str) -> Any:
        if name == JAW:
            return Markup(jaw.get(which, ""))
        path = out / FIGURES / f"{name}-{which}.svg"
        return Markup(path.read_text(encoding="utf-8")) if path.is_file() else ""

    missing = [name for name in names if name not in sets]
    return pages.render(
        "cablebench.pages",
        "templates/recordings.html.j2",
        {"sets": sets, "missing": missing, "glance": glance(sets)},
        filters={"local_groups": local_groups, "plain": plain, "number": number, "estimate": estimate, "error": error},
        helpers={"drawn": drawn},
    )


def summary(out: Path, names: Sequence[str]) -> str:
    """The first table of the page as Markdown, for readers of the repository."""
    lines = [
        "# Recordings of real rigs, diagnosed",
        "",
        "Five public recordings of real rigs were diagnosed. Each diagnosis began with a *naive* simulator, which",
        "lacks almost everything, and accepted an effect only if its evidence is above 20 to 1",
        "([how](../evidence.md)). The error is the RMS of the prediction on held-out records, which no refit has used.",
        "The last column says which effects are named when the diagnosis starts from the corrected rig.",
        "",
        "| recording | effects that are named, in their order | error, naive simulator | error, with these effects "
        "| named from the corrected rig |",
        "|---|---|--:|--:|---|",
    ]
    for row in glance(_sets(out, names)):
        again = ", ".join(row["again"])
        lines.append(f"| {row['title']} | {', '.join(row['named'])} | {row['naive']} | {row['final']} | {again} |")
    lines += [
        "",
        "`cablebench real-data --page-only --out docs/recordings` makes this table, and the page with all figures",
        f"({PAGE}), from the numbers beside this file.",
    ]
    return "\n".join(lines) + "\n"


def glance(sets: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row for each set: what was named, and the error on held-out records before and after."""
    rows = []
    for name, (title, anchor, steps_of, shown) in _GLANCE.items():
        if name in sets:
            steps = steps_of(sets[name])
            named = [plain(name) for name in inside(steps)]
            rows.append({"title": title, "anchor": anchor, "named": named})
            rows[-1] |= {"naive": shown(steps[0]), "final": shown(steps[-1])}
            rows[-1]["again"] = [plain(n) for n in again_of(sets[name])] or ["nothing"]
    return rows


def inside(steps: Sequence[Mapping[str, Any]]) -> list[str]:
    """Effects that are in after the last step, in the order in which they came."""
    found: list[str] = []
    for step in steps[1:]:
        found = [name for name in (*found, step.get("effect") or step["name"]) if name not in step["dropped"]]
    return found


def again_of(numbers: Mapping[str, Any]) -> list[str]:
    """What is named of a set when its diagnosis starts from the corrected rig, in any group of its records."""
    findings = numbers.get("findings", {"": numbers.get("finding", numbers)})
    return [name for finding in findings.values() for name in finding["again"]]


def _sets(out: Path, names: Sequence[str]) -> dict[str, Any]:
    sets = {name: _read(path) for name in names if (path := numbers_of(out, name)).is_file()}
    if not sets:
        raise ConfigurationError(f"{out} holds no set's numbers; leave out --page-only, or name another folder")
    return sets


def _read(path: Path) -> Any:
    try:
        return read_json(path)
    except (OSError, ValueError) as problem:
        raise ConfigurationError(f"cannot read {path}: {problem}") from None


def plain(name: str) -> str:
    """An effect's name as a person says it."""
    return _SAID.get(name, name.split(".")[0].replace("_", " ")) or "naive simulator"


def number(value: Any, digits: int = 3) -> str:
    """Three digits, without an exponent where that reads well."""
    if value is None:
        return "–"
    text = f"{float(value):.{digits}g}"
    return f"{float(text):,.0f}".replace(",", "\u202f") if "e+" in text else text


def error(value: float, unit: str) -> str:
    """An error of a channel in the unit in which people read it."""
    shown, factor = _SHOWN.get(unit, (unit, 1.0))
    return f"{number(value * factor)} {shown}"


def estimate(found: Mapping[str, Any]) -> str:
    """A parameter with its interval."""
    value, low, high, unit = (found[k] for k in ("value", "low", "high", "unit"))
    factor, prefix = 1.0, ""
    if unit in ("m", "s", "rad", "m/N") and abs(value) < 0.1:
        factor, prefix = (1e6, "u") if abs(value) < 1e-4 else (1e3, "m")
    shown = "" if unit == "1" else f" {prefix}{unit}"
    return f"{number(factor * value)} [{number(factor * low)}, {number(factor * high)}]{shown}"


_GLANCE: Mapping[str, tuple[str, str, Callable[[Any], Any], Callable[[Any], str]]] = {
    JAW: (
        "da Vinci jaw", "jaw", lambda numbers: numbers["ladder"],
        lambda step: f"{number(step['heldout_deg'])} deg, {number(step['heldout_mnm'])} mN m",
    ),
    "band-brake": (
        "band brake", "brake", lambda numbers: numbers["finding"]["steps"],
        lambda step: f"{number(step['heldout']['force'])} N",
    ),
    "emps": (
        "EMPS", "emps", lambda numbers: numbers["finding"]["steps"],
        lambda step: error(step["heldout"]["position"], "m"),
    ),
    "coupled-drives": (
        "coupled drives", "drives", lambda numbers: numbers["findings"]["uniform"]["steps"],
        lambda step: f"{number(step['heldout']['speed_reading'])} V",
    ),
    "servo-pendulum": (
        "servo pendulum", "servo", lambda numbers: numbers["steps"],
        lambda step: f"{number(step['heldout'])} rad (mean size)",
    ),
}  # fmt: skip
"""Of each set: its title, its place on the page, its accepted steps, and how an error is shown."""
