"""Fig. 7: what the torque saturator does to the grasp.

The paper draws the saturator and prints neither its limit nor a run in which it acts. Two things can be checked. What
a limit on the drive's torque makes of the grasp is Eq. (44); the chain, pressed slowly against an object by a motor
whose torque is limited, has to come to it. And the loop of Fig. 7, compensation, PID and a saturator fed by the
estimated grasp torque, has to keep the grasp at its limit: with exact parameters, and for the truths of Fig. 11.
"""

from typing import Any, NamedTuple

import numpy as np

from cable_envs.plants.circuit.statics import Statics
from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Extra, Figure, Progress, Result
from cable_envs.reproduction.rows import Row, curve, missing, statement
from cable_envs.reproduction.yardstick import CURVE
from cable_envs.reproduction.zou.data import AMPLITUDE, GRASPER_LENGTH, PERIOD
from cable_envs.reproduction.zou.grasp import SPREAD, TRUTHS, Sine, compensated, contact, truths
from cable_envs.reproduction.zou.runs import DT, Run, follow

REFERENCE = Sine(AMPLITUDE * 1.4, PERIOD)
"""as in Fig. 12"""
SETTLE = 0.25 * PERIOD
MOTOR_LIMITS = (0.2, 0.3, 0.5)
"""N m, at the drive; with the last one a cable goes slack"""
GRASP_LIMITS = (0.1, 0.2, 0.3)
"""N m, at the jaw; 0.2 N m are 13 N at its tip"""
SHOWN = 0.2
NONE = 5.0
"""N m; a saturator out of reach"""
FORCE_ERROR = 1.67
"""N; section 4: the grasping force error is less"""
RAMP, HOLD = 10.0, 5.0
"""s"""


class Case(NamedTuple):
    """One limit with exact parameters."""

    run: Run
    grasp: float
    """largest, N m"""
    error: float
    """largest position error, degrees"""
    tension: float
    """largest, N"""


def pressed() -> Run:
    """A motor with limited torque presses the jaw slowly against an object that it touches from the start."""
    rigs = [{**contact().parameters(), "contact_angle": 0.0, "drive_torque_limit": limit} for limit in MOTOR_LIMITS]
    time = DT * np.arange(round((RAMP + HOLD) / DT) + 1)
    wanted = 1.2 * MOTOR_LIMITS[-1] * np.minimum(time / RAMP, 1.0)
    return follow("chain", rigs, wanted, action_mode="torque")


def strong() -> dict[str, float]:
    """Table 2 with the contact of Fig. 11, and a motor that only the saturator limits."""
    return {**contact().parameters(), "drive_torque_limit": 2.0}


def limited(limit: float) -> Case:
    """The loop of Fig. 7 with exact parameters."""
    nominal = strong()
    run = compensated("feedforward-pid", nominal, [nominal], REFERENCE, action_mode="torque", grasp_limit=limit)
    late = run.part(SETTLE)
    error = np.degrees(np.max(np.abs(late["reference"] - late["output_angle"])))
    return Case(run, float(late["output_torque"].max()), float(error), float(late["tension_drive_top"].max()))


def beyond(limit: float) -> np.ndarray:
    """Force at the tip beyond the limit, N, for each truth."""
    nominal = strong()
    rigs = truths(nominal, SPREAD, TRUTHS)
    run = compensated("feedforward-pid", nominal, rigs, REFERENCE, action_mode="torque", grasp_limit=limit)
    return (run.part(SETTLE)["output_torque"].max(axis=0) - limit) / GRASPER_LENGTH


def reproduce(progress: Progress) -> Result:
    """Limits on the motor; limits on the grasp; truths that the saturator does not know."""
    progress(0.0, "a motor with limited torque against an object")
    slow = pressed()
    cases = {}
    for k, limit in enumerate((*GRASP_LIMITS, NONE)):
        progress(0.3 + 0.1 * k, f"saturator at {limit:g} N m")
        cases[limit] = limited(limit)
    progress(0.7, f"{TRUTHS} truths")
    excess = beyond(SHOWN)
    return Result(
        [*motor_rows(slow), *saturator_rows(cases, excess)],
        (figure(slow, cases),),
        (table(cases),),
        notes=(
            "The loop is feedforward-pid with default gains, which commands the motor's torque; only the saturator "
            "limits it. Sensors are noisy.",
            "The motor meets an object that the jaw touches from the start. A jaw that is driven freely by a torque "
            "arrives at speed, overshoots, and is kept there by the friction of the circuit.",
        ),
        why="A limit on the drive's torque limits the grasp as Eq. (44) says, and a saturator fed by the estimate "
        "keeps it within the printed force error even with parameters wrong by 20 %. While it acts, the position is "
        "no longer followed.",
    )


def motor_rows(slow: Run) -> list[Row]:
    """Grasp under a limited motor: Eq. (44) against the chain."""
    found = []
    for j, limit in enumerate(MOTOR_LIMITS):
        statics = Statics.from_rig(slow.rigs[j])
        slack = bool(limit > statics.torque_range(1)[1][0])
        found.append(
            curve(
                f"grasp torque where the motor is limited to {limit:g} N m (Eq. (44))",
                float(statics.working(limit, 1).output_torque[0]),
                float(slow["output_torque"][-1, j]),
                "N m",
                how="The equation in counter-clockwise motion"
                + (", with a slack cable that carries nothing," if slack else "")
                + f" against the chain: its motor's torque rises for {RAMP:g} s and is cut at the limit.",
            )
        )
    return found


