"""Of docs/cable-mechanisms.md: what a tendon in a sheath loses, and how a reversal gets through it.

Run ``python docs/pictures/sheath.py`` (under a minute); it writes sheath.svg beside itself.
"""

from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from cable_envs.drawing.compact_svg import compact_svg
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig

FILE = Path(__file__).with_suffix(".svg")
PERIOD, LOW, HIGH = 0.01, 0.002, 0.025
CONTACTS = 20


def run(name: str, command: np.ndarray, posture: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Signals of a rig whose drive follows a path in m."""
    rig = load_rig(name)
    plant = rig.simulated_by()
    names = [s.name for s in plant.signals]
    out = replay(
        plant, rig.column(plant), command, PERIOD, drive="follow", signals=names, posture=posture, start=0.0
    )  # fmt: skip
    return {signal: out[:, k, 0] for k, signal in enumerate(names)}


def path() -> np.ndarray:
    """In, out and in again, with a small loop on the way, each leg in straight lines, m."""
    ends = [0.001, HIGH, 0.014, 0.019, LOW, HIGH]
    return np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(ends)])


def main() -> None:
    """Draw the three panels."""
    mpl.rcParams.update({"svg.hashsalt": "sheath", "svg.fonttype": "none", "font.size": 9})
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(10.0, 3.3))
    way = path()
    one, many = run("bowden-1m", way), run("bowden-1m-20", way)
    bent = run("bowden-1m-20", way, np.full(len(way), np.pi))
    for seen, colour, label in (
        (bent, "#edae49", "20 contacts, 360°"), (one, "#888888", "one contact, 180°"),
        (many, "#00798c", "20 contacts, 180°"),
    ):  # fmt: skip
        x = 1e3 * seen["drive_position"]
        left.plot(x[200:], 1e3 * seen["load_position"][200:], color=colour, lw=1.2)
        middle.plot(x[200:], seen["drive_tension"][200:], color=colour, lw=1.2, label=label)
    left.set(xlabel="drive $x$ [mm]", ylabel="load $y$ [mm]", title="hysteresis")
    middle.set(xlabel="drive $x$ [mm]", ylabel="tension at the drive $T_0$ [N]", title="tension")
    middle.legend(frameon=False, fontsize=7.5, loc="upper left")
    spans = np.array(
        [many["drive_tension"], *(many[f"span_tension_{j}"] for j in range(1, CONTACTS)), many["load_tension"]]
    )
    angle = np.concatenate([[0.0], np.repeat(180.0 * (np.arange(CONTACTS) + 0.5) / CONTACTS, 2), [180.0]])
    for k, shade in ((199, 0.0), (212, 0.25), (225, 0.5), (240, 0.75), (300, 1.0)):
        colour = (shade * 0.82, 0.47 * (1 - shade) + 0.29 * shade, 0.55 * (1 - shade) + 0.36 * shade)
        right.plot(angle, np.repeat(spans[:, k], 2), color=colour, lw=1.2, label=f"{1e3 * way[k]:.1f} mm")
    right.set(xlabel="angle from the drive [°]", ylabel="tension [N]", title="a reversal in the sheath", ylim=(22, 68))
    right.legend(frameon=False, fontsize=7.5, title="drive at", title_fontsize=7.5)
    for axes in (left, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(FILE, metadata={"Date": None})
    FILE.write_text(compact_svg(FILE.read_text(encoding="utf-8")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
