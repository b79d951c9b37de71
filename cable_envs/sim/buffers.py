"""What a batch of environments is in memory: one block of named rows, the observations, and what is common to all."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.core.lanes import Lanes
from cable_envs.plants.base import OUT_OF_RANGE
from cable_envs.sim.references import FIELDS
from cable_envs.sim.setup import Setup
from cable_envs.sim.suite.judging import JUDGED, PAUSE, WINDOW, high_pass
from cable_envs.sim.suite.levels import Conditions
from cable_envs.sim.suite.sensing import Sensor
from cable_envs.sim.tasks import COMMAND, ERROR, INFO, REFERENCE, REFERENCE_ACCELERATION, REFERENCE_RATE

ENVIRONMENT = Lanes(
    "Environment",
    [
        "asked", "action", "last_action",  # the action to take, the one that acts now (late by its delay), the last
        "asked_second", "second_action", "last_second",  # the same of a second action
        "tension_limit", "breaking_tension",  # of the rig of this episode
        "proxy_gain", "error_seen",  # of what stands for the output; the error that it shows
        "key", "step",  # what is drawn from, and control steps since the reset
        "reference_rate", "reference_acceleration",
        ("inputs", INPUTS.count), ("followed", FIELDS.count),  # the reference
        ("push", FIELDS.count), ("bending", FIELDS.count),  # disturbance and posture
        # of the suite (`cable_envs.sim.suite`): the encoder's zero, what the command's high pass remembers, its mean
        # square, steps for which nothing is added to it, the reference to be expected, and its rate
        "zero", "passed_1", "passed_2", "power", "paused", "expected", "true_rate",
        "reward", "terminated", "truncated",
        ("info", INFO.count),
    ],
)  # fmt: skip
"""First rows of `Buffers.block`. Behind them: for tasks of the suite what is judged (`JUDGED`); the plant's signals and
the states of its effects; coefficients; what each sensor shows; a ring of what each showed before, where one is late; a
ring of actions, where these are, and behind it one of second actions; for tasks of the suite how long each rule has
been broken, and the last readings."""

LISTED = 64
"""Room for channels of an observation, and for sensors."""

COMMON = np.dtype([
    *((name, np.int64) for name in (
        "rows",  # of the block
        "signals", "states", "coefficients",  # rows of the plant, of its effects' states, of all coefficients
        "shown", "ring", "waiting",  # rows where these begin
        "channels", "sensors", "proxy",  # how many; which sensor stands for the output
        "slots", "late", "action_delay",  # measurements that are kept; control steps that all come late
        "actions",  # 1 or 2
        "output", "peak",  # rows among the signals
        "substeps", "last_step", "mode", "noisy",  # noisy: whether any sensor has noise
        "limits", "beyond",  # how many signals have a range; the row that says when one is outside
        "poses",  # whether the plant has a posture
        "judged", "rules", "counts", "kept",  # suite: rows that are judged; how many rules; rows where these begin
        "shifted", "preview",  # 1 where the encoder's zero shifts the command, and where the acceleration is shown
    )),
    *((name, np.float64) for name in (
        "dt", "period", "low", "high", "second_low", "second_high", "error_scale", "effort_weight",
        "pass_b", "pass_a1", "pass_a2", "fading", "activity_limit", "pause",  # of the suite's activity
    )),
    ("source", np.int64, LISTED), ("scale", np.float64, LISTED),  # of each channel: row, and SI value of one
    ("sensor", np.int64, LISTED), ("deviation", np.float64, LISTED),  # of each sensor: row among the signals, noise
    ("limited", np.int64, LISTED), ("least", np.float64, LISTED), ("most", np.float64, LISTED),  # their rows and ranges
    ("effects", np.int64, LISTED),  # of each sensor: first row of its effects among the coefficients, or -1
    # of each sensor in the suite: step of its quantiser, control steps between readings and until they are seen, the
    # sensor whose difference it is or -1, the filter's share of the newest, whether the encoder's zero is added
    ("quantum", np.float64, LISTED), ("every", np.int64, LISTED), ("behind", np.float64, LISTED),
    ("derived", np.int64, LISTED), ("smoothing", np.float64, LISTED), ("zeroed", np.float64, LISTED),
    # of each rule: row of its signal in the block, its range, control steps beyond it that are allowed
    ("rule", np.int64, LISTED), ("lowest", np.float64, LISTED), ("highest", np.float64, LISTED),
    ("allowed", np.float64, LISTED),
])  # fmt: skip
"""What is the same for all environments of a batch: counts, steps, and values in SI."""


@dataclass(frozen=True)
class Buffers:
    """Everything that a stepper reads and writes.

    Attributes
    ----------
    block : ndarray, shape (rows, columns)
        One column for each environment, padded by a cache line: with a stride that is a power of two all rows of an
        environment would compete for the same few places of the cache.
    obs : ndarray of float32, shape (n, channels)
        Observations.
    common : recarray, shape (1,)
        One record of `COMMON`.
    """

    block: np.ndarray
    obs: np.ndarray
    common: np.recarray

    @classmethod
    def of(cls, setup: Setup, n: int) -> "Buffers":
        """Zeroed buffers for ``n`` environments."""
        common = _common(setup)
        c = common[0]
        return cls(
            block=np.zeros((c.rows, n if n == 1 else n + 8)),
            obs=np.zeros((n, c.channels), dtype=np.float32),
            common=common,
        )

    @property
    def named(self) -> Any:
        """The first rows of the block by name (`ENVIRONMENT`), [n] or [count, n] each."""
        return ENVIRONMENT.over(self.block[:, : len(self.obs)])

    @property
    def u(self) -> Any:
        """Inputs of the plant by name (`INPUTS`), [n] each."""
        return INPUTS.over(self.named.inputs)

    @property
    def x(self) -> np.ndarray:
        """Signals of the plant and states of its effects, [rows, n]."""
        c = self.common[0]
        return self._rows(ENVIRONMENT.count + c.judged, c.signals + c.states)

    @property
    def p(self) -> np.ndarray:
        """Coefficients of the plant and its effects, [rows, n]."""
        c = self.common[0]
        return self._rows(ENVIRONMENT.count + c.judged + c.signals + c.states, c.coefficients)

    @property
    def outcome(self) -> np.ndarray:
        """Reward, terminated (0 or 1), truncated (0 or 1), then `table`, [rows, n]."""
        return self._from(ENVIRONMENT.row("reward"))

    @property
    def table(self) -> np.ndarray:
        """The values of an info: `INFO`, what is judged in the suite, then the plant's signals, [rows, n]."""
        return self._from(ENVIRONMENT.row("info"))

    def _from(self, first: int) -> np.ndarray:
        """Rows from there to the last of the plant's signals."""
        c = self.common[0]
        return self._rows(first, ENVIRONMENT.count - first + c.judged + c.signals)

    def _rows(self, first: int, count: int) -> np.ndarray:
        return self.block[first : first + count, : len(self.obs)]


