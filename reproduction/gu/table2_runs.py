"""The runs behind `gu_table2`: three methods on the data of ten experiments, swarms of other sizes and constants."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.identification.cma_es import cma_es
from cable_envs.identification.fit import Fit
from cable_envs.identification.least_squares import least_squares, refine
from cable_envs.identification.problem import RatioProblem
from cable_envs.identification.pso import SwarmSettings, swarm
from cable_envs.reproduction.gu.data import (
    PEAK_SPEED,
    TABLE_2,
    WEIGHT,
    WRAPS,
    Cable,
    lateral_contact,
    measured,
    problem,
    simulated_ratios_exact_area,
)

SEEDS = 20
PAPER_ITERATIONS = 550
METHODS: Mapping[str, Callable[[RatioProblem, np.random.Generator], Fit]] = {
    "pso": swarm, "lsq": least_squares, "cma": cma_es
}  # fmt: skip
NAMES = ("delta", "mu", "K", "omega")
FOUND = 0.1
"""a fit counts as the optimum when its cost exceeds the best known one by less than this many variances of a residual:
its parameters are then within a third of a standard error of the optimum's, in every direction"""
STANDARD = SwarmSettings(w=0.729, c1=1.494, c2=1.494)
"""Clerc and Kennedy 2002: the constants of most implementations"""


@dataclass(frozen=True)
class Runs:
    """All methods and seeds on the data of one cable."""

    cable: Cable
    top_speed: float
    data: RatioProblem
    fits: Mapping[str, Sequence[Fit]]

    @property
    def best(self) -> Fit:
        """The lowest cost that any run found."""
        return min((fit for fits in self.fits.values() for fit in fits), key=lambda fit: fit.cost)

    def excess(self, fit: Fit) -> float:
        """Cost above the best, in variances of a residual."""
        free = len(self.data.free)
        return (fit.cost - self.best.cost) / (self.best.cost / (len(self.data.wrap) - free))

    def successes(self, method: str) -> int:
        """Seeds with which the method found the optimum."""
        return sum(self.excess(fit) < FOUND for fit in self.fits[method])


def identify(cable: Cable, top_speed: float, seed: int) -> Runs:
    """One noisy data set of a cable, and every method from `SEEDS` seeds on it.

    Parameters
    ----------
    cable : Cable
    top_speed : float
        Highest speed of the experiment, m/s.
    seed : int
        Of the noise.

    Returns
    -------
    Runs
    """
    data = problem(cable, top_speed, np.random.default_rng((2024, seed)))
    fits = {name: [run(data, np.random.default_rng((seed, k))) for k in range(SEEDS)] for name, run in METHODS.items()}
    return Runs(cable, top_speed, data, fits)


def exact_data() -> Runs:
    """Table 2's cable without noise: the swarm and least squares."""
    data = problem(TABLE_2, PEAK_SPEED, None)
    fits = {name: [METHODS[name](data, np.random.default_rng((7, k))) for k in range(SEEDS)] for name in ("pso", "lsq")}
    return Runs(TABLE_2, PEAK_SPEED, data, fits)


def swarm_sizes(slow: Runs) -> list[tuple[int, bool, int, float, float]]:
    """(particles, r for each coordinate, successes of `SEEDS`, median evaluations, median excess) on noisy data."""
    found = []
    for per_coordinate in (False, True):
        for particles in (10, 20, 40, 80, 160):
            settings = SwarmSettings(particles=particles, per_coordinate=per_coordinate)
            fits = [swarm(slow.data, np.random.default_rng((3, k)), settings) for k in range(SEEDS)]
            excess = [slow.excess(fit) for fit in fits]
            evaluations = float(np.median([fit.evaluations for fit in fits]))
            found.append(
                (particles, per_coordinate, sum(e < FOUND for e in excess), evaluations, float(np.median(excess)))
            )
    return found


def standard_swarm(slow: Runs, clean: Runs) -> dict[str, Any]:
    """The swarm with the usual constants in place of Table 1's, on noisy and on exact data."""
    noisy = [swarm(slow.data, np.random.default_rng((3, k)), STANDARD) for k in range(SEEDS)]
    exact = [swarm(clean.data, np.random.default_rng((7, k)), STANDARD) for k in range(SEEDS)]
    below = [np.flatnonzero(fit.details["best"] < 1e-6) for fit in exact]
    return {
        "hits": sum(slow.excess(fit) < FOUND for fit in noisy),
        "evaluations": float(np.median([fit.evaluations for fit in noisy])),
        "excess": float(np.median([slow.excess(fit) for fit in noisy])),
        "below": sum(len(k) > 0 for k in below),
        "iterations": float(np.median([k[0] if len(k) else np.inf for k in below])),
    }


def single_starts(slow: Runs) -> int:
    """How many least-squares runs from one random point each, with K itself, find the optimum of the noisy data."""
    rng = np.random.default_rng(3)
    plain = slow.data.changed(log_gain=False)
    allowed = slow.best.cost * (1 + FOUND / (len(plain.wrap) - len(plain.free)))
    return sum(2.0 * refine(plain, rng.random(len(plain.free))).cost < allowed for _ in range(3 * SEEDS))


def absorbed() -> list[tuple[Any, ...]]:
    """Identified parameters when the area of Eq. (6) made the data instead of its first Taylor term."""
    wrap, speed = np.meshgrid(WRAPS, PEAK_SPEED * np.arange(1, 6) / 5, indexing="ij")
    lines = []
    for modulus in (80e6, 320e6):
        contact = lateral_contact(TABLE_2, modulus)
        ratio = simulated_ratios_exact_area(TABLE_2, contact, wrap.ravel(), speed.ravel())
        fit = least_squares(RatioProblem(wrap.ravel(), speed.ravel(), *measured(ratio, None)), np.random.default_rng(0))
        eps = 1e3 * float(contact.compression(WEIGHT))
        lines.append((f"{eps:.3f}", *(fit.parameters[n] for n in NAMES), math.sqrt(fit.cost / len(ratio))))
    return lines
