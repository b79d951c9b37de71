"""A row of a board run again, and compared with its records to the last digit."""

import itertools
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.board.scoring import Record, episode_key, latest, newest, score_episodes
from cablebench.protocol.protocol import Protocol
from cablebench.run.makers import told_apart
from cablebench.score.statistics import interquartile_mean

TIMED = ("inference_us",)
"""Metrics that measure the machine: no two runs have the same."""

_FLAGS = ("--controller", "--gain", "--policy")


@dataclass(frozen=True)
class Difference:
    """One number that did not come out as recorded."""

    seed: int
    where: str
    metric: str
    recorded: float | None
    replayed: float | None


@dataclass(frozen=True)
class Comparison:
    """Records against their replay: `score` pairs are interquartile means (NaN without references in the store)."""

    episodes: int
    recorded_score: float
    replayed_score: float
    differences: tuple[Difference, ...]

    @property
    def same(self) -> bool:
        """Whether every metric of every episode is the same number."""
        return not self.differences


def rows_of(records: Sequence[Record], protocol: Protocol, entrant: str, env_id: str, track: str) -> list[Record]:
    """The records behind a row of the board.

    Parameters
    ----------
    records : sequence of mapping
        Of the store.
    protocol : Protocol
    entrant, env_id, track : str
        Name the row.

    Returns
    -------
    list of mapping

    Raises
    ------
    ConfigurationError
        With the nearest names where there is no such row.
    """
    reserved = (protocol.open_loop, protocol.oracle, *protocol.paper.values())
    own = told_apart((r for r in records if r["protocol_hash"] == protocol.hash()), reserved)
    if not own:
        raise ConfigurationError(f"no records of protocol '{protocol.name}' (configuration {protocol.hash()})")
    row = newest(latest(r for r in own if (r["entrant"], r["env_id"], r["track"]) == (entrant, env_id, track)))
    if row:
        return row
    for key, value in (("entrant", entrant), ("env_id", env_id), ("track", track)):
        known = sorted({str(r[key]) for r in own})
        if value not in known:
            raise ConfigurationError(f"no records of {key.removesuffix('_id')} '{value}'; {nearest(value, known)}")
    raise ConfigurationError(f"'{entrant}' has no records on {env_id}, {track} track")


def arguments_of(row: Sequence[Record], folders: Sequence[Path]) -> dict[str, list[Record]]:
    """The flags that name the entrant -> its records: training seeds have their own. Paths may lie in ``folders``."""
    found: dict[str, list[Record]] = {}
    for r in row:
        words = shlex.split(r["replay"])
        pairs = list(itertools.pairwise(words))
        flags = [(flag, value) for flag, value in pairs if flag in _FLAGS]
        if not flags:
            raise ConfigurationError(f"the record's command names no controller or policy: {r['replay']}")
        flags = [(flag, value if flag == "--gain" else moved(value, folders)) for flag, value in flags]
        for flag, value in flags:
            if flag == "--policy" and not Path(value).exists():
                raise ConfigurationError(_how_to_make(value, r))
        found.setdefault(shlex.join([word for pair in flags for word in pair]), []).append(r)
    return found


def _how_to_make(path: str, record: Record) -> str:
    """What to do about the policy of a record that is not there: train it again, to the bit on the same processor."""
    train = f"cablebench train --env {record['task']} --algo {record['entrant']} --seed {record['training_seed']}"
    return (
        f"no policy at {path}: `{train} --out runs/again` and `cablebench publish runs/again --out "
        f"{Path(path).parent}` make it again; the record's policy has the hash {record['settings'].get('policy')}"
    )


def moved(path: str, folders: Sequence[Path]) -> str:
    """``path`` as it is, or the part of it that lies in a folder: a board may have been copied to another place."""
    given = Path(path)
    if given.exists() or len(given.parts) == 1:
        return path
    parts = given.parts[1:] if given.is_absolute() else given.parts
    inside = (folder.joinpath(*parts[k:]) for folder in folders for k in range(len(parts)))
    return next((str(found) for found in inside if found.exists()), path)


def compare(
    row: Sequence[Record], again: Sequence[Record], everything: Sequence[Record], protocol: Protocol
) -> Comparison:
    """A row's records against those of its replay, number by number.

    Parameters
    ----------
    row, again : sequence of mapping
        The records, and what was run anew.
    everything : sequence of mapping
        All records of the store: the references among them score both.
    protocol : Protocol

    Returns
    -------
    Comparison

    Raises
    ------
    ConfigurationError
        Where an episode of the row was not run again.
    """
    key: Callable[[Record], Any] = lambda r: (r["training_seed"], *episode_key(r))  # noqa: E731
    new = {key(r): r for r in again}
    differences = []
    for r in row:
        if key(r) not in new:
            raise ConfigurationError(f"episode {r['seed']} was not replayed: the record is of another protocol")
        differences += list(_differences(r, new[key(r)]))
    # scored together, so that both see the same references; replayed references stand in for nobody
    others = [r for r in latest(everything) if r["entrant"] in (protocol.open_loop, protocol.oracle)]
    others = [r for r in others if r["protocol_hash"] == protocol.hash()]
    renamed = [{**new[key(r)], "entrant": f"{r['entrant']} again"} for r in row]
    scores = score_episodes([*others, *({**r, "entrant": f"{r['entrant']} then"} for r in row), *renamed], protocol)
    then, now = scores[len(others) : len(others) + len(row)], scores[len(others) + len(row) :]
    return Comparison(len(row), _iqm(then), _iqm(now), tuple(differences))


def runs_again(row: Sequence[Record], again: Sequence[Record]) -> dict[str, str]:
    """The run of the replay that stands for each run of a row.

    Parameters
    ----------
    row, again : sequence of mapping
        As of `compare`.

    Returns
    -------
    dict
        Key of the recorded run -> key of the one that was run anew.
    """
    new = {(r["training_seed"], *episode_key(r)): r["run"] for r in again}
    return {r["run"]: new[r["training_seed"], *episode_key(r)] for r in row}


def _iqm(values: Sequence[float]) -> float:
    return float(interquartile_mean(np.array(values)))


def _differences(recorded: Record, replayed: Record) -> list[Difference]:
    def sweep(r: Mapping[str, Any]) -> str:
        return f", {r['sweep']} = {r['sweep_value']:g}" if r.get("sweep") else ""

    a, b = recorded["metrics"], replayed["metrics"]
    return [
        Difference(recorded["seed"], recorded["track"] + sweep(recorded), name, a.get(name), b.get(name))
        for name in differing(a, b)
    ]


def differing(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Names of the metrics that are not as recorded; one that is younger than the record cannot differ from it."""
    return [name for name in recorded if name not in TIMED and recorded[name] != now.get(name)]
