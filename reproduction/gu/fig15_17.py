"""Figs. 15-17: the swarm's sensitivity to w, c1 and c2, and whether Eq. (27) predicts where it diverges.

The paper varies one constant at a time, five values each, around Table 1 and prints none of the values. Here: from
gentle to beyond the bound of Eq. (27) and beyond the bound of mean-square stability. No edge of the search box, as
Eq. (25) is printed: a box would hide a divergence.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.identification.problem import RatioProblem
from cable_envs.identification.pso import SwarmSettings, growth, stable_as_printed, swarm, typical_growth
from cable_envs.reproduction import style
from cable_envs.reproduction.gu.data import PEAK_SPEED, TABLE_2, problem
from cable_envs.reproduction.registry import Extra, Figure, Progress, Result
from cable_envs.reproduction.rows import Row, curve, missing, statement

SEEDS = 20
TABLE_1 = {"w": 0.4, "c1": 0.6, "c2": 0.8}
VALUES = {"w": (0.2, 0.4, 0.6, 0.8, 1.05), "c1": (0.2, 0.6, 2.4, 3.6, 5.0), "c2": (0.2, 0.8, 2.6, 3.8, 5.0)}
FIGURE = {"w": 15, "c1": 16, "c2": 17}


@dataclass(frozen=True)
class Setting:
    """All seeds with one value of one constant."""

    constant: str
    value: float
    printed_stable: bool
    """Eq. (27)"""
    growth: float
    """factor of the swarm's size in an iteration around fixed best points: root of `pso.growth` of the mean square"""
    typical: float
    """the same for a typical particle (`pso.typical_growth`)"""
    measured: float
    """the same, measured: median over the seeds"""
    best: np.ndarray
    """[seeds, iterations + 1] best cost so far"""
    median: np.ndarray
    """[seeds, iterations + 1] median cost of the particles"""
    iterations: float
    """median until within a factor of two of the last cost"""

    @property
    def diverged(self) -> bool:
        """Measured."""
        return self.measured > 1.0


def reproduce(progress: Progress) -> Result:
    """Three sweeps of five values and twenty seeds on data without noise."""
    data = problem(TABLE_2, PEAK_SPEED, None)
    total = sum(map(len, VALUES.values()))
    settings: list[Setting] = []
    for constant, values in VALUES.items():
        for value in values:
            progress(0.95 * len(settings) / total, f"{constant} = {value:g}, {SEEDS} seeds")
            settings.append(sweep(data, constant, value))
    return Result(
        rows(settings),
        figures(settings),
        tables(settings),
        why=(
            "Eq. (27) is right for w and far too strict for c1 and c2: swarms it forbids converge, and better than "
            "Table 1's, which collapse too early. What predicts divergence is the growth of a typical particle."
        ),
    )


def sweep(data: RatioProblem, constant: str, value: float) -> Setting:
    """All seeds of the particle swarm with one constant at one value.

    Parameters
    ----------
    data : RatioProblem
        What is identified.
    constant : str
        Of the swarm, as in Table 1; the others stay as printed.
    value : float
        Of that constant.

    Returns
    -------
    Setting
    """
    chosen: dict[str, Any] = {**TABLE_1, constant: value}
    fits = [swarm(data, np.random.default_rng((15, k)), SwarmSettings(**chosen, edge="open")) for k in range(SEEDS)]
    length = 1 + SwarmSettings().iterations
    curves = {name: np.array([_padded(fit.details[name], length) for fit in fits]) for name in ("best", "median")}
    settled = np.argmax(curves["best"] <= 2.0 * curves["best"][:, -1:], axis=1)
    return Setting(
        constant,
        value,
        stable_as_printed(**chosen),
        float(np.sqrt(growth(**chosen)[1])),
        typical_growth(**chosen, rng=np.random.default_rng(27)),
        float(np.median([growth_of(fit.details["spread"]) for fit in fits])),
        curves["best"],
        curves["median"],
        float(np.median(settled)),
    )


def _padded(curve: np.ndarray, length: int) -> np.ndarray:
    """A run that ended because the swarm had collapsed keeps its last cost."""
    return np.concatenate([curve, np.full(length - len(curve), curve[-1])])


