"""A task: which output of which rig follows which reference, what is observed, and how a step is rewarded.

Tasks are declared in configs/tasks/*.yaml; `load_task` validates one.

    reward = 1 / (1 + |error| / error_scale) - effort_weight (a - a_previous)^2

It lies in (0, 1] but for the effort term, so an episode that ends early (torn cable) loses what was still to earn.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import numpy as np

from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.kernels import inline
from cable_envs.core.lanes import Lanes

SCHEMA, SUITE_SCHEMA = "cable-task/1", "cable-suite/1"
LEVELS = ("drive", "output", "full")
TASKS = config_names("tasks")
SUITE = config_names("suite")
"""Names of the tasks of suite v1 (configs/suite), which have levels."""
REFERENCES = ("Step", "Sine")
OBSERVATION_LIMIT = 100.0
"""Observations are SI values over their scale, limited to +/- this many scales."""

REFERENCE, REFERENCE_RATE, REFERENCE_ACCELERATION, ERROR, COMMAND = (
    "reference", "reference_rate", "reference_acceleration", "error", "command",
)  # fmt: skip
"""Names of the channels that are no signal of the plant."""

INFO = Lanes("Info", ["time", "reference", "output", "error", "command", "overload"])
"""What an info holds beside the plant's signals."""


@dataclass(frozen=True)
class Channel:
    """One entry of an observation, which is the SI value over the scale.

    Attributes
    ----------
    name : str
        Name of the signal, or of one of the channels that are no signal of the plant.
    unit : str
        SI unit.
    scale : float
        SI value that is observed as 1.
    measured : bool
        Whether it is a signal of the plant, measured by a sensor.
    """

    name: str
    unit: str
    scale: float
    measured: bool


@dataclass(frozen=True)
class Task:
    """The validated content of a task file (configs/tasks, configs/suite).

    Attributes
    ----------
    name, description : str
        Name of the file, and what it is about.
    rigs : mapping of str to str
        Rig of the first episodes of each version of the ids, where it is not ``rig``.
    since : str
        First version of the ids that the task has.
    rig : str
        Preset that the task is made for.
    output : str
        Signal that should follow the reference.
    proxy : str
        Signal that stands for the output, through the rigid transmission ratio, where that is not observed.
    action_mode : str
        What a command is unless the environment says otherwise.
    observe : str
        Level of observation unless the environment says otherwise: "drive", "output" or "full".
    duration, control_period : float
        Length of an episode and of a control step, s.
    substeps : int
        Integration steps in a control step.
    error_scale : float
        Error at which the reward is one half, in the unit of the output.
    effort_weight : float
        Weight of the squared change of the action.
    success_error : float
        Largest error of the last fifth of an episode that counts as success, in the unit of the output.
    references : mapping of str to mapping
        Signals by name, "step" and "sine" (`cable_envs.sim.references`).
    scales : mapping of str to float
        SI value that is observed as 1, for every signal of the plant, "error" and "command".
    observe_levels : mapping of str to list of str
        Signals that each level adds to those of the level before it.
    sensor_noise : mapping of str to float
        Standard deviation of the noise on signals, SI, where noise is asked for.
    randomize : mapping of str to mapping
        Ranges of parameters, where randomisation is asked for: ``{"scale": [a, b]}`` or ``{"low": a, "high": b}``.
    extends : str
        Of a task of the suite: the task whose keys it has where it gives none.
    homing : float
        Of a task of the suite: time at the start in which the reference stands and nothing is scored, s.
    conditions : mapping
        Of a task of the suite: what its levels have in common (`cable_envs.sim.suite.levels`).
    levels : mapping of str to mapping
        What each level has besides; a task that is not of the suite has none.
    """

    name: str
    description: str
    rig: str
    output: str
    proxy: str
    action_mode: str
    observe: str
    duration: float
    control_period: float
    substeps: int
    error_scale: float
    effort_weight: float
    success_error: float
    references: Mapping[str, Mapping[str, Any]]
    scales: Mapping[str, float]
    observe_levels: Mapping[str, list[str]]
    sensor_noise: Mapping[str, float]
    randomize: Mapping[str, Mapping[str, Any]]
    rigs: Mapping[str, str] = field(default_factory=dict)
    since: str = "v0"
    extends: str = ""
    homing: float = 0.0
    conditions: Mapping[str, Any] = field(default_factory=dict)
    levels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """What is controlled: "position", "tension" or "torque"."""
        return (self.extends or self.name).split("-")[1].lower()

    def observed(self, level: str) -> tuple[str, ...]:
        """Signals of the plant that are observed at a level.

        Parameters
        ----------
        level : str
            "drive", "output" or "full".

        Returns
        -------
        tuple of str
            Signals of this level and of those before it.

        Raises
        ------
        ConfigurationError
            For an unknown level.

        Examples
        --------
        >>> load_task("CableHole-Tension").observed("output")
        ('drive_position', 'drive_velocity', 'drive_tension', 'load_tension')
        """
        require_known("observe level", [level], LEVELS)
        return tuple(n for lv in LEVELS[: LEVELS.index(level) + 1] for n in self.observe_levels[lv])


