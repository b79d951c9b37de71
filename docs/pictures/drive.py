"""The picture of a real drive: its parts one after the other, and its answer to a step beside that of an ideal one.

Run ``python docs/pictures/drive.py`` (seconds); it writes drive.svg beside itself. Both rigs are told to pull the load
of a Bowden cable in by 10 mm.
"""

from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from cable_envs import load_rig
from cable_envs.core.inputs import INPUTS
from cable_envs.drawing.compact_svg import compact_svg

FILE = Path(__file__).parent / "drive.svg"
BLOCKS = (
    ("PID", "1 kHz"), ("saturator", "80 N"), ("motor", "current, voltage,\nback-EMF"),
    ("gear, spool", "efficiency,\nfriction"), ("cable", ""),
)  # fmt: skip
FLOWS = ("command", "force asked", "", "torque", "tension")
PERIOD, STEPS, SUBSTEPS = 0.002, 200, 10
STEP, AT = 0.01, 0.05
"""Size of the step, m, and when it comes, s."""


def answer(name: str) -> dict[str, np.ndarray]:
    """Signals of a rig whose position command steps."""
    rig = load_rig(name)
    plant = rig.simulated_by()
    p = plant.prepare(rig.column(plant)[: len(plant.parameters)])
    x, u, seen = plant.rest(p, np.zeros(1)), INPUTS.zeros(1), []
    rest = float(x[plant.row("drive_position"), 0])
    for k in range(STEPS):
        u.command[:] = rest + STEP * (k * PERIOD >= AT)
        plant.advance(x, p, u.rows, 0, 1, SUBSTEPS, PERIOD / SUBSTEPS)
        seen.append(x[: len(plant.signals), 0].copy())
    found = dict(zip([s.name for s in plant.signals], np.array(seen).T, strict=True))
    return found | {"drive_position": found["drive_position"] - rest}


def blocks(axes: Any) -> None:
    """The parts of the drive, and the encoder's way back."""
    axes.set_xlim(0.0, 10.4)
    axes.set_ylim(-1.7, 1.1)
    axes.axis("off")
    for k, ((name, under), flow) in enumerate(zip(BLOCKS, FLOWS, strict=True)):
        left = 1.0 + 1.95 * k
        box = mpl.patches.FancyBboxPatch(
            (left, -0.35), 1.25, 0.7, boxstyle="round,pad=0.05", fc="#e8eef5", ec="#43566b"
        )
        axes.add_patch(box)
        axes.text(left + 0.625, 0.0, name, ha="center", va="center")
        axes.text(left + 0.625, -0.5, under, ha="center", va="top", fontsize=8, color="#555")
        arrow = {"arrowstyle": "-|>", "color": "#43566b", "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (left - 0.07, 0.0), (left - 0.65, 0.0), arrowprops=arrow)
        axes.text(left - 0.35, 0.5, flow, ha="center", fontsize=8)
    axes.text(5.5, 0.85, "supply: U - R_s i", ha="center", fontsize=8, color="#555")
    axes.annotate("", (5.5, 0.42), (5.5, 0.78), arrowprops=arrow)
    axes.plot([7.475, 7.475], [-1.0, -1.4], color="#43566b", lw=1)
    axes.plot([7.475, 1.625], [-1.4, -1.4], color="#43566b", lw=1)
    axes.annotate("", (1.625, -0.75), (1.625, -1.4), arrowprops=arrow)
    axes.text(4.5, -1.35, "encoder: steps, at its own rate", ha="center", va="bottom", fontsize=8)


def main() -> None:
    """Write the picture."""
    mpl.rcParams.update({"svg.hashsalt": "drive", "svg.fonttype": "none", "font.size": 9})
    figure, (above, left, below) = plt.subplots(
        3, 1, figsize=(7.0, 5.6), height_ratios=[1.2, 1.3, 1.0], layout="constrained"
    )
    blocks(above)
    time = 1e3 * PERIOD * (1.0 + np.arange(STEPS))
    ideal, motor = answer("bowden-1m"), answer("bowden-1m-motor")
    left.step(time, 1e3 * STEP * (time > 1e3 * AT), color="#999", lw=1, where="post", label="command")
    left.plot(time, 1e3 * ideal["drive_position"], color="#8c6bb1", label="ideal drive")
    left.plot(time, 1e3 * motor["drive_position"], color="#d95f02", label="motor")
    left.set_ylabel("position, mm")
    left.legend(frameon=False, loc="lower right")
    below.plot(time, motor["servo_force"], color="#1b9e77", label="asked by the servo")
    below.plot(time, motor["motor_force"], color="#d95f02", label="motor, behind its gear")
    below.plot(time, motor["drive_tension"], color="#43566b", label="cable")
    below.set_ylabel("force, N")
    below.set_xlabel("time, ms")
    below.legend(frameon=False, loc="upper right", ncols=3, fontsize=8)
    for axes in (left, below):
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlim(0.0, time[-1])
    text = StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    FILE.write_text(compact_svg(text.getvalue()), encoding="utf-8")


if __name__ == "__main__":
    main()