def growth_of(spread: np.ndarray) -> float:
    """Growth of a swarm: by what factor its spread changes in an iteration.

    Parameters
    ----------
    spread : ndarray [iterations]
        Of the particles.

    Returns
    -------
    float
        After the first fifth of a run, until the swarm collapses or leaves all bounds.
    """
    inside = np.flatnonzero((spread > 1e-11) & (spread < 1e6))
    first, last = inside[-1] // 5, inside[-1]
    return float((spread[last] / spread[first]) ** (1.0 / max(last - first, 1)))


def rows(settings: Sequence[Setting]) -> list[Row]:
    """The statements of section 5.2 about Figs. 15-17, and Eq. (27)."""
    ratio = {name: _extremes(settings, name) for name in VALUES}
    text = {name: f"best/worst median cost {r[0]:.1e} / {r[1]:.1e}" for name, r in ratio.items()}
    share = {name: r[1] / max(r[0], 1e-300) for name, r in ratio.items()}
    wrong = [s for s in settings if s.printed_stable == s.diverged]
    moments = [s for s in settings if (s.growth < 1.0) == s.diverged]
    typical = [s for s in settings if (s.typical < 1.0) == s.diverged]
    table_1 = next(s for s in settings if s.constant == "w" and s.value == TABLE_1["w"])
    listed = ", ".join(f"{s.constant} = {s.value:g}" for s in wrong) or "none"
    shrink = float(np.sqrt(growth(**TABLE_1)[1]))
    unstable = [s for s in wrong if not s.printed_stable]
    return [
        statement(
            "Fig. 15: sensitivity to w",
            "not sensitive",
            text["w"],
            share["w"] < 2,
            how=f"Final costs differ by a factor of {share['w']:.0f} among the values that converge, as the swarm "
            "keeps searching with w near 0.8.",
        ),
        statement(
            "Fig. 16: sensitivity to c1",
            "highly sensitive, differences above 50 %",
            text["c1"],
            share["c1"] > 1.5,
            chosen="The five values of c1 are not printed and were chosen.",
            how=f"Final costs differ by a factor of {share['c1']:.1f} among the values that converge.",
        ),
        statement(
            "Fig. 17: sensitivity to c2",
            "not highly sensitive",
            text["c2"],
            share["c2"] < 2,
            how=f"Final costs differ by a factor of {share['c2']:.0e} among the values that converge. The same "
            "attraction enters with c1 and c2.",
        ),
        curve(
            "Fig. 15: iterations to converge, w = 0.4",
            600,
            table_1.iterations,
            "1",
            reason="The count and Table 1 exclude each other: Eq. (25) with its constants contracts the swarm by a "
            f"factor of {shrink:.2f} in every iteration (see gu-table2).",
            how="Median over the seeds until within a factor of two of the last cost.",
        ),
        statement(
            "Eq. (27) bounds the stable constants",
            "mean-square convergence",
            f"wrong for {len(wrong)} of {len(settings)}: {listed}",
            not wrong,
            reason=f"Of these, {len(unstable)} are called unstable and converge. Eq. (26) turns the iteration into a "
            "differential equation, which moves the bound: the second moments of Eq. (25) itself are wrong for "
            f"{len(moments)}, the growth of a typical particle for {len(typical)}.",
        ),
        missing(
            "values of w, c1, c2",
            None,
            "; ".join(f"{k}: {', '.join(f'{v:g}' for v in vs)}" for k, vs in VALUES.items()),
            "1",
            "There are five each, and none is printed: c1 = 0.6 is named twice with different results.",
        ),
    ]


def _extremes(settings: Sequence[Setting], name: str) -> tuple[float, float]:
    """(smallest, largest) median final cost among the values that converge."""
    finals = [float(np.median(s.best[:, -1])) for s in settings if s.constant == name and not s.diverged]
    return min(finals), max(finals)


