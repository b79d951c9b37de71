"""Fig. 14: the surgical instrument at 25 N with compensation.

The paper gives its pretension and three errors: no amplitude, no period, no object, no cable run. Chosen: the cable run
of Table 2, the period of 12.5 s, and the amplitudes and objects of `AMPLITUDES` and `STIFFNESSES`; the jaw closes on
the object at half of the swing. Truths as in Fig. 11.
"""

from typing import Any, NamedTuple

import numpy as np

from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Extra, Figure, Progress, Result
from cable_envs.reproduction.rows import digits, missing
from cable_envs.reproduction.zou.data import GRASPER_LENGTH, INSTRUMENT, INSTRUMENT_MEAN, PERIOD
from cable_envs.reproduction.zou.grasp import SPREAD, Contact, Sine, compensated, estimate, largest, noisy, truths
from cable_envs.reproduction.zou.runs import Run

AMPLITUDES = (0.3, 0.6, 1.0)
"""rad, half of the swing of the output"""
STIFFNESSES = (0.05, 0.2, 0.5)
"""N m/rad; 0.2 is the preset zou-instrument, firm tissue at the tip of a 15 mm jaw"""
SHOWN = (0.6, 0.2)
COUNT = 20


class Case(NamedTuple):
    """Errors of an ensemble: medians; degrees and N m."""

    run: Run
    max_angle: float
    mean_angle: float
    max_torque: float
    """estimated less desired grasp torque"""
    peak: float
    """largest grasp torque"""


def case(amplitude: float, stiffness: float) -> Case:
    """Every truth under the compensation that believes in Table 2 at 25 N."""
    nominal = Contact(stiffness, 0.0).parameters()
    whole = compensated("feedforward-pid", nominal, truths(nominal, SPREAD, COUNT), Sine(amplitude, PERIOD))
    found = estimate(nominal, noisy(whole, np.random.default_rng(9)))
    run = whole.part(0.25 * PERIOD)
    late = whole.time > 0.25 * PERIOD + 1e-9
    angle = np.degrees(np.abs(run["reference"] - run["output_angle"]))
    torque = found.torque[late] - run.contact_torque(run["reference"])
    return Case(
        run,
        float(np.median(angle.max(axis=0))),
        float(np.median(angle.mean(axis=0))),
        float(np.median(largest(torque))),
        float(run["output_torque"].max()),
    )


def reproduce(progress: Progress) -> Result:
    """Nine combinations of what is not printed."""
    cases = {}
    for k, (amplitude, stiffness) in enumerate((a, s) for a in AMPLITUDES for s in STIFFNESSES):
        progress(k / 9, f"amplitude {amplitude:g} rad, object {stiffness:g} N m/rad")
        cases[amplitude, stiffness] = case(amplitude, stiffness)
    shown = cases[SHOWN]
    reach = {name: [getattr(c, name) for c in cases.values()] for name in ("max_angle", "mean_angle", "max_torque")}
    rows = [
        missing(
            label,
            printed,
            getattr(shown, name),
            unit,
            "Amplitude, period, object and cable run are not printed.",
            how=f"Chosen are {SHOWN[0]:g} rad, 12.5 s, {SHOWN[1]:g} N m/rad and Table 2. Over amplitudes of 0.3 to 1 "
            f"rad and objects of 0.05 to 0.5 N m/rad there are {min(reach[name]):.3g} to {max(reach[name]):.3g} "
            f"{unit}.",
        )
        for label, printed, name, unit in (
            ("max position error, compensated", INSTRUMENT.degrees, "max_angle", "deg"),
            ("mean position error, compensated", INSTRUMENT_MEAN, "mean_angle", "deg"),
            ("max torque error, estimated less desired", INSTRUMENT.torque, "max_torque", "N m"),
        )
    ]
    force = INSTRUMENT.torque / GRASPER_LENGTH
    rows.append(
        digits(
            "force error for 0.025 N m, 15 mm grasper",
            "1.47",
            force,
            "N",
            inputs=(force - 5e-4 / GRASPER_LENGTH, force + 5e-4 / GRASPER_LENGTH),
            reason=f"It is a misprint: the conclusions have 1.67 N, which is {INSTRUMENT.torque:g} N m over 15 mm. "
            f"1.47 N would need {1.47 * GRASPER_LENGTH:.3f} N m or {1e3 * INSTRUMENT.torque / 1.47:.0f} mm.",
        )
    )
    return Result(
        rows,
        (figure(cases),),
        (table(cases),),
        why="The printed torque error lies within what the nine chosen cases give, and the position errors are smaller "
        "than printed in all of them. Neither can be checked.",
    )


def table(cases: dict[tuple[float, float], Case]) -> Extra:
    """Medians over the truths."""
    return Extra(
        "Instrument at 25 N, truths within ±20 %",
        ("amplitude rad", "object N m/rad", "max deg", "mean deg", "max N m", "largest grasp N m"),
        [(a, s, c.max_angle, c.mean_angle, c.max_torque, c.peak) for (a, s), c in cases.items()],
        "Medians over 20 truths.",
    )


def figure(cases: dict[tuple[float, float], Case]) -> Figure:
    """One case in time; the three errors over amplitude."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(1, 4, width_ratios=(1.5, 1, 1, 1))
        run = cases[SHOWN].run
        time = run.time - run.time[0]
        axes[0].plot(time, run["reference"][:, 0], color=style.INK, linewidth=2.2, alpha=0.35, label="desired")
        axes[0].plot(time, run["output_angle"][:, 0], color=style.COLOURS[0], label="actual")
        axes[0].set(xlabel="time [s]", ylabel="output angle θ_out [rad]", xlim=(0, 12.5), ylim=(-0.75, 1.05))
        axes[0].legend(loc="upper center")
        for ax, name, printed, label in (
            (axes[1], "max_angle", INSTRUMENT.degrees, "max angle error [°]"),
            (axes[2], "mean_angle", INSTRUMENT_MEAN, "mean angle error [°]"),
            (axes[3], "max_torque", INSTRUMENT.torque, "max torque error [N m]"),
        ):
            for k, s in enumerate(STIFFNESSES):
                ax.plot(
                    AMPLITUDES,
                    [getattr(cases[a, s], name) for a in AMPLITUDES],
                    color=style.COLOURS[k],
                    linestyle=style.DASHES[k],
                    marker=".",
                    label=f"{s:g} N m/rad",
                )
            ax.axhline(printed, **style.PUBLISHED_LINE, label="printed")
            ax.set(xlabel="amplitude [rad]", ylabel=label)
            ax.set_ylim(0, 1.25 * max(printed, max(getattr(c, name) for c in cases.values())))
        handles, labels = axes[1].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside lower right", ncols=4)
        style.letters(axes)

    return Figure(
        "instrument",
        "Instrument at 25 N with compensation, truths within ±20 %. (a) one truth, 0.6 rad on an object of 0.2 N "
        "m/rad; (b)-(d) median errors over amplitude for three objects.",
        style.svg(draw, style.PAGE, 2.7),
    )
