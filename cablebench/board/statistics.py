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
    """Mean of the middle half along the last axis [..., n] -> [...]: a quarter (rounded down) is cut at each end.

    Source: Agarwal et al. 2021, "Deep RL at the edge of the statistical precipice"; scipy.stats.trim_mean(x, 0.25).
    """
    ordered = np.sort(np.asarray(values, float), axis=-1)
    n = ordered.shape[-1]
    cut = n // 4
    return ordered[..., cut : n - cut].mean(axis=-1)


def median(values: np.ndarray) -> np.ndarray:
    """Median along the last axis."""
    return np.median(np.asarray(values, float), axis=-1)


def optimality_gap(values: np.ndarray, target: float = 1.0) -> np.ndarray:
    """Mean shortfall below ``target`` along the last axis; values above it count as reached. Lower is better."""
    return np.maximum(target - np.asarray(values, float), 0.0).mean(axis=-1)


def worst_tenth(values: np.ndarray, share: float = 0.1) -> np.ndarray:
    """Mean of the worst ``share`` of the values along the last axis (CVaR, higher is better), at least one value."""
    ordered = np.sort(np.asarray(values, float), axis=-1)
    # the small subtraction keeps 0.1 * 30 = 3.0000000000000004 from becoming four values
    count = max(1, int(np.ceil(share * ordered.shape[-1] - 1e-9)))
    return ordered[..., :count].mean(axis=-1)


@dataclass(frozen=True)
class BootstrapInterval(Interval):
    """A statistic with its percentile bootstrap interval. `unit` says what was resampled."""

    unit: str
    runs: int


def bootstrap(
    scores: Scores, statistic: Statistic, rng: np.random.Generator, resamples: int = 2000, level: float = 0.95
) -> BootstrapInterval:
    """``statistic`` of all episodes' scores, with a percentile interval from a bootstrap stratified by task.

    In each resample every task's runs are drawn with replacement among themselves, each with all of its episodes. A
    task with a single run says nothing about training; its episodes are resampled instead, which measures the spread
    over test episodes only. `BootstrapInterval.unit` says which it was.
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
    """Chance that a run of x scores above a run of y on the same episode; ties count half; mean over common tasks.

    x, y: {task: [runs, episodes]} with the same episodes in the same order. NaN when they share no task.
    """
    chances = []
    for task in (task for task in x if task in y):
        a, b = np.atleast_2d(x[task])[:, None, :], np.atleast_2d(y[task])[None, :, :]
        chances.append(float(np.mean((a > b) + 0.5 * (a == b))))
    return fmean(chances) if chances else float("nan")


def performance_profile(values: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Share of the values [n] that are at least each threshold [k] -> [k] (Dolan and More 2002, for scores)."""
    ordered = np.sort(np.asarray(values, float).reshape(-1))
    return 1.0 - np.searchsorted(ordered, np.asarray(thresholds, float), side="left") / len(ordered)
