"""Intervals of scores over both that a board samples, training seeds and rigs: the pigeonhole bootstrap of Owen 2007.

Scores of a task are an array [training seeds, rigs]. A resample draws seeds and rigs with replacement, independently,
and takes the scores where they cross. The interval is a percentile interval, widened for small numbers: each level's
variance is multiplied by n/(n - 1), and the normal quantile is replaced by Student's with the degrees of freedom of
Welch and Satterthwaite. Without that, the interval of three seeds covers the truth in 76 % of the cases, not in 95 %.

Every draw comes from a generator of its own: seeds from the entrant's name and the cell, rigs from the cell alone. So
an entrant's interval does not depend on who else is on the board, and two entrants are compared on the same rigs.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from cable_envs.core.intervals import Interval
from cablebench.score.statistics import BootstrapInterval, interquartile_mean

Scores = Mapping[str, np.ndarray]
"""task -> scores [training seeds, rigs]"""

_ROUNDING = 1e-24
"""Variance of scores that differ by rounding alone."""

_CHUNK = 2**22
"""Numbers that are sorted at once."""


@dataclass(frozen=True)
class Plan:
    """What a bootstrap draws from: everything but the scores. `cell` names the track, or the board's table."""

    cell: str
    seed: int = 0
    resamples: int = 2000
    level: float = 0.95

    def generator(self, *names: str) -> np.random.Generator:
        """The generator of these names in this cell, always the same one."""
        text = "\n".join([str(self.seed), self.cell, *names])
        return np.random.default_rng(list(hashlib.sha256(text.encode()).digest()))

    def seeds(self, name: str, task: str, count: int) -> np.ndarray:
        """Training seeds of an entrant on a task, drawn with replacement: indices [resamples, count]."""
        return self.generator("seeds", task, name).integers(0, count, (self.resamples, count))

    def rigs(self, task: str, count: int) -> np.ndarray:
        """Rigs of a task, drawn with replacement: indices [resamples, count], the same for every entrant."""
        return self.generator("rigs", task).integers(0, count, (self.resamples, count))


@dataclass(frozen=True)
class Draws:
    """A statistic of one task with its resamples: seeds and rigs drawn together, and each of them alone [resamples]."""

    value: float
    both: np.ndarray
    seeds: np.ndarray
    rigs: np.ndarray
    runs: int
    episodes: int


@dataclass(frozen=True)
class Spread:
    """Variance of a statistic and the degrees of freedom that it is known with."""

    variance: float
    freedom: float


def task_draws(name: str, task: str, scores: np.ndarray, plan: Plan) -> Draws:
    """The interquartile mean of an entrant's scores on one task, resampled.

    Parameters
    ----------
    name, task : str
        Decide the draws.
    scores : ndarray [runs, rigs]
    plan : Plan

    Returns
    -------
    Draws

    Raises
    ------
    ValueError
        Where there is no score.
    """
    table = np.atleast_2d(np.asarray(scores, float))
    if table.size == 0:
        raise ValueError("a bootstrap needs at least one episode for every task")
    runs, episodes = table.shape
    seeds, rigs = plan.seeds(name, task, runs), plan.rigs(task, episodes)
    every_run, every_rig = (np.broadcast_to(np.arange(n), (plan.resamples, n)) for n in (runs, episodes))
    only_rigs = _resampled(table, every_run, rigs)
    one = runs == 1
    return Draws(
        value=float(interquartile_mean(table.reshape(-1))),
        both=only_rigs if one else _resampled(table, seeds, rigs),
        seeds=np.zeros(plan.resamples) if one else _resampled(table, seeds, every_rig),
        rigs=only_rigs, runs=runs, episodes=episodes,
    )  # fmt: skip


def _resampled(table: np.ndarray, seeds: np.ndarray, rigs: np.ndarray) -> np.ndarray:
    """Interquartile mean of the crossing of the drawn seeds and rigs, for each resample."""
    step = max(_CHUNK // table.size, 1)
    parts = [
        interquartile_mean(table[seeds[k : k + step, :, None], rigs[k : k + step, None, :]].reshape(-1, table.size))
        for k in range(0, len(seeds), step)
    ]
    return np.concatenate(parts)


def spread(parts: Sequence[tuple[float, int]]) -> Spread:
    """Variance of a sum of independent parts.

    Parameters
    ----------
    parts : sequence of (float, int)
        Bootstrap variance of each, and the number of things that it was drawn from; one thing tells no variance.

    Returns
    -------
    Spread
        Each variance times n/(n - 1), added; degrees of freedom of Welch and Satterthwaite, infinite for variance 0.
    """
    known = [(v * n / (n - 1), n - 1) for v, n in parts if n > 1 and v > _ROUNDING]
    total = sum(v for v, _ in known)
    return Spread(total, total**2 / sum(v**2 / f for v, f in known)) if known else Spread(0.0, math.inf)


def spread_of(draws: Sequence[Draws]) -> Spread:
    """Variance of the mean over tasks of their statistics."""
    share = 1.0 / len(draws) ** 2
    levels = [(d.seeds, d.runs) for d in draws] + [(d.rigs, d.episodes) for d in draws]
    return spread([(share * _variance(values), n) for values, n in levels])


def _variance(values: np.ndarray) -> float:
    return float(np.var(values, ddof=1))


def widened(value: float, resamples: np.ndarray, known: Spread, level: float) -> Interval:
    """Percentile interval whose distances from the value are stretched to the spread that small numbers leave.

    Parameters
    ----------
    value : float
        The statistic.
    resamples : ndarray [n]
        Of it.
    known : Spread
    level : float

    Returns
    -------
    Interval
    """
    deviation = math.sqrt(_variance(resamples))
    if deviation == 0.0:
        return Interval(value, value, value)
    upper = (1.0 + level) / 2.0
    stretch = stats.t.ppf(upper, known.freedom) / stats.norm.ppf(upper) * math.sqrt(known.variance) / deviation
    low, high = np.quantile(resamples, [1.0 - upper, upper])
    return Interval(value, value + stretch * min(low - value, 0.0), value + stretch * max(high - value, 0.0))


def mean_of_tasks(draws: Sequence[Draws], level: float, worst: float) -> BootstrapInterval:
    """The mean over tasks of their interquartile means, with its interval.

    Parameters
    ----------
    draws : sequence of Draws
        One for each task.
    level : float
        Of the interval.
    worst : float
        No score is below it, and no end of the interval.

    Returns
    -------
    BootstrapInterval
        Its `unit` says what was resampled.
    """
    value = float(np.mean([d.value for d in draws]))
    both = np.mean([d.both for d in draws], axis=0)
    found = widened(value, both, spread_of(draws), level)
    runs = [d.runs for d in draws]
    unit = "training seeds and rigs" if max(runs) > 1 else "rigs"
    return BootstrapInterval(value, max(found.low, worst), found.high, unit, min(runs))


def worst_rigs(scores: Scores, tail: Callable[[np.ndarray], np.ndarray]) -> float:
    """Tail mean over rigs: a rig's score is its mean over training seeds; mean over tasks.

    Parameters
    ----------
    scores : mapping of str to ndarray [runs, rigs]
    tail : callable
        Of the rigs' scores [n]: `cablebench.score.statistics.worst_tenth`.

    Returns
    -------
    float
    """
    return float(np.mean([tail(np.atleast_2d(s).mean(axis=0)) for s in scores.values()]))
