"""Statistics of scores: what a ranked board needs and nothing else. Every random draw comes from a passed Generator.

Scores are arranged as ``{task: array [runs, episodes]}``; a run is one training seed (a controller that is not trained
has one run). Episodes of one run share its training, so they are not independent: intervals resample whole runs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from cable_envs.core.intervals import Interval

Scores = Mapping[str, np.ndarray]
Statistic = Callable[[np.ndarray], np.ndarray]
"""Maps values [..., n] to [...]."""


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the middle half: a quarter of the values (rounded down) is cut at each end.

    Parameters
    ----------
    values : ndarray [..., n]
        Scores.

    Returns
    -------
    ndarray [...]

    References
    ----------
    Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice"; the same as
    ``scipy.stats.trim_mean(values, 0.25)``.

    Examples
    --------
    >>> float(interquartile_mean(np.array([-100.0, 1.0, 2.0, 3.0, 4.0, 50.0, 60.0, 900.0])))
    14.75
    """
    ordered = np.sort(np.asarray(values, float), axis=-1)
    n = ordered.shape[-1]
    cut = n // 4
    return ordered[..., cut : n - cut].mean(axis=-1)


def median(values: np.ndarray) -> np.ndarray:
    """Median along the last axis."""
    return np.median(np.asarray(values, float), axis=-1)


def optimality_gap(values: np.ndarray, target: float = 1.0) -> np.ndarray:
    """Mean shortfall below a target; values above it count as reached. Lower is better.

    Parameters
    ----------
    values : ndarray [..., n]
        Scores.
    target : float
        The score that is as good as wanted.

    Returns
    -------
    ndarray [...]

    Examples
    --------
    >>> float(optimality_gap(np.array([0.5, 1.0, 1.5, 0.0])))
    0.375
    """
    return np.maximum(target - np.asarray(values, float), 0.0).mean(axis=-1)


def worst_tenth(values: np.ndarray, share: float = 0.1) -> np.ndarray:
    """Mean of the worst values: the conditional value at risk (CVaR). Higher is better.

    Parameters
    ----------
    values : ndarray [..., n]
        Scores.
    share : float
        Of the values that count, at least one.

    Returns
    -------
    ndarray [...]

    Examples
    --------
    >>> float(worst_tenth(np.arange(20.0)))
    0.5
    """
    ordered = np.sort(np.asarray(values, float), axis=-1)
    # the small subtraction keeps 0.1 * 30 = 3.0000000000000004 from becoming four values
    count = max(1, int(np.ceil(share * ordered.shape[-1] - 1e-9)))
    return ordered[..., :count].mean(axis=-1)


@dataclass(frozen=True)
class BootstrapInterval(Interval):
    """A statistic with its percentile bootstrap interval. `unit` says what was resampled."""

    unit: str
    runs: int

    @property
    def single(self) -> bool:
        """Whether it says nothing about training, because there is one run only."""
        return "training seeds" not in self.unit


def bootstrap(
    scores: Scores, statistic: Statistic, rng: np.random.Generator, resamples: int = 2000, level: float = 0.95
) -> BootstrapInterval:
    """A statistic of all episodes' scores with a percentile interval from a bootstrap stratified by task.

    In each resample every task's runs are drawn with replacement among themselves, each with all of its episodes. A
    task with a single run says nothing about training; its episodes are resampled instead, which measures the spread
    over test episodes only.

    Parameters
    ----------
    scores : mapping of str to ndarray [runs, episodes]
        By task.
    statistic : callable
        Maps [..., n] to [...].
    rng : numpy.random.Generator
        Draws the resamples.
    resamples : int
        How many.
    level : float
        Of the interval.

    Returns
    -------
    BootstrapInterval
        Its `unit` says what was resampled.

    Raises
    ------
    ValueError
        Where a task has no episode.
    """
    tables = [np.atleast_2d(np.asarray(t, float)) for t in scores.values()]
    if not tables or any(t.size == 0 for t in tables):
        raise ValueError("bootstrap needs at least one episode for every task")
    clusters = [t if t.shape[0] > 1 else t.reshape(-1, 1) for t in tables]
    draws = [c[rng.integers(0, len(c), size=(resamples, len(c)))].reshape(resamples, -1) for c in clusters]
    low, high = np.quantile(statistic(np.concatenate(draws, axis=-1)), [(1 - level) / 2, (1 + level) / 2])
    value = float(statistic(np.concatenate([t.reshape(-1) for t in tables])))
    runs = [t.shape[0] for t in tables]
    units = ["training seeds"] * (max(runs) > 1) + ["episodes"] * (min(runs) == 1)
    return BootstrapInterval(value, float(low), float(high), " and ".join(units), min(runs))


def probability_of_improvement(x: Scores, y: Scores) -> float:
    """Chance that a run of one entrant scores above a run of another on the same episode.

    Parameters
    ----------
    x, y : mapping of str to ndarray [runs, episodes]
        Scores by task, the episodes in the same order.

    Returns
    -------
    float
        Mean over the common tasks; ties count half. NaN when there is no common task.

    Examples
    --------
    >>> probability_of_improvement({"a": np.array([[1.0, 2.0]])}, {"a": np.array([[0.0, 2.0]])})
    0.75
    """
    chances = []
    for task in (task for task in x if task in y):
        a, b = np.atleast_2d(x[task])[:, None, :], np.atleast_2d(y[task])[None, :, :]
        chances.append(float(np.mean((a > b) + 0.5 * (a == b))))
    return fmean(chances) if chances else float("nan")


def performance_profile(values: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Share of the values that are at least a threshold.

    Parameters
    ----------
    values : ndarray [n]
        Scores.
    thresholds : ndarray [k]

    Returns
    -------
    ndarray [k]

    References
    ----------
    Dolan and More 2002, "Benchmarking optimization software with performance profiles", for scores.
    """
    ordered = np.sort(np.asarray(values, float).reshape(-1))
    return 1.0 - np.searchsorted(ordered, np.asarray(thresholds, float), side="left") / len(ordered)
