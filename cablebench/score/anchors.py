"""Frozen anchors: the errors of open loop and bound that belong to the version of a task.

They are numbers in a file (configs/anchors), so that no entrant's score depends on who else was run. Each entry holds
the hash of what its task is made of; where the task has changed since, the anchors are refused.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import yaml

from cable_envs.core.config import config_path, configuration_hash, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import write_atomic
from cable_envs.core.params import is_number
from cable_envs.sim.registered import setup_of
from cablebench.protocol.protocol import Protocol, Task, Track

SCHEMA = "cable-anchors/1"

LEAST_RATIO = 1.5
"""Of the open loop's error to the bound's. Below it a task has too little to gain for a score."""

_TYPES = {
    "task": str, "track": str, "open_loop": float, "bound": float, "unit": str, "open_loop_by": str, "bound_by": str,
    "episodes": int, "first_seed": int, "task_hash": str, "source": str, "off": float, "spread": float, "bounds": list,
}  # fmt: skip


@dataclass(frozen=True)
class Anchor:
    """The two errors between which a condition is scored, and how they were made."""

    task: str
    """id of the environment"""
    track: str
    """track or level of the protocol"""
    open_loop: float
    """median error of doing nothing, in `unit`"""
    bound: float
    """median of the least errors that were found with the true parameters, episode by episode, in `unit`"""
    unit: str
    open_loop_by: str
    bound_by: str
    """what made the two; of the bound how many episodes each"""
    episodes: int
    first_seed: int
    """the episodes have the seeds from this one on"""
    task_hash: str
    """`task_hash` of the task and track when the anchor was made"""
    source: str
    """hash of the simulator's source that made it"""
    off: float = 0.0
    """median share of the bound that the search says may still be gained (`cablebench.bound`)"""
    spread: float = 0.0
    """median of the share by which its second start ended above the first"""
    bounds: tuple[float, ...] = ()
    """the bound of each episode, in `unit`; empty: not kept"""

    def __post_init__(self) -> None:
        if not (0.0 < LEAST_RATIO * self.bound <= self.open_loop < math.inf):
            raise ConfigurationError(
                f"anchor of {self.task} ({self.track}): open loop {self.open_loop:g} {self.unit}, bound "
                f"{self.bound:g} {self.unit}; expected positive numbers, the first at least {LEAST_RATIO:g} times the "
                "second: a task without that much to gain cannot be scored"
            )


Anchors = Mapping[tuple[str, str], Anchor]
"""By id of the environment and name of the track."""


def task_hash(task: Task, track: Track) -> str:
    """Hash of what decides the episodes of a task on a track, other than the simulator's source.

    Parameters
    ----------
    task : Task
    track : Track
        Its sweeps do not count.

    Returns
    -------
    str
        Twelve hex digits over the task's YAML file, the rig's parameters, what the id is registered with, and the
        options of task and track. On tasks of suite v1 the file of the task that it extends, and the parameters of
        the cables that its episodes draw, count too.
    """
    options = {**task.options, **track.options}
    setup = setup_of(task.env, options)
    decides = {
        "env": task.env, "registered": gym.spec(task.env).kwargs, "options": options, "rig": setup.rig.content(),
    }  # fmt: skip
    if setup.conditions is None:
        return configuration_hash({**decides, "task": read_yaml(config_path("tasks", f"{setup.task.name}.yaml"))})
    own = read_yaml(config_path("suite", f"{setup.task.name}.yaml"))
    base = read_yaml(config_path("tasks", f"{own['extends']}.yaml"))
    return configuration_hash({**decides, "task": base, "suite": own, "cables": setup.conditions.cables.tolist()})


def anchors_path(name: str) -> Path:
    """The file of that name in configs/anchors, or the path of a YAML file. ConfigurationError where there is none."""
    given = Path(name)
    if given.suffix in (".yaml", ".yml") and given.is_file():
        return given
    return config_path("anchors", f"{name.removesuffix('.yaml')}.yaml", "file of anchors")


