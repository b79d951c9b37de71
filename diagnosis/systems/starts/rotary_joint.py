"""Inertia and weight of a joint by the balance of torque in its records.

    (J + J_l + m l^2) q'' + b q' + F sign(q') + m g l sin(q - q_0) = T

A window w over a part of a record is zero at both of its ends, and so are its slope and its curvature. Multiplied by it
and integrated by parts, the balance holds no derivative of the recorded angle besides the direction of the motion:

    (J + ..) ∫ q w'' - b ∫ q w' + F ∫ sign(q') w + m g l (cos q_0 ∫ w sin q - sin q_0 ∫ w cos q) = ∫ T w

which is linear in what is sought (modulating functions: Shinbrot, Trans. ASME 79 (1957) 547; Preisig and Rippin,
Computers Chem. Eng. 17 (1993) 1). Friction is in it, so that a joint that rubs is not taken for a heavier one.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import convolve

from cable_envs.diagnosis.systems.common import Sampled, smooth_speed
from cable_envs.diagnosis.systems.starts import UNSURE

SHORTEST, LONGEST = 16, 6
"""Samples of the shortest window; windows of that kind, at least, in the longest record."""
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
    found = [dict(series) for series in records]
    most = max((len(series["position"].values) for series in found), default=0) // LONGEST
    tried = []
    for length in (SHORTEST * 2**k for k in range(32)):
        if length > most:
            break
        rows = [_rows(series, period, effort, length) for series in found]
        if (one := _solved(np.vstack(rows))) is not None:
            tried.append(one)
    sure = [one for one in tried if one.inertia > 0.0 and one.error < UNSURE * one.inertia]
    return min(sure, key=lambda one: one.error / one.inertia, default=None)


def _rows(series: Mapping[str, Sampled], period: float, effort: str, length: int) -> np.ndarray:
    """The balance over windows of ``length`` samples, half a window apart: terms and torque [windows, 6]."""
    angle, torque = series["position"], series[effort]
    turn = np.pi / length
    sine, cosine = np.sin(turn * np.arange(length + 1)), np.cos(turn * np.arange(length + 1))
    window = sine**4
    slope = 4.0 * (turn / period) * sine**3 * cosine
    bent = (turn / period) ** 2 * (12.0 * sine**2 * cosine**2 - 4.0 * sine**4)
    way = np.sign(smooth_speed(angle.values, period))
    # the mean angle of a window tells nothing of what its slopes are multiplied by
    centred = angle.values - np.mean(angle.values)
    over = [
        (centred, bent), (-centred, slope), (way, window), (np.sin(angle.values), window),
        (np.cos(angle.values), window), (torque.values, window),
    ]  # fmt: skip
    if len(centred) <= length:
        return np.empty((0, len(over)))
    whole = convolve((angle.good & torque.good).astype(float), np.ones(length + 1), "valid") > length + 0.5
    terms = np.column_stack([convolve(signal, shape[::-1], "valid") * period for signal, shape in over])
    return terms[:: length // 2][whole[:: length // 2]]


def _solved(rows: np.ndarray) -> Balance | None:
    """The balance that fits best; None of fewer windows than twice the terms."""
    terms, torque = rows[:, :-1], rows[:, -1]
    count = terms.shape[1]
    if len(rows) < 2 * count:
        return None
    size = np.maximum(np.sqrt(np.mean(terms**2, axis=0)), 1e-300)
    scaled = terms / size
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    found = inverse @ (scaled.T @ torque)
    left = float(np.sum((torque - scaled @ found) ** 2)) / (len(rows) - count)
    errors = np.sqrt(np.maximum(np.diag(inverse) * left, 0.0)) / size
    inertia, _, _, along, across = found / size
    weight = float(np.hypot(along, across))
    if weight < TOLD * float(np.hypot(*errors[3:])):
        return Balance(float(inertia), float(errors[0]), 0.0, 0.0)
    return Balance(float(inertia), float(errors[0]), weight, float(np.arctan2(-across, along)))
