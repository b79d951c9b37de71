"""Mass of a drive by the balance of force in its records (`windows`), beside friction and what depends on the place.

    (m + m_m) x'' + b x' + (F + F' x) sign(x') + g(x) = f

g is made of straight lines between places of the travel: a spring, a weight, something that the carriage meets.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.systems.common import Sampled
from cable_envs.diagnosis.systems.starts import UNSURE, windows

PARTS = 6
"""Of the travel, between which the force at a place is a straight line."""
_LEAST = 0.05
"""Share of what moves that is the carriage at least, where the motor's stated inertia would be more than all."""


def begin(
    series: Sequence[Mapping[str, Sampled]], values: Mapping[str, float], period: float, said: Collection[str]
) -> dict[str, float]:
    """The carriage's mass; see the package. A force is what tells it, or a voltage of which the force is stated."""
    effort = "force" if "force" in series[0] else "voltage"
    if effort == "voltage" and "force_per_volt" not in said:
        return {}
    places = np.concatenate([one["position"].values for one in series])
    low, high = float(np.min(places)), float(np.max(places))
    knots = np.linspace(low, high, PARTS + 1)

    def beside(x: np.ndarray, way: np.ndarray) -> list[np.ndarray]:
        """Lines that are 1 at one knot and 0 at all others; friction that grows along the way."""
        return [*(np.interp(x, knots, one) for one in np.eye(len(knots))), way * (x - low)]

    told = windows.balance(series, period, effort, beside, UNSURE)
    if told is None:
        return {}
    moved = float(told.found[windows.MASS]) * (values["force_per_volt"] if effort == "voltage" else 1.0)
    return {"mass": max(moved - values["motor_mass"], _LEAST * moved)}
