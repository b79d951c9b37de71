"""A balance of forces over windows of records: linear in what is sought, without a derivative of a recorded place.

    m x'' + b x' + F sign(x') + sum_k c_k g_k(x, sign(x')) = f

A window w over a part of a record is zero at both of its ends, and so are its slope and its curvature. Multiplied by it
and integrated by parts, the balance holds no derivative besides the direction of the motion:

    m ∫ x w'' - b ∫ x w' + F ∫ sign(x') w + sum_k c_k ∫ g_k w = ∫ f w

(modulating functions: Shinbrot, Trans. ASME 79 (1957) 547; Preisig and Rippin, Computers Chem. Eng. 17 (1993) 1).
Friction is in it, so that what rubs is not taken for heavier.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import convolve

from cable_envs.diagnosis.systems.common import Sampled, smooth_speed

SHORTEST, LONGEST = 16, 6
"""Samples of the shortest window; windows of that kind, at least, in the longest record."""
MASS, DAMPING, FRICTION, BESIDE = 0, 1, 2, 3
"""Places of m, b and F in what is found, and that of the first c_k."""
Beside = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]
"""Places [T], directions of the motion [T] -> the functions g_k of them [T] each."""


@dataclass(frozen=True)
class Balanced:
    """What a balance tells: m, b, F and every c_k [3 + K], SI, and their standard errors."""

    found: np.ndarray
    errors: np.ndarray


def balance(
    records: Iterable[Mapping[str, Sampled]], period: float, effort: str, beside: Beside, most: float
) -> Balanced | None:
    """What the records tell, by the length of window that tells the mass best.

    Parameters
    ----------
    records : iterable of mapping of str to Sampled
        Samples of ``position``, and of the effort, of each record on its even clock.
    period : float
        Of the clock, s.
    effort : str
        Channel of the force or torque, or of what is in proportion to it but for viscous friction.
    beside : callable
        Functions g_k of the place and the direction.
    most : float
        Largest standard error of the mass, as a share of it.

    Returns
    -------
    Balanced or None
        None where the records do not tell a mass above 0 that well.
    """
    found = [dict(series) for series in records]
    longest = max((len(series["position"].values) for series in found), default=0) // LONGEST
    tried = []
    for length in (SHORTEST * 2**k for k in range(32)):
        if length > longest:
            break
        rows = [_rows(series, period, effort, length, beside) for series in found]
        if (one := _solved(np.vstack(rows))) is not None:
            tried.append(one)
    sure = [one for one in tried if 0.0 < one.errors[MASS] < most * one.found[MASS]]
    return min(sure, key=lambda one: one.errors[MASS] / one.found[MASS], default=None)


def _rows(series: Mapping[str, Sampled], period: float, effort: str, length: int, beside: Beside) -> np.ndarray:
    """The balance over windows of ``length`` samples, half a window apart: terms and effort [windows, 4 + K]."""
    place, force = series["position"], series[effort]
    turn = np.pi / length
    sine, cosine = np.sin(turn * np.arange(length + 1)), np.cos(turn * np.arange(length + 1))
    window = sine**4
    slope = 4.0 * (turn / period) * sine**3 * cosine
    bent = (turn / period) ** 2 * (12.0 * sine**2 * cosine**2 - 4.0 * sine**4)
    way = np.sign(smooth_speed(place.values, period))
    # the mean place of a window tells nothing of what its slopes are multiplied by
    centred = place.values - np.mean(place.values)
    over = [(centred, bent), (-centred, slope), (way, window)]
    over += [(signal, window) for signal in (*beside(place.values, way), force.values)]
    if len(centred) <= length:
        return np.empty((0, len(over)))
    whole = convolve((place.good & force.good).astype(float), np.ones(length + 1), "valid") > length + 0.5
    terms = np.column_stack([convolve(signal, shape[::-1], "valid") * period for signal, shape in over])
    return terms[:: length // 2][whole[:: length // 2]]


def _solved(rows: np.ndarray) -> Balanced | None:
    """The balance that fits best; None of fewer windows than twice the terms."""
    terms, force = rows[:, :-1], rows[:, -1]
    count = terms.shape[1]
    if len(rows) < 2 * count:
        return None
    size = np.maximum(np.sqrt(np.mean(terms**2, axis=0)), 1e-300)
    scaled = terms / size
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    found = inverse @ (scaled.T @ force)
    left = float(np.sum((force - scaled @ found) ** 2)) / (len(rows) - count)
    return Balanced(found / size, np.sqrt(np.maximum(np.diag(inverse) * left, 0.0)) / size)
