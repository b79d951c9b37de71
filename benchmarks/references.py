"""`python -m benchmarks.references`: the measured part of docs/references.md.

It runs the reference controllers that invert a model, their tuned gains and the two textbook files of examples/ on the
quick board's test episodes (nominal rig and randomised rigs, with sensor noise), reads the rows of all others from the
published board, finds the upper bound of a few randomised episodes of each task, and compares every reference with the
two textbook controllers. Episodes are kept under ``--out``; what is there is not run again. ``--page
docs/references.md`` puts the text in its place there.
"""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.baselines import controller_class
from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cablebench.bound import upper_bound
from cablebench.entrants.controller_files import load_controller_file, shipped_files
from cablebench.entrants.entrant import Entrant
from cablebench.entrants.named import named_entrant
from cablebench.protocol.files import load_protocol
from cablebench.run.evaluation import evaluate, make_plan
from cablebench.run.store import ResultStore

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- begin: python -m benchmarks.references -->", "<!-- end -->"
BOARD = ROOT / "boards" / "quick" / "records.jsonl"
TEXTBOOK = {
    "CableHole-Position-Sine": "textbook-hole", "PulleyCircuit-Position-Sine": "textbook-circuit",
}  # fmt: skip
"""Task -> the controller of examples/ that a reference of this task is compared with."""
REVIEWED = {
    "CableHole-Position-Step": (0.869e-3, 0.835e-3), "CableHole-Position-Sine": (0.0243e-3, 0.0295e-3),
    "CableHole-Tension-Step": (1.01, 1.09), "CableHole-Tension-Sine": (0.117, 0.194),
    "PulleyCircuit-Position-Step": (15.4e-3, 15.5e-3), "PulleyCircuit-Position-Sine": (1.45e-3, 1.81e-3),
    "PulleyCircuit-Torque-Step": (5.01e-3, 4.64e-3), "PulleyCircuit-Torque-Sine": (3.77e-3, 4.57e-3),
}  # fmt: skip
"""Median RMSE on the same episodes, nominal and randomised, of two other controllers of that kind, which an independent
review wrote and tuned in an hour."""
TRACKS = ("nominal", "randomised")
FAMILIES = {
    "CableHole": (
        "scheduled-pid",
        "adaptive-inverse",
        "adaptive-inverse-tuned",
        "lqg",
        "lqg-tuned",
        "ilc",
        "mrac",
        "mrac-tuned",
        "mpc",
    ),
    "PulleyCircuit": ("virtual-jaw", "virtual-jaw-tuned"),
}
AGENTS = ("ppo", "residual-ppo", "sac")
PUBLISHED = {
    "CableHole": ("open-loop", "pid", "pid-tuned", "mrac-g22", "mrac-g22-tuned", *AGENTS, "oracle"),
    "PulleyCircuit": (
        "open-loop", "pid", "pid-tuned", "feedforward-pid", "feedforward-pid-tuned", *AGENTS, "oracle"
    ),
}  # fmt: skip
SCALES = {"m": (1e3, "mm"), "N": (1.0, "N"), "rad": (1e3, "mrad"), "N m": (1e3, "mN m")}

Medians = Mapping[tuple[str, str, str], float]
"""(entrant, task without version, track) -> median RMSE, SI"""


def entrants() -> list[Entrant]:
    """Those that are run."""
    files = [str(ROOT / "examples" / f"{name.replace('-', '_')}.py") for name in TEXTBOOK.values()]
    names = [name for family in reversed(FAMILIES.values()) for name in family]
    return [named_entrant(file, sandbox="none") for file in files] + [named_entrant(name) for name in names]


def measured(out: Path, again: Sequence[str]) -> list[dict[str, Any]]:
    """Records of the entrants that are run: of those that have none yet, and of those named in ``again``."""
    store = ResultStore(out / "records.jsonl")
    protocol = load_protocol("quick")
    for entrant in entrants():
        plan = make_plan(protocol, [entrant], (), TRACKS)
        kept = sum(r["entrant"] == entrant.name for r in store.read().records)
        if kept < sum(cell.episodes for cell, _, _ in plan) or entrant.name in again:
            evaluate(protocol, [entrant], tracks=TRACKS, store=store, resume=entrant.name not in again)
            print(f"{entrant.name} is measured", flush=True)
    return store.read().records


def medians(records: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str, str], float]:
    """Median RMSE over test episodes and training seeds; a failed episode counts as infinite."""
    found: dict[tuple[str, str, str], dict[Any, float]] = {}
    for r in records:
        if r["track"] in TRACKS:
            error = math.inf if r["metrics"]["failed"] else r["metrics"]["rmse"]
            key = r["entrant"], r["task"], r["track"]
            found.setdefault(key, {})[r["seed"], r["training_seed"]] = error  # the newest of each episode
    return {key: float(np.median(list(errors.values()))) for key, errors in found.items()}


