"""A real drive for plants whose command is an angle or a torque: motor, gear, supply, encoder and the servo on top.

The servo is the paper's (Zou 2022, Fig. 7): a PID on what the encoder shows, and a torque saturator behind it. It runs
at the encoder's rate and holds its torque between two readings. In torque mode the command goes to the saturator.

    reading   angle of the encoder, in steps, every ``encoder_period``; its rate from differences, filtered
    servo     M* = kp e + ki int e + kd (r' - rate), within the saturator; the integral waits while it saturates
    motor     i = M* / (N k_t) within what current limit, voltage and back-EMF allow (`physics.motor`)
    drive     J a = M(i) - b v - friction - cogging - torque of the cables, J with the rotor behind its gear

``drive: motor`` in a rig file asks for it. Without, the drive is ideal: in position mode it is a servo of second order
that no cable can push, in torque mode a torque without limits but one.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import clip, inline, maximum, select, sine_cosine
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.physics.friction import stick_slip_step
from cable_envs.physics.modes import longest_step
from cable_envs.physics.motor import behind_gear, current_range, shown
from cable_envs.plants.base import Plant, Signal

_SIZE = "chosen: the size of a 16 mm DC motor of 12 V"

PARAMETERS = (
    Parameter("motor_constant", "N m/A", 0.0115, 1e-6, 1e3, "torque constant k_t, and that of the back-EMF", _SIZE),
    Parameter("motor_resistance", "ohm", 3.3, 1e-6, 1e6, "resistance of the winding", _SIZE),
    Parameter("motor_current_limit", "A", 1.5, 1e-6, 1e4, "largest current of the amplifier, both ways", _SIZE),
    Parameter("motor_inertia", "kg m^2", 0.0, 0.0, 10.0, "inertia of the rotor, besides drive_inertia", "null"),
    Parameter("supply_voltage", "V", 12.0, 1e-3, 1e4, "voltage of the supply without load", _SIZE),
    Parameter("supply_resistance", "ohm", 0.2, 0.0, 1e4, "resistance of the supply and its leads", _SIZE),
    Parameter("gear_ratio", "1", 44.0, 1e-3, 1e4, "turns of the motor for one of the drive", "Table 1, Zou 2022"),
    Parameter("gear_efficiency", "1", 0.8, 0.01, 1.0, "share of the power that the gear passes", "chosen: planetary"),
    Parameter("drive_friction", "N m", 0.01, 0.0, 1e3, "Coulomb friction of motor and gear, at the drive", _SIZE),
    Parameter("cogging_torque", "N m", 0.0, 0.0, 1e3, "amplitude of the cogging of the motor, at the motor", "null"),
    Parameter("cogging_periods", "1", 12.0, 1.0, 1e4, "periods of the cogging in a turn of the motor", "chosen"),
    Parameter("encoder_counts", "1", 2048.0, 0.0, 1e8, "steps in a turn of the motor; 0: no quantisation", "chosen"),
    Parameter("encoder_period", "s", 1e-3, 0.0, 1.0, "time between two readings of the encoder", "chosen: 1 kHz"),
    Parameter("servo_kp", "N m/rad", 6.0, 0.0, 1e6, "proportional gain of the servo", "chosen: 24 Hz with the drive"),
    Parameter("servo_ki", "N m/(rad s)", 120.0, 0.0, 1e8, "integral gain of the servo", "chosen"),
    Parameter("servo_kd", "N m s/rad", 0.06, 0.0, 1e5, "derivative gain of the servo", "chosen"),
    Parameter("servo_filter", "s", 1e-3, 0.0, 1.0, "time constant of the filter of the encoder's rate", "chosen"),
)

MOTOR = tuple(p.name for p in PARAMETERS)
"""Names of the parameters that a drive with a motor has besides."""

SIGNALS = (
    Signal("encoder_angle", "rad", "what the encoder of the drive shows"),
    Signal("encoder_velocity", "rad/s", "its rate, from differences, filtered"),
    Signal("motor_current", "A", "current of the motor"),
    Signal("motor_torque", "N m", "torque of the motor behind its gear"),
    Signal("servo_torque", "N m", "torque that the servo asks for, behind the saturator"),
    Signal("servo_integral", "N m", "integral part of the servo"),
    Signal("servo_age", "s", "time since the last reading of the encoder"),
)

ROWS = (
    "torque_constant", "gear_ratio", "gear_efficiency", "resistance", "supply_voltage", "current_limit",
    "drive_friction", "cogging_torque", "cogging_turns", "encoder_steps", "encoder_period", "servo_kp", "servo_ki",
    "servo_kd", "servo_filter",
)  # fmt: skip
"""Coefficients. resistance: of winding and supply; cogging_torque: at the drive; cogging_turns: periods in a radian of
the drive over 2 pi; encoder_steps: in a radian of the drive."""


@inline
def _read(x, p, u, i, dt):
    """The encoder's next reading if it is due, and what the servo then asks for."""
    age = x.servo_age[i]
    due = age >= p.encoder_period[i] * (1.0 - 1e-9)
    angle = shown(x.drive_angle[i], p.encoder_steps[i])
    by_torque, limit = u.mode[i] > 0.5, p.drive_torque_limit[i]
    since = maximum(age, p.encoder_period[i])
    share = since / (since + p.servo_filter[i])
    rate = x.encoder_velocity[i] + share * ((angle - x.encoder_angle[i]) / since - x.encoder_velocity[i])
    error = u.command[i] - angle
    apart = p.servo_kp[i] * error + p.servo_kd[i] * (u.command_rate[i] - rate)
    grown = x.servo_integral[i] + since * p.servo_ki[i] * error
    beyond = abs(apart + grown) > limit
    unwinds = (apart + grown) * error < 0.0
    integral = select(beyond & (not unwinds), x.servo_integral[i], grown)
    asked = clip(select(by_torque, u.command[i], apart + integral), -limit, limit)
    x.servo_torque[i] = select(due | by_torque, asked, x.servo_torque[i])
    x.servo_integral[i] = select(due & (not by_torque), clip(integral, -limit, limit), x.servo_integral[i])
    x.encoder_angle[i] = select(due, angle, x.encoder_angle[i])
    x.encoder_velocity[i] = select(due, rate, x.encoder_velocity[i])
    x.servo_age[i] = select(due, 0.0, age) + dt


