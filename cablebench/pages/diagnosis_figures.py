"""Figures of a diagnosis as inline SVG.

Over time, along coordinates, errors against the noise, maps of what is left, spectra. ``traces`` are
`cable_envs.diagnosis.model.verdict.Trace`, read by their fields only.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cable_envs.drawing.charts import BLUE, INK, RED, SOFT, svg
from cablebench.pages.diagnosis_words import plain

SHADE = "#f3d9b1"
_SHOWN = {
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
    "rad": ("deg", 57.29577951308232),
    "rad/s": ("deg/s", 57.29577951308232),
}
_POINTS, _BINS, _PANELS = 1200, 24, 6


def scale(unit: str) -> tuple[str, float]:
    """(unit for people, factor)."""
    return _SHOWN.get(unit, (unit, 1.0))


def over_time(trace: Any, named: bool) -> str:
    """Recording against simulation, and below it what the refit and the answer leave; the mismatch is shaded."""
    unit, factor = scale(trace.unit)
    time, keep = _thinned(trace)

    def draw(figure: Any) -> None:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.25))
        for ax in (top, bottom):
            for a, b in trace.shaded:
                ax.axvspan(a, b, color=SHADE, alpha=0.6, linewidth=0)
        top.plot(time, factor * trace.measured[keep], color=INK, linewidth=1.0, label="recorded")
        top.plot(time, factor * trace.refit[keep], color=RED, linewidth=0.8, linestyle=(0, (4, 2)), label="refitted")
        top.set_ylabel(f"{plain(trace.channel)} [{unit}]")
        left = np.where(trace.good, trace.measured - trace.refit, np.nan)[keep]
        bottom.plot(time, factor * left, color=RED, linewidth=0.6, label="refitted")
        if named:
            after = np.where(trace.good, trace.measured - trace.augmented, np.nan)[keep]
            bottom.plot(time, factor * after, color=BLUE, linewidth=0.6, label="with the answer")
        for side in (-2.0, 2.0):
            bottom.axhline(side * factor * trace.noise, color=SOFT, linewidth=0.7, linestyle=(0, (2, 2)))
        bottom.set(
            xlabel="time of the recording [s]", ylabel=f"recorded less\nsimulated [{unit}]", xlim=(time[0], time[-1])
        )
        for ax in (top, bottom):
            ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
        figure.subplots_adjust(left=0.085, right=0.99, top=0.92, bottom=0.12, hspace=0.3)

    return svg(draw, 9.6, 4.2)


def _thinned(trace: Any) -> tuple[np.ndarray, np.ndarray]:
    """(times, samples): of each span the samples that lie lowest and highest, so that peaks stay."""
    count = len(trace.time)
    if count <= _POINTS:
        return trace.time, np.arange(count)
    left = trace.measured - trace.refit
    edges = np.linspace(0, count, _POINTS // 2 + 1).astype(int)
    keep = [a + f(left[a:b]) for a, b in pairwise(edges) for f in (np.argmin, np.argmax)]
    order = np.unique(keep)
    return trace.time[order], order


def along(traces: Sequence[Any], place: Mapping[str, Any] | None, named: bool) -> str:
    """Mean of what is left in one channel along every coordinate, +- 2 standard errors; the regime is shaded."""
    names = ["elapsed time", *(n for n in traces[0].along if n not in ("direction", "size of speed"))][:_PANELS]
    if place is not None and place["regime"] == "size of speed":
        names = ["size of speed" if n == "speed" else n for n in names]
    unit, factor = scale(traces[0].unit)

    def draw(figure: Any) -> None:
        rows = -(-len(names) // 3)
        axes = figure.subplots(rows, 3, sharey=True, squeeze=False).ravel()
        for ax, name in zip(axes, names, strict=False):
            _panel(ax, traces, name, place, factor, named)
        for k, ax in enumerate(axes):
            if k >= len(names):
                ax.set_visible(False)
            elif k % 3 == 0:
                ax.set_ylabel(f"mean residual [{unit}]")
        axes[0].legend(loc="lower left", bbox_to_anchor=(-0.2, 1.0), ncols=2, borderaxespad=0.1, columnspacing=1.2)
        height = figure.get_size_inches()[1]
        figure.subplots_adjust(
            left=0.1, right=0.99, top=1 - 0.3 / height, bottom=0.5 / height, hspace=0.45, wspace=0.08
        )

    return svg(draw, 9.6, 0.6 + 1.75 * -(-len(names) // 3))


def _panel(
    ax: Any, traces: Sequence[Any], name: str, place: Mapping[str, Any] | None, factor: float, named: bool
) -> None:
    values, unit = _coordinate(traces, name)
    shown, by = scale(unit)
    good = np.concatenate([t.good for t in traces])
    if place is not None and place["regime"] == name and place["range"]:
        ax.axvspan(by * place["range"][0], by * place["range"][1], color=SHADE, alpha=0.6, linewidth=0)
    elif place is not None and place["regime"] == "direction" and name == "speed" and place["range"]:
        forward = place["range"][0] > 0.0
        low, high = (0.0, values.max()) if forward else (values.min(), 0.0)
        ax.axvspan(by * low, by * high, color=SHADE, alpha=0.6, linewidth=0)
    series = [("refitted", RED, np.concatenate([t.measured - t.refit for t in traces]))]
    if named:
        series.append(("with the answer", BLUE, np.concatenate([t.measured - t.augmented for t in traces])))
    edges = np.unique(np.quantile(values[good], np.linspace(0.0, 1.0, _BINS + 1)))
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(len(edges) - 2, 0))
    for label, colour, left in series:
        at, mean, error = [], [], []
        for k in range(len(edges) - 1):
            own = good & (bins == k)
            if own.sum() > 3:
                at.append(by * values[own].mean())
                mean.append(factor * left[own].mean())
                error.append(2.0 * factor * left[own].std() / np.sqrt(own.sum()))
        ax.errorbar(
            at, mean, error, color=colour, linewidth=1.0, elinewidth=0.7, marker="o", markersize=2.2, label=label
        )
    ax.axhline(0.0, color=SOFT, linewidth=0.7)
    ax.set_xlabel(f"{name} [{shown}]" if shown not in ("", "1") else name)


def _coordinate(traces: Sequence[Any], name: str) -> tuple[np.ndarray, str]:
    if name == "elapsed time":
        return np.concatenate([t.time - t.time[0] for t in traces]), "s"
    return np.concatenate([t.along[name][1] for t in traces]), traces[0].along[name][0]


def errors(fit: Mapping[str, Any], named: bool) -> str:
    """RMS on the records that no fit has seen over the noise, by channel: claimed, refitted, with the answer."""
    channels = list(fit)
    kinds = [("nominal", "o", SOFT, "claimed parameters"), ("refit", "s", RED, "refitted")]
    kinds += [("augmented", "D", BLUE, "with the answer")] if named else []

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        for key, marker, colour, label in kinds:
            ratios = [fit[c]["heldout_rmse"][key] / max(fit[c]["noise_floor"], 1e-300) for c in channels]
            ax.plot(ratios, range(len(channels)), marker, color=colour, markersize=6, label=label)
        ax.axvline(1.0, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="noise")
        ax.set_yticks(range(len(channels)), [plain(c) for c in channels])
        ax.set(ylim=(len(channels) - 0.5, -0.5), xlabel="RMS on held-out records over the noise", xscale="log")
        ticks = [
            t for t in (0.5, 1, 1.2, 1.5, 2, 3, 5, 10, 20, 50, 100, 1000) if ax.get_xlim()[0] <= t <= ax.get_xlim()[1]
        ]
        ax.set_xticks(ticks, [f"{t:g}" for t in ticks])
        ax.set_xticks([], minor=True)
        ax.legend(loc="lower left", bbox_to_anchor=(-0.18, 1.0), ncols=2, borderaxespad=0.1, columnspacing=1.2)
        height = figure.get_size_inches()[1]
        figure.subplots_adjust(left=0.16, right=0.98, top=1 - 0.52 / height, bottom=0.5 / height)

    return svg(draw, 7.2, 1.2 + 0.34 * len(channels))


def maps(leftover: Sequence[Mapping[str, Any]], fit: Mapping[str, Any]) -> str:
    """Smooth maps of what is left, the smallest p-value first; empty text without any."""
    drawn = [row for row in leftover if row["at"] and row["height"]][:3]
    if not drawn:
        return ""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(drawn), squeeze=False)[0]
        for ax, row in zip(axes, drawn, strict=True):
            unit, factor = scale(fit[row["channel"]]["unit"])
            shown, by = scale(row["unit"])
            at, height, error = (np.asarray(row[k]) for k in ("at", "height", "error"))
            ax.fill_between(
                by * at, factor * (height - 2 * error), factor * (height + 2 * error), color=BLUE, alpha=0.2
            )
            ax.plot(by * at, factor * height, color=BLUE)
            ax.axhline(0.0, color=SOFT, linewidth=0.7)
            ax.set(title=plain(row["channel"]), xlabel=f"{row['coordinate']} [{shown}]", ylabel=f"residual [{unit}]")
        figure.subplots_adjust(left=0.085, right=0.99, top=0.88, bottom=0.2, wspace=0.35)

    return svg(draw, 9.6, 2.5)


def spectra(rows: Sequence[Mapping[str, Any]]) -> str:
    """Power of what is left over that of the noise, and what the answer expects of it; empty text without any."""
    if not rows:
        return ""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(rows), squeeze=False)[0]
        for ax, row in zip(axes, rows, strict=True):
            ax.step(row["at"], row["left"], where="mid", color=RED, linewidth=0.9, label="recorded")
            ax.step(row["at"], row["expected"], where="mid", color=BLUE, linewidth=0.9, label="expected")
            ax.axhline(1.0, color=SOFT, linewidth=0.7, linestyle=(0, (2, 2)))
            ax.set(title=plain(row["channel"]), xlabel="frequency [Hz]", yscale="log", xlim=(0.0, max(row["at"])))
            least, most = min(min(row["left"]), 1.0), max(*row["left"], *row["expected"])
            decades = [f for k in range(-3, 9) for f in (10.0**k,) if least / 2 < f < 2 * most]
            ax.set_yticks(decades, [f"{f:g}" for f in decades])
            ax.set_yticks([], minor=True)
        axes[0].set_ylabel("power over that of the noise")
        axes[0].legend(loc="upper left")
        figure.subplots_adjust(left=0.085, right=0.99, top=0.9, bottom=0.18, wspace=0.25)

    return svg(draw, 9.6, 2.7)
