"""What the two circuit plants share: their signals, and the drive and the load at the circuit's two ends.

symbol | meaning | unit
------ | ------- | ----
theta_in, theta_out | drive and output angle, counter-clockwise positive | rad
M_in   | torque on the driving pulley that the cables need | N m
M_out  | torque of the driven pulley on its load | N m
D      | theta_in R0 / R5 - theta_out, the angle taken up by the cables | rad

Both inertias move by the linearly implicit trapezoidal rule. Forces are taken at the predicted middle of the step, so
the stiffness in the denominator need not be exact: it keeps the step stable, the order stays 2.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sine_cosine
from cable_envs.effects.slow_creep import lasting
from cable_envs.physics.friction import ringing_inertia
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import ActionMode, Signal
from cable_envs.plants.circuit.effects import drive_at
from cable_envs.plants.circuit.statics import Statics

SIGNALS = (
    Signal("drive_angle", "rad", "angle of the driving pulley"),
    Signal("drive_velocity", "rad/s", "speed of the driving pulley"),
    Signal("drive_torque", "N m", "torque on the driving pulley, M_in"),
    Signal("output_angle", "rad", "angle of the driven pulley"),
    Signal("output_velocity", "rad/s", "speed of the driven pulley"),
    Signal("output_torque", "N m", "torque of the driven pulley on its load, M_out"),
    Signal("tension_drive_top", "N", "tension of cable t at the driving pulley, T01t"),
    Signal("tension_drive_bottom", "N", "tension of cable b at the driving pulley, T01b"),
    Signal("tension_output_top", "N", "tension of cable t at the driven pulley, T45t"),
    Signal("tension_output_bottom", "N", "tension of cable b at the driven pulley, T45b"),
    Signal("phase", "1", "0 rest, 1 delay, 2 transition, 3 working"),
    Signal("out_of_range", "1", "1 where a cable is slack, so that Eqs. (42)-(46) do not hold"),
    Signal("slack_fraction", "1", "share of the last control step in which a cable was slack"),
    Signal("peak_tension", "N", "largest tension of either cable within the last control step"),
)

ACTION_MODES = (
    ActionMode("position", "rad", "drive_angle_limit", rest_signal="drive_angle"),
    ActionMode("torque", "N m", "drive_torque_limit", rest_signal="drive_torque"),
)

STILL = 1e-4
"""Drive speed below which the drive counts as being at rest, rad/s: 0.01 mrad over a control step of 0.1 s."""

COEFFICIENTS = (
    "gear", "drive_radius", "output_radius", "stretch_stiffness", "stretch_damping", "preload_top", "preload_bottom",
    "drive_inertia", "drive_damping", "drive_torque_limit", "drive_speed_limit", "drive_acceleration_limit",
    "servo_stiffness", "servo_damping", "output_inertia", "output_damping", "contact_angle", "contact_stiffness",
    "contact_damping", "payload_torque", "brake_torque",
)  # fmt: skip
"""Rows both plants share. gear = R0/R5; stretch_stiffness = EA R5, so that EA Delta L = stretch_stiffness D;
preload = T_pre L_total of a side (N m); payload_torque = m g l."""


def shared_coefficients(value: Mapping[str, np.ndarray], statics: Statics, e) -> dict[str, np.ndarray]:
    """Rows named by `COEFFICIENTS` from the circuit's parameters; raises ConfigurationError for senseless ones.

    ``e``: rows of the effects, or None.
    """
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any(statics.pretension.max(axis=0) >= value["breaking_tension"]):
        raise ConfigurationError("the pretension alone exceeds breaking_tension")
    arm = value["payload_mass"] * value["payload_arm"]
    preload = statics.pretension * statics.length
    if e is not None:  # as the linear law would have it, less what slack takes
        linear = 2.0 / (1.0 + np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * statics.pretension))
        preload = preload * linear - value["tensile_stiffness"] * e.slack_length
    same = (
        "drive_radius", "output_radius", "drive_inertia", "drive_damping", "drive_torque_limit", "drive_speed_limit",
        "drive_acceleration_limit", "output_damping", "contact_angle", "contact_stiffness", "contact_damping",
        "brake_torque",
    )  # fmt: skip
    return {
        **{name: value[name] for name in same},
        "gear": value["drive_radius"] / value["output_radius"],
        "stretch_stiffness": value["tensile_stiffness"] * value["output_radius"],
        "stretch_damping": value["cable_damping"] * value["output_radius"],
        "preload_top": preload[0],
        "preload_bottom": preload[1],
        "servo_stiffness": value["servo_frequency"] ** 2,
        "servo_damping": 2.0 * value["servo_damping_ratio"] * value["servo_frequency"],
        "output_inertia": value["output_inertia"] + arm * value["payload_arm"],
        "payload_torque": arm * value["gravity"],
    }


def rest_elongation(p, length_top, length_bottom, position: np.ndarray, e):
    """(D, T_t, T_b) at rest with uniform tension on each side, balancing the load at ``position`` (rad, [n]).

    ``e``: rows of the effects. The D is that of the elastic cable: creep has more.
    """
    depth = np.maximum(position - p.contact_angle, 0.0)
    spring = e.position_dependent_load_stiffness * (position - e.position_dependent_load_neutral)
    force = (p.contact_stiffness * depth + p.payload_torque * np.cos(position) + spring) / p.output_radius
    stretch = (force - p.preload_top / length_top + p.preload_bottom / length_bottom) / (
        1 / length_top + 1 / length_bottom
    )
    stretch = np.where(stretch > p.preload_bottom[:], force * length_top - p.preload_top[:], stretch)
    stretch = np.where(stretch < -p.preload_top[:], force * length_bottom + p.preload_bottom[:], stretch)
    hard = 0.5 * e.stiffness_hardening_coefficient

    def tensions(stretch):
        top = np.maximum(p.preload_top + stretch, 0.0) / length_top
        bottom = np.maximum(p.preload_bottom - stretch, 0.0) / length_bottom
        return top * (1.0 + hard * top), bottom * (1.0 + hard * bottom)

    if np.any(hard > 0.0):
        wide = np.abs(force) * np.maximum(length_top, length_bottom) + np.abs(p.preload_top) + np.abs(p.preload_bottom)
        low, high = -wide, wide
        for _ in range(100):
            middle = 0.5 * (low + high)
            top, bottom = tensions(middle)
            low, high = np.where(top - bottom < force, middle, low), np.where(top - bottom < force, high, middle)
        stretch = np.where(hard > 0.0, 0.5 * (low + high), stretch)
    return stretch / p.stretch_stiffness, *tensions(stretch)


def settle_ends(x, s, p, e, position: np.ndarray, elongation, top, bottom) -> None:
    """Write signals and states of effects of mechanisms at rest with uniform tensions.

    ``elongation`` is the D of the elastic cable.
    """
    x.output_angle[:] = position
    pulley = (position + elongation * (1.0 + lasting(e))) / p.gear
    s.creep_top[:] = lasting(e) * p.stretch_stiffness * elongation
    s.slow_creep_top[:] = e.slow_creep_share * p.stretch_stiffness * elongation
    s.creep_bottom[:], s.slow_creep_bottom[:] = -s.creep_top, -s.slow_creep_top
    s.pulley_angle[:] = pulley
    x.drive_angle[:], s.gap_position[:] = drive_at(pulley, p.drive_radius * (top - bottom), e)
    x.tension_drive_top[:], x.tension_output_top[:] = top, top
    x.tension_drive_bottom[:], x.tension_output_bottom[:] = bottom, bottom
    x.drive_torque[:] = p.drive_radius * (top - bottom)
    x.output_torque[:] = p.output_radius * (top - bottom)
    x.out_of_range[:] = (top <= 0.0) | (bottom <= 0.0)
    x.peak_tension[:] = np.maximum(top, bottom)


def raised(p, stiffness_in, stiffness_out, dt: float) -> None:
    """Raise inertias and dampings that are too small for steps of dt, in place (`Plant.raise_to`).

    A contact or cable that tightens within a step is noticed late and pushes too hard: up to (omega dt)^2 / 4 of the
    energy is fed in. So omega dt is kept below 0.7 by the least inertia that does it, and a relaxation time of at
    least dt (omega dt)^6 takes more than that out again. Neither touches the rigs of the paper at 1 ms.
    """
    p.drive_inertia[:] = np.maximum(p.drive_inertia, 2.0 * dt * dt * stiffness_in)
    p.output_inertia[:] = np.maximum(p.output_inertia, 2.0 * dt * dt * stiffness_out)
    fast = dt * dt * np.maximum(stiffness_in / p.drive_inertia, stiffness_out / p.output_inertia)
    tau = dt * fast * fast * fast
    p.stretch_damping[:] = np.maximum(p.stretch_damping, tau * p.stretch_stiffness)
    p.contact_damping[:] = np.maximum(p.contact_damping, tau * p.contact_stiffness)


def resolved(p, e, stiffness_in, stiffness_out, length_top, length_bottom) -> np.ndarray:
    """Longest steps, s, of servo and both inertias on the stiffnesses (N m) they feel (`Plant.longest_step`)."""
    share_in, share_out = (
        stiffness_in / p.stretch_stiffness,
        (stiffness_out - p.contact_stiffness) / p.stretch_stiffness,
    )
    tension = np.maximum(p.preload_top / length_top, p.preload_bottom / length_bottom)
    harder = np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * np.maximum(tension, 0.0))
    swing = p.output_damping + p.contact_damping + share_out * p.stretch_damping
    turn = p.drive_damping + share_in * p.stretch_damping
    spring = p.contact_stiffness + share_out * p.stretch_stiffness * harder + e.position_dependent_load_stiffness
    ends = np.minimum(
        longest_step(p.drive_inertia, turn, stiffness_in * harder), longest_step(p.output_inertia, swing, spring)
    )
    return np.minimum(ends, longest_step(1.0, p.servo_damping, p.servo_stiffness))


@inline
def drive_step(x, p, u, g, i, torque, stiffness, damping, dt):
    """Drive velocity after dt, and how far the drive falls short of its mean speed where friction stops it.

    Position mode: a servo of second order with speed and acceleration limits, ``command_rate`` as feedforward, that the
    cables cannot push. Torque mode: J a = command - b v - M_in, where ``torque`` is M_in at the predicted middle of the
    step and ``stiffness``, ``damping`` are its slopes. The speed limit acts in both. ``g``: None, or with effects what
    says that the drive follows a path.
    """
    v = x.drive_velocity[i]
    k, d = p.servo_stiffness[i], p.servo_damping[i]
    rate = clip(u.command_rate[i], -p.drive_speed_limit[i], p.drive_speed_limit[i])
    pull = k * (u.command[i] - x.drive_angle[i] - 0.5 * dt * v) + d * (rate - v)
    push = clip(u.command[i], -p.drive_torque_limit[i], p.drive_torque_limit[i]) - p.drive_damping[i] * v - torque
    by_torque = u.mode[i] > 0.5
    k, d = select(by_torque, stiffness, k), select(by_torque, p.drive_damping[i] + damping, d)
    inertia = ringing_inertia(select(by_torque, p.drive_inertia[i], 1.0), d, k, dt)
    most = select(by_torque, 2.0 * p.drive_speed_limit[i], p.drive_acceleration_limit[i] * dt)
    change = clip(dt * select(by_torque, push, pull) / inertia, -most, most)
    new = clip(v + change, -p.drive_speed_limit[i], p.drive_speed_limit[i])
    if g is not None:
        new = select(g.follows[i] > 0.5, g.target_rate[i], new)
    return new, 0.0


@inline
def load_torque(p, u, i, angle, v, level):
    """(torque, stiffness, damping) of the load less its brake: viscous friction, grasped object, payload, disturbance.

    The object only pushes back, and only beyond the contact angle; the payload hangs at ``payload_arm`` from a
    horizontal axis, level at angle 0: ``level`` is cos(angle). The disturbance helps positive motion.
    """
    depth = angle - p.contact_angle[i]
    push = maximum(p.contact_stiffness[i] * depth + p.contact_damping[i] * v, 0.0)
    touching = select(depth > 0.0, select(push > 0.0, 1.0, 0.0), 0.0)
    torque = p.output_damping[i] * v + touching * push + p.payload_torque[i] * level - u.disturbance[i]
    return torque, touching * p.contact_stiffness[i], p.output_damping[i] + touching * p.contact_damping[i]


@inline
def moving(v, up, down):
    """What moves an output with the speed v: the net torque with its friction against ``up`` or ``down``."""
    return select(v > 0.0, up, select(v < 0.0, down, maximum(up, 0.0) + minimum(down, 0.0)))


@inline
def largest(x, i):
    """The largest tension that is shown of the two cables, N."""
    top, bottom = x.tension_drive_top[i], x.tension_drive_bottom[i]
    return maximum(maximum(top, x.tension_output_top[i]), maximum(bottom, x.tension_output_bottom[i]))


@inline
def cosine(x):
    """cos x, see `kernels.sine_cosine`."""
    return sine_cosine(x)[1]


@inline
def any_payload(p, lanes):
    """Whether one of the columns carries a payload; without, the cosine of its angle need not be known."""
    found = False
    for i in range(lanes):
        found = found or p.payload_torque[i] != 0.0
    return found
