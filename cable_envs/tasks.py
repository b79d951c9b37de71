"""A task: which output of which rig follows which reference, what is observed, and how a step is rewarded.

Tasks are declared in configs/tasks/*.yaml; `load_task` validates one. The kernels at the end are shared by single and
batched environments: `before_step` turns an action into the plant's inputs, `after_step` measures, rewards and
terminates.

    reward = 1 / (1 + |error| / error_scale) - effort_weight (a - a_previous)^2

It lies in (0, 1] but for the effort term, so an episode that ends early (torn cable) loses what was still to earn.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cable_envs.config import config_path, read_yaml
from cable_envs.errors import ConfigurationError, require_known
from cable_envs.kernels import clip, inline
from cable_envs.noise import normal
from cable_envs.plants.base import COMMAND, COMMAND_RATE, DISTURBANCE, MODE
from cable_envs.references import signal

SCHEMA = "cable-task/1"
LEVELS = ("drive", "output", "full")
TASKS = ("CableHole-Position", "CableHole-Tension", "PulleyCircuit-Position", "PulleyCircuit-Torque")
REFERENCES = ("Step", "Sine")
OBSERVATION_LIMIT = 100.0
"""Observations are SI values over their scale, limited to +/- this many scales."""

# channels that are no signal of the plant carry these rows
REFERENCE, REFERENCE_RATE, REFERENCE_ACCELERATION, ERROR, LAST_COMMAND = -1, -2, -3, -4, -5
INFO = ("time", "reference", "output", "error", "command", "overload")


@dataclass(frozen=True)
class Channel:
    """One entry of the observation: observation = SI value / scale."""

    name: str
    unit: str
    scale: float
    row: int


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
def before_step(u, disturbance, action, last, i, time, low, high, mode, period):
    """Action in [-1, 1] -> command, its rate since the ``last`` command, and the disturbance at this time."""
    command = low + 0.5 * (action + 1.0) * (high - low)
    u[COMMAND_RATE, i] = (command - last) / period
    u[COMMAND, i] = command
    u[MODE, i] = mode
    u[DISTURBANCE, i] = signal(disturbance, i, time)[0]


@inline
def observe(x, u, q, i, step, period, key, rows, scales, noise, proxy_row, proxy_gain, obs):
    """Measure: signals with sensor noise, the reference and its derivatives; writes obs[i, :]."""
    r, rate, acceleration = signal(q, i, step * period)
    for c in range(rows.shape[0]):
        row = rows[c]
        if row >= 0:
            value = x[row, i]
            if noise[row] > 0.0:
                value += noise[row] * normal(key, step, row)
        elif row == REFERENCE:
            value = r
        elif row == REFERENCE_RATE:
            value = rate
        elif row == REFERENCE_ACCELERATION:
            value = acceleration
        elif row == ERROR:
            value = x[proxy_row, i]
            if noise[proxy_row] > 0.0:
                value += noise[proxy_row] * normal(key, step, proxy_row)
            value = r - value / proxy_gain
        else:
            value = u[COMMAND, i]
        obs[i, c] = np.float32(clip(value / scales[c], -OBSERVATION_LIMIT, OBSERVATION_LIMIT))


@inline
def after_step(x, u, q, i, step, period, output_row, peak_row, tension_limit, info):
    """Writes the six values of `INFO`; returns the tracking error (reference minus true output)."""
    time = step * period
    r = signal(q, i, time)[0]
    error = r - x[output_row, i]
    info[0, i] = time
    info[1, i] = r
    info[2, i] = x[output_row, i]
    info[3, i] = error
    info[4, i] = u[COMMAND, i]
    info[5, i] = 1.0 if x[peak_row, i] > tension_limit else 0.0
    return error
