"""Fig. 3, Eqs. (12)-(21): the tension along a wrapped part and its stretch, while its outlet is loaded and unloaded.

Everything printed is compared with the differential equation behind it. `profile` integrates Eq. (7) and the stretch of
Eq. (14) with a Runge-Kutta method; nothing of `cable_envs.physics` is used there. While unloading, the friction points
the other way between the outlet and an angle alpha: from the inlet the tension rises as it did, from the outlet it
rises as Eq. (7) says of a cable that slides back, and both meet where they are equal.

Part: idler 3t of Table 2 over its slip angle of Table 3, under 50 N at the inlet and 50 N of pretension.
"""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cable_envs.physics.supports import WrappedPart
from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Extra, Figure, Progress, Result
from cable_envs.reproduction.rows import Row, equation, missing, statement
from cable_envs.reproduction.zou.data import idler

TENSILE_STIFFNESS = 16840.0
"""N; Table 2"""
INLET = PRETENSION = 50.0
"""N; chosen, one of the three pretensions of section 3.2. All elongations are proportional to it."""
SHARES = np.linspace(0.0, 1.0, 21)
"""of the way back of the outlet from T_pk to T_pk / lambda^2"""
WIDE = 1e4
"""rho at which bending no longer matters: the capstan"""


def part(joint: str = "continuous", rho: float | None = None) -> WrappedPart:
    """Idler 3t; with ``rho`` in place of its own radius ratio."""
    pulley = idler("3t")
    return WrappedPart(
        pulley.radius_ratio if rho is None else rho,
        pulley.cable_friction,
        pulley.slip_angle,
        pulley.radius,
        TENSILE_STIFFNESS,
        PRETENSION,
        joint,
    )


def profile(rho: float, mu: float, low: float, angle: float) -> tuple[float, float]:
    """Tension at the end of a sliding part, and the integral of the tension, from Eq. (7) by integration.

    Parameters
    ----------
    rho, mu : float
        Radius ratio and friction coefficient.
    low : float
        Tension at the side with the smaller one, N.
    angle : float
        Length of the part, rad.

    Returns
    -------
    tuple of float
        N, N rad.
    """
    if angle <= 0.0:
        return low, 0.0

    def slope(_: float, y: np.ndarray) -> tuple[float, float, float]:
        return y[1], (rho * mu * y[0] - (1 + rho) * y[1]) / mu, y[0]

    method = "DOP853" if rho < 1e3 else "Radau"  # the shear force decays within mu / rho: stiff in the capstan's limit
    end = solve_ivp(slope, (0.0, angle), (low, 0.0, 0.0), method=method, rtol=1e-11, atol=1e-11 * low).y[:, -1]
    return float(end[0]), float(end[2])


def integrated(whole: WrappedPart, outlet: float) -> tuple[float, float]:
    """Reversed angle (rad) and elongation (m) of a part whose outlet has come back to a tension (N), by integration."""

    def gap(alpha: float) -> float:
        still = profile(whole.rho, whole.mu, INLET, whole.slip - alpha)[0]
        return still - profile(whole.rho, whole.mu, outlet, alpha)[0]

    ends = gap(0.0), gap(whole.slip)
    alpha = 0.0 if ends[0] <= 1e-9 else whole.slip if ends[1] >= -1e-9 else brentq(gap, 0.0, whole.slip, xtol=1e-11)
    area = profile(whole.rho, whole.mu, INLET, whole.slip - alpha)[1] + profile(whole.rho, whole.mu, outlet, alpha)[1]
    return alpha, (area - PRETENSION * whole.slip) * whole.radius / whole.axial_stiffness


def outlets(whole: WrappedPart) -> np.ndarray:
    """Tensions of the outlet on its way back, N."""
    peak = whole.turning_outlet(INLET)
    return peak + (peak / whole.ratio(whole.slip) ** 2 - peak) * SHARES


