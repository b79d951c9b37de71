"""One control step of a block of environments in one compiled call: action -> plant -> measurement and reward.

Every array handed to a compiled function costs about a thirtieth of a single environment's step, so a stepper gets
three (`Buffers`): a block of everything that differs between environments, the observations, and what is the same for
all. The plants' kernels are called by name, one stepper each: a compiled function handed in as an argument would not be
cached on disk.
"""

from dataclasses import dataclass

import numpy as np

from cable_envs.kernels import clip, inline, jit, select
from cable_envs.plants import cable_hole, pulley_chain, pulley_circuit
from cable_envs.plants.base import COMMAND, INPUTS
from cable_envs.references import FIELDS
from cable_envs.setup import Setup
from cable_envs.tasks import INFO, before_step, observe, refill, reward, sense, target

BLOCK = 128
"""Environments whose numbers stay in the cache from action to reward."""

(ASKED, ACTION, LAST_ACTION, TENSION_LIMIT, BREAKING, PROXY_GAIN, KEY, STEP, RATE, ACCELERATION,
 SCRATCH) = range(11)  # fmt: skip
U = 11
Q = U + len(INPUTS)
PUSH = Q + len(FIELDS)
REWARD, TERMINATED, TRUNCATED = range(PUSH + len(FIELDS), PUSH + len(FIELDS) + 3)
TIME, REFERENCE, OUTPUT, ERROR, APPLIED, OVERLOAD = range(TRUNCATED + 1, TRUNCATED + 1 + len(INFO))
X = TRUNCATED + 1 + len(INFO)
"""Rows of `Buffers.block`. ASKED is the action to take, ACTION the one that acts now (the same without delay); plant
inputs, reference and disturbance begin at U, Q and PUSH; TIME .. OVERLOAD are `INFO`; from X on: the plant's signals,
its coefficients, a ring of 1 + delay measurements of each sensor, and a ring of delayed actions."""

(SIGNALS, COEFFICIENTS, CHANNELS, SENSORS, SLOTS, DELAY, OUTPUT_ROW, PEAK_ROW, PROXY, SUBSTEPS, LAST_STEP, DT, PERIOD,
 MODE_NUMBER, LOW, HIGH, ERROR_SCALE, EFFORT_WEIGHT) = range(18)  # fmt: skip
LISTS = 18
"""Places in `Buffers.common`: numbers of rows, rows within x, numbers of steps, and values in SI. From LISTS on: source
and scale of each channel, row and standard deviation of each sensor."""


