"""The best commands for episodes whose rig and reference are known, by iLQR.

At each step of a trajectory the simulator itself gives the slopes of the state after it. A Riccati recursion backwards
(Li and Todorov 2004, iLQR; limits as in Tassa et al. 2014 by leaving out what lies at them) gives a change of the
actions and a feedback that holds the states to it; the change is tried in many sizes at once, with the simulator, and
the best is kept. The cost is the mean square of the error that the episode is scored by, and nothing else, so whatever
is found is an error that commands within the limits can reach.

On tasks of suite v1 that is the priced error r = |e| + s P / L^2, with P the mean square of the high-passed command q:
P' = P + f (q^2 - P). With the multipliers m_k = f sum_(j >= k) r_j (s / L^2) (1 - f)^(j - k) the price of all later
steps is m_k q_k^2, which is quadratic in the filter's state and the action, and enters the recursion as such.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cablebench.bound.motion import STEP, Motion, Plants

DAMPINGS = (1e-4, 1e-2, 1.0, 100.0, 1e4)
"""Weights of a squared change of an action, times the steps, beside the squared error over its mean."""

WILD = 1e25
"""Curvature at which the recursion counts as diverging, at a kink of the motion: it begins anew there."""

WAYS = ((STEP, False), (0.1, True), (0.01, True))
"""How the slopes are taken, in turn: share of each state's range, and whether they are tame (`Plants.slopes`). The
first are those of the motion as it is; the others pass over the kinks of play and dry friction."""

SIZES = (1.0, 0.3, 0.1, 0.02)
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
        Relative improvement of a mean squared error below which a round counts as without gain; one with each of the
        `WAYS` end it.
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
    for count in range(rounds):
        states = blocks[:, plants.rows].transpose(0, 2, 1)
        way = WAYS[count % len(WAYS)]
        motion = plants.motion(blocks, best, *way)
        with np.errstate(all="ignore"):
            change, gain, fall = _backward(motion, best, limits, first)
        if way == WAYS[0]:
            promised = np.where(np.isfinite(cost), np.minimum(fall / np.maximum(cost, 1e-300), 1.0), 0.0)
        taken = _try(plants, states, best, change, gain, limits)
        better = taken[1] < cost
        gained = np.where(better, 1.0 - taken[1] / np.where(np.isfinite(cost), cost, np.inf), 0.0)
        best = np.where(better, taken[0], best)
        cost, _, blocks = plants.follow(_commands_of(best), 1, keep=True)
        cost = cost[:, 0]
        idle = idle + 1 if np.all(gained < least) else 0
        if idle == len(WAYS):
            break
    return Found(best, cost, promised)


def _commands_of(plan: np.ndarray) -> Callable[[int, np.ndarray], np.ndarray]:
    """The plan [steps, episodes] as what `Plants.follow` asks: the commands of one step, whatever the states are."""
    return lambda step, _: plan[step]


def _backward(
    m: Motion, actions: np.ndarray, limits: tuple[float, float], first: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Changes [steps, episodes, dampings], gains [steps, episodes, dampings, states], promised fall [episodes]."""
    steps, episodes, n = m.b.shape
    shape = (episodes, len(DAMPINGS))
    scored = m.weight[:, None] > 0.0
    mean = np.sum(np.where(scored, m.error**2, 0.0), axis=0) / max(int(scored.sum()), 1)
    weight = 1.0 / np.maximum(mean, 1e-300)  # in shares of the present error
    damping = np.array(DAMPINGS) * steps
    v, vv = np.zeros((*shape, n)), np.zeros((*shape, n, n))
    change, gain, fall = np.zeros((steps, *shape)), np.zeros((steps, *shape, n)), np.zeros(episodes)
    low, high = limits
    for k in range(steps - 1, first - 1, -1):
        v[..., m.output] -= (weight * m.weight[k] * m.error[k])[:, None]
        vv[..., m.output, m.output] += (weight * m.weight[k])[:, None]
        a, b = m.a[k][:, None], m.b[k][:, None]
        va = vv @ a
        vx = np.einsum("edi,eij->edj", v, m.a[k])
        bv = np.einsum("ei,edij->edj", m.b[k], va)
        bvb = np.einsum("edi,ei->ed", (vv @ b[..., None])[..., 0], m.b[k])
        qu = np.einsum("ei,edi->ed", m.b[k], v)
        xx = a.transpose(0, 1, 3, 2) @ va
        if m.filter >= 0:  # the price of the command's part above the corner
            dear = 2.0 * (weight * m.price[k])[:, None]
            qu = qu + dear * m.passed[k][:, None] * m.direct
            bvb = bvb + dear * m.direct**2
            vx[..., m.filter] += dear * m.passed[k][:, None]
            bv[..., m.filter] += dear * m.direct
            xx[..., m.filter, m.filter] += dear
        quu = bvb + damping
        now = actions[k][:, None]
        stuck = ((now >= high) & (qu < 0.0)) | ((now <= low) & (qu > 0.0))
        wild = ~np.isfinite(quu) | (np.abs(quu) > WILD)
        step = np.where(stuck | wild, 0.0, -qu / quu)
        back = np.where((stuck | wild)[..., None], 0.0, -bv / quu[..., None])
        fall += np.where((stuck | wild)[:, 0], 0.0, (qu * qu / quu)[:, 0])
        change[k], gain[k] = step, back
        v = vx + back * qu[..., None]
        vv = xx + back[..., :, None] * bv[..., None, :]
        vv = 0.5 * (vv + vv.swapaxes(-1, -2))
        v, vv = np.where(wild[..., None], 0.0, v), np.where(wild[..., None, None], 0.0, vv)
    return change, gain, fall / weight / max(float(np.sum(m.weight)), 1.0)


def _try(plants, states, actions, change, gain, limits):
    """(best actions [steps, episodes], their cost [episodes]) among every damping in every size."""
    steps, episodes, dampings = change.shape
    copies = dampings * len(SIZES)
    change = (change[..., None] * np.array(SIZES)).reshape(steps, episodes, copies)
    took = np.empty((steps, episodes, copies))

    def act(k: int, now: np.ndarray) -> np.ndarray:
        off = now.reshape(episodes, dampings, len(SIZES), -1) - states[k][:, None, None, :]
        held = np.einsum("edsi,edi->eds", off, gain[k]).reshape(episodes, copies)
        took[k] = np.clip(actions[k][:, None] + change[k] + held, *limits)
        return took[k].reshape(-1)

    with np.errstate(all="ignore"):
        cost, _, _ = plants.follow(act, copies)
    chosen = np.argmin(cost, axis=1)
    return took[:, np.arange(episodes), chosen], cost[np.arange(episodes), chosen]