def load_anchors(name: str) -> dict[tuple[str, str], Anchor]:
    """The anchors in a file.

    Parameters
    ----------
    name : str
        Name in configs/anchors, or path of a YAML file.

    Returns
    -------
    dict
        `Anchor` by id of the environment and name of the track.

    Raises
    ------
    ConfigurationError
        Where there is no such file, and for entries that are wrong or stand twice.

    Examples
    --------
    >>> found = load_anchors("suite-v1")["cable_envs/CableHole-Track-Easy-v1", "test"]
    >>> found.unit, found.open_loop > found.bound, len(found.bounds) == found.episodes
    ('m', True, True)
    """
    path = anchors_path(name)
    data = read_yaml(path)
    require_known(f"key in {path.name}", data, ("schema", "note", "anchors"))
    if data.get("schema") != SCHEMA or not isinstance(data.get("anchors"), list):
        raise ConfigurationError(f"{path.name}: expected schema '{SCHEMA}' and a list 'anchors'")
    found: dict[tuple[str, str], Anchor] = {}
    for entry in data["anchors"]:
        anchor = _anchor(entry, path.name)
        if (anchor.task, anchor.track) in found:
            raise ConfigurationError(f"{path.name}: two anchors of {anchor.task} ({anchor.track})")
        found[anchor.task, anchor.track] = anchor
    return found


def _anchor(entry: Any, source: str) -> Anchor:
    if not isinstance(entry, Mapping):
        raise ConfigurationError(f"{source}: an anchor is a mapping with the keys {', '.join(_TYPES)}; found {entry!r}")
    require_known(f"key of an anchor in {source}", entry, tuple(_TYPES))
    given = {f.name: f.default for f in fields(Anchor) if f.default is not MISSING} | dict(entry)
    given["bounds"] = list(given["bounds"]) if isinstance(given["bounds"], (list, tuple)) else given["bounds"]
    for name, kind in _TYPES.items():
        value = given.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float) if kind is float else kind):
            raise ConfigurationError(f"{source}: {name} of an anchor is {value!r}; expected {kind.__name__}")
    if not all(is_number(bound) and bound > 0.0 for bound in given["bounds"]):
        raise ConfigurationError(f"{source}: bounds of an anchor are {given['bounds']!r}; expected numbers above 0")
    made = {name: kind(given[name]) for name, kind in _TYPES.items()}
    return Anchor(**{**made, "bounds": tuple(map(float, made["bounds"]))})


def anchors_of(protocol: Protocol, tasks: Sequence[Task] = ()) -> dict[tuple[str, str], Anchor]:
    """The anchors of a protocol's tasks on its tracks, each checked against the task as it is now.

    Parameters
    ----------
    protocol : Protocol
        Of score version 1.
    tasks : sequence of Task
        Of the protocol; empty: all.

    Returns
    -------
    dict
        `Anchor` by id of the environment and name of the track; conditions without an anchor are absent.

    Raises
    ------
    ConfigurationError
        Where a task has changed since its anchor was made.
    """
    known = load_anchors(protocol.anchors)
    found: dict[tuple[str, str], Anchor] = {}
    for task in tasks or protocol.tasks:
        for track in protocol.tracks:
            anchor = known.get((task.env, track.name))
            if anchor is None:
                continue
            now = task_hash(task, track)
            if anchor.task_hash != now:
                raise ConfigurationError(
                    f"the anchors '{protocol.anchors}' of {task.env} ({track.name}) are of another version of the "
                    f"task: made for {anchor.task_hash}, the task is {now}. Give the changed task a new id, or make "
                    f"its anchors again: `cablebench anchors --protocol {protocol.name} --env {task.short} --replace`"
                )
            found[task.env, track.name] = anchor
    return found


def _entry(anchor: Anchor) -> dict[str, Any]:
    """What the file has of an anchor: without what is as by default."""
    defaults = {f.name: f.default for f in fields(Anchor)}
    entry = {name: value for name, value in asdict(anchor).items() if value != defaults[name]}
    return entry | {name: list(value) for name, value in entry.items() if isinstance(value, tuple)}


def write_anchors(path: Path, anchors: Iterable[Anchor], note: str) -> Path:
    """Write a file of anchors, whole or not at all.

    Parameters
    ----------
    path : Path
    anchors : iterable of Anchor
    note : str
        For people: what the numbers are.

    Returns
    -------
    Path
    """
    ordered = sorted(anchors, key=lambda a: (a.task, a.track))
    head = yaml.safe_dump({"schema": SCHEMA, "note": note}, sort_keys=False, width=120)
    lines = [yaml.safe_dump(_entry(a), sort_keys=False, default_flow_style=True, width=10_000).strip() for a in ordered]
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_atomic(path, f"{head}anchors:\n" + "".join(f"  - {line}\n" for line in lines))
