"""What a step of a task of the suite costs and what ends its episode: one law for reward, termination and info.

    priced error = |error| + error_scale (activity / limit)^2
    reward = 1 / (1 + priced error / error_scale)

``activity`` is the part of the command above a corner frequency (Butterworth high pass of order 2), as a root mean
square over the last half second and as a share of the command's range. For 0.3 s after a jump of the reference nothing
is added to it: a command may jump where its reference does. An episode ends where one of the task's rules has been
broken for longer than the rule allows; what was still to earn is lost.
"""

import math
from dataclasses import dataclass

from cable_envs.core.kernels import inline, select, sqrt
from cable_envs.core.lanes import Lanes
from cable_envs.sim.tasks import INFO, reward

JUDGED = Lanes("Judged", ["violations", "failure", "activity", "priced_error"])
"""What an info of a task of the suite has besides: how many rules are broken now; 0, or the number of the rule that has
ended the episode, counted from 1; activity, a share of the command's range; priced error, SI."""

CUTOFF = 10.0
"""Hz from which on the command counts as active: an order above the references, as for the metric "chatter"."""
WINDOW = 0.5
"""Time constant of the mean square, s."""
PAUSE = 0.3
"""Time after a jump of the reference in which nothing is added, s: three time constants of a servo of 10 rad/s."""

_info, _judged = INFO.views, JUDGED.views


@dataclass(frozen=True)
class Rule:
    """A range that a signal must not leave for long.

    Attributes
    ----------
    name : str
        What breaking it is called: "overload", "slack", "dropped", "runaway", "grasp_force".
    signal : str
        A signal of the plant, or "error".
    low, high : float
        The range, SI.
    longer_than : float
        Time beyond it that is allowed, s.
    """

    name: str
    signal: str
    low: float = -math.inf
    high: float = math.inf
    longer_than: float = 0.05


def high_pass(period: float) -> tuple[float, float, float]:
    """Butterworth high pass of order 2 at `CUTOFF`, by the bilinear transform with the corner where it should be.

    Parameters
    ----------
    period : float
        Control period, s.

    Returns
    -------
    b, a1, a2 : float
        y_k = b (u_k - 2 u_(k-1) + u_(k-2)) - a1 y_(k-1) - a2 y_(k-2). Zeros where the period is too long to hold
        anything above the corner.
    """
    if CUTOFF * period >= 0.5:
        return 0.0, 0.0, 0.0
    w = math.tan(math.pi * CUTOFF * period)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * w + w * w)
    return scale, 2.0 * (w * w - 1.0) * scale, (1.0 - math.sqrt(2.0) * w + w * w) * scale


@inline
def begin_judging(block, s, j, c, i):
    """Nothing is broken, and the command has stood where it is."""
    for k in range(c.rules):
        block[c.counts + k, i] = 0.0
    share = 0.5 * s.action[i]
    s.passed_1[i], s.passed_2[i] = -c.pass_b * share, c.pass_b * share
    s.power[i], s.paused[i] = 0.0, 0.0
    j.violations[i], j.failure[i], j.activity[i] = 0.0, 0.0, 0.0


@inline
def expect(s, c, lo, hi):
    """Where the reference goes if it does not jump, and where it is now."""
    info = _info(s.info)
    for i in range(lo, hi):
        s.expected[i] = info.reference[i] + c.period * s.true_rate[i]


@inline
def priced(j, info, c, lo, hi):
    """The priced error, by the activity there is."""
    for i in range(lo, hi):
        share = j.activity[i] / c.activity_limit
        j.priced_error[i] = abs(info.error[i]) + c.error_scale * share * share


@inline
def judge(block, s, j, c, lo, hi):
    """Activity, rules, priced error, reward and end of a step, after those that every task has."""
    info = _info(s.info)
    pause = math.floor(c.pause / c.period + 0.5)
    for i in range(lo, hi):
        share = 0.5 * s.action[i]
        passed = c.pass_b * share + s.passed_1[i]
        s.passed_1[i] = s.passed_2[i] - 2.0 * c.pass_b * share - c.pass_a1 * passed
        s.passed_2[i] = c.pass_b * share - c.pass_a2 * passed
        jumped = abs(info.reference[i] - s.expected[i]) > c.error_scale
        s.paused[i] = select(jumped, pause, s.paused[i] - 1.0)
        added = select(s.paused[i] > 0.0, 0.0, passed * passed)
        s.power[i] = s.power[i] + c.fading * (added - s.power[i])
        j.activity[i] = sqrt(s.power[i])
        j.violations[i] = 0.0
    for k in range(c.rules):
        value, count, low, high, most = block[c.rule[k]], block[c.counts + k], c.lowest[k], c.highest[k], c.allowed[k]
        for i in range(lo, hi):
            broken = (value[i] < low) | (value[i] > high)
            count[i] = select(broken, count[i] + 1.0, 0.0)
            j.violations[i] = j.violations[i] + select(broken, 1.0, 0.0)
            ends = (count[i] > most) & (j.failure[i] == 0.0)
            j.failure[i] = select(ends, k + 1.0, j.failure[i])
    priced(j, info, c, lo, hi)
    for i in range(lo, hi):
        failed = j.failure[i] > 0.0
        earned = reward(j.priced_error[i], s.action[i] - s.last_action[i], c.error_scale, c.effort_weight)
        s.reward[i] = select(failed, 0.0, earned)
        s.terminated[i] = select(failed, 1.0, s.terminated[i])
        s.truncated[i] = select(failed, 0.0, s.truncated[i])
