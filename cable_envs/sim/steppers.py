"""One control step of a block of environments in one compiled call: action -> plant -> measurement and reward.

The text of a step is written once; a plant's kernel is put into it (`templates.instantiate`), as a compiled function
handed in as an argument could neither be kept on disk nor merged into its caller. A step of one environment is the same
text for one column: the compiler then needs no loops over columns.

Short names: s the environments' rows (`buffers.ENVIRONMENT`), u the plant's inputs, x its signals, p its coefficients,
c what is common to all (`buffers.COMMON`); columns lo..hi.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from cable_envs.core.compiling.templates import inlined, instantiate
from cable_envs.core.inputs import INPUTS
from cable_envs.core.kernels import clip, inline, jit, minimum, received, select
from cable_envs.core.noise import normal
from cable_envs.effects.lanes import SENSE
from cable_envs.effects.sensor_delay import between, seen_at
from cable_envs.plants.base import Plant
from cable_envs.sim.buffers import COMMON, ENVIRONMENT
from cable_envs.sim.references import FIELDS, signal
from cable_envs.sim.suite.judging import JUDGED, begin_judging, expect, judge, priced
from cable_envs.sim.suite.sensing import as_on_a_rig
from cable_envs.sim.tasks import INFO, OBSERVATION_LIMIT, command_of, reward

BLOCK = 128
"""Environments whose numbers stay in the cache from action to reward."""

_X = _JUDGED_AT = ENVIRONMENT.count
_environment, _inputs, _signal, _info, _sense, _judged = (
    ENVIRONMENT.views, INPUTS.views, FIELDS.views, INFO.views, SENSE.views, JUDGED.views,
)  # fmt: skip


@inline
def _act(block, s, c, lo, hi):
    """The action asked for (or, with a delay, asked for that many steps ago) becomes the plant's input."""
    u, push, waiting = _inputs(s.inputs), _signal(s.push), block[c.waiting :]
    delay, low, high, mode, period = c.action_delay, c.low, c.high, c.mode, c.period
    for i in range(lo, hi):
        action = clip(s.asked[i], -1.0, 1.0)
        if delay > 0:
            slot = int(s.step[i]) % delay
            action, waiting[slot, i] = waiting[slot, i], action
        s.last_action[i] = s.action[i]
        s.action[i] = action
        command = command_of(action, low, high)
        if suite is not None:
            command = command - c.shifted * s.zero[i]
        u.command_rate[i] = (command - u.command[i]) / period
        u.command[i] = command
        u.mode[i] = mode
        u.disturbance[i] = signal(push, i, s.step[i] * period)[0]
        s.step[i] += 1.0
    if c.poses:
        bending = _signal(s.bending)
        for i in range(lo, hi):
            u.posture[i] = signal(bending, i, (s.step[i] - 1.0) * period)[0]


@inline
def _act_second(block, s, c, lo, hi):
    """The same for a second action, before `_act` counts the step."""
    u, waiting = _inputs(s.inputs), block[c.waiting + c.action_delay :]
    delay, low, high, period = c.action_delay, c.second_low, c.second_high, c.period
    for i in range(lo, hi):
        action = clip(s.asked_second[i], -1.0, 1.0)
        if delay > 0:
            slot = int(s.step[i]) % delay
            action, waiting[slot, i] = waiting[slot, i], action
        s.last_second[i] = s.second_action[i]
        s.second_action[i] = action
        second = command_of(action, low, high)
        u.second_rate[i] = (second - u.second[i]) / period
        u.second[i] = second


@inline
def _sensed(block, x, p, s, shown, c, fresh, distorted, lo, hi):  # noqa: C901 - as a piece of its own the noise is drawn in vain
    """What every sensor shows of now: its signal with noise, then scale, bias and rectification."""
    for k in range(c.sensors):
        for i in range(lo, hi):
            shown[k, i] = x[c.sensor[k], i]
    if c.noisy:  # a loop of its own: the compiler would else draw numbers that nobody needs
        for k in range(c.sensors):
            row, deviation = c.sensor[k], c.deviation[k]
            if deviation > 0.0:
                for i in range(lo, hi):
                    shown[k, i] = shown[k, i] + deviation * normal(s.key[i], s.step[i], row)
    if distorted is not None:
        for k in range(c.sensors):
            if c.effects[k] >= 0:
                e = _sense(p[c.effects[k] :])
                for i in range(lo, hi):
                    value = shown[k, i] * e.sensor_scale[i] + e.sensor_bias[i]
                    shown[k, i] = value - e.sensor_rectification[i] * minimum(value, 0.0)
    if suite is not None:
        as_on_a_rig(block, s, shown, c, fresh, lo, hi)


