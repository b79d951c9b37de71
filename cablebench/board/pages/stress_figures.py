"""Figures beyond rankings: the radar of robustness over the stress sweeps, and the agents' learning curves."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.drawing.charts import GRID, INK, legend_below
from cablebench.board.learning import Curve
from cablebench.board.pages.figures import Style, svg
from cablebench.board.tables import Board

SHOWN = 7
"""Entrants drawn in a radar; more cannot be told apart. The table beside it has all."""


def robustness(board: Board, task: str) -> dict[str, dict[str, tuple[float, float]]]:
    """{entrant: {sweep: (robustness, lowest score of the swept values)}} of a task, best mean robustness first.

    Robustness is the mean score over the swept values, or in score version 1 the share of them that was survived.
    """
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for s in board.sweeps:
        if s["task"] == task and all(map(math.isfinite, s["score"])):
            found.setdefault(s["entrant"], {})[s["sweep"]] = (s["robustness"], min(s["score"]))
    mean = {name: float(np.mean([m for m, _ in sweeps.values()])) for name, sweeps in found.items()}
    return {name: found[name] for name in sorted(found, key=lambda n: -mean[n])}


def radar(board: Board, task: str, style: Style) -> str:
    """One axis for each sweep: the robustness over it, and the lowest score; empty text below three sweeps.

    Drawn are the papers' controller and the most robust others; open loop and oracle are 0 and 1 by definition.
    """
    values = robustness(board, task)
    sweeps = sorted({sweep for found in values.values() for sweep in found})
    if len(sweeps) < 3:
        return ""
    names = _chosen(board, task, values, sweeps)
    if not names:
        return ""
    angles = np.linspace(0.0, 2 * np.pi, len(sweeps) + 1)

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
        first = "share survived" if board.protocol.score_version else "score, mean over the sweep"
        for k, (ax, title) in enumerate(zip(axes, (first, "score, lowest in the sweep"), strict=True)):
            for name in names:
                s = style[name]
                radii = [max(values[name][sweep][k], 0.0) for sweep in sweeps]
                ax.plot(
                    angles, [*radii, radii[0]], color=s["color"], linestyle=s["dash"], marker=s["marker"], markersize=4,
                    label=name,
                )  # fmt: skip
            ax.set_theta_offset(np.pi / 2)
            ax.set_xticks(angles[:-1], sweeps)
            ax.set_ylim(0.0, max(1.1, ax.get_ylim()[1]))
            ax.set_yticks([0.25, 0.5, 0.75, 1.0], ["", "0.5", "", "1"])
            ax.spines["polar"].set_color(GRID)
            ax.set_title(title, pad=16, loc="center")
            ax.tick_params(axis="x", pad=6, colors=INK)
        legend_below(figure, axes, gap=1.2, head=0.62, foot=0.45)
        figure.subplots_adjust(right=1 - 0.8 / figure.get_figwidth())  # room for the name of the axis on the right

    return svg(draw, 7.8, 3.9, style)


def _chosen(board: Board, task: str, values: Mapping[str, Any], sweeps: Sequence[str]) -> list[str]:
    ends = (board.protocol.open_loop, board.protocol.oracle)
    names = [n for n in values if n not in ends and len(values[n]) == len(sweeps)]
    paper = next((t.paper for t in board.tables if t.task == task), "")
    first = [paper] if paper in names else []
    return [*first, *(n for n in names if n not in first)][:SHOWN]


def learning(curves: Sequence[Curve], task: str, style: Style) -> str:
    """Mean reward per step over environment steps, one line for each training seed; empty text without curves."""
    own = [c for c in curves if c.task == task and c.entrant in style and len(c.steps) > 1]
    if not own:
        return ""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        for c in own:
            s = style[c.entrant]
            ax.plot(
                np.array(c.steps) / 1e6,
                c.rewards,
                color=s["color"],
                linestyle=s["dash"],
                linewidth=1.1,
                label=c.entrant,
            )
        floor = float(np.quantile(np.concatenate([c.rewards for c in own]), 0.02))
        top = max(max(c.rewards) for c in own)
        ax.set_ylim(floor - 0.05 * (top - floor or 1.0), top + 0.05 * (top - floor or 1.0))
        ax.set(xlabel="environment steps [millions]", ylabel="reward per step")
        legend_below(figure, [ax], gap=0.85)

    return svg(draw, 5.6, 3.2, style)