@inline
def motor_step(x, p, u, g, i, torque, stiffness, damping, dt):
    """Drive velocity after dt, in the place of `circuit.ends.drive_step`.

    ``torque`` is that of the cables at the predicted middle of the step, ``stiffness`` and ``damping`` are its slopes.
    """
    _read(x, p, u, i, dt)
    v, ratio, constant = x.drive_velocity[i], p.gear_ratio[i], p.torque_constant[i]
    least, most = current_range(constant * ratio * v, p.resistance[i], p.supply_voltage[i], p.current_limit[i])
    current = clip(x.servo_torque[i] / (constant * ratio), least, most)
    # what the gear takes of the power is a friction too: at rest it holds anything between these two
    forward = behind_gear(constant * current, 1.0, ratio, p.gear_efficiency[i])
    backward = behind_gear(constant * current, -1.0, ratio, p.gear_efficiency[i])
    cogging = p.cogging_torque[i] * sine_cosine(p.cogging_turns[i] * x.drive_angle[i])[0]
    against = cogging + torque
    net = 0.5 * dt * stiffness * v - against - p.drive_damping[i] * v  # the torque is that of the middle already
    # a voltage that is used up brakes like a damper
    braked = select((current <= least) | (current >= most), constant * ratio * constant * ratio / p.resistance[i], 0.0)
    braked = select(abs(current) < p.current_limit[i], braked, 0.0)
    rest = p.drive_damping[i] + damping + braked
    friction = p.drive_friction[i]
    up, down = net + forward - friction, net + backward + friction
    new = stick_slip_step(v, p.drive_inertia[i], up, down, stiffness, rest, rest, dt)
    held = clip(against, forward, backward)
    x.motor_current[i] = current
    x.motor_torque[i] = select(new > 0.0, forward, select(new < 0.0, backward, held))
    new = clip(new, -p.drive_speed_limit[i], p.drive_speed_limit[i])
    if g is not None:
        new = select(g.follows[i] > 0.5, g.target_rate[i], new)
    return new