def tables(settings: Sequence[Setting]) -> list[Extra]:
    """Every setting."""
    lines = [
        (
            s.constant,
            f"{s.value:g}",
            "stable" if s.printed_stable else "unstable",
            s.growth,
            s.typical,
            s.measured,
            "diverges" if s.diverged else "converges",
            float(np.median(s.best[:, -1])),
            int(np.sum(s.best[:, -1] < 1e-6)),
            s.iterations,
        )
        for s in settings
    ]
    columns = (
        "constant",
        "value",
        "Eq. (27)",
        "growth, mean square",
        "growth, typical",
        "growth, measured",
        "swarm",
        "final cost, median",
        "below 1e-6",
        "iterations",
    )
    note = (
        f"{SEEDS} seeds, 40 particles, 1000 iterations, the other constants as in Table 1. Growth: factor of the "
        "swarm's size in an iteration. Mean square and typical: around best points that do not move. The best cost "
        "of a diverging swarm is what it met before."
    )
    return [Extra("All settings", columns, lines, note)]


def figures(settings: Sequence[Setting]) -> list[Figure]:
    """Cost against iteration for each constant; the stability map."""

    def draw_costs(figure: Any) -> None:
        axes = figure.subplots(2, 3, sharex=True, sharey="row")
        for column, name in enumerate(VALUES):
            for k, s in enumerate(s for s in settings if s.constant == name):
                dash = (0, (1, 1)) if s.diverged else "-"
                shown = np.unique(np.geomspace(1, s.best.shape[1], 160).astype(int))
                for row, curves in enumerate((s.best, s.median)):
                    axes[row, column].plot(
                        shown,
                        np.median(curves, axis=0)[shown - 1],
                        color=style.COLOURS[k],
                        linestyle=dash,
                        label=f"{s.value:g}",
                    )
            axes[0, column].set(title=f"Fig. {FIGURE[name]}: {_symbol(name)}", xscale="log", yscale="log")
            axes[0, column].axhline(1e-6, **style.PUBLISHED_LINE)
            axes[1, column].set(yscale="log", xlabel="iteration [1]", ylim=(1e-11, 1e4))
            axes[0, column].legend(title=_symbol(name), fontsize=7.5, title_fontsize=7.5, loc="lower left")
        axes[0, 0].set_ylabel("best cost so far g [1]")
        axes[1, 0].set_ylabel("median cost of the particles [1]")

    def draw_stability(figure: Any) -> None:
        axes = figure.subplots(1, 3, sharey=True)
        for ax, name in zip(axes, VALUES, strict=True):
            grid = np.linspace(min(VALUES[name]) * 0.5, max(VALUES[name]) * 1.05, 200)
            curve = [np.sqrt(growth(**{**TABLE_1, name: v})[1]) for v in grid]
            printed = [v for v in grid if not stable_as_printed(**{**TABLE_1, name: v})]
            ax.plot(grid, curve, color=style.COLOURS[0], label="theory, mean square")
            coarse = grid[::10]
            path = [typical_growth(**{**TABLE_1, name: v}, rng=np.random.default_rng(27), steps=4000) for v in coarse]
            ax.plot(coarse, path, color=style.COLOURS[2], linestyle=style.DASHES[1], label="theory, typical")
            if printed:
                ax.axvspan(printed[0], grid[-1], color=style.GRID, zorder=0, label="unstable by Eq. (27)")
            of = [s for s in settings if s.constant == name]
            ax.plot(
                [s.value for s in of],
                [s.measured for s in of],
                "s",
                color=style.COLOURS[1],
                markersize=4,
                label="measured",
            )
            ax.axhline(1.0, color=style.INK, linewidth=0.7)
            ax.set(xlabel=f"{_symbol(name)} [1]", xlim=(grid[0], grid[-1]))
        axes[0].set_ylabel("growth of the swarm per iteration [1]")
        axes[0].legend(loc="upper left", fontsize=7.5)
        style.letters(axes)

    return [
        Figure(
            "costs",
            "Medians over 20 seeds, data without noise; dotted: the swarm diverges. Long dashes: the reported final "
            "cost. Upper row: best cost so far, which no divergence can raise. Lower row: median cost of the "
            "particles, which may oscillate as the paper describes.",
            style.svg(draw_costs, style.PAGE, 4.2),
        ),
        Figure(
            "stability",
            "Factor by which the swarm's size changes in an iteration: above 1 it diverges. Shaded: unstable by Eq. "
            "(27).",
            style.svg(draw_stability, style.PAGE, 2.5),
        ),
    ]


def _symbol(name: str) -> str:
    return {"w": "w", "c1": "c₁", "c2": "c₂"}[name]
