"""What a motion is worth: the log odds and the intervals to be expected of its record, in closed form.

Of a motion, model h predicts whitened samples N(f_h, S_h), S_h = 1 + J_h C_h J_h': its sensors' noise, and what the
records so far leave open of its parameters (covariance C, slopes J). If h is true, the expected log odds of h over k
that the record adds are the Kullback-Leibler divergence

    D(h, k) = 1/2 [ d' S_k^-1 d + tr(S_k^-1 S_h) - n + log det S_k - log det S_h ],   d = f_h - f_k.

With B_k = (C_k^-1 + A_kk)^-1, A_hk = J_h' J_k (Woodbury):

    S_k^-1 = 1 - J_k B_k J_k',   log det S_k = log det (1 + C_k A_kk),
    tr(S_k^-1 S_h) - n = tr(C_h A_hh) - tr(B_k A_kk) - tr(C_h A_hk B_k A_kh).

A parameter's covariance after the record is B (Chaloner, Verdinelli, Statist. Sci. 10 (1995) 273).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Told:
    """What one model predicts of one motion, whitened.

    Parameters
    ----------
    values : ndarray
        [samples].
    slopes : ndarray
        Of ``values`` by the model's free parameters [samples, free].
    covariance : ndarray
        Of these parameters by the records so far [free, free].
    """

    values: np.ndarray
    slopes: np.ndarray
    covariance: np.ndarray

    @property
    def after(self) -> np.ndarray:
        """Covariance of the parameters with the record of the motion [free, free]."""
        own = self.slopes.T @ self.slopes
        root = _root(self.covariance)
        return root @ np.linalg.solve(np.eye(len(own)) + root.T @ own @ root, root.T)

    @property
    def volume(self) -> float:
        """log det of the covariance of the samples, over that of the noise."""
        root = _root(self.covariance)
        own = self.slopes @ root
        return float(np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1])


def divergence(true: Told, other: Told) -> float:
    """Expected log odds that the record gives to the true model over another one.

    Parameters
    ----------
    true, other : Told
        Of the same motion, under the same noise.

    Returns
    -------
    float
        Not negative.
    """
    apart, after = true.values - other.values, other.after
    along = other.slopes.T @ apart
    own, cross, their = (a.T @ b for a, b in ((true.slopes, true.slopes), (true.slopes, other.slopes),
                                              (other.slopes, other.slopes)))  # fmt: skip
    spread = np.sum(true.covariance * own) - np.sum(after * their)
    spread -= np.sum(true.covariance * (cross @ after @ cross.T))
    found = float(apart @ apart - along @ after @ along) + float(spread) + other.volume - true.volume
    return max(0.5 * found, 0.0)


def divergences(told: Sequence[Told]) -> np.ndarray:
    """Expected log odds of every model over every other one, if the first is true [models, models]."""
    count = len(told)
    return np.array([[0.0 if h == k else divergence(told[h], told[k]) for k in range(count)] for h in range(count)])


def narrowing(told: Told) -> np.ndarray:
    """Standard deviation of every free parameter after the record over that before it [free]."""
    before = np.sqrt(np.maximum(np.diag(told.covariance), 1e-300))
    return np.sqrt(np.maximum(np.diag(told.after), 0.0)) / before


def _root(covariance: np.ndarray) -> np.ndarray:
    """A matrix of which the product with its transpose is the covariance; of one that has lost definiteness, too."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))
