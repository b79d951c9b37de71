"""Properties of every plant over random rigs: one table, in the terminal and as a page of the documentation.

python -m benchmarks.properties [--rigs 40] [--out docs/properties.md]
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.properties import loops
from benchmarks.properties.energy import MECHANISMS, energy_made
from benchmarks.properties.measures import FINER, MOST, converged, holds, outside_contact, pushed, rest_moves
from benchmarks.properties.rigs import FACTOR, USUAL, Box, Trial, trials
from cable_envs import load_rig
from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.base import ActionMode, Plant

CASES = (
    ("gu-inferred", "analytic"), ("gu-steel-1mm-motor", "analytic"), ("gu-three-holes", "analytic"),
    ("bowden-1m", "analytic"), ("bowden-1m-motor", "analytic"), ("bowden-1m-20", "analytic"),
    ("endoscope-2m", "analytic"), ("zou-table2", "analytic"), ("zou-grasp", "analytic"), ("zou-table2", "chain"),
    ("zou-grasp", "chain"), ("zou-table2-motor", "analytic"), ("zou-table2-motor", "chain"),
    ("zou-grasp-motor", "analytic"), ("bowden-1m-20-motor", "analytic"), ("finger-joint", "analytic"),
    ("finger-joint-motor", "analytic"), ("wrist-8mm", "analytic"), ("wrist-8mm-motor", "analytic"),
)  # fmt: skip
"""Shipped rigs, and which simulator of them."""

USUAL_BOX = Box("usual")
STIFF = dict.fromkeys(
    ("cable_stiffness", "tendon_stiffness", "tensile_stiffness", "yaw_cable_stiffness", "pitch_cable_stiffness"), 1e9
)
"""Stiffnesses of cables, with the highest that a rig may have, N/m (N of the circuit)."""

SECONDS = 3.0
"""Length of a trial in the usual box; others are a third of it."""

HEAD = ("rig", "simulator", "command", "driven by", "box", "property", "rigs", "median", "95 %", "worst")


def boxes(plant: Plant, nominal: np.ndarray) -> Iterator[Box]:
    """What else rigs are drawn from: other control periods, cables over their declared range, light loads."""
    for period in (1e-3, 0.05, 0.2):
        yield Box(f"{1e3 * period:g} ms", period)
    names = plant.parameters.names
    cables = [(name, float(nominal[names.index(name)]), most) for name, most in STIFF.items() if name in names]
    yield Box("stiff cable", within={name: (usual / FACTOR, most) for name, usual, most in cables})
    if "load_mass" in names:
        yield Box("20 g", within={"load_mass": (0.02, 0.02)})
        yield Box("0.5 kg", within={"load_mass": (0.5, 0.5)})


def rows(rigs: int, seed: int) -> Iterator[tuple[str, ...]]:
    """The rows of the table."""
    for name, variant in CASES:
        rig = load_rig(name)
        plant = rig.simulated_by(variant)
        nominal = rig.column(plant)[: len(plant.parameters), 0]
        for mode in plant.action_modes:
            yield from _whole(name, variant, plant, mode, nominal, rigs, seed)
            for box in boxes(plant, nominal):
                few = max(rigs // 5, 1)
                steps = max(round(SECONDS / 3.0 / box.period), 10)
                groups = list(trials(plant, mode, nominal, box, few, steps, seed))
                where = (name, variant, mode.name, "random", box.name)
                runs = [(g, g.run(g.substeps), g.run(g.substeps * FINER)) for g in groups]
                yield from _steps(where, groups, few)
                if runs:
                    yield from _convergence(where, *_joined([converged(*run) for run in runs]))
    yield from controllers(max(rigs // 20, 1), seed)


def controllers(rigs: int, seed: int) -> Iterator[tuple[str, ...]]:
    """Rows of the reference controllers, each on every task and action mode."""
    for task, mode, controller in loops.cases():
        found = []
        for rig in loops.rigs(task, USUAL_BOX, rigs, seed):
            try:
                found.append(loops.loop_error(task, mode, controller, rig, USUAL_BOX.period, FINER))
            except ConfigurationError:
                continue
        where = (task, "analytic", mode, controller, USUAL_BOX.name)
        yield from _convergence(where, np.array([e for e, _ in found]), np.array([s for _, s in found], bool))


def _whole(
    name: str, variant: str, plant: Plant, mode: ActionMode, nominal: np.ndarray, rigs: int, seed: int
) -> Iterator[tuple[str, ...]]:
    """Every property of rigs of the usual box."""
    steps = round(SECONDS / USUAL_BOX.period)
    groups = list(trials(plant, mode, nominal, USUAL_BOX, rigs, steps, seed))
    where = (name, variant, mode.name, "random", USUAL_BOX.name)
    runs = [(g, g.run(g.substeps), g.run(g.substeps * FINER)) for g in groups]
    yield from _steps(where, groups, rigs)
    yield from _convergence(where, *_joined([converged(*run) for run in runs]))
    for what, measure in (
        ("outside the contact's law", outside_contact),
        ("most negative tension, N", pushed),
    ):
        found = np.concatenate([measure(*run) for run in runs])
        if len(found):
            yield (*where, what, f"{len(found)}", *_shown(found))
    resting = [g.of(slice(4)) for g in groups[:8]]
    still, held = (np.concatenate([measure(g) for g in resting]) for measure in (rest_moves, holds))
    if held.any():
        yield (*where, "motion in a minute at rest, m or rad", f"{int(held.sum())}", *_shown(still[held]))
    if not held.all():
        yield (*where, "motors too weak to hold their load at rest", f"{int((~held).sum())} of {len(held)}", "", "", "")
    if plant.name in MECHANISMS:
        made = np.concatenate([energy_made(g) for g in groups])
        yield (*where, "energy made, over the work that passed", f"{len(made)}", *_shown(made))


def _steps(where: tuple[str, ...], groups: list[Trial], asked: int) -> Iterator[tuple[str, ...]]:
    count = sum(g.values.shape[1] for g in groups)
    if groups:
        steps = np.concatenate([np.full(g.values.shape[1], g.substeps) for g in groups])
        yield (*where, STEPS, f"{count}", *_shown(steps, "{:.0f}"))
    if count < asked:
        yield (*where, "rigs refused", f"{asked - count} of {asked}", "", "", "")


def _joined(found: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([e for e, _ in found]), np.concatenate([s for _, s in found])


def _convergence(where: tuple[str, ...], error: np.ndarray, sure: np.ndarray) -> Iterator[tuple[str, ...]]:
    if sure.any():
        late = int((error[sure] > MOST).sum())
        what = "step error" + (f" ({late} above 1 %)" if late else "")
        yield (*where, what, f"{int(sure.sum())}", *_shown(error[sure]))
    if not sure.all():
        yield (*where, "motion not determined", f"{int((~sure).sum())} of {len(sure)}", "", "", "")


def _shown(values: np.ndarray, form: str = "{:.1e}") -> tuple[str, str, str]:
    found = np.median(values), np.quantile(values, 0.95), values.max()
    return tuple("0" if v == 0.0 else form.format(v) for v in found)  # type: ignore[return-value]


NONE = ("most negative tension", "motion in a minute at rest", "energy made")
"""Beginnings of lines that the page leaves out where all is 0."""
STEPS = "integration steps in a control period"
"""Of a line that stands in a column of the next one in the page."""


def _tables(lines: list[tuple[str, ...]]) -> Iterator[str]:
    """A table for every rig and simulator, as Markdown; what is as in the line above is left out.

    How many integration steps the rigs of a box take, half of them at most and the most, is a column beside the box.
    What is 0 for every rig is left out.
    """
    title, above, steps = "", ("", "", ""), ""
    for line in lines:
        if f"{line[0]}, {line[1]}" != title:
            title, above = f"{line[0]}, {line[1]}", ("", "", "")
            head = (*HEAD[2:5], "steps", *HEAD[5:])
            yield f"\n## {title}\n\n|{'|'.join(head)}|\n|{'---|' * len(head)}\n"
        if line[5] == STEPS:
            steps = line[7] if line[7] == line[9] else f"{line[7]} to {line[9]}"
            continue
        if line[5].startswith(NONE) and line[7:] == ("0", "0", "0"):
            continue
        told = tuple("" if now == before else now for now, before in zip(line[2:5], above, strict=True))
        above = line[2:5]
        yield f"|{'|'.join((*told, steps, *line[5:]))}|\n"
        steps = ""


PAGE = """# Properties of the plants, over random rigs