def reproduce(progress: Progress) -> Result:
    """Loading and unloading of one part, printed and integrated."""
    progress(0.0, "Eq. (7) along the loaded part")
    whole, printed = part(), part("printed")
    values = outlets(whole)
    progress(0.2, "Eq. (7) along the part that lets go")
    solved = np.array([integrated(whole, t) for t in values])
    as_printed = np.array([printed.unloading(INLET, t) for t in values])
    angles = np.array([printed.reversed_angle(INLET, t) for t in values])
    progress(0.7, "the capstan's limit")
    wide = part("printed", WIDE)
    middle = outlets(wide)[len(SHARES) // 2]
    limit = (wide.unloading(INLET, middle), integrated(wide, middle)[1])
    rows = [*loading_rows(whole), *unloading_rows(whole, printed, values, solved, as_printed), capstan_row(*limit)]
    rows.append(
        missing(
            "curves of Fig. 3", None, None, "", "They are drawn without numbers, and no pulley or tension is named."
        )
    )
    return Result(
        rows,
        (figure(whole, values, solved, as_printed, angles),),
        (table(values, solved, as_printed, angles),),
        notes=(
            "The circuit of the paper does not use Eqs. (17)-(21): section 2.3.2 calls them too complicated and puts "
            "the hold of Eq. (47) in their place. The chain of this package has the continuous joint.",
        ),
        why="Loading is as printed. Unloading is right at both ends of the way back and in the limit of the capstan; "
        "between them Eq. (17) joins two tensions that are not equal.",
    )


def loading_rows(whole: WrappedPart) -> list[Row]:
    """Eqs. (12), (13) and (16), and what Fig. 3a says."""
    peak, area = profile(whole.rho, whole.mu, INLET, whole.slip)
    stretch = (area - PRETENSION * whole.slip) * whole.radius / whole.axial_stiffness
    along = [profile(whole.rho, whole.mu, INLET, a)[0] for a in np.linspace(0.0, whole.slip, 9)]
    return [
        equation(
            "T_pk at the end of loading (Eqs. (12), (13))",
            whole.turning_outlet(INLET),
            peak,
            "N",
            how="Eq. (7) integrated from T(0) = 50 N, T'(0) = 0.",
        ),
        equation(
            "elongation at the end of loading (Eq. (16))",
            1e6 * whole.loading(INLET),
            1e6 * stretch,
            "µm",
            how="The integrated tension put into Eqs. (14) and (15).",
        ),
        statement(
            "tension along the loaded part (Fig. 3a)",
            "grows from the inlet to the outlet",
            f"{along[0]:.1f} to {along[-1]:.2f} N",
            bool(np.all(np.diff(along) > 0)),
            how="Eq. (7) integrated.",
        ),
    ]


def unloading_rows(
    whole: WrappedPart, printed: WrappedPart, values: np.ndarray, solved: np.ndarray, as_printed: np.ndarray
) -> list[Row]:
    """Eqs. (17)-(21), and what the text about Fig. 3b says."""
    k = int(np.argmax(np.abs(as_printed - solved[:, 1])))
    alpha = printed.reversed_angle(INLET, values[k])
    inner, outer = INLET * printed.ratio(whole.slip - alpha), values[k] * printed.ratio(alpha)
    rise = float(np.max(as_printed) - as_printed[0])
    low = whole.turning_outlet(INLET, rising=False)
    back = 1.0 + 0.5 * (whole.ratio(whole.slip) ** 2 - 1.0)
    return [
        equation(
            "elongation when the outlet turns (Eq. (21), T_2 = T_pk)",
            1e6 * as_printed[0],
            1e6 * solved[0, 1],
            "µm",
            how="Eq. (7) integrated from both ends.",
        ),
        equation(
            "elongation when all of the part has slipped back (Eq. (21), T_2 = T_pk / lambda^2)",
            1e6 * as_printed[-1],
            1e6 * solved[-1, 1],
            "µm",
            how="Eq. (7) integrated from the outlet.",
        ),
        equation(
            f"elongation on the way back, where it is furthest off (Eq. (21), T_2 = {values[k]:.2f} N)",
            1e6 * as_printed[k],
            1e6 * solved[k, 1],
            "µm",
            how="Eq. (7) integrated from both ends up to the angle at which both tensions are equal.",
            reason="Eq. (17) takes lambda(x + y) = lambda(x) lambda(y), which is true of the capstan only. At the "
            f"joint the tension of the printed equations jumps from {inner:.3f} to {outer:.3f} N, by "
            f"{100 * abs(outer / inner - 1):.1f} %.",
        ),
        statement(
            "elongation while the outlet lets go (Eq. (21))",
            "gradually reduced",
            f"{'falls' if rise <= 0 else f'first grows by {1e9 * rise:.1f} nm'}",
            rise <= 0,
            reason="The joint of Eq. (17) again: as printed the part grows longer by "
            f"{100 * rise / as_printed[0]:.2f} % while its outlet lets go. With equal tensions at the joint it only "
            "gets shorter.",
            how="The integrated one falls all the way." if np.all(np.diff(solved[:, 1]) < 0) else "",
        ),
        statement(
            "cable slips back only partially (Fig. 3b)",
            "partially moves on the pulley",
            f"alpha grows from {solved[0, 0]:.3f} to {solved[-1, 0]:.3f} rad of {whole.slip:.3f}",
            bool(np.all(np.diff(solved[:, 0]) > 0) and solved[-1, 0] <= whole.slip * (1 + 1e-9)),
            how="The angle at which the two integrated tensions meet.",
        ),
        statement(
            "reversed angle where the tension drops towards the outlet (Eq. (18), sgn = 1)",
            "lambda(alpha)^2 = T_pk / T_2",
            f"T_pk / T_2 = {1 / back:.3f}, below 1",
            1 / back >= 1.0,
            reason="lambda is at least 1, so that the equation has no solution: there the outlet turns at its lowest "
            f"tension, {low:.2f} N, and rises, here to {low * back:.2f} N. The inverse, T_2 / T_pk, has one.",
        ),
    ]


def capstan_row(as_printed: float, solved: float) -> Row:
    """Eq. (21) where its joint is right."""
    return equation(
        "elongation half of the way back in the capstan's limit (Eq. (21))",
        1e6 * as_printed,
        1e6 * solved,
        "µm",
        how=f"Eq. (7) integrated from both ends, with a radius ratio of {WIDE:g} in place of {part().rho:.2f}.",
    )


def table(values: np.ndarray, solved: np.ndarray, as_printed: np.ndarray, angles: np.ndarray) -> Extra:
    """The way back in numbers."""
    chosen = range(0, len(values), 4)
    return Extra(
        "Outlet on its way back, idler 3t",
        ("outlet N", "reversed angle rad", "printed rad", "elongation µm", "printed µm", "printed less integrated %"),
        [
            (
                float(values[k]),
                float(solved[k, 0]),
                float(angles[k]),
                1e6 * float(solved[k, 1]),
                1e6 * float(as_printed[k]),
                round(100 * float(as_printed[k] / solved[k, 1] - 1), 3),
            )
            for k in chosen
        ],
    )


def figure(
    whole: WrappedPart, values: np.ndarray, solved: np.ndarray, as_printed: np.ndarray, angles: np.ndarray
) -> Figure:
    """Fig. 3 with numbers, and the stretch over the outlet's tension."""

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2, width_ratios=(1.2, 1))
        dense = np.linspace(0.0, whole.slip, 60)
        left.plot(dense, [INLET * whole.ratio(a) for a in dense], color=style.INK, label="loaded")
        for j, k in enumerate((5, 10, 15)):
            alpha = solved[k, 0]
            inner, outer = dense[dense <= whole.slip - alpha], dense[dense >= whole.slip - alpha]
            tension = [INLET * whole.ratio(a) for a in inner]
            tension += [values[k] * whole.ratio(whole.slip - a) for a in outer]
            left.plot(
                np.concatenate([inner, outer]), tension, color=style.COLOURS[j], label=f"back to {values[k]:.1f} N"
            )
            cut = whole.slip - angles[k]
            a, b = dense[dense <= cut], dense[dense >= cut]
            left.plot(b, [values[k] * whole.ratio(whole.slip - x) for x in b], **_PRINTED)
            left.plot(a[-8:], [INLET * whole.ratio(x) for x in a[-8:]], **_PRINTED)
        left.plot([], [], **_PRINTED, label="Eqs. (17), (18)")
        left.set(xlabel="angle from the inlet [rad]", ylabel="tension [N]")
        left.legend(loc="upper left")
        right.plot(values, 1e6 * solved[:, 1], color=style.COLOURS[0], label="integrated")
        right.plot(values, 1e6 * as_printed, **_PRINTED, label="Eq. (21)")
        load = np.linspace(INLET, values[0], 20)
        right.plot(
            load,
            [1e6 * (profile(whole.rho, whole.mu, INLET, a)[1] - INLET * a) * whole.radius / whole.axial_stiffness
             for a in [_reached(whole, t) for t in load]],
            color=style.INK, label="first loading",
        )  # fmt: skip
        right.set(xlabel="tension of the outlet [N]", ylabel="elongation [µm]")
        right.legend(loc="upper left")
        style.letters((left, right))

    return Figure(
        "unloading",
        "Idler 3t under 50 N. (a) Tension along the slipping part when loaded and with the outlet on its way back, "
        "Eq. (12); dashed: the printed joint, where it differs. (b) Elongation over the outlet's tension.",
        style.svg(draw, style.PAGE, 2.8),
    )


_PRINTED: dict[str, Any] = {"color": style.COLOURS[1], "linestyle": (0, (3, 2)), "linewidth": 1.0}


def _reached(whole: WrappedPart, outlet: float) -> float:
    """How far from the outlet the cable slips when the outlet is first raised to a tension above the inlet's, rad."""
    if outlet <= INLET:
        return 0.0
    return float(brentq(lambda a: whole.ratio(a) - outlet / INLET, 0.0, whole.slip * 1.001))