def saturator_rows(cases: dict[float, Case], excess: np.ndarray) -> list[Row]:
    """What section 2.4 and section 4 say of the saturator."""
    over = {limit: (cases[limit].grasp - limit) / GRASPER_LENGTH for limit in GRASP_LIMITS}
    free, held = cases[NONE], cases[SHOWN]
    touched = contact()
    wanted = touched.stiffness * (REFERENCE.amplitude - touched.angle)
    given_up = float(np.degrees((wanted - SHOWN) / touched.stiffness))
    low, high = np.quantile(excess, (0.05, 0.95))
    return [
        statement(
            "the estimated torque limits the grasp (section 2.4)",
            "avoids excessive force",
            ", ".join(f"{cases[limit].grasp:.3f}" for limit in GRASP_LIMITS) + " N m",
            all(0.0 <= force < FORCE_ERROR for force in over.values()) and max(GRASP_LIMITS) < free.grasp,
            chosen="The limits are not printed and were chosen.",
            how=f"Largest grasps for limits of {', '.join(f'{limit:g}' for limit in GRASP_LIMITS)} N m with exact "
            f"parameters, at most {max(over.values()):.2f} N beyond them at the tip. Without a saturator it is "
            f"{free.grasp:.3f} N m.",
        ),
        statement(
            "grasping force error under the saturator (section 4)",
            "less than 1.67 N",
            f"{np.sum(excess < FORCE_ERROR)} of {len(excess)} truths",
            bool(np.all(excess < FORCE_ERROR)),
            chosen=f"The limit of {SHOWN:g} N m and the truths within ±{100 * SPREAD:.0f} % are chosen.",
            how=f"Force beyond the limit at the tip of 15 mm: 5 to 95 % of the truths are {low:.2f} to {high:.2f} N.",
        ),
        statement(
            "accurate position and limited force together (section 2.4)",
            "both completed",
            f"{held.error:.1f} deg with the limit, {free.error:.1f} deg without",
            CURVE.within(free.error, held.error) or held.error < free.error,
            reason=f"Against an object they exclude each other: the reference would press with {wanted:.2f} N m, and "
            f"a grasp held at {SHOWN:g} N m leaves {given_up:.1f} deg of it.",
            how=f"Largest position errors with a limit of {SHOWN:g} N m.",
        ),
        missing("limit of the saturator", None, SHOWN, "N m", "It is not printed, nor is a run in which it acts."),
    ]


def table(cases: dict[float, Case]) -> Extra:
    """Every limit with exact parameters."""
    lines = [
        ("none" if limit == NONE else f"{limit:g}", c.grasp, c.grasp / GRASPER_LENGTH, c.error, c.tension)
        for limit, c in cases.items()
    ]
    columns = ("limit N m", "largest grasp N m", "at 15 mm N", "largest position error deg", "largest tension N")
    return Extra("The loop of Fig. 7, exact parameters", columns, lines)


def figure(slow: Run, cases: dict[float, Case]) -> Figure:
    """Grasp of the limited motor; the loop with and without a saturator."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(1, 3, width_ratios=(1, 1.2, 1.2))
        for j, limit in enumerate(MOTOR_LIMITS):
            axes[0].plot(
                slow["drive_torque"][:, j], slow["output_torque"][:, j], color=style.COLOURS[j],
                linewidth=3.0 - j, label=f"limit {limit:g} N m",
            )  # fmt: skip
        torque = np.linspace(0.09, MOTOR_LIMITS[-1] * 1.1, 60)
        line = Statics.from_rig(slow.rigs[0]).working(torque, 1).output_torque
        axes[0].plot(torque, line, **style.PUBLISHED_LINE, label="Eq. (44)")
        axes[0].set(xlabel="drive torque M_in [N m]", ylabel="grasp torque [N m]")
        axes[0].legend(loc="upper left")
        for k, limit in enumerate((NONE, *reversed(GRASP_LIMITS))):
            run = cases[limit].run
            label = "no saturator" if limit == NONE else f"limit {limit:g} N m"
            dash = style.DASHES[k % len(style.DASHES)]
            axes[1].plot(run.time, run["output_torque"], color=style.COLOURS[k], linestyle=dash, label=label)
            axes[2].plot(run.time, run["output_angle"], color=style.COLOURS[k], linestyle=dash)
        axes[2].plot(run.time, run["reference"], **style.PUBLISHED_LINE, label="desired")
        axes[1].set(xlabel="time [s]", ylabel="grasp torque [N m]", xlim=(12.5, 18.75), ylim=(-0.05, 0.85))
        axes[2].set(xlabel="time [s]", ylabel="output angle θ_out [rad]", xlim=(12.5, 18.75), ylim=(0.8, 2.6))
        axes[1].legend(loc="upper right")
        axes[2].legend(loc="lower center")
        style.letters(axes)

    caption = (
        "(a) A motor with limited torque presses slowly against an object: grasp over drive torque. (b), (c) The "
        "loop of Fig. 7 at 25 N with exact parameters, for three limits of the saturator and without one."
    )
    return Figure("saturator", caption, style.svg(draw, style.PAGE, 2.7))
