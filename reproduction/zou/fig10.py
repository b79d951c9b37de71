"""Fig. 10: output angle and output torque at three pretensions.

Free in one half cycle, against the sensor in the other.
"""

from typing import Any

import numpy as np

from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import missing, statement
from cable_envs.reproduction.zou.data import PRETENSIONS
from cable_envs.reproduction.zou.pretension import BY_NAME, CHOSEN, Fitted, fit, simulate
from cable_envs.reproduction.zou.runs import Run
from cable_envs.reproduction.zou.table4 import SECTION, conditions


def reproduce(progress: Progress) -> Result:
    """The chain under the contact that suits Table 4 best (`zou_table4`), beside the analytic plant."""
    progress(0.0, "fit of the contact")
    fitted = fit(BY_NAME["chain"], CHOSEN)
    progress(0.8, "one cycle at three pretensions")
    chain, analytic = (simulate(BY_NAME[name], [fitted.conditions], 0.01) for name in ("chain", "analytic"))
    errors = np.abs(chain.position_error).max(axis=0)
    turning = float(chain.expected_angle.max())
    at = chain.expected_angle[np.argmax(np.abs(chain.position_error), axis=0), range(3)]
    apart = float(np.max(np.abs(chain["output_angle"] - analytic["output_angle"])))
    slack = chain["slack_fraction"].mean(axis=0)
    sensor = f"Stiffness and position of the sensor are fitted to Table 4: {conditions(fitted)}."
    rows = [
        statement(
            "backlash is large, with all three pretensions",
            "very large",
            f"{', '.join(f'{v:.2f}' for v in errors)} of {turning:.2f} rad",
            bool(errors.min() > 0.05 * turning),
            chosen=sensor,
            how="Largest differences between expected and output angle at 12.5, 50 and 150 N.",
        ),
        statement(
            "where it is largest",
            "where the direction of the drive's torque changes",
            f"at {', '.join(f'{v:.2f}' for v in at)} of {turning:.2f} rad",
            bool(np.all(at > 0.97 * turning)),
            chosen="The words are read as the reversal in contact, where the drive's torque is largest and begins to "
            "fall; its sign does not change there.",
        ),
        statement(
            "output torque closer to the expected with more pretension",
            "in theory, not observed",
            ", ".join(f"{v:.3f}" for v in fitted.errors[:, 2]) + " N m",
            not bool(np.all(np.diff(fitted.errors[:, 2]) < 0)),
            chosen=sensor,
            how=f"Largest torque errors at 12.5, 50 and 150 N. See {SECTION}.",
        ),
        missing(
            "curves of Fig. 10",
            None,
            None,
            "",
            "They are drawn without numbers that the text gives, and stiffness and position of the sensor are not "
            "printed.",
        ),
    ]
    return Result(
        rows,
        (figure(chain, fitted),),
        notes=(
            f"Slack share of the cycle at 12.5, 50, 150 N: {', '.join(f'{100 * v:.0f} %' for v in slack)}. Chain and "
            f"analytic plant are within {apart:.4f} rad of each other.",
            f"Largest tensions: {', '.join(f'{v:.0f}' for v in chain['peak_tension'].max(axis=0))} N; the rope is "
            "good for about 223 N.",
        ),
        why="The loops are as described: errors are large at all three pretensions, and largest at the reversal in "
        "contact.",
    )


def figure(chain: Run, fitted: Fitted) -> Figure:
    """Loops over the drive angle, and both errors in time."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(2, 2)
        time = chain.time - chain.time[0]
        panels = (
            (
                axes[0, 0],
                chain["drive_angle"],
                chain["output_angle"],
                "drive angle θ_in [rad]",
                "output angle θ_out [rad]",
            ),
            (
                axes[0, 1],
                chain["drive_angle"],
                chain["output_torque"],
                "drive angle θ_in [rad]",
                "output torque M_out [N m]",
            ),
            (
                axes[1, 0],
                time[:, None] + 0 * chain.position_error,
                chain.position_error,
                "time [s]",
                "position error [rad]",
            ),
            (
                axes[1, 1],
                time[:, None] + 0 * chain.position_error,
                chain.torque_error(),
                "time [s]",
                "torque error [N m]",
            ),
        )
        for ax, x, y, xlabel, ylabel in panels:
            for k, pretension in enumerate(PRETENSIONS):
                ax.plot(x[:, k], y[:, k], color=style.COLOURS[k], linestyle=style.DASHES[k], label=f"{pretension:g} N")
            ax.set(xlabel=xlabel, ylabel=ylabel)
        drive = chain["drive_angle"][:, 0]
        order = np.argsort(drive)
        axes[0, 0].plot(drive[order], 1.4 * drive[order], **style.PUBLISHED_LINE, label="rigid cable")
        axes[0, 1].plot(
            drive[order],
            chain.contact_torque(chain.expected_angle)[order, 0],
            **style.PUBLISHED_LINE,
            label="rigid cable",
        )
        axes[0, 0].set(xlim=(0.8, 1.78), ylim=(1.0, 2.5))
        axes[0, 1].set(xlim=(0.8, 1.78))
        axes[0, 0].legend(loc="upper left")
        axes[1, 0].set_xlim(0, 12.5)
        axes[1, 1].set_xlim(0, 12.5)
        style.letters(axes.ravel())

    k, c = fitted.conditions["contact_stiffness"], fitted.conditions["contact_angle"]
    return Figure(
        "cycle",
        f"One cycle of 1.74 sin(2πt/12.5 s) at the drive, from the chain; contact from {c:.2f} rad with {k:.2f} N "
        "m/rad. (a), (b) the part of the loops near the contact, (c), (d) errors against a rigid cable.",
        style.svg(draw, style.PAGE, 4.6),
    )