def load_task(name: str) -> Task:
    """A task by its name.

    Parameters
    ----------
    name : str
        One of `TASKS` or `SUITE`.

    Returns
    -------
    Task
        The content of its file.

    Raises
    ------
    ConfigurationError
        For an unknown name, with the nearest, and for a file with missing or unknown keys.

    Examples
    --------
    >>> load_task("PulleyCircuit-Torque").kind, load_task("CableHole-Track").kind
    ('torque', 'position')
    """
    require_known("task", [name], (*TASKS, *SUITE))
    data = _of_suite(name) if name in SUITE else _content(name, "tasks", SCHEMA)
    keys = [f.name for f in fields(Task)]
    require_known(f"key in task {name}", data, keys)
    needed = [f.name for f in fields(Task) if f.default is MISSING and f.default_factory is MISSING]
    missing = [key for key in needed if key not in data]
    if missing:
        raise ConfigurationError(f"task {name}: missing {', '.join(missing)}")
    return Task(**data)


def _content(name: str, folder: str, schema: str) -> dict[str, Any]:
    data = read_yaml(config_path(folder, f"{name}.yaml"))
    if data.pop("schema", None) != schema:
        raise ConfigurationError(f"task {name}: schema must be '{schema}'")
    return data


def _of_suite(name: str) -> dict[str, Any]:
    """A task of the suite: its own keys over those of the task that it extends; scales are joined."""
    own = _content(name, "suite", SUITE_SCHEMA)
    base = _content(str(own.get("extends")), "tasks", SCHEMA)
    scales = {**base["scales"], **own.get("scales", {})}
    return {**base, "rigs": {}, **own, "scales": scales, "since": "v1"}


@inline
def command_of(action, low, high):
    """The command that an action asks for, linear over the range of the action mode.

    Parameters
    ----------
    action : float
        In [-1, 1].
    low, high : float
        Commands of the actions -1 and 1.

    Returns
    -------
    float
        In the unit of ``low`` and ``high``.
    """
    return low + 0.5 * (action + 1.0) * (high - low)


@inline
def reward(error, change, error_scale, effort_weight):
    """Reward of a control step (equation at the head of this module).

    Parameters
    ----------
    error : float
        Absolute tracking error, SI.
    change : float
        Change of the action since the last step.
    error_scale : float
        Error at which the first term is one half, SI.
    effort_weight : float
        Weight of the squared change.

    Returns
    -------
    float
        At most 1.
    """
    return 1.0 / (1.0 + error / error_scale) - effort_weight * change * change


def action_of(command: np.ndarray, low: float, high: float) -> np.ndarray:
    """The actions that ask for commands: `command_of` the other way round.

    Parameters
    ----------
    command : ndarray
        In the unit of ``low`` and ``high``.
    low, high : float
        Commands of the actions -1 and 1.

    Returns
    -------
    ndarray
        Beyond -1 or 1 where a command is beyond the range.
    """
    return 2.0 * (command - low) / (high - low) - 1.0
