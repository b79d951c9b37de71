"""Figures of `zou_table4`."""

from typing import Any

import numpy as np

from cable_envs.reproduction import style
from cable_envs.reproduction.registry import Figure
from cable_envs.reproduction.zou.data import ERRORS, PRETENSIONS, TABLE_4
from cable_envs.reproduction.zou.pretension import CHOSEN, MODELS, Fits, Reading, landscape

DRAWN = ("printed", "chain", "bearings", "preload")


def figures(fits: Fits) -> tuple[Figure, ...]:
    """Errors against pretension; misfits and the misfit over the contact's conditions."""
    chain = fits["chain", CHOSEN]
    stiffness, angle = np.linspace(0.2, 1.4, 25), np.linspace(0.2, 2.2, 21)
    ground = landscape(chain.model, CHOSEN, stiffness, angle)

    def draw_errors(figure: Any) -> None:
        axes = figure.subplots(1, 4)
        for j, ax in enumerate(axes):
            for k, name in enumerate(DRAWN):
                f = fits[name, CHOSEN]
                ax.plot(
                    PRETENSIONS,
                    f.errors[:, j],
                    color=style.COLOURS[k],
                    linestyle=style.DASHES[k],
                    marker=".",
                    markersize=3.5,
                    label=f.model.label,
                )
            ax.plot(PRETENSIONS, TABLE_4[:, j], **style.PUBLISHED, label="Table 4")
            ax.set(
                xscale="log",
                xticks=PRETENSIONS,
                xticklabels=["12.5", "50", "150"],
                xlabel="pretension [N]",
                title=ERRORS[j].replace(" error", ""),
                ylim=(0, 1.45 * max(TABLE_4[:, j].max(), fits["chain", CHOSEN].errors[:, j].max())),
            )
            ax.minorticks_off()
        axes[0].set_ylabel("position error [rad]")
        axes[2].set_ylabel("torque error [N m]")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        style.letters(axes)

    def draw_misfit(figure: Any) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
        names = [m.name for m in MODELS]
        for k, reading in enumerate((CHOSEN, Reading("contact", False), Reading("drive", True))):
            values = [100 * fits[n, reading].misfit if (n, reading) in fits else np.nan for n in names]
            left.barh(
                np.arange(len(names)) + 0.26 * (k - 1), values, height=0.24, color=style.COLOURS[k], label=reading.label
            )
        left.set(
            yticks=range(len(names)),
            yticklabels=[m.label for m in MODELS],
            xlabel="misfit of the twelve numbers [%]",
            ylim=(-0.6, len(names) + 1.6),
        )
        left.invert_yaxis()
        left.grid(axis="y", visible=False)
        left.legend(
            title="torque expected from, means over", loc="lower right", bbox_to_anchor=(1.0, 0.0), alignment="left"
        )
        filled = right.contourf(stiffness, angle, 100 * ground, levels=np.arange(20, 101, 10), extend="both")
        right.plot(
            chain.conditions["contact_stiffness"],
            chain.conditions["contact_angle"],
            marker="+",
            color="white",
            markersize=9,
        )
        right.axvline(np.mean(TABLE_4[:, 2] / TABLE_4[:, 0]), color="white", linewidth=0.9, linestyle=(0, (4, 2)))
        right.set(xlabel="contact stiffness k [N m/rad]", ylabel="contact from output angle [rad]")
        right.grid(visible=False)
        figure.colorbar(filled, ax=right, label="misfit [%]")
        style.letters((left, right))

    return (
        Figure(
            "pretension",
            "The twelve numbers of Table 4 (circles) and the models under their best conditions: only models with "
            "slack have the minimum of the position error at 50 N; friction in the bearings changes little.",
            style.svg(draw_errors, style.PAGE, 2.8),
        ),
        Figure(
            "misfit",
            "(a) Misfit of all models; the last four are not the paper's. (b) Chain: misfit over the two free "
            "conditions; cross: best, dashed: the stiffness that the ratio of torque to position error gives, 0.568 "
            "N m/rad.",
            style.svg(draw_misfit, style.PAGE, 3.6),
        ),
    )
