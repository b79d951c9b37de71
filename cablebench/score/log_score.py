"""Score version 1: logarithmic between frozen anchors, so that a factor in the error counts alike everywhere.

    score = ln(e_open / e) / ln(e_open / e_bound), at least the protocol's worst score

e is the error of the episode (`cablebench.protocol.failures.scored_error`: the priced error on tasks of suite v1, else
the RMSE), e_open and e_bound the anchors of its task and track (`cablebench.score.anchors`). The open loop's error
scores 0, the bound's 1. An episode that breaks a rule (`cablebench.protocol.failures`) has the worst score. Nothing in
it depends on other entrants.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cablebench.protocol.failures import broken, scored_error
from cablebench.protocol.protocol import Protocol
from cablebench.score.anchors import Anchor, Anchors

LEAST_SHARE = 1e-3
"""Of the bound: a smaller error counts as this one, so that no score is infinite."""

Record = Mapping[str, Any]


def log_score(error: float, open_loop: float, bound: float, worst: float = -1.0) -> float:
    """Score of an error between two anchors.

    Parameters
    ----------
    error : float
        Of an episode.
    open_loop, bound : float
        The anchors, in the same unit, the first the larger one.
    worst : float
        Least score.

    Returns
    -------
    float

    Examples
    --------
    >>> log_score(1.0, 1.0, 0.01), log_score(0.1, 1.0, 0.01), log_score(0.01, 1.0, 0.01), log_score(1e6, 1.0, 0.01)
    (0.0, 0.5, 1.0, -1.0)
    """
    span = math.log(open_loop / bound)
    return max(math.log(open_loop / max(error, LEAST_SHARE * bound)) / span, worst)


def anchored(record: Record, anchors: Anchors) -> Anchor | None:
    """The anchor of a record's task and track, if there is one."""
    return anchors.get((record["env_id"], record["track"]))


def violations(record: Record, anchors: Anchors) -> tuple[str, ...]:
    """The failure rules that a record's episode breaks; without an anchor nothing counts as a runaway."""
    anchor = anchored(record, anchors)
    return broken(record["metrics"], math.inf if anchor is None else anchor.open_loop)


def score_records(records: Sequence[Record], protocol: Protocol, anchors: Anchors) -> list[float]:
    """The score of each record.

    Parameters
    ----------
    records : sequence of mapping
    protocol : Protocol
        Says the worst score.
    anchors : mapping
        `cablebench.score.anchors.anchors_of` the protocol.

    Returns
    -------
    list of float
        NaN where the condition has no anchor.
    """
    return [_score(r, protocol.worst_score, anchors) for r in records]


def _score(record: Record, worst: float, anchors: Anchors) -> float:
    anchor = anchored(record, anchors)
    if anchor is None:
        return math.nan
    if violations(record, anchors):
        return worst
    return log_score(scored_error(record["metrics"]), anchor.open_loop, anchor.bound, worst)


def survived(record: Record, score: float, protocol: Protocol, anchors: Anchors) -> bool:
    """Whether an episode breaks no rule and scores above the protocol's `survival`, so that it beats the open loop."""
    return not violations(record, anchors) and score > protocol.survival
