"""Confidence intervals: one type for all that estimate something, however the ends were found."""

from dataclasses import dataclass

NORMAL_95 = 1.96
"""Standard errors on each side of a normal estimate's 95 % interval."""


@dataclass(frozen=True)
class Interval:
    """An estimate with the ends of its confidence interval, all in one unit.

    Derived types say more: over what a bootstrap resampled (`cablebench.score.statistics.BootstrapInterval`), which end
    only a search bound gives (`cable_envs.identification.information.ProfileInterval`), the unit of a parameter
    (`cable_envs.diagnosis.model.verdict.Estimate`).

    Attributes
    ----------
    value : float
        The estimate.
    low, high : float
        Ends of the interval. They need not lie alike on both sides of the estimate.

    Examples
    --------
    >>> found = normal_interval(2.0, 0.5)
    >>> found.low, found.high, found.holds(1.5), round(found.width, 2)
    (1.02, 2.98, True, 1.96)
    """

    value: float
    low: float
    high: float

    @property
    def width(self) -> float:
        """Distance from the lower to the upper end."""
        return self.high - self.low

    def holds(self, value: float) -> bool:
        """Whether a value lies within the interval, its ends included."""
        return self.low <= value <= self.high

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end."""
        return self.low, self.high


def normal_interval(value: float, error: float, factor: float = NORMAL_95) -> Interval:
    """Interval of an estimate with a normal distribution.

    Parameters
    ----------
    value : float
        The estimate.
    error : float
        Its standard error, in the same unit.
    factor : float
        Standard errors on each side; by default those of 95 %.

    Returns
    -------
    Interval
        ``value - factor error`` to ``value + factor error``.
    """
    half = factor * error
    return Interval(value, value - half, value + half)
