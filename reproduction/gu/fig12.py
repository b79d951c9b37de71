"""Fig. 12: the tension ratio over wrap and speed; what Eq. (13) cannot produce, and what a Stribeck term does."""

import math
from typing import Any

import numpy as np

from cable_envs.identification.problem import ratio_at
from cable_envs.physics.contact import tension_ratio
from cable_envs.reproduction import style
from cable_envs.reproduction.gu.data import PEAK_SPEED, TABLE_2
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import Row, digits, missing, statement

SECTION = "docs/mismatches/fig12-speed.md"


def reproduce(progress: Progress) -> Result:
    """Ratio map from Table 2; the two statements about it; a friction law that would bear out the second."""
    progress(0.0, "ratio map")
    wraps, speeds = np.radians(np.linspace(30, 90, 61)), np.linspace(0.0, PEAK_SPEED, 61)
    n = ratio_at(TABLE_2.parameters, wraps[:, None], speeds[None, :], "g22")
    exact = ratio_at(TABLE_2.parameters, wraps[:, None], speeds[None, :], "exact")
    rise = {angle: 100 * (n[angle - 30, -1] / n[angle - 30, 0] - 1) for angle in (30, 60, 90)}
    progress(0.5, "Stribeck term")
    found = stribeck_search()
    falls = [100 * found[f"fall_{angle}"] for angle in (30, 60, 90)]
    rows = [*statements(n, rise, falls), mass_row(), expansion_row(n, exact)]
    note = (
        "A Stribeck term of Gauss' form (exponent 2) on top of Table 2 makes the ratio fall with speed from the "
        "start and rise later, never the other way round: K v^2.03 and the Gaussian both start with v^2. With "
        f"exponent 4, a drop of {found['drop']:.2f} and a Stribeck speed of {1e3 * found['speed']:.1f} mm/s the "
        "ratio rises, falls and rises again, at all wraps at the same speeds since dn/dv = (dn/dM) M'(v), but "
        f"{falls[2] / falls[0]:.0f} times less at 30° than at 90°."
    )
    why = "The map follows from Table 2. That n falls again with speed at 60-90° takes a friction that weakens."
    return Result(rows, figures(wraps, speeds, n, found), notes=(note,), why=why)


RANGES = ((33.0, 73.0), (40.0, 62.0))
"""N; tensions of section 5.3 with the extrusion in the controller and without"""


def statements(n: np.ndarray, rise: dict[int, float], falls: list[float]) -> list[Row]:
    """What section 5.2 says about the map: ratios [wraps, speeds], their rise (%) and falls (%) of the Stribeck law."""
    backwards = bool(np.any(np.diff(n, axis=1) < 0))
    (low, high), (low_9, high_9) = RANGES
    needed = 100 * (math.sqrt(high / low) / math.sqrt(high_9 / low_9) - 1)
    return [
        missing(
            "ratios of the 75 points",
            None,
            f"{n.min():.3f} to {n.max():.3f}",
            "",
            "They are shown as a contour plot without readable numbers, and speeds, hole and load are not printed.",
        ),
        statement(
            "speed matters little at 30-60°",
            "contours almost straight",
            f"+{rise[30]:.0f} % at 30°, +{rise[60]:.0f} % at 60°",
            rise[60] < 5,
            reason="Two prints exclude each other: at 60° the tensions of section 5.3 need the ratio to grow by "
            f"{needed:.0f} %, from sqrt(62/40) to sqrt(73/33). The statement holds up to "
            f"{1e3 * quiet_speed(0.02):.1f} mm/s (2 %), so that Fig. 12 was taken slower than section 5.3, or the "
            "two do not belong to one cable.",
            how=f"Speeds go up to the {1e3 * PEAK_SPEED:g} mm/s of section 5.3.",
        ),
        statement(
            "speed at 60-90°",
            "n rises, then falls",
            f"{'falls too' if backwards else 'only rises'} (by {rise[90]:.0f} % at 90°)",
            backwards,
            reason="The equation cannot do it: n grows with M = mu + C at every wrap and C = K v^omega with v, so "
            "that no K, omega > 0 makes it fall. A friction that weakens at some speed does: the example below falls "
            f"by {falls[0]:.1f} % at 30°, {falls[1]:.1f} % at 60°, {falls[2]:.1f} % at 90°, so that contours of "
            f"small wraps stay nearly straight. See {SECTION}.",
        ),
    ]


