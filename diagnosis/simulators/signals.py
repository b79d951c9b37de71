"""What happens to a command before a simulator gets it, and to an output behind it."""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.core.kernels import jit
from cable_envs.diagnosis.intake.logged import filtered
from cable_envs.diagnosis.simulators.declaration import Command
from cable_envs.diagnosis.simulators.effects import drooping, limited
from cable_envs.diagnosis.systems.replayed import delayed as smoothly_delayed
from cable_envs.effects.actuator_lag import keep, lagged
from cable_envs.effects.backlash import dead_zone, play
from cable_envs.effects.lanes import SENSE
from cable_envs.effects.sensor_delay import delayed
from cable_envs.physics.motor import shown as in_steps
from cable_envs.sim.replay import distort

Values = Mapping[str, np.ndarray]
"""Row -> [n]."""


@jit
def _lag(commands, time, dt, out):
    """Means over each step of commands [n, T] behind lags [n] (`actuator_lag`) that begin in balance."""
    for i in range(commands.shape[0]):
        left = keep(time[i], dt)
        late = (1.0 - left) * time[i] / dt
        state = commands[i, 0]
        for k in range(commands.shape[1]):
            asked = commands[i, k]
            out[i, k] = asked + (state - asked) * late
            state = lagged(state, asked, left)


@jit
def _play(commands, gap, out):
    """Commands [n, T] behind gaps [n] (`backlash`), each in the middle of its gap when it begins."""
    for i in range(commands.shape[0]):
        nut = commands[i, 0]
        for k in range(commands.shape[1]):
            nut = play(nut, commands[i, k], gap[i])
            out[i, k] = nut


@jit
def _dead(commands, width, out):
    """Commands [n, T] less dead bands [n] (`backlash.dead_zone`)."""
    for i in range(commands.shape[0]):
        for k in range(commands.shape[1]):
            out[i, k] = dead_zone(commands[i, k], width[i])


@jit
def _steps(values, step, out):
    """Values [n, T] in whole steps [n] (`motor.shown`); as they are where there are none (0)."""
    for i in range(values.shape[0]):
        steps = 1.0 / step[i] if step[i] > 0.0 else 0.0
        for k in range(values.shape[1]):
            out[i, k] = in_steps(values[i, k], steps)


def sent(command: Command, series: np.ndarray, values: Values, period: float) -> np.ndarray:
    """What acts of a command [n, T] over each step of ``period`` s.

    It goes through gain, delay, converter, dead band, gap, limit, supply and lag, in this order. Rows of effects that
    ``values`` does not have are at their null.
    """

    def of(effect: str, parameter: str) -> np.ndarray | None:
        return values.get(f"{effect}.{command.name}.{parameter}")

    if (gain := of("command_gain", "gain")) is not None:
        series = series * gain[:, None]
    if (late := of("command_delay", "time")) is not None and np.any(late > 0.0):
        series = delayed(series.T, late / period).T
    if (step := of("command_step", "step")) is not None:
        series = _through(_steps, series, step)
    if (width := of("command_dead_band", "width")) is not None:
        series = _through(_dead, series, width)
    if (gap := of("backlash", "gap")) is not None and np.any(gap > 0.0):
        series = _through(_play, series, gap)
    if (limit := of("command_saturation", "limit")) is not None:
        series = limited(series, limit[:, None])
    if (droop := of("supply_droop", "droop")) is not None and command.full is not None:
        series = drooping(series, droop[:, None], command.full)
    if (time := of("actuator_lag", "time")) is not None and np.any(time > 0.0):
        series = _through(_lag, series, time, period)
    return series


def _through(kernel, series: np.ndarray, *numbers) -> np.ndarray:
    whole = np.ascontiguousarray(series)
    out = np.empty_like(whole)
    kernel(whole, *numbers, out)
    return out


class _Sensors:
    """Where `distort` finds the rows of each sensor."""

    def __init__(self, signals: Sequence[str]):
        self._signals = list(signals)

    def sense_row(self, signal: str) -> int:
        return SENSE.count * self._signals.index(signal)


def shown(signals: Sequence[str], series: np.ndarray, values: Values, period: float) -> np.ndarray:
    """What the sensors show of outputs [T, k, n] that are ``period`` s apart.

    They go through lag, delay, scale, zero, rectification, drift and converter, in this order. Rows of effects that
    ``values`` does not have are at their null.
    """
    count = series.shape[2]
    p = np.zeros((SENSE.count * len(signals), count))
    p[SENSE.row("sensor_scale") :: SENSE.count] = 1.0
    time = period * np.arange(len(series))
    found = series
    for j, name in enumerate(signals):
        slow, late = values.get(f"sensor_lag.{name}"), values.get(f"sensor_delay.{name}")
        for one, law in ((slow, lambda x, by: filtered(x, time, by)),
                         (late, lambda x, by: smoothly_delayed(x, by / period))):  # fmt: skip
            if one is not None and np.any(one > 0.0):
                found = found.copy() if found is series else found
                found[:, j] = law(found[:, j], one)
        for effect in ("sensor_bias", "sensor_scale", "sensor_rectification"):
            if f"{effect}.{name}" in values:
                p[SENSE.count * j + SENSE.row(effect)] = values[f"{effect}.{name}"]
    found = distort(_Sensors(signals), p, signals, found, period, found[0])  # type: ignore[arg-type]
    for j, name in enumerate(signals):
        rate, step = values.get(f"sensor_drift.{name}"), values.get(f"sensor_step.{name}")
        if rate is None and step is None:
            continue
        found = found.copy() if found is series else found
        if rate is not None:
            found[:, j] = found[:, j] + time[:, None] * rate
        if step is not None:
            found[:, j] = _through(_steps, found[:, j].T, step).T
    return found
