"""Files to begin with: a controller, an effect, a plant, a recording, a sample rig, the examples; all work as they are.

CONTRIBUTING.md shows what is written here (`tests/test_contributing.py` holds the two equal).
"""

import re
from dataclasses import dataclass
from pathlib import Path

from cable_envs.core.config import config_root
from cable_envs.core.errors import ConfigurationError, require_known

TEMPLATES = Path(__file__).with_name("templates")
EXAMPLES = "examples"
"""Kind, and the folder of the examples: in a checkout at its top, in an installation beside the configuration."""
SAMPLE = "sample"
"""Kind: three small logs of a rig (``examples/sample_rig``), to try the diagnosis on."""


@dataclass(frozen=True)
class Skeleton:
    """One kind of thing that can be begun."""

    files: tuple[tuple[str, str], ...]
    """(path, itself a template; template), in the order in which they are written"""
    next_steps: tuple[str, ...]
    """What to do then, one line each."""


KINDS = {
    "controller": Skeleton(
        (("{{ module }}.py", "controller.py.j2"),),
        (
            "cablebench run CableHole-Position-Sine --controller {{ file }} --trust",
            "cablebench submit {{ file }} --check-only",
        ),
    ),
    "effect": Skeleton(
        (("{{ module }}.py", "effect.py.j2"),),
        (
            "cablebench run CableHole-Position-Sine --controller pid -o effect_file={{ file }} "
            "-o 'effects={ {{- module -}} : {stiffness: 10000}}' --trust",
            "cablebench diagnose RECORDING --effect-file {{ file }}",
        ),
    ),
    "plant": Skeleton(
        (
            ("cable_envs/plants/{{ module }}/__init__.py", "plant_init.py.j2"),
            ("cable_envs/plants/{{ module }}/plant.py", "plant.py.j2"),
            ("configs/rigs/{{ name }}-small.yaml", "plant_rig.yaml.j2"),
            ("configs/tasks/{{ type }}-Position.yaml", "plant_task.yaml.j2"),
        ),
        (
            "in a checkout (--out names its folder) the plant is found where it lies:",
            "cablebench envs {{ type }}-Position-Sine",
            "cablebench run {{ type }}-Position-Sine --controller open-loop",
        ),
    ),
    "recording": Skeleton(
        (("{{ name }}/recording.yaml", "recording.yaml.j2"),),
        ("cablebench inspect {{ folder }}", "cablebench diagnose {{ folder }} --out {{ folder }}-found"),
    ),
    SAMPLE: Skeleton(
        (), ("cablebench inspect {{ folder }}", "cablebench diagnose {{ folder }} --out {{ folder }}-found")
    ),
    EXAMPLES: Skeleton((), ("python {{ folder }}/gym_loop.py", "python {{ folder }}/own_recording.py --out sample")),
}
"""What can be begun, by name."""


def check_name(name: str) -> str:
    """The name as it is; ConfigurationError where no file and no class can be called so."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9]*([-_][A-Za-z0-9]+)*", name):
        raise ConfigurationError(
            f"'{name}' is no name for a file: a letter first, then letters, digits, '-' and '_' between them"
        )
    return name


def examples() -> dict[str, str]:
    """The examples of this package: path within their folder, text."""
    folder = config_root().parent / EXAMPLES
    paths = sorted(p for suffix in ("py", "ipynb") for p in folder.rglob(f"*.{suffix}"))
    return {p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8") for p in paths}


def sample_rig() -> dict[str, str]:
    """The sample rig: name of a file, text."""
    folder = config_root().parent / EXAMPLES / "sample_rig"
    return {p.name: p.read_text(encoding="utf-8") for p in sorted(folder.iterdir()) if p.suffix in (".csv", ".yaml")}


def skeleton(kind: str, name: str, out: Path | str = ".") -> tuple[dict[str, str], tuple[str, ...]]:
    """The files of a new controller, effect, plant or recording, or the examples, and what to do with them.

    Parameters
    ----------
    kind : str
        "controller", "effect", "plant", "recording", "sample" or "examples".
    name : str
        Letters, digits, "-" and "_", a letter first. Modules are called so with "_", classes in capitals; the examples
        lie in a folder of this name.
    out : path, optional
        Folder in which the files are going to lie: the next steps name it.

    Returns
    -------
    files : dict of str to str
        Path within the folder, text.
    next_steps : tuple of str
        Lines for people.

    Raises
    ------
    ConfigurationError
        For an unknown kind and for a name that is none.

    Examples
    --------
    >>> files, steps = skeleton("controller", "my-pid")
    >>> list(files)
    ['my_pid.py']
    >>> steps[1]
    'cablebench submit my_pid.py --check-only'
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    require_known("kind", [kind], KINDS)
    words = re.split("[-_]", check_name(name))
    names = {
        "name": name,
        "module": "_".join(words).lower(),
        "type": "".join(word[0].upper() + word[1:] for word in words),
        "title": " ".join(words).capitalize(),
    }
    paths = {"file": str(Path(out) / f"{names['module']}.py"), "folder": str(Path(out) / name)}
    # these are no pages: nothing is escaped
    made = Environment(loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, keep_trailing_newline=True)
    chosen = KINDS[kind]
    files = {
        made.from_string(path).render(names): made.get_template(template).render(names)
        for path, template in chosen.files
    }
    if kind == "recording":
        files |= {f"{name}/{record}.csv": text for record, text in sample_tables().items()}
    if kind == SAMPLE:
        files |= {f"{name}/{path}": text for path, text in sample_rig().items()}
    if kind == EXAMPLES:
        files = {f"{name}/{path}": text for path, text in examples().items()}
    return files, tuple(made.from_string(step).render(names | paths) for step in chosen.next_steps)


def sample_tables() -> dict[str, str]:
    """Two records as CSV: 2.5 kg with 12 N s/m of friction on a spring of 60 N/m, moved along two sines."""
    import numpy as np

    t, rng, tables = np.arange(0.0, 8.0, 0.01), np.random.default_rng(0), {}
    for name, pace in (("slow", 2.0), ("fast", 3.0)):
        x, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
        for amplitude, w in ((0.02, pace), (0.01, 3.1 * pace)):  # m, rad/s
            x += amplitude * np.sin(w * t)
            v += amplitude * w * np.cos(w * t)
            a -= amplitude * w**2 * np.sin(w * t)
        force = 2.5 * a + 12.0 * v + 60.0 * x
        read = 1000.0 * x + rng.normal(0.0, 0.01, len(t)), force + rng.normal(0.0, 0.05, len(t))
        rows = (f"{time:.2f},{mm:.4f},{newton:.4f}" for time, mm, newton in zip(t, *read))
        tables[name] = "\n".join(["t,x,F", *rows]) + "\n"
    return tables
