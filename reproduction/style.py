"""One style for all figures of the report: a journal's. Widths in inches as printed; matplotlib is imported lazily."""

from collections.abc import Callable, Mapping
from typing import Any

from cable_envs.drawing import charts

COLUMN, PAGE = 3.4, 7.0
"""widths of a figure in one column and over the page, in"""

INK, SOFT, GRID = charts.INK, charts.SOFT, "#e3e7ea"
COLOURS, DASHES = charts.COLOURS[:9], charts.DASHES
PUBLISHED: Mapping[str, Any] = {
    "linestyle": "", "marker": "o", "markersize": 4.5, "markerfacecolor": "white", "markeredgecolor": INK,
    "markeredgewidth": 1.1, "color": INK, "zorder": 5,
}  # fmt: skip
"""plot(..., **PUBLISHED): how a printed value is marked, in every figure"""
PUBLISHED_LINE: Mapping[str, Any] = {"color": INK, "linestyle": (0, (4, 2)), "linewidth": 0.9, "zorder": 1}
"""axhline(..., **PUBLISHED_LINE): a printed value that is a level"""
MAP = "cividis"
"""colour map; its lightness grows monotonically, so it survives a grey print"""

_RC: dict[Any, Any] = {
    "font.family": "sans-serif", "font.size": 8, "mathtext.fontset": "dejavusans", "svg.fonttype": "none",
    "svg.hashsalt": "reproduction", "axes.edgecolor": INK, "axes.labelcolor": INK, "axes.titlesize": 8,
    "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.linewidth": 0.6, "axes.grid": True,
    "axes.axisbelow": True, "axes.formatter.useoffset": False, "axes.prop_cycle": None, "grid.color": GRID,
    "grid.linewidth": 0.5, "xtick.color": INK, "ytick.color": INK, "xtick.direction": "in", "ytick.direction": "in",
    "xtick.top": True, "ytick.right": True, "xtick.major.size": 3, "ytick.major.size": 3, "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False,
    "legend.fontsize": 7.5, "legend.handlelength": 2.2, "lines.linewidth": 1.2, "savefig.facecolor": "none",
    "figure.facecolor": "none", "axes.facecolor": "none", "image.cmap": MAP, "contour.linewidth": 0.7,
}  # fmt: skip


def svg(draw: Callable[[Any], None], width: float, height: float) -> str:
    """A figure in the style of a journal.

    Parameters
    ----------
    draw : callable
        Draws on the empty `matplotlib.figure.Figure` that it is given; its layout is constrained.
    width, height : float
        As printed, inches; `COLUMN` and `PAGE` are usual widths.

    Returns
    -------
    str
        SVG element, the same for the same drawing (`cable_envs.drawing.charts.svg`).
    """
    from cycler import cycler

    return charts.svg(draw, width, height, {**_RC, "axes.prop_cycle": cycler(color=COLOURS)}, layout="constrained")


def letters(axes: Any) -> None:
    """(a), (b), ... before the titles of ``axes``, as journals do."""
    for letter, ax in zip("abcdefghijkl", axes, strict=False):
        ax.set_title(f"({letter}) {ax.get_title(loc='left')}".rstrip(), loc="left")
