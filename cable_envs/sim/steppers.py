"""One control step of a block of environments in one compiled call: action -> plant -> measurement and reward.

Every array handed to a compiled function costs about a thirtieth of a single environment's step, so a stepper gets
three (`Buffers`): a block of everything that differs between environments, the observations, and what is the same for
all. The plants' kernels are called by name, one stepper each: a compiled function handed in as an argument would not be
cached on disk.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from cable_envs.core.inputs import COMMAND, INPUTS
from cable_envs.core.kernels import clip, inline, instantiate, jit, minimum, select
from cable_envs.effects.rows import ROWS_S, S_BIAS, S_DELAY, S_RECTIFICATION, S_SCALE
from cable_envs.plants.base import Plant
from cable_envs.sim.references import FIELDS
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import INFO, before_step, observe, refill, reward, sense, target

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
inputs, reference and disturbance begin at U, Q and PUSH; TIME .. OVERLOAD are `INFO`; from X on: the plant's signals
(then the states of effects), its coefficients (then those of effects), a ring of 1 + delay measurements of each sensor,
a ring of delayed actions, and what each sensor shows with effects."""

(SIGNALS, COEFFICIENTS, CHANNELS, SENSORS, SLOTS, DELAY, OUTPUT_ROW, PEAK_ROW, PROXY, SUBSTEPS, LAST_STEP, DT, PERIOD,
 MODE_NUMBER, LOW, HIGH, ERROR_SCALE, EFFORT_WEIGHT, VISIBLE, LATE) = range(20)  # fmt: skip
LISTS = 20
"""Places in `Buffers.common`: numbers of rows, rows within x, numbers of steps, and values in SI. From LISTS on: source
and scale of each channel; row, standard deviation and first row of its effects within the coefficients (or -1) of each
sensor. VISIBLE: signals without the states of effects; LATE: control steps by which all measurements are late."""


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
        slots = 1 + setup.sensor_delay + setup.sensor_steps
        signals, coefficients = len(plant.signals) + ROWS_S, len(plant.coefficients) + plant.effects.count
        common = [
            signals, coefficients, len(channel), len(sensor), slots, setup.action_delay,
            plant.row(task.output), plant.row("peak_tension"), sensor.index(setup.proxy_row), setup.substeps,
            setup.steps, setup.control_period / setup.substeps, setup.control_period, setup.mode_index, setup.low,
            setup.high, task.error_scale, task.effort_weight, len(plant.signals), setup.sensor_delay,
        ]  # fmt: skip
        common += [*channel, *(c.scale for c in setup.channels), *sensor, *setup.noise[sensor]]
        common += [plant.sense_row(plant.signals[row].name) for row in sensor]
        rows = X + signals + coefficients + (slots + 1) * len(sensor) + setup.action_delay
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
        """Signals of the plant and states of its effects [len(signals) + ROWS_S, n]."""
        return self.rows(X, int(self.common[SIGNALS]))

    @property
    def p(self) -> np.ndarray:
        """Coefficients of the plant and its effects [len(coefficients) + effects.count, n]."""
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
        return self.rows(REWARD, 3 + len(INFO) + int(self.common[VISIBLE]))

    @property
    def table(self) -> np.ndarray:
        """The values of an info: `INFO`, then the plant's signals."""
        return self.rows(TIME, len(INFO) + int(self.common[VISIBLE]))


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
def _distort(block, common, place, ring, sensors, slots, fresh, lo, hi):
    """What each sensor shows with its effects: scale, bias, rectification, then delay; into the rows at the end."""
    first = X + int(common[SIGNALS])
    shown = block[first + int(common[COEFFICIENTS]) + slots * sensors + int(common[DELAY]) :]
    for k in range(sensors):
        row = int(place[k])
        for i in range(lo, hi):
            slot = int(block[STEP, i]) % slots * sensors + k
            if row >= 0:
                q = first + row
                value = ring[slot, i] * block[q + S_SCALE, i] + block[q + S_BIAS, i]
                ring[slot, i] = value - block[q + S_RECTIFICATION, i] * minimum(value, 0.0)
                if fresh:
                    for other in range(slots):
                        ring[other * sensors + k, i] = ring[slot, i]
            late = common[LATE] + (block[first + row + S_DELAY, i] / common[PERIOD] if row >= 0 else 0.0)
            whole = int(min(late, slots - 1.0))
            part = min(late, slots - 1.0) - whole
            now = ring[int(block[STEP, i] + slots - whole) % slots * sensors + k, i]
            before = ring[int(block[STEP, i] + 2 * slots - whole - 1) % slots * sensors + k, i]
            shown[k, i] = now + part * (before - now) if part > 0.0 else now
    return shown


