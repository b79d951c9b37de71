"""The best commands for episodes whose rig and reference are known, by iLQR.

At each step of a trajectory the simulator itself gives the slopes of the state after it. A Riccati recursion backwards
(Li and Todorov 2004, iLQR; limits as in Tassa et al. 2014 by leaving out what lies at them) gives a change of the
actions and a feedback that holds the states to it; the change is tried in many sizes at once, with the simulator, and
the best is kept. The cost is the mean squared error of the episode and nothing else, so whatever is found is an error
that commands within the limits can reach.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cablebench.bound.motion import Plants

DAMPINGS = (1e-4, 1e-2, 1.0, 100.0)
"""Weights of a squared change of an action, times the steps, beside the squared error over its mean."""

WILD = 1e25
"""Curvature at which the recursion counts as diverging, at a kink of the motion: it begins anew there."""

SIZES = (1.0, 0.5, 0.2, 0.05)
"""Shares of the proposed change that are tried, with each damping."""


@dataclass
class Found:
    """The best trajectories so far: actions [steps, episodes], their mean squared error, and what a step promised."""

    actions: np.ndarray
    cost: np.ndarray
    promised: np.ndarray
    """share of the cost that the slopes say could still fall, [episodes]"""


def improve(
    plants: Plants, actions: np.ndarray, limits: tuple[float, float], rounds: int, least: float, first: int = 0
) -> Found:
    """Improve actions by rounds of slopes, recursion and trials.

    Parameters
    ----------
    plants : Plants
        Episodes.
    actions : ndarray, shape (steps, episodes)
        To begin with.
    limits : tuple of two float
        Lowest and highest action.
    rounds : int
        Most rounds.
    least : float
        Relative improvement of a mean squared error below which a round counts as without gain; two of them end it.

    first : int
        Steps before it keep the actions of the beginning.

    Returns
    -------
    Found
        What is at least as good as the beginning.
    """
    best = np.clip(actions, *limits)
    cost, _, blocks = plants.follow(_commands_of(best), 1, keep=True)
    cost, idle = cost[:, 0], 0
    plants.relevant(blocks)
    promised = np.zeros_like(cost)
    for _ in range(rounds):
        states = blocks[:, plants.rows].transpose(0, 2, 1)
        a, b, output = plants.slopes(blocks, plants.scales(blocks))
        errors = plants.errors(blocks)
        with np.errstate(all="ignore"):
            plans = [_backward(a, b, output, errors, best, limits, d, first) for d in DAMPINGS]
        promised = np.minimum(plans[0][2] / np.maximum(cost, 1e-300), 1.0)
        trials = [(change, gain, size) for change, gain, _ in plans for size in SIZES]
        taken = _try(plants, states, best, trials, limits)
        better = taken[1] < cost
        gained = np.where(better, 1.0 - taken[1] / cost, 0.0)
        best = np.where(better, taken[0], best)
        cost, _, blocks = plants.follow(_commands_of(best), 1, keep=True)
        cost = cost[:, 0]
        idle = idle + 1 if np.all(gained < least) else 0
        if idle == 2:
            break
    return Found(best, cost, promised)


def _commands_of(plan: np.ndarray) -> Callable[[int, np.ndarray], np.ndarray]:
    """The plan [steps, episodes] as what `Plants.follow` asks: the commands of one step, whatever the states are."""
    return lambda step, _: plan[step]


def _backward(a, b, output, errors, actions, limits, damping, first):
    """(change [steps, episodes], gain [steps, episodes, states], promised fall of the cost [episodes])."""
    steps, episodes, n = b.shape
    weight = 1.0 / np.maximum(np.mean(errors**2, axis=0), 1e-300)  # in shares of the present error
    v, vv = np.zeros((episodes, n)), np.zeros((episodes, n, n))
    change, gain, fall = np.zeros((steps, episodes)), np.zeros((steps, episodes, n)), np.zeros(episodes)
    low, high = limits
    for k in range(steps - 1, first - 1, -1):
        v[:, output] -= weight * errors[k]
        vv[:, output, output] += weight
        va = vv @ a[k]
        bv = np.einsum("ei,eij->ej", b[k], va)
        qu = np.einsum("ei,ei->e", b[k], v)
        quu = np.einsum("ei,eij,ej->e", b[k], vv, b[k]) + damping * steps
        stuck = ((actions[k] >= high) & (qu < 0.0)) | ((actions[k] <= low) & (qu > 0.0))
        step = np.where(stuck, 0.0, -qu / quu)
        back = np.where(stuck[:, None], 0.0, -bv / quu[:, None])
        fall += np.where(stuck | ~np.isfinite(quu), 0.0, qu * qu / quu) / weight / steps
        wild = ~np.isfinite(quu) | (np.abs(quu) > WILD)
        step, back = np.where(wild, 0.0, step), np.where(wild[:, None], 0.0, back)
        change[k], gain[k] = step, back
        v = np.einsum("eji,ej->ei", a[k], v) + back * qu[:, None]
        vv = a[k].transpose(0, 2, 1) @ va + back[:, :, None] * bv[:, None, :]
        vv = 0.5 * (vv + vv.transpose(0, 2, 1))
        v, vv = np.where(wild[:, None], 0.0, v), np.where(wild[:, None, None], 0.0, vv)
    return change, gain, fall


def _try(plants, states, actions, trials, limits):
    """(best actions [steps, episodes], their cost [episodes]) among the trials."""
    copies, episodes = len(trials), plants.episodes
    sizes = np.array([size for _, _, size in trials])
    change = np.stack([c for c, _, _ in trials], axis=2) * sizes  # steps, episodes, copies
    gain = np.stack([g for _, g, _ in trials], axis=2)
    took = np.empty((len(actions), episodes, copies))

    def act(k: int, now: np.ndarray) -> np.ndarray:
        off = now.reshape(episodes, copies, -1) - states[k][:, None, :]
        took[k] = np.clip(actions[k][:, None] + change[k] + np.einsum("eci,eci->ec", gain[k], off), *limits)
        return took[k].reshape(-1)

    with np.errstate(all="ignore"):
        cost, _, _ = plants.follow(act, copies)
    chosen = np.argmin(cost, axis=1)
    return took[:, np.arange(episodes), chosen], cost[np.arange(episodes), chosen]