def _common(setup: Setup) -> np.recarray:
    """The record of `COMMON` for a setup."""
    plant, task, channels, sensors = setup.plant, setup.task, setup.channels, setup.sensors
    if max(len(channels), len(sensors)) > LISTED:
        raise ConfigurationError(f"an observation has at most {LISTED} channels, not {len(channels)}")
    common = np.zeros(1, dtype=COMMON).view(np.recarray)
    c = common[0]
    c.signals, c.states = len(plant.signals), plant.effects.states.count
    c.coefficients = len(plant.coefficients) + plant.effects.count
    c.channels, c.sensors, c.proxy = len(channels), len(sensors), sensors.index(setup.proxy)
    c.slots, c.late = 1 + setup.sensor_delay + setup.sensor_steps + _latest(setup), setup.sensor_delay
    c.action_delay = setup.action_delay
    c.judged = JUDGED.count if setup.conditions is not None else 0
    first = ENVIRONMENT.count + c.judged
    c.shown = first + c.signals + c.states + c.coefficients
    c.ring = c.shown + c.sensors
    c.waiting = c.ring + (c.slots * c.sensors if c.slots > 1 else 0)
    c.actions = len(setup.ranges)
    c.rows = c.waiting + c.action_delay * c.actions
    c.output = plant.row(task.output)
    c.peak = plant.row("peak_tension") if plant.tears else c.output  # without a limit
    c.substeps, c.last_step, c.mode = setup.substeps, setup.steps, plant.number_of(setup.action_mode)
    c.dt, c.period = setup.control_period / setup.substeps, setup.control_period
    c.low, c.high, c.error_scale, c.effort_weight = setup.low, setup.high, task.error_scale, task.effort_weight
    c.second_low, c.second_high = setup.ranges[-1]
    own = _own_rows() | {s.name: first + k for k, s in enumerate(plant.signals)}
    for k, channel in enumerate(channels):
        c.source[k] = c.shown + sensors.index(channel.name) if channel.measured else own[channel.name]
        c.scale[k] = channel.scale
    for k, name in enumerate(sensors):
        c.sensor[k], c.effects[k] = plant.row(plant.measured.get(name, name)), plant.sense_row(name)
        c.deviation[k] = setup.noise[plant.row(name)]
    c.poses = bool(plant.posture)
    c.noisy = np.any(c.deviation > 0.0)
    holds = setup.rig.holds(plant)
    c.limits = len(holds)
    c.beyond = plant.row(OUT_OF_RANGE.name) if c.limits else 0
    for k, (name, (low, high)) in enumerate(holds.items()):
        c.limited[k], c.least[k], c.most[k] = plant.row(name), low, high
    if setup.conditions is not None:
        _in_suite(c, setup, setup.conditions, own)
    return common