Every parameter of a shipped rig is drawn between {factor:g} times less and {factor:g} times more, log-uniformly; the
gains of a servo go with the inertia of its drive. The rig then follows a command of two sinusoids, steps and a little
noise for {seconds:g} s, or a reference controller with its own gains follows the sine of a task for {loop:g} s. An
environment takes {usual} integration steps in a control period, and more where a rig is quicker; rigs that would need
more than 10 000 are refused.

| box | what else is drawn |
| --- | --- |
| usual | nothing; the control period is 10 ms |
| 1 ms, 50 ms, 200 ms | the control period is that |
| stiff cable | the stiffness of the cable, from a third of the shipped rig's to 1e9 N/m (circuit: 1e9 N) |
| 20 g, 0.5 kg | the mass of the load is that |

The *step error* is the difference to a run whose integration steps are {finer} times shorter: the root mean square of
the worst signal, of positions relative to how much they move, of tensions and torques relative to those at the drive,
of a servo's torque relative to itself. Encoders have no steps here: which step an encoder shows jumps, whatever the
integration does.

A rig *does not determine its motion* where the step error is above 1 %, and one whose parameters are 1e-4 larger or
smaller moves more than 1 % differently too, in one of eight random directions (or of four with changes of 1e-6 and
1e-9, which move what is chaotic). That is so for limit cycles of an unstable loop, and for loads at the edge of
breaking away. Such rigs are counted by themselves (*motion not determined*).

*Outside the contact's law* is how far a ratio of tensions is beyond what friction can hold.

*Steps* are the integration steps in a control period: the median of the rigs, and the most. Left out is what is 0 for
every rig: negative tensions, motion at rest, energy made.

The table is made by `make properties` ({rigs} rigs of the usual box, {few} of others, {loops} for a controller).

"""


def main(arguments: list[str] | None = None) -> None:
    """Print the table, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.properties", description=__doc__)
    parser.add_argument("--rigs", type=int, default=40, help="random rigs for each shipped rig and kind of command")
    parser.add_argument("--seed", type=int, default=1, help="of the random rigs")
    parser.add_argument("--out", type=Path, help="file for the table as a page")
    chosen = parser.parse_args(arguments)
    began, lines = time.monotonic(), [HEAD, tuple("---" for _ in HEAD)]
    for row in rows(chosen.rigs, chosen.seed):
        print("  ".join(row), flush=True)
        lines.append(row)
    if chosen.out is not None:
        page = PAGE.format(
            factor=FACTOR, seconds=SECONDS, loop=loops.SECONDS, usual=USUAL, finer=FINER, rigs=chosen.rigs,
            few=max(chosen.rigs // 5, 1), loops=max(chosen.rigs // 20, 1),
        )  # fmt: skip
        chosen.out.write_text(page + "".join(_tables(lines[2:])), encoding="utf-8")
    print(f"{time.monotonic() - began:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
