"""Table 3: slip angles and tension ratios of the eight idlers."""

from typing import Any

import numpy as np

from cable_envs.reproduction import style
from cable_envs.reproduction.registry import DIFFERS, REPRODUCED, Figure, Progress, Result, Row
from cable_envs.reproduction.zou.data import EXACT_WRAPS, IDLERS, TABLE_3, idler

LAST_DIGIT = 5e-4
"""half a unit of the last printed digit"""
SLACK = 5e-5
"""what a wrap known to three decimals may add: 3b (4.62148) and 4t (4.79652) lie that close to the rounding"""
EXCEPTIONS = {("4b", "slip"), ("4b", "fixed")}
COLUMNS = {"slip": ("slip angle", "rad"), "rotatable": ("ratio, rotatable", "1"), "fixed": ("ratio, fixed", "1")}


def computed(name: str, wrap: float | None = None) -> dict[str, float]:
    """The three computed columns of an idler: Eqs. (12), (30) and the capstan's slip angle.

    Parameters
    ----------
    name : str
        As in the table.
    wrap : float, optional
        rad; without it its own.

    Returns
    -------
    dict of float
        By column.
    """
    pulley, fixed = idler(name, wrap=wrap), idler(name, "fixed", wrap)
    return {"slip": pulley.slip_angle, "rotatable": pulley.ratio_over_slip, "fixed": fixed.ratio}


def rows() -> list[Row]:
    """24 computed values, and the eight wraps that went in."""
    found = []
    for name in IDLERS:
        values = computed(name)
        for key, (label, unit) in COLUMNS.items():
            printed = getattr(TABLE_3[name], key)
            same = abs(values[key] - printed) <= LAST_DIGIT + SLACK
            why = f"to the last printed digit: {values[key]:.5f}" if same else _misprint(name, key)
            found.append(Row(f"P{name} {label}", printed, values[key], unit, REPRODUCED if same else DIFFERS, why))
    for name in IDLERS:
        wrap = TABLE_3[name].wrap
        used = EXACT_WRAPS.get(wrap, wrap)
        why = "as in Table 2" if used == wrap else "as in Table 2; the ratios need the right or straight angle itself"
        found.append(Row(f"P{name} wrap angle", wrap, used, "rad", REPRODUCED, why))
    return found


def _misprint(name: str, key: str) -> str:
    """Why a value is off: what the wraps that round to the printed one give."""
    if (name, key) not in EXCEPTIONS:
        return "reason not found"
    wrap = TABLE_3[name].wrap
    low, high = (computed(name, wrap + shift)[key] for shift in (-LAST_DIGIT, LAST_DIGIT))
    return f"misprint: the wraps that round to {wrap:.3f} give {low:.4f} to {high:.4f}, and the other 22 values agree"


def reproduce(progress: Progress) -> Result:
    """Eqs. (12), (30) and the capstan's slip angle."""
    progress(0.0, "eight idlers")
    found = rows()
    return Result(
        found,
        (figure(),),
        notes=(
            "The ratio of the rotatable column is Eq. (12) over the capstan's slip angle. The support's own ratio, "
            "Eq. (30), "
            "is larger: 1.028 on P1 against 1.006, because the capstan equation has no bending and Eq. (12) has.",
            "The radius r = 0.560 mm of Table 2 is used as a radius; Table 1 gives 0.54 mm as the diameter. Half of "
            "it misses the table.",
        ),
        why="22 of 24 values to the last printed digit; the other two, both of pulley 4b, follow from no wrap that "
        "rounds to the printed one.",
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
        "Slip angle and tension ratio of the eight idlers: computed (bars) and printed (circles). "
        "Only 4b is off, in (a) by 0.0009 and in (c) by 0.009.",
        style.svg(draw, style.PAGE, 2.4),
    )
