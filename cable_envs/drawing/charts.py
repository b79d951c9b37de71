"""Figures as inline SVG text, in one style, for every page of this project. matplotlib is imported where it is used."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cable_envs.drawing.compact_svg import compact_svg, name_of

INK, SOFT, GRID = "#1f2933", "#5b6770", "#dfe3e6"
COLOURS = (
    "#1b6ca8", "#c8553d", "#3a8f5c", "#b8860b", "#7b5ea7", "#0f8b8d", "#a04668", "#6b7f2a", "#8a5a3b", "#4a6fa5",
)  # fmt: skip
BLUE, RED = COLOURS[:2]
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)))
"""so that curves can be told apart on a black-and-white print"""

SCREEN: Mapping[str, Any] = {
    "font.family": "sans-serif", "font.size": 8.5, "svg.fonttype": "none", "svg.hashsalt": "cablebench",
    "axes.edgecolor": SOFT, "axes.labelcolor": INK, "axes.titlesize": 9, "axes.titleweight": "bold",
    "axes.titlecolor": INK, "axes.titlelocation": "left", "axes.linewidth": 0.7, "axes.spines.top": False,
    "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True, "grid.color": GRID, "grid.linewidth": 0.6,
    "xtick.color": SOFT, "ytick.color": SOFT, "xtick.major.size": 3, "ytick.major.size": 3, "xtick.minor.size": 0,
    "ytick.minor.size": 0, "legend.frameon": False, "legend.fontsize": 8, "lines.linewidth": 1.4,
    "savefig.facecolor": "none", "figure.facecolor": "none", "axes.facecolor": "none",
    "axes.formatter.useoffset": False, "path.simplify_threshold": 0.25,  # points: what no screen shows of a curve
}  # fmt: skip
"""matplotlib's settings for a page: transparent, so that it lies on any background."""


def svg(
    draw: Callable[[Any], None], width: float, height: float, rc: Mapping[Any, Any] = SCREEN, layout: Any = None
) -> str:
    """A figure as an SVG element.

    The same input gives the same text: there is no date in it and its ids come from a hash, so that a committed figure
    changes only when what it shows does.

    Parameters
    ----------
    draw : callable
        Draws on the empty `matplotlib.figure.Figure` that it is given.
    width, height : float
        Size as printed, inches.
    rc : mapping
        matplotlib's settings.
    layout : str, optional
        matplotlib's layout engine; without it the figure places its axes itself.

    Returns
    -------
    str
        The element without XML prologue, with ids that no other figure shares (`scoped`).
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context(dict(rc)):
        figure = Figure(figsize=(width, height), layout=layout)
        FigureCanvasSVG(figure)
        draw(figure)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    # the metadata block names only matplotlib and licence vocabularies
    return scoped(re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL))


def scoped(svg: str) -> str:
    """An SVG element with every id prefixed by a hash of the figure: several figures share one HTML page.

    An id ``entrant-<n>`` becomes the attribute ``data-entrant="<n>"``, by which a page hides what it is drawn for.
    The text is made small (`compact_svg`), and the fixed size becomes a greatest width: the page scales figures.
    """
    prefix = name_of(svg)
    svg = re.sub(r'\bid="entrant-(\d+)"', r'data-entrant="\1"', svg)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", svg)
    svg = compact_svg(svg)
    # the page scales figures to its width: drop the fixed size, keep the viewBox
    return re.sub(r'(<svg[^>]*?) width="([\d.]+)pt" height="[\d.]+pt"', r'\1 style="max-width:\2pt"', svg, count=1)


def legend_below(figure: Any, axes: Sequence[Any], gap: float, head: float = 0.28, foot: float = 0.55) -> None:
    """A legend below the axes; everything is placed in inches, which is much faster than a constrained layout.

    ``gap`` is the space between two panels: for tick labels, and an axis label where every panel has its own; ``head``
    and ``foot`` are the space above the panels and between them and the legend.
    """
    handles: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    width, height = figure.get_size_inches()
    entry = 0.55 + 0.068 * max(map(len, handles), default=0)  # handle and gap; a letter at 8 points
    columns = max(1, min(len(handles), int((width - 0.3) / entry)))
    rows = -(-len(handles) // columns)
    below = foot + 0.2 * rows
    figure.set_size_inches(width, height + max(below - 0.95, 0.0))  # a long legend does not eat the panels
    height = figure.get_size_inches()[1]
    panel = (width - 0.9 - gap * (len(axes) - 1)) / len(axes)
    figure.subplots_adjust(
        left=0.8 / width, right=1 - 0.1 / width, top=1 - head / height, bottom=below / height, wspace=gap / panel
    )
    figure.legend(
        handles.values(), handles.keys(), loc="lower left", bbox_to_anchor=(0.3 / width, 0), ncols=columns,
        handlelength=2.2, columnspacing=1.4, borderaxespad=0,
    )  # fmt: skip


def plain_tick(value: float, _: int = 0) -> str:
    """Tick labels without powers of ten: 0.05, 2, 45k."""
    return f"{value / 1000:g}k" if abs(value) >= 1e4 else f"{value:g}"


def ticks(ax: Any, axis: str, log: bool) -> None:
    """Few, plainly written ticks on the "x" or "y" axis, 1, 2 and 5 in each decade where it is logarithmic."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    if log:
        getattr(ax, f"set_{axis}scale")("log")
    target = getattr(ax, f"{axis}axis")
    target.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12) if log else MaxNLocator(5))
    target.set_minor_locator(NullLocator())
    target.set_major_formatter(FuncFormatter(plain_tick))


def key(figure: Any, names: Sequence[tuple[str, str]]) -> None:
    """Coloured words above the panels instead of a legend box."""
    width, height = figure.get_size_inches()
    at = 0.62
    for text, colour in names:
        figure.text(at / width, 1 - 0.16 / height, text, color=colour, fontsize=8.5, fontweight="bold", va="center")
        at += 0.075 * len(text) + 0.3
