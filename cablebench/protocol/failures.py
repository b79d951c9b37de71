"""What makes an episode a failure, whatever its tracking error: rules over the metrics of the episode.

The rules belong to score version 1. A rule whose metric was not measured (NaN, or a record that is older than the
metric) is not broken. Tasks of suite v1 have rules for slack, dropped loads and overload of their own, which end the
episode (`cable_envs.sim.suite.judging`): there these here do not count beside them.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

RUNAWAY = 10.0
"""Open loop's errors: an RMSE beyond so many of them is no tracking."""

SHARE = 0.005
"""Of the time: a cable may be slack, or a tension above the rig's limit, no longer than this."""

Metrics = Mapping[str, Any]


def torn(metrics: Metrics, open_loop: float) -> bool:
    """The episode did not run to its end: the cable tore, or a number was not finite."""
    unfinished = bool(_value(metrics, "failed") > 0.0) or math.isnan(_value(metrics, "rmse"))
    return unfinished and not ended(metrics, open_loop)


def ended(metrics: Metrics, open_loop: float) -> bool:
    """A rule of the task ended the episode: tension, slack, dropped load, grasp force or runaway for over 50 ms."""
    return _value(metrics, "ended_by_rule") > 0.0


def dropped(metrics: Metrics, open_loop: float) -> bool:
    """The load fell: it ended more than 50 mm below every place where it started or should have been."""
    return not _has_rules(metrics) and _value(metrics, "dropped") > 0.0


def runaway(metrics: Metrics, open_loop: float) -> bool:
    """The RMSE is more than 10 times that of the open loop."""
    return _value(metrics, "rmse") > RUNAWAY * open_loop


def slack(metrics: Metrics, open_loop: float) -> bool:
    """A cable was slack for more than 0.5 % of the time."""
    return not _has_rules(metrics) and _value(metrics, "slack") > SHARE


def overload(metrics: Metrics, open_loop: float) -> bool:
    """A tension was above the rig's safety limit for more than 0.5 % of the time."""
    return not _has_rules(metrics) and _value(metrics, "overload") > SHARE


Rule = Callable[[Metrics, float], bool]

RULES: tuple[Rule, ...] = (torn, ended, dropped, runaway, slack, overload)
"""(metrics of an episode, RMSE of the open loop in the unit of the output) -> whether the rule is broken."""


def broken(metrics: Metrics, open_loop: float) -> tuple[str, ...]:
    """The rules that an episode breaks.

    Parameters
    ----------
    metrics : mapping
        Of the episode, SI (`cablebench.protocol.metrics.measure`); None counts as NaN.
    open_loop : float
        RMSE of the open loop in the same condition, in the unit of the output.

    Returns
    -------
    tuple of str
        Names of `RULES`; empty for an episode that counts.

    Examples
    --------
    >>> broken({"rmse": 0.001, "failed": 0.0, "slack": 0.2, "overload": 0.005}, open_loop=0.007)
    ('slack',)
    """
    return tuple(rule.__name__ for rule in RULES if rule(metrics, open_loop))


def scored_error(metrics: Metrics) -> float:
    """The error that an episode is scored by, SI: the priced error where the task has one, else the RMSE.

    Parameters
    ----------
    metrics : mapping
        Of the episode.

    Returns
    -------
    float
        NaN where there is neither.

    Examples
    --------
    >>> scored_error({"rmse": 0.002, "priced_rmse": None}), scored_error({"rmse": 0.002, "priced_rmse": 0.003})
    (0.002, 0.003)
    """
    priced = _value(metrics, "priced_rmse")
    return _value(metrics, "rmse") if math.isnan(priced) else priced


def _has_rules(metrics: Metrics) -> bool:
    """Whether the task has rules of its own that end its episodes."""
    return not math.isnan(_value(metrics, "ended_by_rule"))


def _value(metrics: Metrics, name: str) -> float:
    found = metrics.get(name)
    return math.nan if found is None else float(found)
