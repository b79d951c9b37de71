"""Fig. 4, Eqs. (22)-(30): the eight idlers of Table 2 fixed, on a shaft, and on a rolling bearing.

The closed forms are compared with the balance of torques, written with vectors and solved by root finding: nothing of
`cable_envs.physics` is used there. The paper prints no number for a rolling bearing; assumed are the coefficient that
SKF gives for open deep-groove ball bearings and the shaft's radius as that of the bore.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cable_envs.physics.supports import BEARING_FRICTION, SUPPORTS, Pulley, loaded_shaft_ratio
from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Extra, Figure, Progress, Result
from cable_envs.reproduction.rows import Row, equation, missing, statement
from cable_envs.reproduction.yardstick import EQUATION, same_digits
from cable_envs.reproduction.zou.data import ESTIMATED, GRASP_PRETENSION, IDLERS, TABLE_3, idler

LOADS = (0.0, 0.01, 0.05, 0.2)
"""N m; on a pulley whose slack side carries 25 N. The grasps of the paper reach 0.2 N m"""
SIDES = {"t": ("1t", "2t", "3t", "4t"), "b": ("1b", "2b", "3b", "4b")}
DRIVING_WRAP, DRIVING_RADIUS = 3.700, 7e-3
"""rad, m; P0 of Table 2"""


def on(name: str, support: str) -> Pulley:
    """An idler on one of the three supports."""
    pulley = idler(name, support)
    return replace(pulley, support_friction=BEARING_FRICTION) if support == "bearing" else pulley


def balanced(pulley: Pulley, low: float = 1.0, load: float = 0.0) -> float:
    """The larger tension that turns a pulley on its support against a load: balance of torques with vectors, N.

    Parameters
    ----------
    pulley : Pulley
        On a shaft or a bearing.
    low : float
        The smaller tension, N.
    load : float
        Torque on the pulley against its motion, N m.

    Returns
    -------
    float
    """
    arm = float(pulley.support_friction or 0.0) * float(pulley.support_radius or 0.0)

    def excess(high: float) -> float:
        force = np.array([low, 0.0]) + high * np.array([-math.cos(pulley.wrap), math.sin(pulley.wrap)])
        return pulley.radius * (high - low) - load - arm * float(np.linalg.norm(force))

    start = low + load / pulley.radius
    return float(brentq(excess, start, 1e3 * start, xtol=1e-14, rtol=1e-14))


def reproduce(progress: Progress) -> Result:
    """Every idler on every support; a loaded pulley; the bearing of the driving pulley."""
    progress(0.0, "eight idlers on three supports")
    rows = [*ratio_rows(), loaded_row(), *statement_rows(), *bearing_rows()]
    progress(0.8, "figure")
    return Result(
        rows,
        (figure(),),
        (table(),),
        notes=(
            "Table 3's rotatable column is compared in zou-table3, as it was computed: Eq. (12) over the capstan's "
            "slip angle. Here it is compared with what the text says it is.",
        ),
        why="The equations of all three supports are right. The rotatable column of Table 3 is not Eq. (30), a slip "
        "angle taken from the capstan does depend on the cable's friction, and a rolling bearing is far too light to "
        "be blamed.",
    )


def ratio_rows() -> list[Row]:
    """Eq. (30) for idlers on shafts and bearings: the one that is furthest off."""
    found = []
    for support, words in (("shaft", "(b)"), ("bearing", "(c)")):
        pairs = [(name, 1.0 / on(name, support).turning_ratio, 1.0 / balanced(on(name, support))) for name in IDLERS]
        name, closed, solved = max(pairs, key=lambda p: abs(p[1] / p[2] - 1.0))
        found.append(
            equation(
                f"tension ratio T_1 / T_2 of idlers on a {support} (Eq. (30), Fig. 4{words})",
                closed,
                solved,
                "1",
                how=f"Balance of torques by root finding, for eight idlers. The least exact one, P{name}, is shown.",
            )
        )
    return found


def loaded_row() -> Row:
    """Eq. (29) over loads and idlers: the pair that is furthest off."""
    pairs = []
    for name in IDLERS:
        pulley = on(name, "shaft")
        for load in LOADS:
            k = load / (GRASP_PRETENSION * pulley.radius) + 1.0
            closed = float(loaded_shaft_ratio(k, pulley.share, math.cos(pulley.wrap)))
            pairs.append((name, load, closed, GRASP_PRETENSION / balanced(pulley, GRASP_PRETENSION, load)))
    name, load, closed, solved = max(pairs, key=lambda p: abs(p[2] / p[3] - 1.0))
    return equation(
        "tension ratio T_1 / T_2 of a pulley with a load torque (Eq. (29))",
        closed,
        solved,
        "1",
        how=f"Balance of torques by root finding, for eight idlers at {len(LOADS)} loads of up to {LOADS[-1]:g} N m. "
        f"The least exact one, P{name} at {load:g} N m, is shown.",
    )


def statement_rows() -> list[Row]:
    """What sections 2.1 and 3.1 say of the supports."""
    order = [[on(name, support).loss(10.0) for support in SUPPORTS] for name in IDLERS]
    ordered = sum(bool(np.all(np.diff(losses) < 0)) for losses in order)
    rough = [Pulley(4e-3, 0.56e-3, 0.279, friction, "shaft", 3.5e-3, 1.0) for friction in (0.1, 0.2)]
    slides = [EQUATION.within(p.sliding_ratio, p.ratio) and p.ratio < balanced(p) for p in rough]
    one, half = on("3t", "shaft"), replace(on("3t", "shaft"), cable_friction=0.27)
    equal = [same_digits(TABLE_3[name].shown("rotatable"), *[on(name, "shaft").turning_ratio] * 2) for name in IDLERS]
    worst = max(IDLERS, key=lambda name: on(name, "shaft").turning_ratio - TABLE_3[name].rotatable)
    slipping = sum(on(name, "shaft").slip_angle < on(name, "shaft").wrap for name in IDLERS)
    return [
        statement(
            "tension loss of the three supports (Fig. 4, Eqs. (22)-(24))",
            "the smaller of two frictions",
            f"fixed > shaft > bearing for {ordered} of {len(IDLERS)} idlers",
            ordered == len(IDLERS),
            how="The smaller tension is 10 N.",
        ),
        statement(
            "pulley that turns harder than the cable slides (Eq. (22))",
            "the loss is that of the cable",
            f"{sum(slides)} of {len(slides)} rough shafts",
            all(slides),
            how="Wrap 0.279 rad on a shaft with friction 1.0, which Table 2 does not have.",
        ),
        statement(
            "slip angle smaller than the wrap where the pulley turns (section 3.1)",
            "must be smaller",
            f"{slipping} of {len(IDLERS)} idlers",
            slipping == len(IDLERS),
            how="The slip angle is the logarithm of Eq. (30) over the cable's friction coefficient.",
        ),
        statement(
            "slip angle of an idler does not depend on the cable's friction (Eq. (30))",
            "independent",
            f"{one.slip_angle:.3f} rad, {half.slip_angle:.3f} rad at half the friction",
            EQUATION.within(one.slip_angle, half.slip_angle),
            reason=f"The equation gives the ratio, and the ratio alone is independent: {one.turning_ratio:.4f} and "
            f"{half.turning_ratio:.4f}. The slip angle of Table 3 is its logarithm over the cable's friction "
            "coefficient.",
            how="Idler P3t.",
        ),
        statement(
            "rotatable ratios of Table 3 are those of Eq. (29) (section 3.1)",
            "calculated from Eq. (29)",
            f"{sum(equal)} of {len(equal)} agree to the last digit",
            all(equal),
            reason="The column is Eq. (12) over the capstan's slip angle, which agrees to the last digit "
            "(zou-table3). The capstan has no bending and Eq. (12) has, so that part of the support's ratio is lost: "
            f"{on(worst, 'shaft').turning_ratio:.3f} becomes {TABLE_3[worst].rotatable:.3f} on P{worst}.",
        ),
    ]


def bearing_rows() -> list[Row]:
    """What a rolling bearing takes, of the idlers and of the driving pulley."""
    product = {s: math.prod(on(n, s).ratio for n in SIDES["t"]) for s in SUPPORTS}
    force = 2.0 * GRASP_PRETENSION * math.sin(DRIVING_WRAP / 2.0)
    torque = BEARING_FRICTION * float(idler("1t").support_radius or 0.0) * force
    share = torque / ESTIMATED.torque
    return [
        missing(
            "tension ratio on a rolling bearing (Fig. 4c)",
            None,
            max(on(name, "bearing").ratio for name in IDLERS),
            "1",
            "No friction coefficient and no bore of a bearing is printed.",
            how=f"SKF's {BEARING_FRICTION:g} and a bore of {5:g} mm give this on the idler that loses most. Cable t "
            f"over its four idlers loses a factor of {product['fixed']:.0f} fixed, {product['shaft']:.2f} on shafts "
            f"and {product['bearing']:.4f} on bearings.",
        ),
        statement(
            "errors of the estimate come from the bearing of the driving pulley (section 3.2)",
            "named as a cause",
            f"{torque:.1e} N m at 25 N, {100 * share:.2f} % of 0.109 N m",
            share > 0.05,
            reason=f"The bearing carries {force:.0f} N, and its friction is that times {BEARING_FRICTION:g} times "
            f"the radius of its bore. It would have to rub {0.05 / share:.0f} times as much to make a twentieth of "
            "the largest error.",
            how="The coefficient is SKF's, and the bore is assumed as wide as the idlers' shafts.",
        ),
    ]


def table() -> Extra:
    """All idlers on all supports."""
    lines: list[Sequence[Any]] = []
    for name in IDLERS:
        shaft = on(name, "shaft")
        lines.append(
            (
                f"P{name}",
                shaft.wrap,
                on(name, "fixed").ratio,
                shaft.ratio,
                TABLE_3[name].rotatable,
                on(name, "bearing").ratio,
                shaft.slip_angle,
                on(name, "bearing").slip_angle,
            )
        )
    columns = ("idler", "wrap rad", "fixed", "shaft", "printed", "bearing", "slip on a shaft rad", "on a bearing rad")
    return Extra("Tension ratios on three supports", columns, lines, "Printed: the rotatable column of Table 3.")


def figure() -> Figure:
    """Loss of each idler on each support."""

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        x = np.arange(len(IDLERS))
        for k, support in enumerate(SUPPORTS):
            loss = [100 * (on(name, support).ratio - 1.0) for name in IDLERS]
            ax.bar(x + 0.27 * (k - 1), loss, width=0.25, color=style.COLOURS[k], label=support)
        ax.plot(x, [100 * (TABLE_3[n].rotatable - 1) for n in IDLERS], **style.PUBLISHED, label="Table 3, rotatable")
        ax.set(yscale="log", xticks=x, xticklabels=IDLERS, xlabel="idler", ylabel="loss over smaller tension [%]")
        ax.set_ylim(0.01, 3e3)
        ax.grid(axis="x", visible=False)
        ax.legend(ncols=2, loc="upper left")

    caption = (
        "Tension that an idler takes, over the smaller of its two tensions: fixed to the base, on its shaft, and on "
        "a rolling bearing (assumed). Circles: the rotatable column of Table 3."
    )
    return Figure("supports", caption, style.svg(draw, 4.6, 2.9), wide=False)