@dataclass(frozen=True)
class Buffers:
    """Everything a stepper reads and writes; see the names of rows above.

    block [rows, columns] float64, one column for each environment, padded by a cache line: with a stride that is a
    power of two all rows of an environment would compete for the same few places of the cache. obs [n, channels]
    float32. common [places] float64.
    """

    block: np.ndarray
    obs: np.ndarray
    common: np.ndarray

    @classmethod
    def of(cls, setup: Setup, n: int) -> "Buffers":
        """Zeroed buffers for ``n`` environments."""
        plant, task = setup.plant, setup.task
        channel, sensor = setup.sensed()
        slots = 1 + setup.sensor_delay
        common = [
            len(plant.signals), len(plant.coefficients), len(channel), len(sensor), slots, setup.action_delay,
            plant.row(task.output), plant.row("peak_tension"), sensor.index(setup.proxy_row), setup.substeps,
            setup.steps, setup.control_period / setup.substeps, setup.control_period, setup.mode_index, setup.low,
            setup.high, task.error_scale, task.effort_weight,
        ]  # fmt: skip
        common += [*channel, *(c.scale for c in setup.channels), *sensor, *setup.noise[sensor]]
        rows = X + len(plant.signals) + len(plant.coefficients) + slots * len(sensor) + setup.action_delay
        return cls(
            block=np.zeros((rows, n if n == 1 else n + 8)),
            obs=np.zeros((n, len(channel)), dtype=np.float32),
            common=np.array(common, dtype=np.float64),
        )

    def rows(self, first: int, count: int) -> np.ndarray:
        """A view of the block, [count, n]."""
        return self.block[first : first + count, : len(self.obs)]

    @property
    def u(self) -> np.ndarray:
        """Inputs of the plant [len(INPUTS), n]."""
        return self.rows(U, len(INPUTS))

    @property
    def x(self) -> np.ndarray:
        """Signals of the plant [len(signals), n]."""
        return self.rows(X, int(self.common[SIGNALS]))

    @property
    def p(self) -> np.ndarray:
        """Coefficients of the plant [len(coefficients), n]."""
        return self.rows(X + int(self.common[SIGNALS]), int(self.common[COEFFICIENTS]))

    @property
    def reference(self) -> np.ndarray:
        """Columns of `references.pack_signal`."""
        return self.rows(Q, len(FIELDS))

    @property
    def disturbance(self) -> np.ndarray:
        """Columns of `references.pack_signal`."""
        return self.rows(PUSH, len(FIELDS))

    @property
    def outcome(self) -> np.ndarray:
        """Reward, terminated (0/1), truncated (0/1), then `table`."""
        return self.rows(REWARD, 3 + len(INFO) + int(self.common[SIGNALS]))

    @property
    def table(self) -> np.ndarray:
        """The values of an info: `INFO`, then the plant's signals."""
        return self.rows(TIME, len(INFO) + int(self.common[SIGNALS]))


@inline
def _act(block, common, lo, hi):
    """The action asked for (or, with a delay, asked for that many steps ago) becomes the plant's input."""
    u, push, delay = block[U:Q], block[PUSH:REWARD], int(common[DELAY])
    ring = block[X + int(common[SIGNALS]) + int(common[COEFFICIENTS]) + int(common[SLOTS]) * int(common[SENSORS]) :]
    for i in range(lo, hi):
        action = clip(block[ASKED, i], -1.0, 1.0)
        if delay > 0:
            slot = int(block[STEP, i]) % delay
            action, ring[slot, i] = ring[slot, i], action
        block[LAST_ACTION, i] = block[ACTION, i]
        block[ACTION, i] = action
        time = block[STEP, i] * common[PERIOD]
        before_step(u, push, action, i, time, common[LOW], common[HIGH], common[MODE_NUMBER], common[PERIOD])
        block[STEP, i] += 1.0


@inline
def _measure(block, obs, common, fresh, lo, hi):
    """Observation and the task's part of the info table at the present step; ``fresh``: the first of an episode."""
    signals, coefficients = int(common[SIGNALS]), int(common[COEFFICIENTS])
    channels, sensors, slots = int(common[CHANNELS]), int(common[SENSORS]), int(common[SLOTS])
    x, ring = block[X : X + signals], block[X + signals + coefficients :]
    output, peak, period = int(common[OUTPUT_ROW]), int(common[PEAK_ROW]), common[PERIOD]
    channel, scale = common[LISTS : LISTS + channels], common[LISTS + channels : LISTS + 2 * channels]
    sensor, deviation = common[LISTS + 2 * channels :], common[LISTS + 2 * channels + sensors :]
    r, rate, acceleration = block[REFERENCE], block[RATE], block[ACCELERATION]
    target(block[Q:PUSH], block[STEP], period, r, rate, acceleration, lo, hi)
    sense(x, sensor, deviation, sensors, block[STEP], block[KEY], ring, slots, lo, hi)
    if fresh:
        refill(ring, sensors, slots, lo, hi)
    observe(
        channel, scale, ring, sensors, slots, int(common[PROXY]), block[STEP], r, rate, acceleration,
        block[U + COMMAND], block[PROXY_GAIN], block[SCRATCH], obs, lo, hi,
    )  # fmt: skip
    for i in range(lo, hi):
        block[TIME, i] = block[STEP, i] * period
        block[OUTPUT, i] = x[output, i]
        block[ERROR, i] = r[i] - x[output, i]
        block[APPLIED, i] = block[U + COMMAND, i]
        block[OVERLOAD, i] = select(x[peak, i] > block[TENSION_LIMIT, i], 1.0, 0.0)


