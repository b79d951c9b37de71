"""Entrants against each other on the same rigs: differences with Holm's correction, and probability of improvement.

Tasks against each other: how alike they rank.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import stats

from cable_envs.core.intervals import Interval
from cablebench.score.two_level import Draws, Plan, Scores, spread, widened


@dataclass(frozen=True)
class Pair:
    """One entrant against another: how much higher the first one scores, with interval and two-sided p-value."""

    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float
    adjusted: float = math.nan
    """p after Holm's correction over all pairs of the table"""


def paired(first: str, x: Sequence[Draws], second: str, y: Sequence[Draws], level: float) -> Pair:
    """The difference of two entrants' mean scores over the same tasks and rigs.

    Parameters
    ----------
    first, second : str
        Their names.
    x, y : sequence of Draws
        Their resamples, task by task; the rigs are drawn alike for both.
    level : float
        Of the interval.

    Returns
    -------
    Pair
        Its p-value is Student's, with the degrees of freedom of Welch and Satterthwaite. Where no resample differs
        from another, it is the sign test's over the rigs.
    """
    share = 1.0 / len(x) ** 2
    parts: list[tuple[float, int]] = []
    for a, b in zip(x, y, strict=True):
        parts += [(share * float(np.var(d.seeds, ddof=1)), d.runs) for d in (a, b)]
        parts.append((share * float(np.var(a.rigs - b.rigs, ddof=1)), a.episodes))
    known = spread(parts)
    value = float(np.mean([a.value - b.value for a, b in zip(x, y, strict=True)]))
    both = np.mean([a.both - b.both for a, b in zip(x, y, strict=True)], axis=0)
    found = widened(value, both, known, level)
    if value == 0.0:
        p = 1.0
    elif known.variance == 0.0:
        p = min(1.0, 2.0 * 0.5 ** sum(a.episodes for a in x))
    else:
        p = float(2.0 * stats.t.sf(abs(value) / math.sqrt(known.variance), known.freedom))
    return Pair(first, second, value, found.low, found.high, p)


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for the number of comparisons: the chance of any false one stays below the level.

    Parameters
    ----------
    p : sequence of float

    Returns
    -------
    list of float
        In the order given: the k-th smallest of m times m - k + 1, never less than the one before it, at most 1.

    References
    ----------
    Holm 1979, "A simple sequentially rejective multiple test procedure".

    Examples
    --------
    >>> [round(q, 12) for q in holm([0.01, 0.04, 0.03, 0.005])]
    [0.03, 0.06, 0.06, 0.02]
    """
    corrected, least = [0.0] * len(p), 0.0
    for k, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        least = max(least, min(1.0, (len(p) - k) * p[i]))
        corrected[i] = least
    return corrected


def pairs(draws: Mapping[str, Sequence[Draws]], level: float) -> tuple[Pair, ...]:
    """Every two entrants of a table compared, the better one first.

    Parameters
    ----------
    draws : mapping of str to sequence of Draws
        By entrant.
    level : float
        Of the intervals.

    Returns
    -------
    tuple of Pair
        With p-values corrected by Holm over all of them.
    """
    found = []
    for a, b in combinations(sorted(draws), 2):
        pair = paired(a, draws[a], b, draws[b], level)
        found.append(pair if pair.difference >= 0.0 else paired(b, draws[b], a, draws[a], level))
    adjusted = holm([pair.p for pair in found])
    return tuple(replace(pair, adjusted=q) for pair, q in zip(found, adjusted, strict=True))


def separated(found: Sequence[Pair], level: float) -> int:
    """How many pairs differ, with a chance of at most 1 - level that any of them does not."""
    return sum(pair.adjusted < 1.0 - level for pair in found)


def improvement(first: str, x: Scores, second: str, y: Scores, plan: Plan) -> Interval | None:
    """Probability that a training seed of one entrant scores above one of another on the same rig, with its interval.

    Parameters
    ----------
    first, second : str
        Names of the entrants; they decide the draws.
    x, y : mapping of str to ndarray [runs, rigs]
        Their scores by task.
    plan : Plan

    Returns
    -------
    Interval or None
        Mean over the common tasks; ties count half. Where every rig agrees, the end of the interval is that of the
        binomial (Clopper and Pearson). None without a common task.
    """
    tasks = [task for task in x if task in y]
    if not tasks:
        return None
    values, both, parts, rigs = [], [], [], 0
    for task in tasks:
        a, b = np.atleast_2d(x[task]), np.atleast_2d(y[task])
        wins = (a[:, None, :] > b[None, :, :]) + 0.5 * (a[:, None, :] == b[None, :, :])
        sizes = wins.shape
        picked = (plan.seeds(first, task, sizes[0]), plan.seeds(second, task, sizes[1]), plan.rigs(task, sizes[2]))
        weights = [_weights(k, n) for k, n in zip(picked, sizes, strict=True)]
        even = [np.full((1, n), 1.0 / n) for n in sizes]
        values.append(float(np.mean(wins)))
        both.append(_crossed(wins, weights))
        for level, n in enumerate(sizes):
            alone = [weights[k] if k == level else even[k] for k in range(3)]
            parts.append((float(np.var(_crossed(wins, alone), ddof=1)) / len(tasks) ** 2, n))
        rigs += sizes[2]
    value = float(np.mean(values))
    if value in (0.0, 1.0):
        edge = ((1.0 - plan.level) / 2.0) ** (1.0 / rigs)
        return Interval(value, edge if value else 0.0, 1.0 if value else 1.0 - edge)
    found = widened(value, np.mean(both, axis=0), spread(parts), plan.level)
    return Interval(value, max(found.low, 0.0), min(found.high, 1.0))


def _weights(drawn: np.ndarray, count: int) -> np.ndarray:
    """How often each was drawn, as a share [resamples, count]."""
    return np.stack([np.bincount(row, minlength=count) for row in drawn]) / count


def _crossed(wins: np.ndarray, weights: Sequence[np.ndarray]) -> np.ndarray:
    """Weighted mean of ``wins`` over its three axes, for each resample."""
    length = max(len(w) for w in weights)
    first, second, rigs = (np.broadcast_to(w, (length, w.shape[1])) for w in weights)
    return np.einsum("bi,bk,bj,ikj->b", first, second, rigs, wins, optimize=True)


def kendall(scores: Mapping[str, Mapping[str, float]]) -> dict[tuple[str, str], float]:
    """How alike every two tasks rank their entrants.

    Parameters
    ----------
    scores : mapping
        task -> entrant -> score.

    Returns
    -------
    dict of float
        (task, task) -> Kendall's tau-b over the entrants that both have: 1 is the same order, -1 the opposite one.
        Pairs of tasks with fewer than three common entrants are absent.
    """
    found = {}
    for a, b in combinations(scores, 2):
        common = sorted(set(scores[a]) & set(scores[b]))
        if len(common) > 2:
            tau = stats.kendalltau([scores[a][n] for n in common], [scores[b][n] for n in common]).statistic
            if math.isfinite(tau):
                found[a, b] = float(tau)
    return found
