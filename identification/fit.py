"""What every method returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cable_envs.identification.problem import RatioProblem


@dataclass(frozen=True)
class Fit:
    """The best parameters that a method found.

    Parameters
    ----------
    method : str
        Its name.
    parameters : Mapping of str to float
        All of `cable_envs.identification.model.NAMES`, SI.
    cost : float
        Sum of squares, Eq. (23), Gu 2024, weighted where the problem is.
    evaluations : int
        Of the model, each at all points.
    seconds : float
        Of the wall clock.
    history : ndarray
        Best cost so far [iterations].
    at_bounds : tuple of str
        Free parameters on the edge of the box: the data do not limit them there.
    details : Mapping
        What the method says besides.
    """

    method: str
    parameters: Mapping[str, float]
    """by name, SI, fixed ones included"""
    cost: float
    """Eq. (23) at ``parameters`` (weighted if the problem is)"""
    evaluations: int
    """model runs over all points; one exact Jacobian counts as one run for each free parameter"""
    seconds: float
    history: np.ndarray
    """[2, steps]: evaluations so far, best cost so far"""
    at_bounds: tuple[str, ...] = ()
    """free parameters that ended on their bound"""
    details: Mapping[str, Any] = field(default_factory=dict)


def at_bounds(problem: RatioProblem, unit: np.ndarray, tolerance: float = 1e-6) -> tuple[str, ...]:
    """Free parameters whose point in the unit box lies on its edge or beyond."""
    return tuple(n for n, z in zip(problem.free, unit, strict=True) if not tolerance < z < 1.0 - tolerance)