def _latest(setup: Setup) -> int:
    """Control steps until the latest sensor of a task of the suite is seen; 0 for others."""
    sensors = setup.conditions.sensors.values() if setup.conditions is not None else ()
    return max((round(sensor.latency / setup.control_period) for sensor in sensors), default=0)


def _in_suite(c: Any, setup: Setup, conditions: Conditions, rows: dict[str, int]) -> None:
    """What the record has of a task of the suite."""
    period, sensors = setup.control_period, setup.sensors
    c.counts, c.rules, c.kept = c.rows, len(conditions.rules), c.rows + len(conditions.rules)
    c.rows = c.kept + c.sensors
    for k, rule in enumerate(conditions.rules):
        c.rule[k] = rows["true_error"] if rule.signal == ERROR else rows[rule.signal]
        c.lowest[k], c.highest[k], c.allowed[k] = rule.low, rule.high, round(rule.longer_than / period)
    for k, name in enumerate(sensors):
        sensor = conditions.sensors.get(name, Sensor())
        c.quantum[k], c.every[k] = sensor.quantum, max(round(sensor.period / period), 1)
        c.behind[k] = round(sensor.latency / period)
        c.derived[k] = sensors.index(sensor.of) if sensor.of else -1
        c.smoothing[k] = period / (sensor.filter + period)
        c.zeroed[k] = float(name in conditions.unhomed)
    c.shifted = int(setup.action_mode.rest_signal in conditions.unhomed)
    c.preview = int(conditions.preview)
    c.pass_b, c.pass_a1, c.pass_a2 = high_pass(period)
    c.fading, c.pause = period / (WINDOW + period), PAUSE
    c.activity_limit = conditions.activity


def _own_rows() -> dict[str, int]:
    """Rows of the channels that are no signal of the plant."""
    return {
        REFERENCE: ENVIRONMENT.row("info", INFO.row("reference")),
        REFERENCE_RATE: ENVIRONMENT.row("reference_rate"),
        REFERENCE_ACCELERATION: ENVIRONMENT.row("reference_acceleration"),
        ERROR: ENVIRONMENT.row("error_seen"),
        COMMAND: ENVIRONMENT.row("info", INFO.row("command")),
        "true_error": ENVIRONMENT.row("info", INFO.row("error")),
    }