def units(records: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Unit of each task's output."""
    return {r["task"]: r["output_unit"] for r in records}


def errors_table(family: str, found: Medians, unit: Mapping[str, str]) -> str:
    """Rows entrants, columns tasks, cells nominal / randomised."""
    tasks = [task for task in unit if task.startswith(family)]
    titles = [f"{t.removeprefix(family + '-').replace('-', ', ')} [{SCALES[unit[t]][1]}]" for t in tasks]
    lines = [f"| {family} | {' | '.join(titles)} |", "|---|" + "--:|" * len(tasks)]
    books = [book for task, book in TEXTBOOK.items() if task.startswith(family)]
    for name in (*FAMILIES[family], *books, *PUBLISHED[family]):
        cells = []
        for task in tasks:
            pair = [found.get((name, task, track)) for track in TRACKS]
            scale = SCALES[unit[task]][0]
            cells.append("" if None in pair else " / ".join(f"{scale * e:.3g}" for e in pair if e is not None))
        lines.append(f"| {name if name in AGENTS else f'`{name}`'} | {' | '.join(cells)} |")
    return "\n".join(lines)


def claims(found: Medians, unit: Mapping[str, str]) -> str:
    """Every reference against textbook control of its task."""
    lines = [
        "| task | track | textbook file | in the review | best reference | references behind either |",
        "|---|---|--:|--:|---|---|",
    ]
    for task, reviewed in REVIEWED.items():
        if task not in unit:
            continue
        scale, named = SCALES[unit[task]]
        rows = [name for name in FAMILIES[task.split("-")[0]] if (name, task, TRACKS[0]) in found]
        for track, other in zip(TRACKS, reviewed, strict=True):
            book = found.get((TEXTBOOK.get(task, ""), task, track))
            most = min(e for e in (book, other) if e is not None)
            best = min(rows, key=lambda n: found[n, task, track])
            behind = [f"`{n}` {scale * found[n, task, track]:.3g}" for n in rows if found[n, task, track] > most]
            cells = [task, track, "" if book is None else f"{scale * book:.3g}", f"{scale * other:.3g} {named}"]
            cells += [f"`{best}` {scale * found[best, task, track]:.3g}", ", ".join(behind) or "none"]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def bounds(out: Path, episodes: int) -> dict[str, Any]:
    """Upper bounds of randomised episodes of each task, kept in a file."""
    file = out / "bounds.json"
    kept: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    protocol = load_protocol("quick")
    for task in protocol.tasks:
        one = kept.get(task.env)
        if one is not None and len(one["rmse"]) == episodes:
            continue
        found = upper_bound(task.env, protocol.seeds(episodes), options={"randomize": True})
        best = [min(b.starts.items(), key=lambda pair: pair[1]) for b in found]
        kept[task.env] = {
            "rmse": [b.rmse for b in found], "off": [b.off for b in found], "spread": [b.spread for b in found],
            "start": [e for _, e in best], "names": [n for n, _ in best],
        }  # fmt: skip
        write_atomic(file, json.dumps(kept, indent=1).encode())
        print(task.env, kept[task.env]["rmse"], flush=True)
    return kept


def bounds_table(kept: Mapping[str, Any], unit: Mapping[str, str]) -> str:
    """Medians over the episodes."""
    lines = ["| task | bound | best controller that it began from | `off` | `spread` |", "|---|--:|--:|--:|--:|"]
    for env_id, one in kept.items():
        task = env_id.split("/")[1].removesuffix("-v0")
        scale, named = SCALES[unit[task]]
        error, start = (f"{scale * float(np.median(one[key])):.3g} {named}" for key in ("rmse", "start"))
        off, spread = (f"{100.0 * float(np.median(one[key])):.2g} %" for key in ("off", "spread"))
        names = ", ".join(f"`{name}`" for name in sorted(set(one["names"])))
        lines.append(f"| {task} | {error} | {start} ({names}) | {off} | {spread} |")
    return "\n".join(lines)


def tuned() -> str:
    """What was tuned, and by how many trials."""
    lines = ["| gains | trials charged | found by |", "|---|--:|---|"]
    for name in dict.fromkeys(n for family in FAMILIES.values() for n in family):
        if name not in shipped_files():
            charged = controller_class(name).charged.get("tuning_trials", 0)
            lines.append(f"| defaults of `{name}` | {charged} | trials on steps, sines, multisines, random steps |")
    for name in shipped_files():
        file = load_controller_file(f"configs/controllers/{name}.yaml")
        if controller_class(file.controller).name in FAMILIES["CableHole"] + FAMILIES["PulleyCircuit"]:
            tasks = len(file.gains)
            made = " ".join(file.made_by.split()[:3])
            lines.append(f"| `{name}`, {tasks} tasks | {file.charged['tuning_trials']} | `{made}` |")
    return "\n".join(lines)


def text(found: Medians, unit: Mapping[str, str], kept: Mapping[str, Any], episodes: int) -> str:
    """The measured part of the page."""
    return "\n\n".join([
        "### Cable-hole", errors_table("CableHole", found, unit),
        "### Pulley circuit", errors_table("PulleyCircuit", found, unit),
        "### Against two textbook controllers", claims(found, unit),
        "### Upper bound", f"Medians over {episodes} randomised episodes without sensor noise.",
        bounds_table(kept, unit), "### Trials", tuned(),
    ])  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.references", description=__doc__)
    parser.add_argument("--bounds", type=int, default=4, help="episodes of each task whose upper bound is found")
    parser.add_argument("--out", type=Path, default=Path("results/references"))
    parser.add_argument("--again", action="append", default=[], help="an entrant that is run anew")
    parser.add_argument("--page", type=Path, help="a page whose marked part is replaced by the text")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    records = [*ResultStore(BOARD).read().records, *measured(arguments.out, arguments.again)]
    said = text(medians(records), units(records), bounds(arguments.out, arguments.bounds), arguments.bounds)
    print(said)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        write_atomic(arguments.page, between_marks(page, BEGIN, END, said))


if __name__ == "__main__":
    main()