@inline
def _judge(block, common, lo, hi):
    """Reward, and whether the episode ends."""
    peak, last_step = X + int(common[PEAK_ROW]), common[LAST_STEP]
    for i in range(lo, hi):
        error = abs(block[ERROR, i])
        change = block[ACTION, i] - block[LAST_ACTION, i]
        block[REWARD, i] = reward(error, change, common[ERROR_SCALE], common[EFFORT_WEIGHT])
        sound = (block[peak, i] <= block[BREAKING, i]) & (error < 1e12)
        block[TERMINATED, i] = select(sound, 0.0, 1.0)
        block[TRUNCATED, i] = select(sound & (block[STEP, i] >= last_step), 1.0, 0.0)


@jit
def ask(block, actions):
    """Put ``actions`` [n, 1] into the row ASKED; returns the first environment whose action is not finite, or -1."""
    bad = -1
    for i in range(actions.shape[0] - 1, -1, -1):
        value = float(actions[i, 0])
        block[ASKED, i] = value
        if not abs(value) < 1e300:
            bad = i
    return bad


@jit
def begin(block, obs, common, lanes):
    """First observation and info of the environments ``lanes``, just reset; actions on their way are those at rest."""
    first = X + int(common[SIGNALS]) + int(common[COEFFICIENTS]) + int(common[SLOTS]) * int(common[SENSORS])
    for k in range(lanes.shape[0]):
        i = lanes[k]
        for slot in range(int(common[DELAY])):
            block[first + slot, i] = block[ACTION, i]
        _measure(block, obs, common, True, i, i + 1)


@jit
def step_cable_hole(block, obs, common, lo, hi):
    signals, coefficients, substeps = int(common[SIGNALS]), int(common[COEFFICIENTS]), int(common[SUBSTEPS])
    x, u, p = block[X : X + signals], block[U:Q], block[X + signals : X + signals + coefficients]
    for first in range(lo, hi, BLOCK):
        last = min(first + BLOCK, hi)
        _act(block, common, first, last)
        cable_hole.advance(x, p, u, first, last, substeps, common[DT])
        _measure(block, obs, common, False, first, last)
        _judge(block, common, first, last)


@jit
def step_pulley_circuit(block, obs, common, lo, hi):
    signals, coefficients, substeps = int(common[SIGNALS]), int(common[COEFFICIENTS]), int(common[SUBSTEPS])
    x, u, p = block[X : X + signals], block[U:Q], block[X + signals : X + signals + coefficients]
    for first in range(lo, hi, BLOCK):
        last = min(first + BLOCK, hi)
        _act(block, common, first, last)
        pulley_circuit.advance(x, p, u, first, last, substeps, common[DT])
        _measure(block, obs, common, False, first, last)
        _judge(block, common, first, last)


@jit
def step_pulley_chain(block, obs, common, lo, hi):
    signals, coefficients, substeps = int(common[SIGNALS]), int(common[COEFFICIENTS]), int(common[SUBSTEPS])
    x, u, p = block[X : X + signals], block[U:Q], block[X + signals : X + signals + coefficients]
    for first in range(lo, hi, BLOCK):
        last = min(first + BLOCK, hi)
        _act(block, common, first, last)
        pulley_chain.advance(x, p, u, first, last, substeps, common[DT])
        _measure(block, obs, common, False, first, last)
        _judge(block, common, first, last)


STEPPERS = {
    "cable_hole": step_cable_hole,
    "pulley_circuit": step_pulley_circuit,
    "pulley_chain": step_pulley_chain,
}
"""plant name -> kernel (block, obs, common, lo, hi)"""
