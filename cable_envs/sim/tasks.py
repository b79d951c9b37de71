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

from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.inputs import COMMAND, COMMAND_RATE, DISTURBANCE, MODE
from cable_envs.core.kernels import clip, inline
from cable_envs.core.noise import normal
from cable_envs.sim.references import signal

SCHEMA = "cable-task/1"
LEVELS = ("drive", "output", "full")
TASKS = config_names("tasks")
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
def before_step(u, disturbance, action, i, time, low, high, mode, period):
    """Action in [-1, 1] -> command, its rate since the last one, and the disturbance at this time."""
    command = low + 0.5 * (action + 1.0) * (high - low)
    u[COMMAND_RATE, i] = (command - u[COMMAND, i]) / period
    u[COMMAND, i] = command
    u[MODE, i] = mode
    u[DISTURBANCE, i] = signal(disturbance, i, time)[0]


@inline
def target(q, steps, period, r, rate, acceleration, lo, hi):
    """The reference and its derivatives at the present step."""
    for i in range(lo, hi):
        r[i], rate[i], acceleration[i] = signal(q, i, steps[i] * period)


@inline
def sense(x, sensor, deviation, sensors, steps, keys, ring, slots, lo, hi):
    """Measure the signals ``sensor`` with their noise, into the ring [slots * sensors, environments]."""
    for k in range(sensors):
        row, spread = int(sensor[k]), deviation[k]
        if slots > 1:
            for i in range(lo, hi):
                noise = spread * normal(keys[i], steps[i], row) if spread > 0.0 else 0.0
                ring[int(steps[i]) % slots * sensors + k, i] = x[row, i] + noise
        elif spread > 0.0:
            for i in range(lo, hi):
                ring[k, i] = x[row, i] + spread * normal(keys[i], steps[i], row)
        else:
            for i in range(lo, hi):
                ring[k, i] = x[row, i]


@inline
def refill(ring, sensors, slots, lo, hi):
    """Before an episode nothing has changed: all slots of the ring hold the first measurement (step 0, slot 0)."""
    for row in range(sensors, slots * sensors):
        for i in range(lo, hi):
            ring[row, i] = ring[row % sensors, i]


@inline
def _scaled(row, unit, obs, c, lo, hi):
    for i in range(lo, hi):
        obs[i, c] = np.float32(clip(row[i] / unit, -OBSERVATION_LIMIT, OBSERVATION_LIMIT))


@inline
def _late(ring, sensors, slots, source, steps, row, lo, hi):
    """The oldest measurement of a sensor in the ring, into ``row``."""
    for i in range(lo, hi):
        row[i] = ring[int(steps[i] + 1.0) % slots * sensors + source, i]


@inline
def observe(
    channel, scale, ring, sensors, slots, proxy, steps, r, rate, acceleration, command, proxy_gain, scratch, obs, lo, hi
):  # fmt: skip
    """obs[i, c]: channel c over its scale. Measurements are the oldest of the ring; the reference is never late."""
    for c in range(channel.shape[0]):
        source, unit = int(channel[c]), scale[c]
        if source == REFERENCE:
            _scaled(r, unit, obs, c, lo, hi)
        elif source == REFERENCE_RATE:
            _scaled(rate, unit, obs, c, lo, hi)
        elif source == REFERENCE_ACCELERATION:
            _scaled(acceleration, unit, obs, c, lo, hi)
        elif source == LAST_COMMAND:
            _scaled(command, unit, obs, c, lo, hi)
        else:
            sensor = proxy if source == ERROR else source
            if slots > 1:
                _late(ring, sensors, slots, sensor, steps, scratch, lo, hi)
            measured = scratch if slots > 1 else ring[sensor]
            if source == ERROR:
                for i in range(lo, hi):
                    scratch[i] = r[i] - measured[i] / proxy_gain[i]
                _scaled(scratch, unit, obs, c, lo, hi)
            else:
                _scaled(measured, unit, obs, c, lo, hi)


@inline
def reward(error, change, error_scale, effort_weight):
    """Reward for an absolute tracking error and a change of the action."""
    return 1.0 / (1.0 + error / error_scale) - effort_weight * change * change
