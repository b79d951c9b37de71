"""Multi-start nonlinear least squares (trust region, exact Jacobian) on the same cost as the swarm.

The paper calls least squares "challenging" here. On the noisy data of Table 2's cable it is not: single starts from
random points, with K itself, find the optimum in 60 of 60 runs (`cablebench reproduce gu-table2`). Here ln K takes the
place of K, since K and omega differ by orders of magnitude and act together, and starts are chosen from a handful of
random points.
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares as trust_region

from cable_envs.identification.fit import Fit, at_bounds
from cable_envs.identification.problem import RatioProblem


@dataclass(frozen=True)
class LeastSquaresSettings:
    """How many starts, and when one has converged."""

    samples: int = 24
    """random points of the box, of which the best become starts"""
    starts: int = 3
    tolerance: float = 1e-12
    """relative change of cost, step and gradient that ends a start"""
    evaluations: int = 60
    """most runs for one start"""


def least_squares(problem: RatioProblem, rng: np.random.Generator, settings: LeastSquaresSettings | None = None) -> Fit:
    """Identify by nonlinear least squares: the best of several trust-region runs (multistart).

    Parameters
    ----------
    problem : RatioProblem
        Points, model and bounds.
    rng : numpy.random.Generator
        Draws the starts.
    settings : LeastSquaresSettings, optional
        Other than the defaults.

    Returns
    -------
    Fit
        ``details``: "costs" of all starts, "agree": how many reached the best.
    """
    s = settings or LeastSquaresSettings()
    begin = time.perf_counter()
    problem = problem.changed(log_gain=True)
    samples = rng.random((len(problem.free), s.samples))
    first = problem.costs(samples)
    order = np.argsort(first)
    history = [(s.samples, float(first[order[0]]))]
    evaluations, found = s.samples, []
    for k in order[: s.starts]:
        result = refine(problem, samples[:, k], s.tolerance, s.evaluations)
        evaluations += result.nfev + len(problem.free) * result.njev
        found.append((2.0 * result.cost, result.x))
        history.append((evaluations, min(c for c, _ in found)))
    cost, point = min(found, key=lambda pair: pair[0])
    costs = [c for c, _ in found]
    return Fit(
        "lsq", problem.named(point), cost, evaluations, time.perf_counter() - begin, np.array(history).T,
        at_bounds(problem, point), {"costs": costs, "agree": sum(c <= cost * (1 + 1e-6) + 1e-20 for c in costs)},
    )  # fmt: skip


def refine(problem: RatioProblem, start: np.ndarray, tolerance: float = 1e-12, evaluations: int = 60):
    """One trust-region run.

    Parameters
    ----------
    problem : RatioProblem
        Points, model and bounds.
    start : ndarray
        Point of the unit box [free parameters].
    tolerance, evaluations : float, int
        When it ends.

    Returns
    -------
    scipy.optimize.OptimizeResult
        Its ``cost`` is half of ours.
    """
    inside = np.clip(start, 1e-9, 1.0 - 1e-9)
    return trust_region(
        problem.residuals, inside, problem.jacobian, bounds=(0.0, 1.0), method="trf", x_scale="jac",
        ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=evaluations,
    )  # fmt: skip
