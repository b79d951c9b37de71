"""Fig. 6: the transmission characteristic and its phases, from the analytic plant and from the chain.

The paper draws Fig. 6 without numbers; what can be checked is what sections 2.3.1-2.3.2 say of the phases. Chosen: 50
N, a contact of 0.57 N m/rad (the ratio of torque and position errors of Table 4) that is touched over the whole motion,
0.2 rad at the drive in the paper's period: no cable goes slack.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from cable_envs.plants.circuit.statics import Statics
from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import curve, missing, statement
from cable_envs.reproduction.yardstick import CURVE
from cable_envs.reproduction.zou.data import PERIOD
from cable_envs.reproduction.zou.runs import CONTACT_DAMPING, Run, follow, last_cycle, sinusoid

RIG = {"contact_stiffness": 0.57, "contact_damping": CONTACT_DAMPING, "contact_angle": -0.7}
SWING = 0.2
"""rad at the drive"""
PHASES = {1: "delay", 2: "transition", 3: "working"}
_COLOUR = {"delay": style.COLOURS[1], "transition": style.COLOURS[3], "working": style.COLOURS[0]}


def characteristic(variant: str, dt: float = 0.005) -> Run:
    """One settled cycle."""
    return last_cycle(follow(variant, [RIG], sinusoid(2.5, dt, SWING), dt))


def dead_band(output_torque: float) -> float:
    """Drive angle between the working lines of both directions at one output torque: Eq. (45) twice.

    Parameters
    ----------
    output_torque : float
        N m.

    Returns
    -------
    float
        rad.
    """
    statics = Statics.from_rig(RIG)
    angle = [float(statics.inverse(0.0, output_torque, direction).drive_angle[0]) for direction in (1, -1)]
    return angle[0] - angle[1]


def strokes(run: Run) -> list[np.ndarray]:
    """Samples of each whole stroke between two reversals of the drive, the reversal first."""
    drive = run["drive_angle"][:, 0]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(drive)))) + 1
    pairs = pairwise(turns)
    # a control step that contains the reversal may still report the phase before it
    return [np.arange(a + (1 if run["phase"][a, 0] == 3 else 0), b) for a, b in pairs]


def slopes(run: Run, stroke: np.ndarray) -> dict[str, float]:
    """Mean slope of the output angle over the drive angle in each phase of a stroke.

    Parameters
    ----------
    run : Run
        One mechanism.
    stroke : ndarray of int
        Samples of the stroke (`strokes`).

    Returns
    -------
    dict of float
        By phase, in units of R0 / R5: 1 is a rigid cable.
    """
    found = {}
    for number, name in PHASES.items():
        inside = stroke[1:][run["phase"][stroke[1:], 0] == number]
        if len(inside) == 0:
            continue
        drive = np.sum(np.diff(run["drive_angle"][:, 0])[inside - 1])
        output = np.sum(np.diff(run["output_angle"][:, 0])[inside - 1])
        found[name] = float(output / drive * run.rig("output_radius")[0] / run.rig("drive_radius")[0])
    return found


def reproduce(progress: Progress) -> Result:
    """Both plants through one cycle; phases of the chain, dead band against the closed forms."""
    progress(0.0, "two plants, one cycle")
    analytic, chain = characteristic("analytic"), characteristic("chain")
    stroke = strokes(chain)[0]
    top = int(stroke[0])
    found = slopes(chain, stroke)
    phases = chain["phase"][stroke, 0]
    drive = chain["drive_angle"][stroke, 0]
    reach = {
        name: float(np.ptp(drive[phases == number])) for number, name in PHASES.items() if np.any(phases == number)
    }
    held = float(abs(drive[0] - drive[np.argmax(phases == 3)]))  # from the reversal to the first sample that works
    predicted = dead_band(float(chain["output_torque"][top, 0]))
    working = (chain["phase"][:, 0] == 3) & (analytic["phase"][:, 0] == 3)
    apart = {
        name: float(np.max(np.abs(chain[name][working, 0] - analytic[name][working, 0])) / np.ptp(chain[name][:, 0]))
        for name in ("output_angle", "output_torque", "drive_torque")
    }
    order = [PHASES[int(p)] for p in phases[np.flatnonzero(np.diff(phases, prepend=0.0))] if p]
    rows = [
        statement(
            "phases after a reversal",
            "delay, transition, working",
            ", ".join(dict.fromkeys(order)),
            list(dict.fromkeys(order)) == list(PHASES.values()),
            how="They emerge in the chain: nothing in it knows of phases.",
        ),
        statement(
            "delay: output",
            "held",
            f"{found['delay']:.1e} of R0/R5",
            abs(found["delay"]) < 1e-3,
            how=f"The slope over {reach['delay']:.3f} rad of the drive is below a thousandth of a rigid cable's.",
        ),
        statement(
            "transition: slope of the output",
            "between zero and the working slope",
            f"{found['transition']:.3f}, working {found['working']:.3f}",
            0 <= found["transition"] < found["working"],
            how=f"Mean over {reach['transition']:.3f} rad of the drive, in units of R0/R5.",
        ),
        curve(
            "delay and transition lumped into one hold (Eq. 47): drive angle until the output works",
            predicted,
            held,
            "rad",
            how="Eq. (45) in both directions at the torque of the reversal, against the chain, which moves a little "
            "within the transition.",
        ),
        statement(
            "working phase: Eqs. (44)-(46) against the chain",
            "the same",
            f"at most {max(apart.values()):.1e} of the range apart",
            CURVE.within(1.0, 1.0 + max(apart.values())),
            how="Angle, output torque and drive torque where both report the working phase. They are furthest apart "
            "right after the high-load reversal, where the chain has moved a little in its transition.",
        ),
        missing(
            "curve of Fig. 6",
            None,
            None,
            "",
            "It is drawn without numbers, and pretension, load and amplitude are not named.",
        ),
    ]
    return Result(
        rows,
        figures(analytic, chain),
        notes=(
            "Eq. (47) with its lost minus restored would hold the output until M_in changes sign; against a load "
            "that pushes back it never does within a stroke. The analytic plant therefore ends the hold by the "
            "balance of torques.",
        ),
        why="Four phases emerge from spans and friction contacts; the hold of Eq. (47) is as long as they take "
        "together.",
    )


def figures(analytic: Run, chain: Run) -> tuple[Figure, ...]:
    """Output angle error and torque over the drive angle, and the phases in time."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(2, 2)
        drive = chain["drive_angle"][:, 0]
        curves = (
            ("output_angle", "output angle θ_out [rad]", axes[0, 0]),
            ("output_torque", "output torque M_out [N m]", axes[0, 1]),
            ("drive_torque", "drive torque M_in [N m]", axes[1, 0]),
        )
        for name, label, ax in curves:
            for number, phase in PHASES.items():
                inside = chain["phase"][:, 0] == number
                ax.plot(
                    drive,
                    np.where(inside, chain[name][:, 0], np.nan),
                    color=_COLOUR[phase],
                    linewidth=2.6,
                    alpha=0.55,
                    label=f"chain: {phase}",
                )
            ax.plot(
                analytic["drive_angle"][:, 0],
                analytic[name][:, 0],
                color=style.INK,
                linewidth=0.9,
                linestyle=style.DASHES[1],
                label="analytic plant",
            )
            ax.set(xlabel="drive angle θ_in [rad]", ylabel=label)
        axes[0, 0].legend(loc="upper left")
        _loop_arrows(axes[0, 0], chain)
        ax = axes[1, 1]
        time = chain.time - chain.time[0]
        ax.plot(time, chain.position_error[:, 0], color=style.COLOURS[0], label="chain")
        ax.plot(
            time,
            analytic.position_error[:, 0],
            color=style.INK,
            linewidth=0.9,
            linestyle=style.DASHES[1],
            label="analytic plant",
        )
        _phase_bands(ax, time, chain["phase"][:, 0])
        ax.set(xlabel="time [s]", ylabel="elongation angle D [rad]", xlim=(0, PERIOD))
        ax.legend(loc="upper left")
        style.letters(axes.ravel())

    return (
        Figure(
            "characteristic",
            "Transmission characteristic at 50 N against a contact of 0.57 N m/rad: (a) output angle, (b) output "
            "torque, (c) drive torque over the drive angle, the chain coloured by its phases; (d) the angle that the "
            "cables take up, with the chain's delay and transition shaded.",
            style.svg(draw, style.PAGE, 4.8),
        ),
    )


def _phase_bands(ax: Any, time: np.ndarray, phase: np.ndarray) -> None:
    edges = np.flatnonzero(np.diff(phase)) + 1
    for part in np.split(np.arange(len(time)), edges):
        name = PHASES.get(int(phase[part[0]]))
        if name in ("delay", "transition"):
            ax.axvspan(time[part[0]], time[part[-1]], color=_COLOUR[name], alpha=0.18, linewidth=0)


def _loop_arrows(ax: Any, run: Run) -> None:
    x, y = run["drive_angle"][:, 0], run["output_angle"][:, 0]
    middle = strokes(run)[0][len(strokes(run)[0]) // 2]
    for k in (middle, middle - len(x) // 2):
        ax.annotate(
            "",
            (x[k + 40], y[k + 40]),
            (x[k - 40], y[k - 40]),
            arrowprops={"arrowstyle": "-|>", "color": style.INK, "linewidth": 0.8},
        )
