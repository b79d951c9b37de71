"""Eq. (48): what friction at the driven pulley leaves of the output torque for the grasp.

The paper gives M_fric no value and no equation; "combining Eqs. (25) and (47)" makes it the friction of the driven
pulley on its support, r_s mu_s times the force that both cables press it with. Section 2.2 puts that pulley on a
rolling bearing. Computed are M_fric for such a bearing and, as an upper end, for a shaft as under the idlers; the
balance of the pulley by root finding; and the chain with that friction at its output, closing and opening.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.physics.supports import BEARING_FRICTION, Pulley, loaded_shaft_ratio
from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import Row, curve, equation, missing
from cable_envs.reproduction.yardstick import CURVE
from cable_envs.reproduction.zou.data import GRASP_PRETENSION, GRASPER_LENGTH
from cable_envs.reproduction.zou.fig6 import RIG, SWING
from cable_envs.reproduction.zou.pulley.fig4 import balanced
from cable_envs.reproduction.zou.runs import Run, follow, last_cycle, sinusoid

DRIVEN = Pulley(5e-3, 0.56e-3, 3.320, 0.54, "shaft", 2.5e-3, 0.157)
"""P5 of Table 2 on a shaft as under the idlers"""
GRASP = 0.2
"""N m; about the largest grasp of Figs. 11 and 14"""
DT = 0.005


def friction(pulley: Pulley, low: float, high: float) -> float:
    """r_s mu_s times the force on the support, Eq. (24), N m."""
    force = math.sqrt(low**2 + high**2 - 2.0 * low * high * math.cos(pulley.wrap))
    return float(pulley.support_radius or 0.0) * float(pulley.support_friction or 0.0) * force


def tensions(pulley: Pulley, low: float, grasp: float) -> float:
    """The larger tension at the driven pulley under a grasp torque, from Eq. (29), N."""
    k = grasp / (low * pulley.radius) + 1.0
    return low / float(loaded_shaft_ratio(k, pulley.share, math.cos(pulley.wrap)))


def moved(brake: float) -> Run:
    """The chain through one settled cycle in contact, as in Fig. 6, with friction at the driven pulley."""
    return last_cycle(follow("chain", [{**RIG, "brake_torque": brake}], sinusoid(2.5, DT, SWING), DT))


def reproduce(progress: Progress) -> Result:
    """The balance of the driven pulley, and the chain in motion."""
    progress(0.0, "balance of the driven pulley")
    high = tensions(DRIVEN, GRASP_PRETENSION, GRASP)
    rubbing = friction(DRIVEN, GRASP_PRETENSION, high)
    progress(0.2, "chain, closing and opening")
    run = moved(rubbing)
    return Result(
        [*balance_rows(high, rubbing), *motion_rows(run, rubbing)],
        (figure(run, rubbing),),
        notes=(
            "The plants of this package have M_fric as the parameter brake_torque, with the direction of motion and "
            "with sticking. Its default is zero, as in the paper's comparisons, which leave it out.",
        ),
        why="Eq. (48) holds while the jaw closes. While it opens the friction helps to hold, and the minus becomes a "
        "plus. On a rolling bearing it is too small to be seen.",
    )


def balance_rows(high: float, rubbing: float) -> list[Row]:
    """Eqs. (24), (25), (29), (33) and (48) against the balance of the pulley, and the size of M_fric."""
    output = DRIVEN.radius * (high - GRASP_PRETENSION)
    solved = balanced(DRIVEN, GRASP_PRETENSION, GRASP)
    bearing = replace(DRIVEN, support="bearing", support_friction=BEARING_FRICTION)
    small = friction(bearing, GRASP_PRETENSION, tensions(bearing, GRASP_PRETENSION, GRASP))
    return [
        equation(
            "output torque that leaves a grasp of 0.2 N m (Eqs. (29), (33))",
            output,
            DRIVEN.radius * (solved - GRASP_PRETENSION),
            "N m",
            how="Balance of torques with vectors by root finding: P5 on a shaft, 25 N on the slack side.",
        ),
        equation(
            "grasp torque left of it (Eqs. (24), (25), (48))",
            output - rubbing,
            GRASP,
            "N m",
            how="M_fric is taken as r_s F_s of Eq. (24). The grasp is the load of that balance.",
        ),
        missing(
            "friction M_fric at the driven pulley",
            None,
            small,
            "N m",
            "Neither its value nor the bearing is printed.",
            how=f"Computed for a rolling bearing with SKF's {BEARING_FRICTION:g} at a bore of 5 mm, 25 N on the "
            f"slack side and a grasp of {GRASP:g} N m: {small / GRASPER_LENGTH:.3f} N at the tip of 15 mm. On a "
            f"shaft as under the idlers it would be {rubbing:.3f} N m, {rubbing / GRASPER_LENGTH:.2f} N.",
        ),
    ]


def passing(run: Run, direction: int) -> int:
    """The sample at which the jaw moves fastest in a direction."""
    return int(np.argmax(direction * run["output_velocity"][:, 0]))


def motion_rows(run: Run, rubbing: float) -> list[Row]:
    """Eq. (48) in the simulated mechanism, closing and opening."""
    output, grasp = run["output_torque"][:, 0], run.contact_torque(run["output_angle"])[:, 0]
    closing, opening = passing(run, 1), passing(run, -1)
    turned = CURVE.within(float(output[opening] + rubbing), float(grasp[opening]))
    how = f"M_out less M_fric = {rubbing:.3f} N m, against what the object answers where the jaw is fastest."
    return [
        curve(
            "grasp torque while the jaw closes (Eq. (48))",
            float(output[closing] - rubbing),
            float(grasp[closing]),
            "N m",
            how=how,
        ),
        curve(
            "grasp torque while the jaw opens (Eq. (48))",
            float(output[opening] - rubbing),
            float(grasp[opening]),
            "N m",
            how=how,
            reason="Friction is against the motion: while the jaw opens, M_fric adds to M_out in holding the object. "
            f"With a plus the equation gives {output[opening] + rubbing:.4f} N m."
            if turned
            else "",
        ),
    ]


def figure(run: Run, rubbing: float) -> Figure:
    """Grasp over output torque through a cycle."""

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        output, grasp = run["output_torque"][:, 0], run.contact_torque(run["output_angle"])[:, 0]
        ax.plot(output, grasp, color=style.COLOURS[0], label="chain, one cycle")
        ends = np.array([output.min(), output.max()])
        ax.plot(ends, ends - rubbing, **style.PUBLISHED_LINE, label="Eq. (48)")
        ax.plot(ends, ends + rubbing, color=style.COLOURS[1], linestyle=style.DASHES[1], label="with a plus")
        ax.set(xlabel="output torque M_out [N m]", ylabel="grasp torque [N m]")
        ax.legend(loc="upper left")

    caption = (
        f"Grasp torque over output torque through a cycle in contact, with friction of {rubbing:.3f} N m at the "
        "driven pulley: the lower line while closing, the upper one while opening, and a hold between them."
    )
    return Figure("friction", caption, style.svg(draw, 4.6, 2.9), wide=False)
