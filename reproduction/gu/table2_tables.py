"""Tables of `gu_table2` that go beyond the paper: methods, swarm sizes, and what the data can tell."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cable_envs.core.text import number
from cable_envs.identification.information import delta_experiments, fisher, profile_interval, speed_shares
from cable_envs.reproduction.gu.data import PEAK_SPEED, TABLE_2, design
from cable_envs.reproduction.gu.table2_runs import (
    FOUND,
    METHODS,
    NAMES,
    PAPER_ITERATIONS,
    SEEDS,
    STANDARD,
    Runs,
    absorbed,
)
from cable_envs.reproduction.registry import Extra, Number


def tables(runs: Sequence[Runs], slow: Runs, sizes: Sequence[tuple], standard: dict[str, Any]) -> list[Extra]:
    """Methods, swarm sizes, information, experiments."""
    everything = [*runs, slow]
    method_lines = []
    for method in METHODS:
        fits = [fit for run in everything for fit in run.fits[method]]
        worst = min(run.successes(method) for run in everything)
        excess = [run.excess(fit) for run in everything for fit in run.fits[method]]
        method_lines.append(
            (
                {
                    "pso": "swarm, Table 1, 40 particles",
                    "lsq": "least squares, 3 starts",
                    "cma": "CMA-ES, population 8",
                }[method],
                f"{sum(run.successes(method) for run in everything)} of {len(fits)}",
                f"{worst} of {SEEDS}",
                int(np.median([fit.evaluations for fit in fits])),
                int(max(fit.evaluations for fit in fits)),
                1e3 * float(np.median([fit.seconds for fit in fits])),
                float(np.median(excess)),
                float(max(excess)),
            )
        )
    paper = PAPER_ITERATIONS * 40
    note = (
        f"Ten data sets with 0.1 N of noise, {SEEDS} seeds each. Success: cost within {FOUND:g} residual variances "
        f"of the best known. The paper's budget would be {PAPER_ITERATIONS} iterations x 40 = {paper} evaluations; a "
        f"tenth is {paper // 10}."
    )
    size_lines = [
        ("Table 1", n, "for each coordinate" if c else "for each particle", f"{hits} of {SEEDS}", int(e), x)
        for n, c, hits, e, x in sizes
    ]
    line = (f"{standard['hits']} of {SEEDS}", int(standard["evaluations"]), max(standard["excess"], 0.0))
    size_lines.append(("0.729, 1.494, 1.494", STANDARD.particles, "for each particle", *line))
    return [
        Extra(
            "Three methods on one cost",
            (
                "method",
                "success",
                "worst cable",
                "evaluations, median",
                "most",
                "time, median [ms]",
                "excess cost, median",
                "most",
            ),
            method_lines,
            note,
        ),
        Extra(
            "Swarm size and constants",
            ("w, c₁, c₂", "particles", "r₁, r₂ drawn", "success", "evaluations, median", "excess cost, median"),
            size_lines,
            "Table 2's cable with noise. Excess cost in residual variances.",
        ),
        *information_tables(runs, slow),
        Extra(
            "What the parameters absorb when the area law is not linear",
            ("compression [mm]", *NAMES, "rms left in n"),
            absorbed(),
            "Table 2's cable, data by Eq. (13) with the area of Eq. (6), no noise; compression at 49 N/rad. Table A1 "
            "has 0.485 mm, beyond the reach of the model at 90°.",
        ),
    ]


def information_tables(runs: Sequence[Runs], slow: Runs) -> list[Extra]:
    """Standard deviations for all cables at both speed ranges; correlations; what would separate delta and rho0."""
    lines: list[Sequence[Number]] = []
    for run in runs:
        for top in (run.top_speed, PEAK_SPEED):
            std = fisher(design(run.cable, top), run.cable.parameters).std
            lines.append(
                (run.cable.name, 1e3 * top, *(f"{number(100 * std[n] / getattr(run.cable, n), 2)} %" for n in NAMES))
            )
    found = fisher(slow.data, TABLE_2.parameters)
    matrix = [
        (a, *(f"{v:+.3f}".replace("-", "−") for v in line)) for a, line in zip(NAMES, found.correlation, strict=True)
    ]
    experiments = delta_experiments(slow.data, TABLE_2.parameters, cable_radius=TABLE_2.diameter / 2)
    weak = found.directions[0][1]
    return [
        Extra(
            "Least standard deviation of an estimate, relative (Cramér-Rao)",
            ("cable", "up to [mm/s]", *NAMES),
            lines,
            "75 points, 0.1 N of noise, rho0 known. At the speeds of section 5.3 the steel cables' K and omega are "
            "not measurable at all.",
        ),
        Extra(
            "Correlation of the estimates, Table 2's cable up to 10.8 mm/s",
            ("", *NAMES),
            matrix,
            "Worst determined direction of relative changes: "
            + ", ".join(f"{k} {v:+.2f}" for k, v in weak.items())
            + f"; its standard deviation is {100 * found.directions[0][0]:.0f} %.",
        ),
        Extra(
            "What would separate delta from rho0",
            ("measured besides the 75 ratios", "std of delta", "std of rho0", "because"),
            [(e.name, _finite(e.std_delta), _finite(e.std_rho0), e.why) for e in experiments],
            "rho0 free. Diameters by the paper's camera (0.01 mm); the second hole twice as large, the second load "
            "twice as heavy.",
        ),
    ]


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else "∞"


def notes(slow: Runs, runs: Sequence[Runs]) -> list[str]:
    """Sentences that follow from the numbers."""
    interval = profile_interval(slow.data, slow.best.parameters, "delta")
    shares = speed_shares(slow.data, TABLE_2.parameters)
    key = {n: 1e3 * shares["speed"][int(np.argmax(shares[n]))] for n in NAMES}
    low = "0 (its bound)" if interval.low_open else f"{interval.low:.4f}"
    high = f"{interval.high:.4f}" + (" (its bound)" if interval.high_open else "")
    return [
        f"Table 2's cable up to 10.8 mm/s: the 95 % profile interval of delta is {low} to {high}, with rho0 taken as "
        "exactly 1.5. If rho0 is off by 1 %, delta is off by 0.01: 75 ratios only determine rho0 (1 + delta).",
        "Success means a cost at the noise floor, not a delta: within that floor delta is anywhere in its interval.",
        "The speed whose loss costs most: " + ", ".join(f"{v:.1f} mm/s for {n}" for n, v in key.items()) + ".",
    ]
