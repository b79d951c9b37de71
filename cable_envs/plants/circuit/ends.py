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

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import clip, inline, maximum, select, sine_cosine
from cable_envs.effects.rows import (
    CREEP,
    CREEP_B,
    CREEP_T,
    HARDENING,
    NEUTRAL,
    PLAY,
    PLAYED,
    ROWS_E,
    ROWS_S,
    SLACK_LENGTH,
    SPRING,
)  # fmt: skip
from cable_envs.effects.seams import FOLLOWS, TARGET_V
from cable_envs.plants.base import COMMAND, COMMAND_RATE, DISTURBANCE, MODE, ActionMode, Signal
from cable_envs.plants.circuit.effects import drive_at
from cable_envs.plants.circuit.parameters import CIRCUIT
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
(THETA_IN, V_IN, M_IN, THETA_OUT, V_OUT, M_OUT, T01_T, T01_B, T45_T, T45_B,
 PHASE, OUT_OF_RANGE, SLACK, PEAK) = range(len(SIGNALS))  # fmt: skip

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
(GEAR, R0, R5, EA5, C5, PRE_T, PRE_B, J_IN, B_IN, M_MAX, V_MAX, A_MAX, SERVO_K, SERVO_D, J_OUT, B_OUT,
 CONTACT, CONTACT_K, CONTACT_D, PAYLOAD, BRAKE) = range(len(COEFFICIENTS))  # fmt: skip
SHARED = len(COEFFICIENTS)


