"""Levels of the tasks of suite v1: from a task's file to the options of an environment and its `Conditions`.

```yaml
conditions:                  # what all levels have: options of an environment, and the keys below
  rig: {tension_command_limit: 100.0}
  start: [-0.01, 0.01]       # how far from its reference the output begins, drawn evenly
  unhomed: {drive_position: 0.03}        # an encoder whose zero differs in each episode by up to this
  sensors: {drive_velocity: {of: drive_position, filter: 0.01}}
  rules: {overload: {signal: peak_tension, high: 100.0, longer_than: 0.05}}
  activity: 0.01             # share of the command's range above 10 Hz that costs as much as an error of error_scale
levels:
  Hard:                      # options and keys that this level has besides, or otherwise
    reference: {kind: multisine, amplitude: 0.01, frequency: [0.05, 0.2], start: 3.0}
    train: {randomize: {load_mass: {scale: [0.8, 1.2]}}}  # and those of the rigs to train on
    test: {randomize: {load_mass: {scale: [0.6, 0.8]}}}   # and of those to be tested on
    # cables: {rigs: [gu-steel-2mm], take: [friction_coefficient]}: presets of which an episode has the parameters
```
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import is_number
from cable_envs.plants.base import Plant
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.suite.drawing import CABLES, PLACES, draws
from cable_envs.sim.suite.judging import Rule
from cable_envs.sim.suite.sensing import Sensor
from cable_envs.sim.tasks import ERROR, LEVELS, Task

SPLITS = ("train", "test")
OWN = ("start", "unhomed", "sensors", "rules", "activity", "cables")
"""Keys of conditions and levels that are no options of an environment."""
_JOINED = ("unhomed", "sensors", "rules", "randomize", "rig", "effects")
SENSORS = ("rig", "ideal")


USUAL: Mapping[str, Any] = {
    "reference": None, "rig": None, "effects": None, "plant": None, "action_mode": None, "observe": None,
    "randomize": False, "sensor_noise": False, "sensor_delay": 0, "action_delay": 0, "disturbance": None,
    "posture": None, "control_period": None, "substeps": None, "duration": None,
}  # fmt: skip
"""Options that a level may give, as they are where neither it nor the caller says otherwise; None: what the task or
the rig says, or nothing."""


@dataclass(frozen=True)
class Conditions:
    """What a level of a task of the suite has, beside the options of an environment.

    Attributes
    ----------
    level, split : str
        Names.
    start : tuple of (float, float)
        How far from its reference the output begins, in its unit; drawn evenly from this range.
    unhomed : mapping of str to float
        Positions of the drive that are measured from an unknown zero; largest distance of it, SI.
    sensors : mapping of str to Sensor
        By signal.
    rules : tuple of Rule
        What ends an episode.
    activity : float
        Share of the command's range above 10 Hz that costs as much as an error of the task's ``error_scale``.
    preview : bool
        Whether the acceleration of the reference is shown; else its channel is 0.
    cables : ndarray, shape (parameters, k)
        Values of k cables of which an episode draws one, in the rows ``cable_rows`` of the plant's table.
    cable_rows : tuple of int
        Rows of the plant's table.
    observe : str
        The most that may be observed with the level's own sensors.
    """

    level: str
    split: str
    start: tuple[float, float]
    unhomed: Mapping[str, float]
    sensors: Mapping[str, Sensor]
    rules: tuple[Rule, ...]
    activity: float
    preview: bool
    cables: np.ndarray
    cable_rows: tuple[int, ...]
    observe: str

    def draw_cable(self, column: np.ndarray, key: float) -> None:
        """Write the parameters of one of the level's cables, where it has some, into a rig.

        Parameters
        ----------
        column : ndarray, shape (len(plant.table),)
            Values of the rig; changed in place.
        key : float
            Key of the episode.
        """
        if self.cable_rows:
            column[list(self.cable_rows)] = self.cables[:, draws(key, CABLES).integers(self.cables.shape[1])]

    def places(self, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where episodes begin, and where their encoders have their zeros.

        Parameters
        ----------
        keys : ndarray, shape (n,)
            Keys of the episodes.

        Returns
        -------
        away, zeros : ndarray, shape (n,)
            Distance of the outputs from their references, and of the zeros, SI.
        """
        low, high = self.start
        reach = max(self.unhomed.values(), default=0.0)
        at = np.array([draws(key, PLACES).random(2) for key in keys])
        return low + at[:, 0] * (high - low), reach * (2.0 * at[:, 1] - 1.0)


def content_of(task: Task, level: str | None, split: str) -> dict[str, Any]:
    """What a level says: the task's conditions, the level's own, and those of the split.

    Parameters
    ----------
    task : Task
        Any task.
    level : str or None
        Name of one of its levels; None for a task without levels.
    split : str
        "train" or "test".

    Returns
    -------
    dict
        Options of an environment, and keys of `OWN`; empty for a task without levels.

    Raises
    ------
    ConfigurationError
        For unknown names and keys, with the nearest, for a level of a task that has none, and without a level of one
        that has.

    Examples
    --------
    >>> from cable_envs.sim.tasks import load_task
    >>> content_of(load_task("CableHole-Track"), "Easy", "train")["sensor_noise"]
    True
    """
    if level is None:
        if task.levels:
            raise ConfigurationError(f"task {task.name} needs a level; one of {', '.join(task.levels)}")
        return {}
    if not task.levels:
        raise ConfigurationError(f"task {task.name} has no levels; leave out 'level'")
    if level not in task.levels:
        raise ConfigurationError(f"unknown level '{level}' of task {task.name}; {nearest(level, task.levels)}")
    if split not in SPLITS:
        raise ConfigurationError(f"unknown split '{split}'; {nearest(str(split), SPLITS)}")
    found: dict[str, Any] = {}
    own = task.levels[level]
    for part in (task.conditions, {k: v for k, v in own.items() if k not in SPLITS}, own.get(split) or {}):
        joined = {k: {**(found.get(k) or {}), **part[k]} for k in _JOINED if isinstance(part.get(k), Mapping)}
        found = {**found, **part, **joined}
    require_known(f"key in level {level} of task {task.name}", found, (*OWN, *USUAL))
    return found


