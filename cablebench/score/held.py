"""Whether the bound is a bound: how many recorded episodes have a smaller error than the bound of that episode."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from cablebench.protocol.failures import broken, scored_error
from cablebench.score.anchors import Anchors

ROUNDED = 5e-6
"""Largest share by which the rounding of a frozen bound moves it: who made the bound is not below it."""


@dataclass(frozen=True)
class Held:
    """What the records say of the bound of one condition."""

    task: str
    """id of the environment"""
    track: str
    episodes: int
    """records of episodes that have a bound of their own and broke no rule"""
    below: int
    """of these with an error below it, by more than it was rounded"""
    nearest: str
    """the entrant with the smallest share of error over bound"""
    share: float
    """that share: below 1 the bound was beaten"""


def held(records: Iterable[Mapping[str, Any]], anchors: Anchors) -> list[Held]:
    """Count the episodes in which an entrant was better than the bound of the same episode.

    Parameters
    ----------
    records : iterable of mapping
        As `ResultStore.read` gives them; those of sweeps and of episodes without a bound are left out.
    anchors : mapping
        `cablebench.score.anchors.anchors_of` a protocol.

    Returns
    -------
    list of Held
        One for each condition that has such records, in the order of the anchors.
    """
    shares: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for r in records:
        anchor = anchors.get((r["env_id"], r["track"]))
        if anchor is None or r.get("sweep") or not 0 <= r["seed"] - anchor.first_seed < len(anchor.bounds):
            continue
        if not broken(r["metrics"], anchor.open_loop):
            share = scored_error(r["metrics"]) / anchor.bounds[r["seed"] - anchor.first_seed]
            shares.setdefault((anchor.task, anchor.track), []).append((share, r["entrant"]))
    return [
        Held(*key, len(found), sum(share < 1.0 - ROUNDED for share, _ in found), min(found)[1], min(found)[0])
        for key in anchors
        if (found := shares.get(key))
    ]