def _derive(plain: Callable) -> Callable:
    def derive(value: Mapping[str, np.ndarray], e: Any) -> dict[str, Any]:
        rows = dict(plain(value, e))
        ratio = value["gear_ratio"]
        if np.any(value["encoder_period"] <= 0.0):
            raise ConfigurationError("encoder_period must be above 0: the servo runs at the encoder's rate")
        rows["drive_inertia"] = rows["drive_inertia"] + value["motor_inertia"] * ratio**2
        return {
            **rows,
            "torque_constant": value["motor_constant"], "gear_ratio": ratio,
            "gear_efficiency": value["gear_efficiency"],
            "resistance": value["motor_resistance"] + value["supply_resistance"],
            "supply_voltage": value["supply_voltage"], "current_limit": value["motor_current_limit"],
            "drive_friction": value["drive_friction"], "cogging_torque": value["cogging_torque"] * ratio,
            "cogging_turns": value["cogging_periods"] * ratio,
            "encoder_steps": value["encoder_counts"] * ratio / (2.0 * np.pi), "encoder_period": value["encoder_period"],
            "servo_kp": value["servo_kp"], "servo_ki": value["servo_ki"], "servo_kd": value["servo_kd"],
            "servo_filter": value["servo_filter"],
        }  # fmt: skip

    return derive


def _settle(plain: Callable) -> Callable:
    def settle(x: Any, s: Any, p: Any, e: Any, position: np.ndarray) -> None:
        """At rest: the servo's integral, or the command, holds what the cables pull."""
        plain(x, s, p, e, position)
        x.encoder_angle[:], x.servo_age[:] = x.drive_angle, p.encoder_period
        x.servo_integral[:] = x.servo_torque[:] = x.motor_torque[:] = x.drive_torque
        x.motor_current[:] = x.drive_torque / (p.torque_constant * p.gear_ratio)

    return settle


def _resolves(plain: Callable) -> Callable:
    def resolves(p: Any, e: Any) -> np.ndarray:
        braked = (p.torque_constant * p.gear_ratio) ** 2 / p.resistance + p.drive_damping
        servo = longest_step(p.drive_inertia, braked, p.servo_kp)
        return np.minimum(np.minimum(plain(p, e), servo), p.encoder_period)

    return resolves


def with_motor(plant: Plant) -> Plant:
    """A circuit with a real drive in the place of its ideal one.

    Parameters
    ----------
    plant : Plant
        A plant whose kernel moves its drive by the piece ``drive_step`` (`cable_envs.plants.circuit.ends`).

    Returns
    -------
    Plant
        Under the same name, with the parameters and the signals of this file too. The ideal servo's frequency, damping
        and acceleration limit mean nothing to it.
    """
    parameters = ParameterTable(*plant.parameters, *PARAMETERS)
    effects = Layout(plant.name, parameters, plant.effects.acting, plant.own, plant.effects.worn)
    rows = plant.signal_rows
    return replace(
        plant,
        parameters=parameters,
        signals=plant.signals + SIGNALS,
        signal_rows=rows.extended(s.name for s in SIGNALS),
        coefficient_rows=plant.coefficient_rows.extended(ROWS),
        derive=_derive(plant.derive),
        settle=_settle(plant.settle),
        solve=specialised(plant.solve, drive_step=motor_step),
        effects=effects,
        resolves=None if plant.resolves is None else _resolves(plant.resolves),
        measured={"drive_angle": "encoder_angle", "drive_velocity": "encoder_velocity"},
        drive="motor",
    )
