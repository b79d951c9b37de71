"""The record of an episode: what was run, what came out, and where the numbers come from."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from cable_envs.core.config import configuration_hash
from cable_envs.core.files import jsonable
from cable_envs.core.provenance import machine, versions
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.episode import Episode
from cablebench.protocol.failures import scored_error
from cablebench.protocol.metrics import measure
from cablebench.protocol.protocol import Cell, Protocol
from cablebench.run.store import ResultStore

TRAJECTORY_POINTS = 400
"""Samples kept of the median and the worst episode of a run, for drawing."""


def known_seeds(store: ResultStore) -> dict[str, set[int]]:
    """The seeds that the store holds of every run."""
    found: dict[str, set[int]] = {}
    for record in store.read().records:
        found.setdefault(record["run"], set()).add(record["seed"])
    return found


def run_key(protocol: Protocol, cell: Cell, entrant: Entrant, options: Mapping[str, Any]) -> str:
    """Names one run: everything that decides its numbers, the simulator's source included."""
    decides = {
        "protocol": protocol.hash(),
        "cell": cell.key,
        "env": cell.task.env,
        "options": options,
        "entrant": entrant.name,
        "settings": entrant.settings,
        "training_seed": entrant.training_seed,
        "source": versions()["source"],
    }
    if entrant.maker:
        decides["maker"] = entrant.maker
    return configuration_hash(decides)


def facts(episode: Episode) -> dict[str, Any]:
    """What a record says about the episode itself and where it was run."""
    return {
        "output_unit": episode.output_unit,
        "command_unit": episode.command_unit,
        "metrics": measure(episode),
        "machine": machine(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def badness(record: Mapping[str, Any]) -> float:
    """The error that a record or `facts` is scored by; infinite where the episode failed."""
    return math.inf if record["metrics"]["failed"] else scored_error(record["metrics"])


def make_record(
    protocol: Protocol,
    cell: Cell,
    entrant: Entrant,
    options: Mapping[str, Any],
    run: str,
    seed: int,
    found: Mapping[str, Any],
) -> dict[str, Any]:
    """The store's record of an episode.

    Parameters
    ----------
    protocol, cell, entrant
        What was run.
    options : mapping
        Of the environment.
    run : str
        `run_key` of these.
    seed : int
        Of the episode.
    found : mapping
        `facts` of the episode.

    Returns
    -------
    dict
        JSON types only.
    """
    record = {
        "protocol": protocol.name,
        "protocol_version": protocol.version,
        "protocol_hash": protocol.hash(),
        "run": run,
        "env_id": cell.task.env,
        "task": cell.task.short,
        "family": cell.task.family,
        "track": cell.track.name,
        "sweep": cell.sweep.name if cell.sweep else None,
        "sweep_value": cell.value,
        "sweep_unit": cell.sweep.unit if cell.sweep else "1",
        "entrant": entrant.name,
        "information": entrant.information,
        "training_seed": entrant.training_seed,
        "seed": seed,
        "options": dict(options),
        "settings": dict(entrant.settings),
        "charged": dict(entrant.charged),
        "versions": {**versions(), **entrant.versions},
        "maker": entrant.maker,
        "sandbox": entrant.sandbox,
        "seal": protocol.seal,
        "replay": entrant.replay(protocol.name, cell.task.env, cell.track.name),
        **found,
    }
    return jsonable(record)


def typical(kept: list[tuple[float, Episode]]) -> dict[str, dict[str, np.ndarray]]:
    """The median and the worst episode of a run, thinned for drawing.

    Parameters
    ----------
    kept : list of (float, Episode)
        Error, infinite for a failed episode, and the episode.

    Returns
    -------
    dict of dict
        "median" and "worst" -> arrays by name (`Episode.thinned`).
    """
    order = sorted(range(len(kept)), key=lambda i: kept[i][0])
    chosen = {"median": order[(len(order) - 1) // 2], "worst": order[-1]}
    return {kind: kept[i][1].thinned(TRAJECTORY_POINTS) for kind, i in chosen.items()}
