"""What a run of the concealed track says: each row's score, what a diagnosis is worth, and where it is worth nothing.

A rig's score is the mean over its episodes; rows are compared on the same rigs, and rigs are what is resampled.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.core.intervals import Interval
from cablebench.concealed.entrants import ON_THE_RIG, tuned_row
from cablebench.concealed.hidden import KINDS
from cablebench.score.statistics import bootstrap

RESAMPLES = 4000
SEED = 20261126
BASE = "nominal-controller"
Rig = Mapping[str, Any]
"""``hidden``: the key of a rig; ``rows``: scores by row; ``answer``: of its diagnosis. `track.run` makes them."""

ANSWERS = ("right", "in part, or another", "unknown", "nothing missing")
"""What a diagnosis said of a rig: all that is concealed and nothing else; effects, and not just these; that something
is missing which it cannot name, or that the data are at fault; that nothing is missing. `track.answer` has what counts
as named."""
OPEN = ("unknown", "data_fault")
"""Verdicts that leave open what is missing, whatever the refit has moved."""


def mean_over_rigs(values: Sequence[float]) -> Interval:
    """The mean with its 95 % interval, rigs resampled.

    Parameters
    ----------
    values : sequence of float
        One for each rig.

    Returns
    -------
    Interval
    """
    table = np.asarray(values, float)[None, :]
    return bootstrap({"rigs": table}, lambda v: v.mean(axis=-1), np.random.default_rng(SEED), RESAMPLES)


def score(rig: Rig, row: str) -> float:
    """The mean score of a row's episodes on a rig."""
    return float(np.mean(rig["rows"][row]["scores"]))


def log_error(rig: Rig, row: str) -> float:
    """The mean logarithm of the errors of a row's episodes on a rig, of SI."""
    return float(np.mean(np.log(rig["rows"][row]["errors"])))


def rows_of(rigs: Sequence[Rig]) -> list[str]:
    """The rows that were run on every rig."""
    return [row for row in rigs[0]["rows"] if all(row in rig["rows"] for rig in rigs)]


def answered(rig: Rig) -> str | None:
    """One of `ANSWERS`; None where no row has diagnosed the rig."""
    told = rig["answer"]
    if told is None:
        return None
    if told["verdict"] in OPEN:
        return ANSWERS[2]
    if not told["named"]:
        return ANSWERS[3] if told["verdict"] == "no_detectable_mismatch" else ANSWERS[2]
    return ANSWERS[0] if sorted(told["named"]) == sorted(rig["hidden"]["effects"]) else ANSWERS[1]


def standing(rigs: Sequence[Rig]) -> list[dict[str, Any]]:
    """For each row its score, what it is ahead of `BASE` on the same rigs, failures, and its score by kind of rig."""
    found = []
    for row in rows_of(rigs):
        entry: dict[str, Any] = {
            "row": row,
            "score": mean_over_rigs([score(rig, row) for rig in rigs]),
            "error": float(np.median([e for rig in rigs for e in rig["rows"][row]["errors"]])),
            "failed": int(sum(sum(rig["rows"][row]["failed"]) for rig in rigs)),
            "episodes": int(sum(len(rig["rows"][row]["failed"]) for rig in rigs)),
            "kinds": {k: _mean([score(rig, row) for rig in rigs if rig["hidden"]["kind"] == k]) for k in KINDS},
        }
        if row != BASE and BASE in rows_of(rigs):
            entry["ahead"] = mean_over_rigs([score(rig, row) - score(rig, BASE) for rig in rigs])
        found.append(entry)
    return sorted(found, key=lambda entry: -entry["score"].value)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def diagnosis(rigs: Sequence[Rig], with_it: str, without: str, oracle: str) -> list[dict[str, Any]]:
    """What a diagnosis is worth, over all rigs and by what it answered.

    Parameters
    ----------
    rigs : sequence of mapping
    with_it, without, oracle : str
        Rows: with the diagnosis, without it, and with the truth.

    Returns
    -------
    list of dict
        ``answer``, ``rigs``, ``times``: the error without it over that with it, an `Interval` of the geometric mean;
        ``oracle``: the same of the truth; ``better``: on how many rigs it has the smaller error.
    """
    found = []
    parts = {"all": list(rigs), **{name: [rig for rig in rigs if answered(rig) == name] for name in ANSWERS}}
    for name, own in parts.items():
        if not own:
            continue
        gained = [log_error(rig, without) - log_error(rig, with_it) for rig in own]
        possible = [log_error(rig, without) - log_error(rig, oracle) for rig in own]
        found.append({
            "answer": name, "rigs": len(own), "times": _times(gained), "oracle": _times(possible),
            "better": int(sum(g > 0.0 for g in gained)),
        })  # fmt: skip
    return found


def _times(logarithms: Sequence[float]) -> Interval:
    found = mean_over_rigs(logarithms)
    return Interval(*(float(np.exp(x)) for x in (found.value, found.low, found.high)))


def episodes_saved(rigs: Sequence[Rig], with_it: str) -> list[dict[str, Any]]:
    """Tuning on the rig itself against the row with a diagnosis: for each number of episodes both, on the same rigs.

    Returns
    -------
    list of dict
        ``episodes``, ``score`` of tuning on the rig, ``ahead``: by how much the row with the diagnosis is ahead.
    """
    found = []
    for count in ON_THE_RIG:
        row = tuned_row(count)
        if row in rows_of(rigs):
            found.append({
                "episodes": count, "score": mean_over_rigs([score(rig, row) for rig in rigs]),
                "ahead": mean_over_rigs([score(rig, with_it) - score(rig, row) for rig in rigs]),
            })  # fmt: skip
    return found