def make_conditions(
    task: Task, content: Mapping[str, Any], level: str, split: str, plant: Plant, sensors: str, preview: bool
) -> Conditions:
    """The validated conditions of a level.

    Parameters
    ----------
    task : Task
        Its task.
    content : mapping
        What the level says (`content_of`).
    level, split : str
        Their names.
    plant : Plant
        What simulates the rig.
    sensors : str
        "rig", or "ideal" for sensors without quantisation, rate, latency and unknown zero.
    preview : bool
        Whether the acceleration of the reference is shown.

    Returns
    -------
    Conditions

    Raises
    ------
    ConfigurationError
        For unknown signals and keys, with the nearest, and values that cannot be.
    """
    if sensors not in SENSORS:
        raise ConfigurationError(f"unknown sensors '{sensors}'; {nearest(str(sensors), SENSORS)}")
    signals = [s.name for s in plant.signals]
    where = f"of level {level} of task {task.name}"
    unhomed, given = content.get("unhomed") or {}, content.get("sensors") or {}
    require_known(f"unhomed signal {where}", unhomed, signals)
    require_known(f"sensor {where}", given, signals)
    ideal = sensors == "ideal"
    rows, cables = _cables(content.get("cables"), plant, where)
    low, high = _pair(content.get("start", (0.0, 0.0)), f"start {where}")
    return Conditions(
        level=level,
        split=split,
        start=(low, high),
        unhomed={} if ideal else {name: _above(reach, f"unhomed.{name} {where}") for name, reach in unhomed.items()},
        sensors={} if ideal else {name: _sensor(one, given, f"{name} {where}") for name, one in given.items()},
        rules=tuple(_rule(name, one, signals, where) for name, one in (content.get("rules") or {}).items()),
        activity=_above(content.get("activity"), f"activity {where}"),
        preview=bool(preview),
        cables=cables,
        cable_rows=rows,
        observe=_allowed(task, content),
    )


def check_observed(task: Task, content: Mapping[str, Any], level: str, observed: str, sensors: str) -> None:
    """Refuse sensors that a level does not have.

    Parameters
    ----------
    task : Task
        Its task.
    content : mapping
        What the level says.
    level : str
        Its name.
    observed : str
        Level of observation that is asked for.
    sensors : str
        With "ideal" ones everything may be observed.

    Raises
    ------
    ConfigurationError
        Where more is asked for than the level has.
    """
    allowed = _allowed(task, content)
    if sensors != "ideal" and LEVELS.index(observed) > LEVELS.index(allowed):
        raise ConfigurationError(
            f"level {level} of task {task.name} has sensors of '{allowed}' only; observe='{observed}' needs "
            "sensors='ideal', as for an oracle"
        )


def _allowed(task: Task, content: Mapping[str, Any]) -> str:
    return str(content.get("observe") or task.observe)


def check_derived(conditions: Conditions, sensors: Iterable[str]) -> None:
    """Refuse a speed that is the difference of a position which is not measured.

    Parameters
    ----------
    conditions : Conditions
        With the sensors as they are declared.
    sensors : iterable of str
        Signals that are measured.

    Raises
    ------
    ConfigurationError
        Names both.
    """
    measured = set(sensors)
    for name, sensor in conditions.sensors.items():
        if name in measured and sensor.of and sensor.of not in measured:
            raise ConfigurationError(f"sensor {name} is the difference of {sensor.of}, which is not observed")


def _sensor(given: Mapping[str, Any], others: Iterable[str], what: str) -> Sensor:
    require_known(f"key of sensor {what}", given, [f.name for f in fields(Sensor)])
    for name, value in given.items():
        if name == "of":
            require_known(f"position under 'of' of sensor {what}", [value], list(others))
        elif not is_number(value) or value < 0.0:
            raise ConfigurationError(f"{name} of sensor {what}: expected a number >= 0, got {value!r}")
    return Sensor(**given)


def _rule(name: str, given: Mapping[str, Any], signals: list[str], where: str) -> Rule:
    require_known(f"key of rule {name} {where}", given, [f.name for f in fields(Rule) if f.name != "name"])
    require_known(f"signal of rule {name} {where}", [given.get("signal", "")], [ERROR, *signals])
    for key in ("low", "high", "longer_than"):
        if key in given and not is_number(given[key]):
            raise ConfigurationError(f"{key} of rule {name} {where}: expected a number, got {given[key]!r}")
    return Rule(name, **given)


def _cables(given: Any, plant: Plant, where: str) -> tuple[tuple[int, ...], np.ndarray]:
    if not given:
        return (), np.zeros((0, 0))
    require_known(f"key of cables {where}", given, ("rigs", "take"))
    rows = tuple(plant.table.index(name) for name in given["take"])
    columns = [load_rig(name).column(plant)[list(rows), 0] for name in given["rigs"]]
    return rows, np.array(columns).T


def _pair(value: Any, what: str) -> tuple[float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 2 or not all(map(is_number, value)) or value[0] > value[1]:
        raise ConfigurationError(f"{what}: expected two rising numbers, got {value!r}")
    return float(value[0]), float(value[1])


def _above(value: Any, what: str) -> float:
    if not is_number(value) or value <= 0.0:
        raise ConfigurationError(f"{what}: expected a number above 0, got {value!r}")
    return float(value)
