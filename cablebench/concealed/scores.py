"""The score of an episode on a hidden rig: between the frozen anchors of the task, as suite v1 has it."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from cablebench.concealed.mechanism import PROTOCOL
from cablebench.protocol.failures import broken, scored_error
from cablebench.protocol.files import load_protocol
from cablebench.score.anchors import Anchor, anchors_of
from cablebench.score.log_score import log_score

TRACK = "test"


@cache
def anchor(env_id: str) -> Anchor:
    """The anchor of a task; ConfigurationError where the suite has none."""
    protocol = load_protocol(PROTOCOL)
    return anchors_of(protocol, (protocol.task(env_id),))[env_id, TRACK]


@cache
def _worst() -> float:
    return load_protocol(PROTOCOL).worst_score


def failed(env_id: str, metrics: Mapping[str, Any]) -> bool:
    """Whether an episode breaks a rule: overload, a dropped load, a runaway, a torn cable."""
    return bool(broken(metrics, anchor(env_id).open_loop))


def score_of(env_id: str, metrics: Mapping[str, Any]) -> float:
    """0 for the error of doing nothing on the believed rig, 1 for the bound there, -1 for a broken rule."""
    worst = _worst()
    if failed(env_id, metrics):
        return worst
    between = anchor(env_id)
    return log_score(scored_error(metrics), between.open_loop, between.bound, worst)
