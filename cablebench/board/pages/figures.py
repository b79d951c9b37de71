"""Figures of a board as inline SVG text: performance profiles, accuracy against effort, phases, sweeps."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.drawing import charts
from cable_envs.drawing.charts import COLOURS, DASHES, GRID, INK, MARKERS, legend_below, ticks
from cablebench.board.tables import Board, Table
from cablebench.protocol.metrics import PHASES
from cablebench.protocol.units import axis_label, display
from cablebench.score.statistics import performance_profile

Style = Mapping[str, Mapping[str, Any]]


def styles(board: Board) -> Style:
    """Colour, marker and dash of every entrant, the same in every figure; the two ends of the score scale are grey."""
    result, k = {}, 0
    for name in board.entrants:
        if name in (board.protocol.open_loop, board.protocol.oracle):
            oracle = name == board.protocol.oracle
            result[name] = {
                "color": INK if oracle else "#9aa5ad",
                "marker": "*" if oracle else "x",
                "dash": (0, (1.2, 1.2)) if oracle else (0, (4, 2)),
            }
        else:
            again = k // len(COLOURS)  # the second time round, a colour comes with another marker and dash
            result[name] = {
                "color": COLOURS[k % len(COLOURS)],
                "marker": MARKERS[(k + 3 * again) % len(MARKERS)],
                "dash": DASHES[(k // 3 + 2 * again) % len(DASHES)],
            }
            k += 1
    return {name: {**style, "index": i} for i, (name, style) in enumerate(result.items())}


def profile(tables: Sequence[Table], style: Style) -> str:
    """Performance profile: share of episodes that reach a score, one panel for each table."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(tables), sharey=True, squeeze=False)[0]
        for ax, table in zip(axes, tables, strict=True):
            low = min((min(map(min, runs)) for r in table.rows if r.score for runs in r.scores.values()), default=0.0)
            thresholds = np.linspace(min(low, 0.0) - 0.05, 1.25, 400)
            for row in table.rows:
                if row.score is None:
                    continue
                values = np.concatenate([np.ravel(s) for s in row.scores.values()])
                share = 100 * performance_profile(values, thresholds)
                s = style[row.entrant]
                ax.step(thresholds, share, where="post", color=s["color"], linestyle=s["dash"], label=row.entrant)
            ax.set(title=f"{table.track} track", xlabel="score τ", ylim=(0, 103), xlim=(thresholds[0], thresholds[-1]))
        axes[0].set_ylabel("episodes with score ≥ τ  [%]")
        legend_below(figure, axes, gap=0.25)

    return svg(draw, min(3.7 * len(tables) + 0.6, 10.5), 3.2, style)


def effort(tables: Sequence[Table], style: Style) -> str:
    """Accuracy against effort: median RMSE over the median integral of u², one panel for each table."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(tables), squeeze=False)[0]
        for ax, table in zip(axes, tables, strict=True):
            for row in table.rows:
                x, y = (display(row.raw[m], m, table) for m in ("effort", "rmse"))
                if math.isfinite(x) and math.isfinite(y):
                    s = style[row.entrant]
                    ax.plot(
                        x,
                        y,
                        linestyle="",
                        marker=s["marker"],
                        color=s["color"],
                        markersize=7,
                        label=row.entrant,
                        markeredgewidth=1.6 if s["marker"] == "x" else 0.6,
                    )
            _log_if_wide(ax)
            ax.margins(0.15)
            ax.set(title=f"{table.track} track", xlabel=axis_label("effort", table), ylabel=axis_label("rmse", table))
        legend_below(figure, axes, gap=0.85)

    return svg(draw, min(3.7 * len(tables) + 0.6, 10.5), 3.2, style)


def phases(tables: Sequence[Table], style: Style) -> str:
    """RMSE in each phase of the circuit, one panel for each table; empty text where no phase was reported."""
    if all(math.isnan(r.raw.get(f"rmse_{p}", math.nan)) for t in tables for r in t.rows for p in PHASES):
        return ""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(tables), squeeze=False)[0]
        for ax, table in zip(axes, tables, strict=True):
            for k, row in enumerate(table.rows):
                s, shift = style[row.entrant], (k - (len(table.rows) - 1) / 2) * 0.78 / max(len(table.rows), 1)
                y = [display(row.raw[f"rmse_{p}"], "rmse", table) for p in PHASES]
                ax.plot(
                    np.arange(len(PHASES)) + shift,
                    y,
                    linestyle="",
                    marker=s["marker"],
                    color=s["color"],
                    label=row.entrant,
                    markersize=6,
                )
            for edge in (0.5, 1.5):
                ax.axvline(edge, color=GRID, linewidth=0.8)
            ax.grid(visible=False, axis="x")
            ax.set_xticks(range(len(PHASES)), list(PHASES))
            ax.set(title=f"{table.track} track", ylabel=axis_label("rmse", table), xlim=(-0.5, len(PHASES) - 0.5))
            ax.set_ylim(bottom=0)
        legend_below(figure, axes, gap=0.85)

    return svg(draw, min(3.7 * len(tables) + 0.6, 10.5), 3.0, style)


def sweeps(board: Board, task: str, style: Style) -> str:
    """Median RMSE against each swept quantity of a stress track; empty text where none was run."""
    lines = [s for s in board.sweeps if s["task"] == task]
    if not lines:
        return ""
    table = next(t for t in board.tables if t.task == task)
    names = sorted({s["sweep"] for s in lines})

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for ax, name in zip(axes, names, strict=True):
            for line in (s for s in lines if s["sweep"] == name):
                s = style[line["entrant"]]
                y = display(np.array(line["rmse"], float), "rmse", table)
                ax.plot(line["values"], y, color=s["color"], linestyle=s["dash"], label=line["entrant"])
            unit = next(s["unit"] for s in lines if s["sweep"] == name)
            ax.set(title=name, xlabel="factor on nominal" if unit == "1" else f"[{unit}]")
            ticks(ax, "y", log=True)
        axes[0].set_ylabel(axis_label("rmse", table))
        legend_below(figure, axes, gap=0.25)

    return svg(draw, min(2.8 * len(names) + 0.8, 12.0), 3.0, style)


def _log_if_wide(ax: Any) -> None:
    """A logarithmic axis where the points span more than a factor of five."""
    for axis in ("x", "y"):
        data = np.array([float(np.ravel(getattr(line, f"get_{axis}data")())[0]) for line in ax.lines])
        ticks(ax, axis, len(data) > 0 and data.min() > 0 and data.max() > 5 * data.min())


def svg(draw: Callable[[Any], None], width: float, height: float, style: Style) -> str:
    """As `cable_envs.drawing.charts.svg`; what is labelled with an entrant's name can be hidden by the page.

    It carries ``data-entrant``, the entrant's ``index`` in ``style``.
    """

    def marked(figure: Any) -> None:
        draw(figure)
        _mark(figure, style)

    return charts.svg(marked, width, height)


def _mark(figure: Any, style: Style) -> None:
    """Give every artist labelled with an entrant's name that entrant's index as id."""
    for artist in (a for ax in figure.axes for a in (*ax.lines, *ax.collections)):
        if artist.get_label() in style:
            artist.set_gid(f"entrant-{style[artist.get_label()]['index']}")
    for legend in figure.legends:
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if text.get_text() in style:
                for artist in (handle, text):
                    artist.set_gid(f"entrant-{style[text.get_text()]['index']}")