def mass_row() -> Row:
    """The towed mass from the tensions of section 5.3."""
    (low, high), half = RANGES[0], 0.5
    heavy = 9.81 * 10.0 * math.sqrt(high / low)
    return digits(
        "towed mass (Eq. 36)",
        "10",
        inferred_mass(),
        "kg",
        inputs=(inferred_mass(-half), inferred_mass(half)),
        how="Mean of two pairs of tensions.",
        reason="Two prints exclude each other: raising takes n G and lowering G / n, so that the product of the "
        "extremes of section 5.3 is G^2, and sqrt(73 x 33) and sqrt(62 x 40) N belong to 5 kg. With 10 kg, raising "
        f"at n = {math.sqrt(high / low):.3f} takes {heavy:.0f} N, beyond the 100 N sensor. See "
        "docs/mismatches/load.md.",
    )


def expansion_row(n: np.ndarray, exact: np.ndarray) -> Row:
    """Eq. (22) against the ratio that it expands in delta."""
    off = float(np.max(np.abs(n / exact - 1)))
    return statement(
        "Eq. (22) approximates G17",
        "approximate",
        f"{off:.1e} off at most",
        off < TABLE_2.delta**2,
        how=f"Over the whole map. A first-order expansion in delta = {TABLE_2.delta:g} may be off by delta^2.",
    )


def inferred_mass(shift: float = 0.0) -> float:
    """kg; the load whose raising and lowering give the ranges of section 5.3, mean of both; all tensions moved by N."""
    return float(np.mean([math.sqrt((low + shift) * (high + shift)) for low, high in RANGES])) / 9.81


def quiet_speed(share: float, wrap: float = math.pi / 3) -> float:
    """m/s up to which n(60 degrees) stays within ``share`` of its value at rest."""
    speeds = np.linspace(0.0, PEAK_SPEED, 2001)
    n = ratio_at(TABLE_2.parameters, wrap, speeds)
    return float(speeds[np.searchsorted(n, n[0] * (1 + share)) - 1])


def friction(speed: np.ndarray, drop: float, stribeck_speed: float, exponent: float) -> np.ndarray:
    """Friction of Table 2 with a Stribeck term: M(v) = mu + drop (e^{-(v/v_s)^exponent} - 1) + K v^omega.

    Parameters
    ----------
    speed : ndarray
        m/s.
    drop : float
        By how much the friction falls from rest.
    stribeck_speed : float
        v_s, m/s.
    exponent : float
        Of the speed.

    Returns
    -------
    ndarray
        Friction coefficient, like ``speed``.
    """
    decay = np.exp(-((speed / stribeck_speed) ** exponent)) - 1.0
    return TABLE_2.mu + drop * decay + TABLE_2.K * speed**TABLE_2.omega


def stribeck_search(exponent: float = 4.0) -> dict[str, float]:
    """The Stribeck term with the largest fall of the friction after a rise.

    Parameters
    ----------
    exponent : float
        Of (v / v_s) in the law of `friction`.

    Returns
    -------
    dict of float
        drop (at most 0.4, so that mu stays positive), its speed in m/s, and the relative fall of the tension ratio at
        wraps of 30, 60 and 90 degrees.
    """
    speeds = np.linspace(0.0, PEAK_SPEED, 201)
    best, top, low = (0.0, PEAK_SPEED), 1.0, 1.0
    for drop in np.arange(0.05, 0.401, 0.05):
        for scale in np.linspace(0.1, 1.0, 46) * PEAK_SPEED:
            m = friction(speeds, drop, scale, exponent)
            k = int(np.argmax(np.diff(m) < 0))  # the first step down
            if k > 0 and m[k] > m[0] + 0.02 and m[k] - m[k:].min() > top - low:
                best, top, low = (float(drop), float(scale)), float(m[k]), float(m[k:].min())
    rho = TABLE_2.parameters["rho0"] * (1 + TABLE_2.delta)
    ratios = {d: [tension_ratio(rho, m, math.radians(d)) for m in (low, top)] for d in (30, 60, 90)}
    return {"drop": best[0], "speed": best[1], **{f"fall_{d}": 1 - a / b for d, (a, b) in ratios.items()}}


