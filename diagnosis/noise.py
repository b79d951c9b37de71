"""The noise of one channel with its colour: an autoregression learnt from residuals.

    e(t) = a_1 e(t - 1) + ... + a_p e(t - p) + std w(t),   w white with variance 1

Coefficients by least squares (Luetkepohl, New Introduction to Multiple Time Series Analysis, 2005, ch. 3), the order by
Schwarz's criterion. Whitened with the right model, what is left of a residual may be treated as independent samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

MAX_ORDER = 8


@dataclass(frozen=True)
class Noise:
    """Autoregression ``coefficients`` [order] and the standard deviation ``std`` of what drives it (channel's unit)."""

    coefficients: np.ndarray
    std: float

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    def whiten(self, series: np.ndarray) -> np.ndarray:
        """Series [T] or [T, n] as w; the first ``order`` samples, that have no whole past, are 0."""
        white = lfilter(np.r_[1.0, -self.coefficients], [1.0], series, axis=0) / self.std
        white[: self.order] = 0.0
        return white

    def simulate(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """``count`` samples of this noise, after 200 that are thrown away."""
        drive = rng.normal(0.0, self.std, count + 200)
        return lfilter([1.0], np.r_[1.0, -self.coefficients], drive)[200:]

    @property
    def floor(self) -> float:
        """Standard deviation of the coloured noise itself."""
        response = lfilter([1.0], np.r_[1.0, -self.coefficients], np.r_[1.0, np.zeros(9999)])
        return float(self.std * np.sqrt(np.sum(response**2)))


def learn_noise(residuals: Sequence[np.ndarray], max_order: int = MAX_ORDER) -> Noise:
    """The noise of residuals [T] of several records; NaN marks samples that do not count.

    All orders are compared on the same samples. Raises ValueError where fewer than ten times ``max_order`` are usable.
    """
    pasts, nows = [], []
    for residual in residuals:
        rows = np.arange(max_order, len(residual))
        pasts.append(residual[rows[:, None] - np.arange(1, max_order + 1)])
        nows.append(residual[rows])
    past, now = np.concatenate(pasts), np.concatenate(nows)
    good = np.isfinite(past).all(axis=1) & np.isfinite(now)
    past, now = past[good], now[good]
    count = len(now)
    if count < 10 * max(max_order, 1):
        raise ValueError(f"{count} usable samples in a row do not show the noise; {10 * max(max_order, 1)} would")
    best = (np.inf, np.empty(0), 0.0)
    for order in range(max_order + 1):
        found = np.linalg.lstsq(past[:, :order], now, rcond=None)[0]
        variance = float(np.mean((now - past[:, :order] @ found) ** 2))
        score = count * np.log(max(variance, 1e-300)) + order * np.log(count)
        if score < best[0]:
            best = (score, found, np.sqrt(max(variance, 1e-300)))
    return Noise(best[1], float(best[2]))
