"""Inertia and weight of a joint by the balance of torque in its records (`windows`).

(J + J_l + m l^2) q'' + b q' + F sign(q') + m g l (cos q_0 sin q - sin q_0 cos q) = T
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_envs.diagnosis.systems.common import Sampled
from cable_envs.diagnosis.systems.starts import UNSURE, windows

TOLD = 3.0
"""Standard errors from which on there is a weight."""

_LEAST = 0.05
"""Share of what turns that is the inertia at least, where the mass on its assumed arm would be more than all."""


@dataclass(frozen=True)
class Balance:
    """What the balance of torque tells of a joint, SI; of a torque that is known to a factor only, that factor of it.

    inertia, error | of all that turns, and its standard error
    weight         | largest torque of gravity, m g l; 0 where there is none
    hanging        | angle at which the mass hangs
    """

    inertia: float
    error: float
    weight: float
    hanging: float


def begin(
    series: Sequence[Mapping[str, Sampled]], values: Mapping[str, float], period: float, said: Collection[str]
) -> dict[str, float]:
    """Inertia, weight, the angle at which it hangs, and of a current the torque of one ampere; see the package."""
    effort = next(name for name in series[0] if name != "position")
    found = balance(series, period, effort)
    if found is None:
        return {}
    factor = {"torque": 1.0, "current": values["torque_constant"]}.get(
        effort, values["torque_constant"] / values["resistance"]
    )
    begun = {}
    if effort == "current" and "torque_constant" not in said:
        factor = begun["torque_constant"] = _factor(found, values, said)
    turned, weight, arm = factor * found.inertia, factor * found.weight, values["arm_length"]
    if "load_mass" not in said:
        begun["load_mass"] = weight / max(values["gravity"] * arm, 1e-9)
    others = values["load_inertia"] + begun.get("load_mass", values["load_mass"]) * arm**2
    return begun | {"hanging_angle": found.hanging, "inertia": max(turned - others, _LEAST * turned)}


def _factor(found: Balance, values: Mapping[str, float], said: Collection[str]) -> float:
    """Torque for one ampere by which the stated weight, or else the stated inertia, is that of the balance."""
    if "load_mass" in said and found.weight > 0.0:
        return values["load_mass"] * values["gravity"] * values["arm_length"] / found.weight
    if "inertia" in said:  # what hangs on the arm turns, too
        arm, gravity = values["arm_length"], max(values["gravity"], 1e-9)
        others = values["inertia"] + values["load_inertia"]
        alone = found.inertia - found.weight * arm / gravity
        return others / alone if alone > _LEAST * found.inertia else others / found.inertia
    return values["torque_constant"]


def balance(records: Iterable[Mapping[str, Sampled]], period: float, effort: str) -> Balance | None:
    """Inertia and weight of the joint.

    Parameters
    ----------
    records : iterable of mapping of str to Sampled
        Samples of ``position``, rad, and of the effort, of each record on its even clock.
    period : float
        Of the clock, s.
    effort : str
        Channel of the torque, or of what is in proportion to it but for viscous friction.

    Returns
    -------
    Balance or None
        None where the records do not tell the inertia to `UNSURE`.
    """
    told = windows.balance(records, period, effort, lambda q, way: (np.sin(q), np.cos(q)), UNSURE)
    if told is None:
        return None
    inertia, error = float(told.found[windows.MASS]), float(told.errors[windows.MASS])
    along, across = told.found[windows.BESIDE :]
    weight = float(np.hypot(along, across))
    if weight < TOLD * float(np.hypot(*told.errors[windows.BESIDE :])):
        return Balance(inertia, error, 0.0, 0.0)
    return Balance(inertia, error, weight, float(np.arctan2(-across, along)))
