"""Figures of the page of real recordings, from findings: loops, free runs, ladders, intervals. Inline SVG."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.drawing.charts import BLUE, GRID, INK, RED, SOFT, key, svg

MEASURED, NAIVE, NAMED = INK, RED, BLUE
POINTS = 700
"""Samples of a curve at most: a figure, no copy of the data."""


def _thin(*series: np.ndarray) -> list[np.ndarray]:
    """Series, all thinned alike to `POINTS`."""
    step = max(-(-len(series[0]) // POINTS), 1)
    return [np.round(np.asarray(s)[::step], 6) for s in series]


def loops(panels: Sequence[Mapping[str, Any]]) -> str:
    """Hysteresis loops: each panel has title, x, measured, nominal, final, and labels xlabel, ylabel."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for ax, p in zip(axes, panels, strict=True):
            x, measured, nominal, final = _thin(p["x"], p["measured"], p["nominal"], p["final"])
            ax.plot(x, nominal, color=NAIVE, linewidth=0.9)
            ax.plot(x, measured, color=MEASURED, linewidth=0.9)
            ax.plot(x, final, color=NAMED, linewidth=1.2)
            ax.set(title=p["title"], xlabel=p["xlabel"], ylabel=p["ylabel"])
        key(figure, (("measured", MEASURED), ("naive simulator", NAIVE), ("with what was named", NAMED)))
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=0.62 / width, right=1 - 0.1 / width, top=1 - 0.55 / height, bottom=0.48 / height, wspace=0.28
        )

    return svg(draw, 4.9 * len(panels), 3.9)


def runs(panels: Sequence[Mapping[str, Any]], shared: bool = False) -> str:
    """Curves over time, one panel below the other; ``from_test``, s, marks where nothing was fitted any more."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(len(panels), 1, squeeze=False, sharex=shared)[:, 0]
        for ax, p in zip(axes, panels, strict=True):
            time, measured, nominal, final = _thin(p["time"], p["measured"], p["nominal"], p["final"])
            ax.plot(time, nominal, color=NAIVE, linewidth=0.9)
            ax.plot(time, measured, color=MEASURED, linewidth=1.6)
            ax.plot(time, final, color=NAMED, linewidth=1.1)
            if p.get("from_test") is not None:
                ax.axvspan(p["from_test"], time[-1], color=GRID, alpha=0.45, linewidth=0)
                ax.text(p["from_test"], 1.0, " held out", transform=ax.get_xaxis_transform(), color=SOFT, fontsize=7.5,
                        va="top")  # fmt: skip
            ax.set(title=p["title"], ylabel=p["ylabel"], xlim=(time[0], time[-1]))
        axes[-1].set_xlabel("time  [s]")
        key(figure, (("measured", MEASURED), ("naive simulator", NAIVE), ("with what was named", NAMED)))
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=0.62 / width, right=1 - 0.1 / width, top=1 - 0.55 / height, bottom=0.48 / height, hspace=0.42
        )

    return svg(draw, 9.8, 0.75 + 1.85 * len(panels))


def bars(rows: Sequence[tuple[str, float, float]], label: str, base: float, marks: Mapping[str, float]) -> str:
    """Horizontal bars (name, held-out error, fit error as a dot) against the naive one; ``marks``: lines, by name."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        names = [name.replace("_", " ") for name, _, _ in rows]
        values = [value for _, value, _ in rows]
        colours = [NAMED if v < 0.98 * base else NAIVE if v > 1.02 * base else "#aeb8bf" for v in values]
        ax.barh(range(len(rows)), values, color=colours, height=0.62)
        ax.plot([fit for _, _, fit in rows], range(len(rows)), "o", color=INK, markersize=3.2)
        ax.axvline(base, color=INK, linewidth=0.9)
        top = max([*values, base]) * 1.04
        for name, value in marks.items():
            ax.axvline(value, color=SOFT, linestyle=(0, (4, 2)), linewidth=0.9)
            ax.text(value, -0.75, f" {name}", color=SOFT, fontsize=7.5, va="center")
        ax.set(xlabel=label, xlim=(0, top), ylim=(len(rows) - 0.4, -1.1))
        ax.set_yticks(range(len(rows)), names)
        ax.grid(axis="y", visible=False)
        width, height = figure.get_size_inches()
        figure.subplots_adjust(left=2.15 / width, right=1 - 0.15 / width, top=1 - 0.05 / height, bottom=0.45 / height)

    return svg(draw, 8.2, 0.75 + 0.24 * len(rows))


def ladder(steps: Sequence[tuple[str, Mapping[str, float], Mapping[str, float]]], panels: Mapping[str, Any]) -> str:
    """Error over the steps, held out and fit: a panel for each channel of ``panels``, channel -> (title, factor)."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        names = [name.split(".")[0].replace("_", " ") or "naive" for name, _, _ in steps]
        for ax, (channel, (title, factor)) in zip(axes, panels.items(), strict=True):
            heldout, fit = [s[2][channel] for s in steps], [s[1][channel] for s in steps]
            for values, colour, marker in ((heldout, NAMED, "o"), (fit, "#aeb8bf", "s")):
                ax.plot([factor * error for error in values], color=colour, marker=marker, markersize=4.5)
            ax.set(title=title, yscale="log")
            ax.set_xticks(range(len(steps)), names, rotation=22, ha="right")
            ax.yaxis.set_major_formatter(lambda v, _: f"{v:g}")
            ax.yaxis.set_minor_formatter(lambda v, _: f"{v:g}" if f"{v:e}"[0] in "25" else "")
            ax.set_xlim(-0.3, len(steps) - 0.7)
        key(figure, (("held out", NAMED), ("fitted", "#8b969e")))
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=0.62 / width, right=1 - 0.12 / width, top=1 - 0.55 / height, bottom=0.95 / height, wspace=0.25
        )

    return svg(draw, 4.9 * len(panels), 3.3)


def intervals(panels: Sequence[Mapping[str, Any]]) -> str:
    """95 % intervals: each panel has title, published, and rows (name, value, low, high)."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for k, (ax, p) in enumerate(zip(axes, panels, strict=True)):
            rows = p["rows"]
            ax.axvline(p["published"], color=NAIVE, linewidth=1.1)
            for i, (_, value, low, high) in enumerate(rows):
                ax.plot([low, high], [i, i], color=NAMED, linewidth=2.0, solid_capstyle="butt")
                ax.plot(value, i, "o", color=NAMED, markersize=4.5)
            ax.set(title=p["title"], ylim=(len(rows) - 0.5, -0.5))
            ax.set_yticks(range(len(rows)), [r[0] for r in rows] if k == 0 else [""] * len(rows))
            ax.xaxis.set_major_locator(_few())
        key(figure, (("95 % interval", NAMED), ("published", NAIVE)))
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=1.75 / width, right=1 - 0.15 / width, top=1 - 0.55 / height, bottom=0.35 / height, wspace=0.12
        )

    return svg(draw, 10.2, 1.9)


def _few() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(3)