@inline
def _measure(block, obs, common, fresh, distorted, lo, hi):
    """Observation and the task's part of the info table at the present step; ``fresh``: the first of an episode.

    ``distorted``: None, or anything else where sensors may have effects.
    """
    signals, coefficients = int(common[SIGNALS]), int(common[COEFFICIENTS])
    channels, sensors, slots = int(common[CHANNELS]), int(common[SENSORS]), int(common[SLOTS])
    x, ring = block[X : X + signals], block[X + signals + coefficients :]
    output, peak, period = int(common[OUTPUT_ROW]), int(common[PEAK_ROW]), common[PERIOD]
    channel, scale = common[LISTS : LISTS + channels], common[LISTS + channels : LISTS + 2 * channels]
    sensor, deviation = common[LISTS + 2 * channels :], common[LISTS + 2 * channels + sensors :]
    place = common[LISTS + 2 * channels + 2 * sensors :]
    r, rate, acceleration = block[REFERENCE], block[RATE], block[ACCELERATION]
    target(block[Q:PUSH], block[STEP], period, r, rate, acceleration, lo, hi)
    sense(x, sensor, deviation, sensors, block[STEP], block[KEY], ring, slots, lo, hi)
    if fresh:
        refill(ring, sensors, slots, lo, hi)
    if distorted is not None:
        ring, slots = _distort(block, common, place, ring, sensors, slots, fresh, lo, hi), 1
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


@inline
def _begin(block, obs, common, lanes, distorted):
    first = X + int(common[SIGNALS]) + int(common[COEFFICIENTS]) + int(common[SLOTS]) * int(common[SENSORS])
    for k in range(lanes.shape[0]):
        i = lanes[k]
        for slot in range(int(common[DELAY])):
            block[first + slot, i] = block[ACTION, i]
        _measure(block, obs, common, True, distorted, i, i + 1)


@jit
def begin(block, obs, common, lanes):
    """First observation and info of the environments ``lanes``, just reset; actions on their way are those at rest."""
    _begin(block, obs, common, lanes, None)


@jit
def begin_with_effects(block, obs, common, lanes):
    """The same where sensors may have effects."""
    _begin(block, obs, common, lanes, 1)


# filled in for each plant
advance: Any = None
distorted: Any = None


def _step(block, obs, common, lo, hi):
    signals, coefficients, substeps = int(common[SIGNALS]), int(common[COEFFICIENTS]), int(common[SUBSTEPS])
    x, u, p = block[X : X + signals], block[U:Q], block[X + signals : X + signals + coefficients]
    for first in range(lo, hi, BLOCK):
        last = min(first + BLOCK, hi)
        _act(block, common, first, last)
        advance(x, p, u, first, last, substeps, common[DT])
        _measure(block, obs, common, False, distorted, first, last)
        _judge(block, common, first, last)


@cache
def kernels_of(plant: Plant) -> tuple[Callable[..., None], Callable[..., None]]:
    """The kernels (block, obs, common, lo, hi) of a plant, without and with effects."""
    name = f"step_{plant.name}_{len(plant.signals)}"
    return (
        instantiate(_step, name, advance=plant.kernels[0], distorted=None),
        instantiate(_step, f"{name}_with_effects", advance=plant.kernels[1], distorted=1),
    )
