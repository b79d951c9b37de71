"""Figures of a board as inline SVG text, in one style; matplotlib is imported only here, without pyplot's state."""

import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cablebench.board.board import Board, Row, Table
from cablebench.board.compact_svg import compact_svg
from cablebench.board.statistics import performance_profile
from cablebench.run.metrics import PHASES
from cablebench.run.units import axis_label, display

INK, SOFT, GRID = "#1f2933", "#5b6770", "#dfe3e6"
_COLOURS = (
    "#1b6ca8", "#c8553d", "#3a8f5c", "#b8860b", "#7b5ea7", "#0f8b8d", "#a04668", "#6b7f2a", "#8a5a3b", "#4a6fa5",
)  # fmt: skip
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)))

Style = Mapping[str, Mapping[str, Any]]

_RC = {
    "font.family": "sans-serif", "font.size": 8.5, "svg.fonttype": "none", "svg.hashsalt": "cablebench",
    "axes.edgecolor": SOFT, "axes.labelcolor": INK, "axes.titlesize": 9, "axes.titleweight": "bold",
    "axes.titlecolor": INK, "axes.titlelocation": "left", "axes.linewidth": 0.7, "axes.spines.top": False,
    "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True, "grid.color": GRID, "grid.linewidth": 0.6,
    "xtick.color": SOFT, "ytick.color": SOFT, "xtick.major.size": 3, "ytick.major.size": 3, "xtick.minor.size": 0,
    "ytick.minor.size": 0, "legend.frameon": False, "legend.fontsize": 8, "lines.linewidth": 1.4,
    "savefig.facecolor": "none", "figure.facecolor": "none", "axes.facecolor": "none",
    "axes.formatter.useoffset": False, "path.simplify_threshold": 0.25,  # points: what no screen shows of a curve
}  # fmt: skip


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
            again = k // len(_COLOURS)  # the second time round, a colour comes with another marker and dash
            result[name] = {
                "color": _COLOURS[k % len(_COLOURS)],
                "marker": _MARKERS[(k + 3 * again) % len(_MARKERS)],
                "dash": _DASHES[(k // 3 + 2 * again) % len(_DASHES)],
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


def trajectories(
    table: Table, rows: Sequence[Row], found: Sequence[Mapping[str, Mapping[str, np.ndarray]]], style: Style
) -> str:
    """Median and worst episode of each row: reference and output above, cable tensions below."""

    def draw(figure: Any) -> None:
        grid = figure.subplots(4, len(rows), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1.1, 2, 1.1))
        for column, (row, pair) in enumerate(zip(rows, found, strict=True)):
            for top, kind in ((0, "median"), (2, "worst")):
                if kind in pair:
                    _one(grid[top, column], grid[top + 1, column], pair[kind], row.entrant, kind, table, style)
            grid[3, column].set_xlabel("time [s]")
        for top, kind in ((0, "median"), (2, "worst")):
            grid[top, 0].set_ylabel(f"{kind} episode\n{axis_label('output', table)}")
            grid[top + 1, 0].set_ylabel("tension [N]")
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=0.95 / width,
            right=1 - 0.1 / width,
            top=1 - 0.28 / height,
            bottom=0.45 / height,
            hspace=0.14,
            wspace=0.09,
        )
        for ax in grid[:, 0]:
            ax.yaxis.set_label_coords(-0.5 / (grid[0, 0].get_position().width * width), 0.5)

    return svg(draw, 2.55 * len(rows) + 0.7, 6.4, style)


def is_drawn(signal: str) -> bool:
    """Whether `trajectories` draws this signal of an episode, so that a packed board keeps it."""
    return signal in ("time", "reference", "output", "failed") or _is_drawn_tension(signal)


def _is_drawn_tension(signal: str) -> bool:
    return "tension" in signal and signal != "peak_tension" and not signal.startswith("tension_output")


def _one(
    above: Any, below: Any, arrays: Mapping[str, np.ndarray], entrant: str, kind: str, table: Table, style: Style
) -> None:
    scale = display(1.0, "rmse", table)
    above.plot(arrays["time"], arrays["reference"] * scale, color=INK, linewidth=1.0, linestyle=(0, (3, 1.5)))
    above.plot(arrays["time"], arrays["output"] * scale, color=style[entrant]["color"])
    if arrays["failed"]:
        above.plot(arrays["time"][-1], arrays["output"][-1] * scale, "x", color="#a8321f", ms=8, mew=2)
    if kind == "median":
        above.set_title(entrant)
    names = [n for n in arrays if _is_drawn_tension(n)]
    for k, name in enumerate(names):
        below.plot(
            arrays["time"],
            arrays[name],
            color=style[entrant]["color"],
            linewidth=0.9,
            linestyle=_DASHES[k % 4],
            alpha=1.0 if k == 0 else 0.75,
        )


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
            _ticks(ax, "y", log=True)
        axes[0].set_ylabel(axis_label("rmse", table))
        legend_below(figure, axes, gap=0.25)

    return svg(draw, min(2.8 * len(names) + 0.8, 12.0), 3.0, style)


def _plain(value: float, _: int = 0) -> str:
    """Tick labels without powers of ten: 0.05, 2, 45k."""
    return f"{value / 1000:g}k" if abs(value) >= 1e4 else f"{value:g}"


def _ticks(ax: Any, axis: str, log: bool) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    if log:
        getattr(ax, f"set_{axis}scale")("log")
    target = getattr(ax, f"{axis}axis")
    target.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12) if log else MaxNLocator(5))
    target.set_minor_locator(NullLocator())
    target.set_major_formatter(FuncFormatter(_plain))


def _log_if_wide(ax: Any) -> None:
    """A logarithmic axis where the points span more than a factor of five."""
    for axis in ("x", "y"):
        data = np.array([float(np.ravel(getattr(line, f"get_{axis}data")())[0]) for line in ax.lines])
        _ticks(ax, axis, len(data) > 0 and data.min() > 0 and data.max() > 5 * data.min())


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


def svg(draw: Callable[[Any], None], width: float, height: float, style: Style) -> str:
    """The SVG element that ``draw(figure)`` makes, without XML prologue, with ids that no other figure shares.

    What is labelled with an entrant's name carries ``data-entrant``, its ``index`` in ``style``: the page hides by it.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_RC):
        figure = Figure(figsize=(width, height))
        FigureCanvasSVG(figure)
        draw(figure)
        _mark(figure, style)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    # the metadata block names only matplotlib and licence vocabularies
    return scoped(re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL))


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


def scoped(svg: str) -> str:
    """Prefix every id by a hash of the figure: several figures share one HTML page."""
    import hashlib

    prefix = "f" + hashlib.sha256(svg.encode()).hexdigest()[:8]
    svg = re.sub(r'\bid="entrant-(\d+)"', r'data-entrant="\1"', svg)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", svg)
    svg = compact_svg(svg)
    # the page scales figures to its width: drop the fixed size, keep the viewBox
    return re.sub(r'(<svg[^>]*?) width="([\d.]+)pt" height="[\d.]+pt"', r'\1 style="max-width:\2pt"', svg, count=1)
