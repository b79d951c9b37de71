"""Table 3: slip angles and tension ratios of the eight idlers."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import Row, digits
from cable_envs.reproduction.yardstick import same_digits
from cable_envs.reproduction.zou.data import IDLERS, TABLE_3, idler

COLUMNS = {"slip": ("slip angle", "rad"), "rotatable": ("ratio, rotatable", "1"), "fixed": ("ratio, fixed", "1")}


WRAP = 5e-4
"""rad; half a unit of the last digit of a printed wrap"""


def computed(name: str, wrap: float | None = None, **change: Any) -> dict[str, float]:
    """The three computed columns of an idler: Eqs. (12), (30) and the capstan's slip angle.

    Parameters
    ----------
    name : str
        As in the table.
    wrap : float, optional
        rad; without it its own.
    **change
        Other fields of `Pulley` than those of Table 2.

    Returns
    -------
    dict of float
        By column.
    """
    pulley, fixed = (replace(idler(name, support, wrap), **change) for support in ("shaft", "fixed"))
    return {"slip": pulley.slip_angle, "rotatable": pulley.ratio_over_slip, "fixed": fixed.ratio}


def rows() -> list[Row]:
    """24 computed values, and the wrap that is printed as 3.141."""
    found = []
    for name in IDLERS:
        values = computed(name)
        wrap = idler(name).wrap
        ends = [computed(name, wrap + shift) for shift in (-WRAP, WRAP)]
        for key, (label, unit) in COLUMNS.items():
            found.append(
                digits(
                    f"P{name} {label}",
                    TABLE_3[name].shown(key),
                    values[key],
                    unit,
                    inputs=(ends[0][key], ends[1][key]),
                    how="The wrap is known to three decimals.",
                    reason=_shared(name, key),
                )
            )
    low = max(TABLE_3[name].fixed - computed(name, 3.141 + WRAP)["fixed"] for name in ("3t", "3b"))
    found.append(
        digits(
            "P3t and P3b wrap angle",
            "3.141",
            math.pi,
            "rad",
            reason="The digits are cut off and not rounded: with the wraps that round to 3.141 a fixed ratio of P3 "
            f"stays {low:.4f} below its print, more than half a unit, and half a turn gives both."
            if low > WRAP
            else "",
            how="Table 3 needs half a turn.",
        )
    )
    return found


SHARED = {"slip": ("support_friction", 0.157, WRAP), "fixed": ("cable_friction", 0.54, WRAP)}
"""the coefficient that all idlers share and that could move a column: field of `Pulley`, printed value, half a unit"""


def _shared(name: str, key: str) -> str:
    """Why a value that no wrap gives cannot come from the rounding of a shared coefficient either; "" if it can."""
    if key not in SHARED:
        return ""
    field, printed, half = SHARED[key]
    wrap = idler(name).wrap
    for value in np.linspace(printed - half, printed + half, 101):
        both = [computed(name, wrap + shift, **{field: value})[key] for shift in (-WRAP, WRAP)]
        if not same_digits(TABLE_3[name].shown(key), *sorted(both)):
            continue
        broken = [other for other in IDLERS if other != name and not _holds(other, key, field, value)]
        if not broken:
            return ""
    return (
        f"No wrap that rounds to {TABLE_3[name].wrap:.3f} gives the print. No {field.replace('_', ' ')} that rounds "
        f"to {printed:g} gives it without taking another idler's value of this column away."
    )


def _holds(name: str, key: str, field: str, value: float) -> bool:
    """Whether an idler keeps its printed digits when a shared coefficient is moved."""
    wrap = idler(name).wrap
    ends = sorted(computed(name, wrap + shift, **{field: value})[key] for shift in (-WRAP, WRAP))
    return same_digits(TABLE_3[name].shown(key), *ends)


def reproduce(progress: Progress) -> Result:
    """Eqs. (12), (30) and the capstan's slip angle."""
    progress(0.0, "eight idlers")
    found = rows()
    return Result(
        found,
        (figure(),),
        notes=(
            "The ratio of the rotatable column is Eq. (12) over the capstan's slip angle. The support's own ratio, "
            "Eq. (30), is larger: 1.028 on P1 against 1.006, because the capstan equation has no bending and Eq. "
            "(12) has.",
            "The radius r = 0.560 mm of Table 2 is used as a radius; Table 1 gives 0.54 mm as the diameter. Half of "
            "it misses the table.",
            "The wraps themselves are inputs, from Table 2. Those printed as 1.571 and 3.141 are taken as a quarter "
            "and half a turn.",
        ),
        why="22 of 24 values agree to the last printed digit. The other two, both of pulley 4b, follow from no "
        "inputs that round to the printed ones.",
    )


def figure() -> Figure:
    """Printed and computed ratios, and their difference in units of the last digit."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(1, 3)
        x = np.arange(len(IDLERS))
        for ax, (key, (label, unit)) in zip(axes, COLUMNS.items(), strict=True):
            values = [computed(name)[key] for name in IDLERS]
            ax.bar(x, values, width=0.62, color=style.COLOURS[0], alpha=0.55, label="computed")
            ax.plot(x, [getattr(TABLE_3[name], key) for name in IDLERS], **style.PUBLISHED, label="Table 3")
            ax.set(title=label, xticks=x, xticklabels=IDLERS, xlabel="idler", ylabel=f"{label} [{unit}]")
            if key == "rotatable":
                ax.set_ylim(1.0, 1.14)
            ax.grid(axis="x", visible=False)
        axes[0].legend(loc="upper left")
        axes[0].set_ylim(0, 0.42)
        style.letters(axes)

    return Figure(
        "idlers",
        "Slip angle and tension ratio of the eight idlers: computed (bars) and printed (circles). Only 4b is off, in "
        "(a) by 0.0009 and in (c) by 0.009.",
        style.svg(draw, style.PAGE, 2.4),
    )