@inline
def _delayed(p, s, shown, ring, c, k, fresh, distorted, lo, hi):
    """What sensor k shows, late; a ring keeps what it showed. Before an episode nothing has changed."""
    slots, sensors = c.slots, c.sensors
    for i in range(lo, hi):
        ring[int(s.step[i]) % slots * sensors + k, i] = shown[k, i]
        if fresh:
            for slot in range(slots):
                ring[slot * sensors + k, i] = shown[k, i]
        late = float(c.late)
        if suite is not None:
            late = late + c.behind[k]
        if distorted is not None and c.effects[k] >= 0:
            late = late + _sense(p[c.effects[k] :]).sensor_delay[i] / c.period
        before, part = seen_at(s.step[i], min(late, slots - 1.0))
        after = (before + 1) % slots * sensors + k
        shown[k, i] = between(ring[before % slots * sensors + k, i], ring[after, i], part)


@inline
def _observe(block, obs, c, lo, hi):
    """obs[i, k]: channel k over its scale, limited."""
    for k in range(c.channels):
        row, unit = block[c.source[k]], c.scale[k]
        for i in range(lo, hi):
            obs[i, k] = np.float32(clip(row[i] / unit, -OBSERVATION_LIMIT, OBSERVATION_LIMIT))


@inline
def _measure(block, s, x, p, obs, c, fresh, distorted, lo, hi):
    """Observation and info at the present step; ``fresh``: the first of an episode.

    ``distorted``: None, or anything else where sensors may have effects.
    """
    followed, u, info = _signal(s.followed), _inputs(s.inputs), _info(s.info)
    shown, ring, measured = block[c.shown :], block[c.ring :], block[c.shown + c.proxy]
    output, peak, period = x[c.output], x[c.peak], c.period
    for k in range(c.limits):
        value, low, high, beyond = x[c.limited[k]], c.least[k], c.most[k], x[c.beyond]
        for i in range(lo, hi):
            beyond[i] = select((value[i] < low) | (value[i] > high), 1.0, beyond[i])
    for i in range(lo, hi):
        r, rate, acceleration = signal(followed, i, s.step[i] * period)
        info.reference[i], s.reference_rate[i], s.reference_acceleration[i] = r, rate, acceleration
    _sensed(block, x, p, s, shown, c, fresh, distorted, lo, hi)
    if c.slots > 1:
        for k in range(c.sensors):
            _delayed(p, s, shown, ring, c, k, fresh, distorted, lo, hi)
    for i in range(lo, hi):
        info.time[i] = s.step[i] * period
        info.output[i] = output[i]
        info.error[i] = info.reference[i] - output[i]
        info.command[i] = u.command[i]
        info.overload[i] = select(peak[i] > s.tension_limit[i], 1.0, 0.0)
        s.error_seen[i] = info.reference[i] - measured[i] / s.proxy_gain[i]
    if suite is not None:
        for i in range(lo, hi):
            s.true_rate[i] = s.reference_rate[i]
            s.reference_acceleration[i] = c.preview * s.reference_acceleration[i]
            info.command[i] = u.command[i] + c.shifted * s.zero[i]
        if fresh:
            priced(_judged(block[_JUDGED_AT:]), info, c, lo, hi)
    _observe(block, obs, c, lo, hi)


@inline
def _judge(block, s, x, c, lo, hi):
    """Reward, and whether the episode ends."""
    info, peak = _info(s.info), x[c.peak]
    scale, weight, last_step = c.error_scale, c.effort_weight, float(c.last_step)
    for i in range(lo, hi):
        error = abs(info.error[i])
        s.reward[i] = reward(error, s.action[i] - s.last_action[i], scale, weight)
        sound = (peak[i] <= s.breaking_tension[i]) & (error < 1e12)
        s.terminated[i] = select(sound, 0.0, 1.0)
        s.truncated[i] = select(sound & (s.step[i] >= last_step), 1.0, 0.0)
    if c.actions > 1:
        for i in range(lo, hi):
            change = s.second_action[i] - s.last_second[i]
            s.reward[i] -= weight * change * change
    if suite is not None:
        judge(block, s, _judged(block[_JUDGED_AT:]), c, lo, hi)


@jit
def ask(block, actions):
    """Put ``actions`` [n, 1 or 2] into their rows; returns the first environment whose action is not finite, or -1."""
    s = _environment(block)
    bad = -1
    for i in range(actions.shape[0] - 1, -1, -1):
        value = float(actions[i, 0])
        s.asked[i] = value
        if not abs(value) < 1e300:
            bad = i
    if actions.shape[1] > 1:
        for i in range(actions.shape[0]):
            value = float(actions[i, 1])
            s.asked_second[i] = value
            if not abs(value) < 1e300:
                bad = i
    return bad


# filled in for each plant
advance: Any = None
distorted: Any = None
signal_column: Any = None
suite: Any = None  # anything else for tasks of the suite, with sensors of a rig, rules and prices
_judged_column: Any = None


