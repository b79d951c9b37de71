"""Figures and tables of the da Vinci jaw, from the record that `diagnosis.real.davinci_study.study` makes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.drawing.charts import key, svg
from cablebench.pages import recordings_figures as draw

MODELS = ("rigid", "physics", "neighbours", "net", "published")
"""Columns of the comparison, where a split has them."""


def figures_of(found: Mapping[str, Any]) -> dict[str, str]:
    """The jaw's figures; those whose numbers are not there are left out."""
    figures = {}
    steps = [
        (row["effect"], _errors(row, "fit"), _errors(row, "heldout")) for row in found.get("ladder", ())
    ]  # fmt: skip
    if steps:
        figures["ladder"] = draw.ladder(
            steps, {"deg": ("Error of the jaw's angle  [deg]", 1.0), "mnm": ("Error of the jaw's torque  [mN m]", 1.0)}
        )
    record = found.get("figures", {}).get("record")
    if record:
        figures["record"] = _record(record)
        figures["loop"] = _loops(record)
    rows = found.get("compare", ())
    if rows:
        figures["compare"] = _compared(rows)
    return figures


def _errors(row: Mapping[str, Any], use: str) -> dict[str, float]:
    return {"deg": row[f"{use}_deg"], "mnm": row[f"{use}_mnm"]}


def _record(record: Mapping[str, Any]) -> str:
    time = np.asarray(record["time"])
    panels = [
        {
            "title": title, "ylabel": label, "time": time,
            **{k: np.asarray(record[n]) for k, n in zip(("measured", "nominal", "final"), names, strict=True)},
        }
        for title, label, names in (
            (f"Jaw angle, {record['name']}", "angle  [deg]",
             ("output_angle_deg", "naive_angle_deg", "augmented_angle_deg")),
            ("Jaw torque", "torque  [mN m]", ("output_torque_mnm", "naive_torque_mnm", "augmented_torque_mnm")),
        )
    ]  # fmt: skip
    return draw.runs(panels, shared=True)


def _loops(record: Mapping[str, Any]) -> str:
    drive = np.asarray(record["drive_angle_deg"])
    measured, naive, final = (
        np.asarray(record[n]) for n in ("output_angle_deg", "naive_angle_deg", "augmented_angle_deg")
    )
    line = np.polyval(np.polyfit(drive, measured, 1), drive)
    torque = [np.asarray(record[n]) for n in ("output_torque_mnm", "naive_torque_mnm", "augmented_torque_mnm")]
    return draw.loops([
        {"title": "Jaw angle less a straight line", "xlabel": "drive angle  [deg]", "ylabel": "angle  [deg]",
         "x": drive, "measured": measured - line, "nominal": naive - line, "final": final - line},
        {"title": "Jaw torque over drive torque", "xlabel": "drive torque  [mN m]", "ylabel": "torque  [mN m]",
         "x": np.asarray(record["drive_torque_mnm"]), "measured": torque[0], "nominal": torque[1], "final": torque[2]},
    ])  # fmt: skip


def _compared(rows: Sequence[Mapping[str, Any]]) -> str:
    """Angle and torque error of every model on every split, with the aims."""
    splits = list(dict.fromkeys(r["split"] for r in rows))
    present = [m for m in MODELS if any(r["model"] == m for r in rows)]
    colours = dict(zip(MODELS, ("#aeb8bf", draw.NAMED, "#b8860b", "#3a8f5c", draw.NAIVE), strict=True))

    def plot(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharey=True)
        for ax, name, label in ((axes[0], "deg", "angle error  [deg]"), (axes[1], "mnm", "torque error  [mN m]")):
            for i, split in enumerate(splits):
                own = [r for r in rows if r["split"] == split]
                for r in own:
                    if r.get(name) is not None:
                        ax.plot(r[name], i, "o", color=colours[r["model"]], markersize=6, alpha=0.9)
                aim = next((r[f"aim_{name}"] for r in own if r.get(f"aim_{name}") is not None), None)
                if aim is not None:
                    ax.plot(aim, i, "|", color=draw.MEASURED, markersize=15, markeredgewidth=1.6)
            ax.set(xscale="log", xlabel=label, ylim=(len(splits) - 0.5, -0.5))
            ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
            ax.xaxis.set_minor_formatter(lambda v, _: f"{v:g}" if f"{v:e}"[0] in "25" else "")
        axes[0].set_yticks(range(len(splits)), splits)
        key(figure, [*((m, colours[m]) for m in present), ("| aim", draw.MEASURED)])
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=2.75 / width, right=1 - 0.15 / width, top=1 - 0.35 / height, bottom=0.48 / height, wspace=0.08
        )

    return svg(plot, 10.2, 0.95 + 0.36 * len(splits))
