"""What a sensor counts in, and of how many of its readings a sample is the mean."""

from typing import NamedTuple

import numpy as np

ROUNDING = 1e-12
"""Of a value, by which computing with it may change it."""


class Reading(NamedTuple):
    """How the samples of a channel were read.

    Parameters
    ----------
    step : float
        Of single readings, in the channel's unit; 0 where they are fine.
    rows : int
        Readings of which each sample is the mean.
    """

    step: float = 0.0
    rows: int = 1

    @property
    def as_one(self) -> float:
        """Step of a single reading whose rounding scatters as that of the mean does."""
        return self.step / float(np.sqrt(self.rows))


FINE = Reading()
"""Of single readings that are as fine as their numbers."""


def resolution(values: np.ndarray) -> float:
    """Quantisation step of samples [T]: the least difference between values, where there are few of them; else 0.

    Values that units or a clock have moved by the rounding of a computer are one.
    """
    levels = np.sort(values)
    steps = np.diff(levels)
    steps = steps[steps > ROUNDING * float(np.max(np.abs(levels), initial=0.0))]
    return float(np.min(steps)) if 1 < len(steps) + 1 < 0.5 * len(values) else 0.0


def weights_of_mean(rows: int) -> np.ndarray:
    """Weights of the rows of a mean, whose middle is its moment: of an even number, the two ends count half."""
    weights = np.ones(2 * (rows // 2) + 1)
    if rows % 2 == 0:
        weights[[0, -1]] = 0.5
    return weights