def _begin(block, obs, common, lanes):
    """First observation and info of the environments ``lanes``, just reset; actions on their way are those at rest."""
    s, c = _environment(block), common[0]
    x, p = block[_X : _X + c.signals], block[_X + c.signals + c.states :]
    for k in range(lanes.shape[0]):
        i = lanes[k]
        for slot in range(c.action_delay):
            block[c.waiting + slot, i] = s.action[i]
            if c.actions > 1:
                block[c.waiting + c.action_delay + slot, i] = s.second_action[i]
        if suite is not None:
            begin_judging(block, s, _judged(block[_JUDGED_AT:]), c, i)
        _measure(block, s, x, p, obs, c, True, distorted, i, i + 1)


def _step(block, obs, common, lo, hi):
    """A control period of columns lo..hi, with the actions asked for."""
    s, c = _environment(block), common[0]
    rows = c.signals + c.states
    x, p = block[_X : _X + rows], block[_X + rows : _X + rows + c.coefficients]
    for first in range(lo, hi, BLOCK):
        last = min(first + BLOCK, hi)
        if c.actions > 1:
            _act_second(block, s, c, first, last)
        _act(block, s, c, first, last)
        if suite is not None:
            expect(s, c, first, last)
        advance(x, p, s.inputs, first, last, c.substeps, c.dt)
        _measure(block, s, x, p, obs, c, False, distorted, first, last)
        _judge(block, s, x, c, first, last)


def _step_one(block, obs, common, asked):
    """`_step` of a single environment; returns reward, terminated, truncated, and the values of its info.

    Its arrays come as `kernels.handed` gives them.
    """
    c = received(common, COMMON, (1,))[0]
    block, obs = received(block, np.float64, (c.rows, 1)), received(obs, np.float32, (1, c.channels))
    s = _environment(block)
    rows = c.signals + c.states
    x, p = block[_X : _X + rows], block[_X + rows : _X + rows + c.coefficients]
    s.asked[0] = asked
    if c.actions > 1:
        _act_second(block, s, c, 0, 1)
    _act(block, s, c, 0, 1)
    if suite is not None:
        expect(s, c, 0, 1)
    advance(x, p, s.inputs, 0, 1, c.substeps, c.dt)
    _measure(block, s, x, p, obs, c, False, distorted, 0, 1)
    _judge(block, s, x, c, 0, 1)
    ends = s.reward[0], s.terminated[0] > 0.0, s.truncated[0] > 0.0
    if suite is not None:
        return ends + _info_column(s.info, 0) + _judged_column(block[_JUDGED_AT:], 0) + signal_column(x, 0)
    return ends + _info_column(s.info, 0) + signal_column(x, 0)


_info_column = INFO.column
_SUITE = {"suite": 1, "_X": ENVIRONMENT.count + JUDGED.count, "_judged_column": JUDGED.column}
"""Names of the templates as the tasks of the suite have them."""


def filled_in(distorted: int | None, suite: bool) -> dict[str, Any]:
    """What the templates read besides a plant: effects of sensors (None or 1), and what the tasks of the suite have."""
    return {"distorted": distorted, **(_SUITE if suite else {})}


@cache
def begin_of(distorted: int | None, suite: bool) -> Callable[..., None]:
    """The kernel (block, obs, common, lanes) of a reset, without (None) or with (1) effects of sensors."""
    name = "begin_with_effects" if distorted else "begin"
    return instantiate(_begin, f"{name}_suite" if suite else name, **filled_in(distorted, suite))


@cache
def kernels_of(plant: Plant, suite: bool = False) -> tuple[Callable[..., None], ...]:
    """The kernels (block, obs, common, lo, hi) of a plant, as `Plant.kernels` has them; compiled on first use."""
    return tuple(
        instantiate(_step, name, advance=kernel, **filled_in(distorted, suite))
        for name, kernel, distorted in zip(_names("step", plant, suite), plant.kernels, (None, 1, 1), strict=True)
    )


@cache
def single_kernels_of(plant: Plant, suite: bool = False) -> tuple[Callable[..., tuple], ...]:
    """The same for a single environment: (block, obs, common, action) -> reward, terminated, truncated, infos.

    The arrays are `kernels.handed`.
    """
    column = plant.signal_rows.column
    return tuple(
        instantiate(_step_one, name, advance=inlined(kernel), signal_column=column, **filled_in(distorted, suite))
        for name, kernel, distorted in zip(_names("step_one", plant, suite), plant.kernels, (None, 1, 1), strict=True)
    )


def _names(what: str, plant: Plant, suite: bool) -> tuple[str, ...]:
    name = f"{what}{'_suite' if suite else ''}_{plant.name}_{plant.version}_{len(plant.signals)}"
    return name, f"{name}_with_effects", f"{name}_with_bristles"
