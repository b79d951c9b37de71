"""A task: which output of which rig follows which reference, what is observed, and how a step is rewarded.

Tasks are declared in configs/tasks/*.yaml; `load_task` validates one.

    reward = 1 / (1 + |error| / error_scale) - effort_weight (a - a_previous)^2

It lies in (0, 1] but for the effort term, so an episode that ends early (torn cable) loses what was still to earn.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.kernels import inline
from cable_envs.core.lanes import Lanes

SCHEMA = "cable-task/1"
LEVELS = ("drive", "output", "full")
TASKS = config_names("tasks")
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
    """One entry of the observation: observation = SI value / scale."""

    name: str
    unit: str
    scale: float
    measured: bool
    """whether it is a signal of the plant, measured by a sensor"""


@dataclass(frozen=True)
class Task:
    """The content of a task file, validated (see configs/tasks)."""

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

    @property
    def kind(self) -> str:
        """What is controlled: "position", "tension" or "torque"."""
        return self.name.split("-")[1].lower()

    def observed(self, level: str) -> tuple[str, ...]:
        """Plant signals observed at a level; each level includes the ones before it."""
        require_known("observe level", [level], LEVELS)
        return tuple(n for lv in LEVELS[: LEVELS.index(level) + 1] for n in self.observe_levels[lv])


def load_task(name: str) -> Task:
    """The task ``name``, one of `TASKS`. Raises ConfigurationError for unknown names or keys."""
    require_known("task", [name], TASKS)
    data = read_yaml(config_path("tasks", f"{name}.yaml"))
    if data.pop("schema", None) != SCHEMA:
        raise ConfigurationError(f"task {name}: schema must be '{SCHEMA}'")
    keys = [f.name for f in fields(Task)]
    require_known(f"key in task {name}", data, keys)
    missing = [key for key in keys if key not in data]
    if missing:
        raise ConfigurationError(f"task {name}: missing {', '.join(missing)}")
    return Task(**data)


@inline
def command_of(action, low, high):
    """The command that an action in [-1, 1] asks for: linear over the range of the action mode."""
    return low + 0.5 * (action + 1.0) * (high - low)


@inline
def reward(error, change, error_scale, effort_weight):
    """Reward for an absolute tracking error and a change of the action."""
    return 1.0 / (1.0 + error / error_scale) - effort_weight * change * change
