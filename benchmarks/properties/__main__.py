"""Properties of every plant over random rigs: one table, in the terminal and as a page of the documentation.

python -m benchmarks.properties [--rigs 200] [--out docs/properties.md]
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.properties.energy import MECHANISMS, energy_made
from benchmarks.properties.measures import FINER, outside_contact, pushed, rest_moves, step_error
from benchmarks.properties.rigs import FACTOR, PERIOD, USUAL, Trial, trials
from cable_envs import load_rig

CASES = (
    ("gu-inferred", "analytic"), ("bowden-1m", "analytic"), ("zou-table2", "analytic"),
    ("zou-grasp", "analytic"), ("zou-table2", "chain"), ("zou-grasp", "chain"), ("zou-table2-motor", "analytic"),
    ("zou-table2-motor", "chain"), ("gu-three-holes", "analytic"), ("bowden-1m-20", "analytic"),
    ("endoscope-2m", "analytic"),
)  # fmt: skip
"""Shipped rigs, and which simulator of them."""

STEPS = 300
"""Control steps of a trial: 3 s."""

HEAD = ("rig", "simulator", "command", "property", "rigs", "median", "95 %", "worst")


def rows(rigs: int, seed: int) -> Iterator[tuple[str, ...]]:
    """The rows of the table."""
    for name, variant in CASES:
        rig = load_rig(name)
        plant = rig.simulated_by(variant)
        nominal = rig.column(plant)[: len(plant.parameters), 0]
        for mode in plant.action_modes:
            groups = list(trials(plant, mode, nominal, rigs, STEPS, seed))
            count = sum(g.values.shape[1] for g in groups)
            where = (name, variant, mode.name)
            steps = np.concatenate([np.full(g.values.shape[1], g.substeps) for g in groups])
            yield (*where, "integration steps in a control period", f"{count}", *_shown(steps, "{:.0f}"))
            runs = [(g, g.run(g.substeps), g.run(g.substeps * FINER)) for g in groups]
            for what, measure in (
                (f"difference to {FINER} times shorter steps", step_error),
                ("tension ratio outside the contact's law", outside_contact),
                ("most negative tension, N", pushed),
            ):
                found = np.concatenate([measure(*run) for run in runs])
                yield (*where, what, f"{count}", *_shown(found))
            few = [
                Trial(g.plant, g.mode, g.values[:, :4], g.start[:4], g.command[:, :4], g.substeps) for g in groups[:8]
            ]
            still = np.concatenate([rest_moves(g) for g in few])
            yield (*where, "motion in a minute at rest, m or rad", f"{len(still)}", *_shown(still))
            if plant.name in MECHANISMS:
                made = np.concatenate([energy_made(g) for g in groups])
                yield (*where, "energy made, over the work that passed", f"{count}", *_shown(made))


def _shown(values: np.ndarray, form: str = "{:.1e}") -> tuple[str, str, str]:
    found = np.median(values), np.quantile(values, 0.95), values.max()
    return tuple("0" if v == 0.0 else form.format(v) for v in found)  # type: ignore[return-value]


PAGE = """# Properties of the plants, over random rigs

Every parameter of a shipped rig is drawn between {factor:g} times less and {factor:g} times more, log-uniformly. The
rig then follows a command of two sinusoids, steps and a little noise for {seconds:g} s. An environment takes {usual}
integration steps in a control period of {period:g} ms, and more where a rig is quicker; rigs that would need more than
10 000 are refused, and are not counted here.

Differences to shorter steps are root mean squares of the worst signal: of positions relative to how much they move, of
tensions and torques relative to those at the drive. Differences below a tenth of what a task's reward calls a small
error (0.1 mm, 2 mrad, 0.05 N, 1 mN m) are relative to that.

The table is made by `make properties` ({rigs} rigs for each row, fewer at rest).

"""


def main(arguments: list[str] | None = None) -> None:
    """Print the table, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.properties", description=__doc__)
    parser.add_argument("--rigs", type=int, default=200, help="random rigs for each shipped rig and kind of command")
    parser.add_argument("--seed", type=int, default=1, help="of the random rigs")
    parser.add_argument("--out", type=Path, help="file for the table as a page")
    chosen = parser.parse_args(arguments)
    began, lines = time.monotonic(), [HEAD, tuple("---" for _ in HEAD)]
    for row in rows(chosen.rigs, chosen.seed):
        print("  ".join(row), flush=True)
        lines.append(row)
    if chosen.out is not None:
        page = PAGE.format(factor=FACTOR, seconds=STEPS * PERIOD, usual=USUAL, period=1e3 * PERIOD, rigs=chosen.rigs)
        chosen.out.write_text(page + "".join(f"| {' | '.join(line)} |\n" for line in lines), encoding="utf-8")
    print(f"{time.monotonic() - began:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
