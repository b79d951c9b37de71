"""CMA-ES (Hansen's pycma) on the same cost as the swarm; it learns the direction of the narrow K-omega valley."""

import time
from dataclasses import dataclass

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.identification.fit import Fit, at_bounds
from cable_envs.identification.problem import RatioProblem


@dataclass(frozen=True)
class CmaSettings:
    """pycma's defaults except for what is named here."""

    evaluations: int = 3000
    step: float = 0.25
    """first standard deviation, in units of the box"""
    tolerance: float = 1e-6
    """ends when all costs of the last generations differ by less than this share"""
    population: int = 8


def cma_es(problem: RatioProblem, rng: np.random.Generator, settings: CmaSettings | None = None) -> Fit:
    """Identify with the covariance matrix adaptation evolution strategy (Hansen 2016; pycma).

    Parameters
    ----------
    problem : RatioProblem
        Points, model and bounds.
    rng : numpy.random.Generator
        Draws the random start in the box and pycma's seed.
    settings : CmaSettings, optional
        Other than the defaults.

    Returns
    -------
    Fit
        The best parameters.

    Raises
    ------
    ConfigurationError
        Where pycma is not installed.
    """
    try:
        import cma
    except ModuleNotFoundError as error:
        raise ConfigurationError("method 'cma' needs pycma: pip install 'cable-envs[identification]'") from error
    s = settings or CmaSettings()
    begin = time.perf_counter()
    problem = problem.changed(log_gain=True)
    options = {
        "bounds": [0.0, 1.0], "popsize": s.population, "maxfevals": s.evaluations, "verbose": -9, "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape), "tolfun": s.tolerance, "tolfunhist": 0.0, "tolx": 1e-9,
    }  # fmt: skip
    strategy = cma.CMAEvolutionStrategy(rng.uniform(0.2, 0.8, len(problem.free)), s.step, options)
    history, best, point = [], np.inf, np.full(len(problem.free), np.nan)
    while not strategy.stop():
        asked = strategy.ask()
        costs = problem.costs(np.array(asked).T)
        # the order decides in CMA-ES; the logarithm keeps far costs and near ones on one scale for its stopping rules
        strategy.tell(asked, np.log(costs + 1e-300).tolist())
        k = int(np.argmin(costs))
        if costs[k] < best:
            best, point = float(costs[k]), np.array(asked[k])
        history.append((strategy.countevals, best))
    return Fit(
        "cma", problem.named(point), best, strategy.countevals, time.perf_counter() - begin, np.array(history, float).T,
        at_bounds(problem, point), {"stop": {k: str(v) for k, v in strategy.stop().items()}},
    )  # fmt: skip