def shared_coefficients(values: np.ndarray, statics: Statics, effects: np.ndarray | None) -> np.ndarray:
    """Rows named by `COEFFICIENTS` [len, n] from parameter columns; raises ConfigurationError for senseless ones.

    ``effects``: coefficient rows of the effects, or None.
    """
    row = {name: values[k] for k, name in enumerate(CIRCUIT.names)}
    if np.any(row["breaking_tension"] < row["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any(statics.pretension.max(axis=0) >= row["breaking_tension"]):
        raise ConfigurationError("the pretension alone exceeds breaking_tension")
    arm = row["payload_mass"] * row["payload_arm"]
    preload = statics.pretension * statics.length
    if effects is not None:  # as the linear law would have it, less what slack takes
        linear = 2.0 / (1.0 + np.sqrt(1.0 + 2.0 * effects[HARDENING] * statics.pretension))
        preload = preload * linear - row["tensile_stiffness"] * effects[SLACK_LENGTH]
    return np.array([
        row["drive_radius"] / row["output_radius"], row["drive_radius"], row["output_radius"],
        row["tensile_stiffness"] * row["output_radius"], row["cable_damping"] * row["output_radius"],
        preload[0], preload[1],
        row["drive_inertia"], row["drive_damping"], row["drive_torque_limit"], row["drive_speed_limit"],
        row["drive_acceleration_limit"],
        row["servo_frequency"] ** 2, 2.0 * row["servo_damping_ratio"] * row["servo_frequency"],
        row["output_inertia"] + arm * row["payload_arm"], row["output_damping"],
        row["contact_angle"], row["contact_stiffness"], row["contact_damping"], arm * row["gravity"],
        row["brake_torque"],
    ])  # fmt: skip


def rest_elongation(p: np.ndarray, length_top, length_bottom, position: np.ndarray, e: np.ndarray):
    """(D, T_t, T_b) at rest with uniform tension on each side, balancing the load at ``position`` (rad, [n]).

    ``e``: coefficient rows of the effects. The D is that of the elastic cable: creep has more.
    """
    depth = np.maximum(position - p[CONTACT], 0.0)
    spring = e[SPRING] * (position - e[NEUTRAL])
    force = (p[CONTACT_K] * depth + p[PAYLOAD] * np.cos(position) + spring) / p[R5]
    stretch = (force - p[PRE_T] / length_top + p[PRE_B] / length_bottom) / (1 / length_top + 1 / length_bottom)
    stretch = np.where(stretch > p[PRE_B], force * length_top - p[PRE_T], stretch)
    stretch = np.where(stretch < -p[PRE_T], force * length_bottom + p[PRE_B], stretch)
    hard = 0.5 * e[HARDENING]

    def tensions(stretch):
        top = np.maximum(p[PRE_T] + stretch, 0.0) / length_top
        bottom = np.maximum(p[PRE_B] - stretch, 0.0) / length_bottom
        return top * (1.0 + hard * top), bottom * (1.0 + hard * bottom)

    if np.any(hard > 0.0):
        wide = np.abs(force) * np.maximum(length_top, length_bottom) + np.abs(p[PRE_T]) + np.abs(p[PRE_B])
        low, high = -wide, wide
        for _ in range(100):
            middle = 0.5 * (low + high)
            top, bottom = tensions(middle)
            low, high = np.where(top - bottom < force, middle, low), np.where(top - bottom < force, high, middle)
        stretch = np.where(hard > 0.0, 0.5 * (low + high), stretch)
    return stretch / p[EA5], *tensions(stretch)


def effect_rows(p: np.ndarray, own: int) -> np.ndarray:
    """Rows of the effects behind a plant's ``own`` ones; zeros where there are none."""
    return p[own:] if len(p) > own else np.zeros((ROWS_E, p.shape[1]))


def rest_signals(p: np.ndarray, rows: int, own: int, position: np.ndarray, elongation, top, bottom) -> np.ndarray:
    """Signals [rows, n] of mechanisms at rest with uniform tensions; behind them the states of the effects, if any.

    ``elongation`` is the D of the elastic cable; ``own``: how many coefficients the plant has without effects.
    """
    e = effect_rows(p, own)
    x = np.zeros((rows + (ROWS_S if len(p) > own else 0), p.shape[1]))
    x[THETA_OUT] = position
    pulley = (position + elongation * (1.0 + e[CREEP])) / p[GEAR]
    if len(p) > own:
        x[rows + CREEP_T] = e[CREEP] * p[EA5] * elongation
        x[rows + CREEP_B] = -x[rows + CREEP_T]
        x[rows + PLAYED] = pulley
        pulley, x[rows + PLAY] = drive_at(pulley, p[R0] * (top - bottom), e)
    x[THETA_IN] = pulley
    x[T01_T], x[T45_T], x[T01_B], x[T45_B] = top, top, bottom, bottom
    x[M_IN] = p[R0] * (top - bottom)
    x[M_OUT] = p[R5] * (top - bottom)
    x[OUT_OF_RANGE] = (top <= 0.0) | (bottom <= 0.0)
    x[PEAK] = np.maximum(top, bottom)
    return x


@inline
def resolve(p, i, stiffness_in, stiffness_out, dt):
    """Make a column resolvable by steps of dt: raise its inertias and dampings where they are too small (in place).

    A contact or cable that tightens within a step is noticed late and pushes too hard: up to (omega dt)^2 / 4 of the
    energy is fed in. So omega dt is kept below 0.7 by the least inertia that does it, and a relaxation time of at
    least dt (omega dt)^6 takes more than that out again. Neither touches the rigs of the paper at 1 ms.
    """
    p[J_IN, i] = maximum(p[J_IN, i], 2.0 * dt * dt * stiffness_in)
    p[J_OUT, i] = maximum(p[J_OUT, i], 2.0 * dt * dt * stiffness_out)
    fast = dt * dt * maximum(stiffness_in / p[J_IN, i], stiffness_out / p[J_OUT, i])
    tau = dt * fast * fast * fast
    p[C5, i] = maximum(p[C5, i], tau * p[EA5, i])
    p[CONTACT_D, i] = maximum(p[CONTACT_D, i], tau * p[CONTACT_K, i])


@inline
def drive_step(x, p, u, g, i, torque, stiffness, damping, dt):
    """Drive velocity after dt.

    Position mode: a servo of second order with speed and acceleration limits, ``command_rate`` as feedforward, that the
    cables cannot push. Torque mode: J a = command - b v - M_in, where ``torque`` is M_in at the predicted middle of the
    step and ``stiffness``, ``damping`` are its slopes. The speed limit acts in both. ``g``: None, or with effects what
    says that the drive follows a path.
    """
    v = x[V_IN, i]
    k, d = p[SERVO_K, i], p[SERVO_D, i]
    rate = clip(u[COMMAND_RATE, i], -p[V_MAX, i], p[V_MAX, i])
    pull = k * (u[COMMAND, i] - x[THETA_IN, i] - 0.5 * dt * v) + d * (rate - v)
    push = clip(u[COMMAND, i], -p[M_MAX, i], p[M_MAX, i]) - p[B_IN, i] * v - torque
    by_torque = u[MODE, i] > 0.5
    k, d = select(by_torque, stiffness, k), select(by_torque, p[B_IN, i] + damping, d)
    inertia = select(by_torque, p[J_IN, i], 1.0) + 0.5 * dt * d + 0.25 * dt * dt * k
    most = select(by_torque, 2.0 * p[V_MAX, i], p[A_MAX, i] * dt)
    change = clip(dt * select(by_torque, push, pull) / inertia, -most, most)
    new = clip(v + change, -p[V_MAX, i], p[V_MAX, i])
    if g is not None:
        new = select(g[FOLLOWS, i] > 0.5, g[TARGET_V, i], new)
    return new


@inline
def load_torque(p, u, i, angle, v, level):
    """(torque, stiffness, damping) of the load less its brake: viscous friction, grasped object, payload, disturbance.

    The object only pushes back, and only beyond the contact angle; the payload hangs at ``payload_arm`` from a
    horizontal axis, level at angle 0: ``level`` is cos(angle). The disturbance helps positive motion.
    """
    depth = angle - p[CONTACT, i]
    push = maximum(p[CONTACT_K, i] * depth + p[CONTACT_D, i] * v, 0.0)
    touching = select(depth > 0.0, select(push > 0.0, 1.0, 0.0), 0.0)
    torque = p[B_OUT, i] * v + touching * push + p[PAYLOAD, i] * level - u[DISTURBANCE, i]
    return torque, touching * p[CONTACT_K, i], p[B_OUT, i] + touching * p[CONTACT_D, i]


@inline
def cosine(x):
    """cos x, see `kernels.sine_cosine`."""
    return sine_cosine(x)[1]


@inline
def any_payload(p, lanes):
    """Whether one of the columns carries a payload; without, the cosine of its angle need not be known."""
    found = False
    for i in range(lanes):
        found = found or p[PAYLOAD, i] != 0.0
    return found
