"""The paper's particle swarm.  Eqs. (24)-(27) and Table 1, Gu 2024.

    v_k = w v_{k-1} + c1 r1 (best of the particle - x_k) + c2 r2 (best of all - x_k),    x_{k+1} = x_k + v_k       (25)

The paper prints w, c1, c2 and the number of iterations. It does not print how many particles there are, where they
start, the search range, what happens at its edge, or whether r1, r2 are drawn for a particle or for each coordinate.
Chosen here: 40 particles, uniform in the box and at rest, stopped at the edge, r1 and r2 for each particle as Eq. (25)
reads.
"""

import time
from dataclasses import dataclass

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.identification.fit import Fit, at_bounds
from cable_envs.identification.problem import RatioProblem

EDGES = ("stop", "open")


@dataclass(frozen=True)
class SwarmSettings:
    """Numbers of Table 1, and what the paper leaves open."""

    iterations: int = 1000
    w: float = 0.4
    """inertia"""
    c1: float = 0.6
    """towards the best point of the particle (cognitive)"""
    c2: float = 0.8
    """towards the best point of all (social)"""
    particles: int = 40
    per_coordinate: bool = False
    """draw r1, r2 for each coordinate (as in most implementations) instead of for each particle"""
    edge: str = "stop"
    """"stop": a particle that leaves the box is put on its edge and loses that velocity; "open": as printed, no box"""
    target: float = 0.0
    """stop early once the best cost is below"""
    collapsed: float = 1e-12
    """stop early once the spread is below: the particles then sit on one point and nothing can change any more"""

    def __post_init__(self):
        if self.edge not in EDGES:
            raise ConfigurationError(f"edge '{self.edge}' must be one of {', '.join(EDGES)}")
        if self.iterations < 1 or self.particles < 2:
            raise ConfigurationError("a swarm needs at least 1 iteration and 2 particles")


def stable_as_printed(w: float, c1: float, c2: float) -> bool:
    """Eq. (27), Gu 2024: w < 1, c1 + c2 > 0, 1 + w > (c1 + c2)/2. Said to be the condition of mean-square stability."""
    return w < 1.0 and c1 + c2 > 0.0 and 1.0 + w > 0.5 * (c1 + c2)


def growth(w: float, c1: float, c2: float) -> tuple[float, float]:
    """(spectral radius of the mean, of the second moments) of a particle while both its best points stay.

    With phi = c1 r1 + c2 r2, r uniform in (0, 1), a coordinate follows x_{k+1} = (1 + w - phi) x_k - w x_{k-1}. The
    second moments of (x_k, x_{k-1}) obey a linear map of their own. Mean-square stable if the second radius is below
    1; its square root is the factor by which the swarm's size changes in an iteration. Poli 2009 has the closed form
    for c1 = c2: c1 + c2 < 24 (1 - w^2) / (7 - 5 w).
    """
    mean, variance = 0.5 * (c1 + c2), (c1 * c1 + c2 * c2) / 12.0
    a = 1.0 + w - mean
    first = np.array([[a, -w], [1.0, 0.0]])
    second = np.array([[a * a + variance, -2.0 * a * w, w * w], [a, -w, 0.0], [1.0, 0.0, 0.0]])
    return float(np.max(np.abs(np.linalg.eigvals(first)))), float(np.max(np.abs(np.linalg.eigvals(second))))


def typical_growth(w: float, c1: float, c2: float, rng: np.random.Generator, steps: int = 20000) -> float:
    """Factor by which a particle's distance changes in an iteration, in the long run (exp of Lyapunov's exponent).

    Same recursion as `growth`, followed along one path. It can be below 1 where the second moments grow: nearly every
    particle then comes to rest, and the mean square is carried by rare far excursions.
    """
    x, y, total = 1.0, 0.5, 0.0
    for r1, r2 in rng.random((steps, 2)):
        x, y = (1.0 + w - c1 * r1 - c2 * r2) * x - w * y, x
        size = abs(x) + abs(y)
        total += np.log(size)
        x, y = x / size, y / size
    return float(np.exp(total / steps))


def swarm(problem: RatioProblem, rng: np.random.Generator, settings: SwarmSettings | None = None) -> Fit:
    """Identify with the particle swarm of Gu 2024, Eqs. (24)-(27).

    Parameters
    ----------
    problem : RatioProblem
        Points, model and bounds.
    rng : numpy.random.Generator
        Of the swarm.
    settings : SwarmSettings, optional
        Numbers of Table 1, and what the paper leaves open.

    Returns
    -------
    Fit
        ``details``: "best", "median" (cost of all particles now) and "spread" [iterations + 1], the root mean square
        distance of the particles from their mean, in units of the box.
    """
    s = settings or SwarmSettings()
    start = time.perf_counter()
    shape = (len(problem.free), s.particles)
    draw = (2, *shape) if s.per_coordinate else (2, s.particles)
    x, v = rng.random(shape), np.zeros(shape)
    cost = problem.costs(x)
    own, own_cost = x.copy(), cost.copy()
    leader = int(np.argmin(cost))
    best, median, spread = (np.empty(s.iterations + 1) for _ in range(3))
    best[0], median[0], spread[0] = cost[leader], np.median(cost), _spread(x)
    k = 0
    while k < s.iterations and own_cost[leader] > s.target and spread[k] > s.collapsed:
        r = rng.random(draw)
        v = s.w * v + s.c1 * r[0] * (own - x) + s.c2 * r[1] * (own[:, leader, None] - x)
        x = x + v
        if s.edge == "stop":
            outside = (x < 0.0) | (x > 1.0)
            v[outside] = 0.0
            np.clip(x, 0.0, 1.0, out=x)
        else:
            np.clip(x, -1e9, 1e9, out=x)  # keeps a diverging swarm finite
        cost = np.nan_to_num(problem.costs(x), nan=np.inf, posinf=np.inf)
        better = cost < own_cost
        own[:, better], own_cost[better] = x[:, better], cost[better]
        leader = int(np.argmin(own_cost))
        k += 1
        best[k], median[k], spread[k] = own_cost[leader], np.median(cost), _spread(x)
    history = np.vstack([s.particles * np.arange(1, k + 2), best[: k + 1]])
    point = own[:, leader]
    details = {"best": best[: k + 1], "median": median[: k + 1], "spread": spread[: k + 1]}
    return Fit(
        "pso", problem.named(point), float(own_cost[leader]), s.particles * (k + 1), time.perf_counter() - start,
        history, at_bounds(problem, point), details,
    )  # fmt: skip


def _spread(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((x - x.mean(axis=1, keepdims=True)) ** 2, axis=0))))