def figures(wraps: np.ndarray, speeds: np.ndarray, n: np.ndarray, found: dict[str, float]) -> tuple[Figure, ...]:
    """The map, and ratio against speed with and without a Stribeck term."""

    def draw_map(figure: Any) -> None:
        ax = figure.subplots()
        filled = ax.contourf(1e3 * speeds, np.degrees(wraps), n, levels=np.arange(1.05, 2.01, 0.05))
        levels = np.arange(1.1, 2.01, 0.1)
        lines = ax.contour(1e3 * speeds, np.degrees(wraps), n, levels=levels, colors="white", linewidths=0.7)
        ax.clabel(lines, fmt="%.1f", fontsize=7.5)
        ax.axhline(60, color="white", linewidth=0.8, linestyle=(0, (4, 2)))
        ax.set(xlabel="sliding speed v [mm/s]", ylabel="wrap angle θ [°]", yticks=range(30, 91, 15))
        ax.grid(visible=False)
        figure.colorbar(filled, ax=ax, label="tension ratio n [1]")

    def draw_laws(figure: Any) -> None:
        axes = figure.subplots(1, 3, sharey=True)
        laws = (
            ("Eq. (22), Table 2", None),
            ("and Stribeck, exponent 2", (0.2, 0.35 * PEAK_SPEED, 2.0)),
            ("and Stribeck, exponent 4", (found["drop"], found["speed"], 4.0)),
        )
        rho = TABLE_2.parameters["rho0"] * (1 + TABLE_2.delta)
        for ax, (title, law) in zip(axes, laws, strict=True):
            m = friction(speeds, *(law or (0.0, 1.0, 2.0)))
            for k, angle in enumerate((90, 75, 60, 45, 30)):
                y = [tension_ratio(rho, value, math.radians(angle)) for value in m]
                ax.plot(1e3 * speeds, y, color=style.COLOURS[k], linestyle=style.DASHES[k % 4], label=f"{angle}°")
            ax.set(title=title, xlabel="sliding speed v [mm/s]")
        axes[0].set_ylabel("tension ratio n [1]")
        axes[0].legend(title="wrap", ncols=2)
        style.letters(axes)

    captions = (
        "Tension ratio of the 2 mm fibre cable over wrap and speed, Eq. (22) with Table 2 and ρ₀ = 1.5 (inferred). "
        "The paper says: straight contours below the dashed line, a rise and a fall above it.",
        "Ratio against speed. (a) The model only rises. (b) A Stribeck term of Gauss' form makes it fall first. (c) "
        "A steeper one makes it rise, fall and rise again, least where the wrap is small.",
        "Tension of raising (upper branch) and lowering (lower branch) a load against the ratio. The tension ranges "
        "of section 5.3 lie on the curves of 5 kg, not of the printed 10 kg.",
        "Ratio at 60° without extrusion against the size of the hole, with both readings of ρ (Eq. 2). With the "
        "printed one the ratio falls to 1 in a wide hole, where it must become the capstan's, and the measured 1.245 "
        "is out of reach for any cable that fits into its hole.",
    )

    def draw_load(figure: Any) -> None:
        ax = figure.subplots()
        ratio = np.linspace(1.0, 1.6, 50)
        for k, mass in enumerate((5.0, 10.0)):
            weight = 9.81 * mass
            ax.plot(ratio, weight * ratio, color=style.COLOURS[k], label=f"{mass:g} kg")
            ax.plot(ratio, weight / ratio, color=style.COLOURS[k])
        for low, high in RANGES:
            ax.plot([math.sqrt(high / low)] * 2, [low, high], **style.PUBLISHED)
        ax.plot([], [], **style.PUBLISHED, label="section 5.3")
        ax.axhline(100.0, **style.PUBLISHED_LINE)
        ax.text(1.005, 103, "range of the tension sensor", fontsize=7.5)
        ax.set(xlabel="tension ratio n [1]", ylabel="drive-side tension [N]", xlim=(1.0, 1.6), ylim=(0, 165))
        ax.legend(loc="lower left", ncols=3)

    def draw_misprint(figure: Any) -> None:
        ax = figure.subplots()
        size = np.geomspace(0.05, 100.0, 300)  # hole radius over cable radius
        readings = (("ρ = R/r (derived, used)", size), ("ρ = r/R (printed)", 1.0 / size))
        for k, (label, rho) in enumerate(readings):
            y = [tension_ratio(value, TABLE_2.mu, math.pi / 3) for value in rho]
            ax.plot(size, y, color=style.COLOURS[k], linestyle=style.DASHES[k], label=label)
        ax.axvline(1.0, color=style.SOFT, linewidth=0.6)
        ax.text(1.06, 1.61, "from here on the cable fits into the hole", fontsize=7.5)
        ax.axhline(math.exp(TABLE_2.mu * math.pi / 3), **style.PUBLISHED_LINE)
        ax.text(0.055, math.exp(TABLE_2.mu * math.pi / 3) + 0.008, "capstan, $e^{μθ}$", fontsize=7.5)
        low, high = RANGES[1]
        ax.plot([1.5], [math.sqrt(high / low)], **style.PUBLISHED, label="40-62 N (section 5.3)")
        ax.set(
            xscale="log", xlabel="hole radius over cable radius R/r [1]", ylabel="tension ratio n [1]", ylim=(1.0, 1.82)
        )
        ax.legend(loc="upper right")

    return (
        Figure("map", captions[0], style.svg(draw_map, 4.6, 3.1), wide=False),
        Figure("stribeck", captions[1], style.svg(draw_laws, style.PAGE, 2.7)),
        Figure("load", captions[2], style.svg(draw_load, 4.6, 2.9), wide=False),
        Figure("misprint", captions[3], style.svg(draw_misprint, 4.6, 2.9), wide=False),
    )
