"""Figures of `gu_table2`."""

from typing import Any

import numpy as np

from cable_envs.identification.information import profile_interval
from cable_envs.identification.least_squares import refine
from cable_envs.reproduction import style

_COLOUR = {"pso": style.COLOURS[1], "lsq": style.COLOURS[0], "cma": style.COLOURS[2]}
_LABEL = {"pso": "swarm", "lsq": "least squares", "cma": "CMA-ES"}


def convergence(slow: Any, clean: Any) -> str:
    """Best cost over evaluations of all runs."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharex=True)
        for ax, runs, title in zip(axes, (clean, slow), ("without noise", "0.1 N of noise"), strict=True):
            for method, fits in runs.fits.items():
                for k, fit in enumerate(fits):
                    ax.plot(
                        *fit.history,
                        color=_COLOUR[method],
                        linewidth=0.6,
                        alpha=0.7,
                        label=_LABEL[method] if not k else None,
                    )
                    ax.plot(*fit.history[:, -1], marker=".", markersize=3, color=_COLOUR[method])
            ax.axhline(1e-6, **style.PUBLISHED_LINE, label="reported")
            ax.set(xscale="log", yscale="log", xlabel="runs of the model over 75 points [1]", title=title)
        axes[0].set_ylabel("cost g, Eq. (23) [1]")
        axes[1].legend()
        style.letters(axes)

    return style.svg(draw, style.PAGE, 2.8)


def valley(slow: Any) -> str:
    """Cost over K and omega; profiles of delta for three values of rho0."""
    gains, exponents, rise = _around_the_valley(slow)
    best = slow.best.parameters

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        lines = left.contour(gains, exponents, rise, levels=[6.0, 100.0, 1000.0], colors=style.SOFT, linewidths=0.8)
        left.contourf(gains, exponents, rise, levels=[0.0, 6.0], colors=[style.GRID])
        left.clabel(lines, fmt="%g", fontsize=7.5)
        for k, fit in enumerate(slow.fits["pso"]):
            left.plot(
                fit.parameters["K"],
                fit.parameters["omega"],
                marker="o",
                markersize=3.5,
                linestyle="",
                color=_COLOUR["pso"],
                markeredgecolor="white",
                markeredgewidth=0.4,
                label=None if k else "20 swarms",
            )
        for k, fit in enumerate(slow.fits["lsq"]):
            left.plot(
                fit.parameters["K"],
                fit.parameters["omega"],
                marker="x",
                markersize=6,
                linestyle="",
                color=style.INK,
                label=None if k else "20 x least squares",
            )
        left.plot(slow.cable.K, slow.cable.omega, **style.PUBLISHED, label="Table 2")
        left.set(xscale="log", xlabel="gain K [SI]", ylabel="exponent ω [1]", xlim=(1500, 20000), ylim=(1.75, 2.32))
        left.set_xticks([2000, 5000, 10000, 20000], ["2000", "5000", "10 000", "20 000"], minor=False)
        left.minorticks_off()
        left.legend(loc="lower right")
        left.grid(visible=False)
        for k, rho0 in enumerate((1.485, 1.5, 1.515)):
            shifted = slow.data.changed(fixed={"rho0": rho0}, bounds={"delta": (-0.1, 0.1)})
            curve = profile_interval(shifted, {**best, "rho0": rho0}, "delta", 0.99).curve
            smooth = np.linspace(curve[0, 0], curve[0, -1], 80)
            fitted = np.polynomial.Polynomial.fit(curve[0], curve[1], min(4, curve.shape[1] - 1))
            right.plot(
                smooth, fitted(smooth), color=style.COLOURS[k], linestyle=style.DASHES[k], label=f"ρ₀ = {rho0:g}"
            )
        right.axhline(3.84, color=style.SOFT, linewidth=0.7)
        right.text(0.98, 4.0, "95 %", ha="right", fontsize=7.5, color=style.SOFT, transform=right.get_yaxis_transform())
        right.plot(slow.cable.delta, 0.0, **style.PUBLISHED, label="Table 2", clip_on=False)
        right.set(xlabel="δ [1]", ylabel="chi-square above the optimum [1]", ylim=(0, 8.5))
        right.legend(ncols=2, loc="upper center")
        style.letters((left, right))

    return style.svg(draw, style.PAGE, 3.1)


def _around_the_valley(slow: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K, omega, chi-square above the optimum with delta and mu refitted), each [33, 21], along the valley."""
    data = slow.data.changed(weighted=True, log_gain=True)
    best = slow.best.parameters
    floor = 2.0 * refine(data, data.unit(best)).cost
    gains = np.geomspace(1500, 20000, 33)
    offsets = 0.1 * np.sinh(np.linspace(-3, 3, 21)) / np.sinh(3)  # dense in the valley
    exponents, rise = np.empty((33, 21)), np.empty((33, 21))
    for i, gain in enumerate(gains):
        along = data.changed(fixed={**data.fixed, "K": gain})
        bottom = along.named(refine(along, along.unit(best), 1e-8, 20).x)
        for j, offset in enumerate(offsets):
            inner = along.changed(fixed={**along.fixed, "omega": bottom["omega"] + offset})
            exponents[i, j] = bottom["omega"] + offset
            rise[i, j] = max(2.0 * refine(inner, inner.unit(bottom), 1e-6, 15).cost - floor, 0.0)
    return np.repeat(gains[:, None], 21, axis=1), exponents, rise


def cables(runs: Any) -> str:
    """The four parameters of the nine cables."""
    labels = {"delta": "δ [1]", "mu": "μ [1]", "K": "K [SI]", "omega": "ω [1]"}

    def draw(figure: Any) -> None:
        axes = figure.subplots(2, 2, sharex=True).ravel()
        for ax, name in zip(axes, labels, strict=True):
            for k, run in enumerate(runs):
                interval = profile_interval(run.data, run.best.parameters, name)
                ax.plot((k + 0.15, k + 0.15), (interval.low, interval.high), color=_COLOUR["lsq"], linewidth=1.6)
                ax.plot(k + 0.15, interval.value, marker="_", markersize=6, color=_COLOUR["lsq"], linestyle="")
                ax.plot(
                    k + 0.35,
                    np.median([f.parameters[name] for f in run.fits["pso"]]),
                    marker="x",
                    markersize=4.5,
                    linestyle="",
                    color=_COLOUR["pso"],
                )
                ax.plot(k - 0.1, getattr(run.cable, name), **style.PUBLISHED)
            ax.set(ylabel=labels[name])
            ax.set_xticks(
                range(9), ["steel 1", "2", "3 mm", "fibre 1", "2", "3 mm", "rubber 1", "2", "3 mm"], rotation=40
            )
            ax.grid(visible=False, axis="x")
        axes[2].set_yscale("log")
        style.letters(axes)

    return style.svg(draw, style.PAGE, 4.2)
