"""A real drive above the hole: a motor that turns a spool or a screw (`cable_envs.plants.servo`).

In tension mode the command is what the motor is to pull with: what friction, gear and inertia take of it the cable does
not get. There is no inner tension loop. In speed mode the command is the speed at which the servo's reference moves on,
within the drive's limits of speed and acceleration, and never further ahead of the encoder than the saturator's torque
over the servo's gain.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cable_envs.core.kernels import clip, inline, maximum, select
from cable_envs.core.params import Parameter
from cable_envs.physics.friction import ringing_way
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.hole.drive import carried, told_step
from cable_envs.plants.hole.series_stages import first_span as ideal_span
from cable_envs.plants.hole.series_stages import moved as ideal_moved
from cable_envs.plants.hole.spool import nut_before, wound
from cable_envs.plants.servo import ALONG, ENCODER, Mount, along, mounted, pulling, servo_signals
from cable_envs.plants.servo_stages import felt_share, motor_shows, motor_step_in_gap, motor_torques, servo_reads

PARAMETERS = (
    *ALONG,
    Parameter("drive_mass", "kg", 0.3, 0.0, 1e4, "mass that moves along with the cable's end", "chosen: a carriage"),
    Parameter("drive_damping", "N s/m", 20.0, 0.0, 1e5, "viscous friction of the drive", "chosen"),
)

SIGNALS = (
    *servo_signals("position", "m", "force", "N"),
    Signal("servo_target", "m", "position that the servo is to hold in speed mode"),
    Signal("servo_pace", "m/s", "speed of that position"),
)


@inline
def told(x, p, u, g, i, at, old, dt):
    """The encoder is read and the servo asks for its force; in speed mode its reference moves on then.

    The reading comes first: how far ahead of it the reference may go does not depend on the step.
    """
    by_force, goal, pace = u.mode[i] < 0.5, x.servo_target[i], x.servo_pace[i]
    servo_reads(x, p, i, at, old, by_force, select(by_force, u.command[i], goal), select(by_force, 0.0, pace), dt)
    leash = p.servo_limit[i] / maximum(p.servo_kp[i], 1e-9)
    new, early = told_step(p, u, g, i, pace, dt)
    ahead = goal + 0.5 * dt * (pace + new) + early
    onward = clip(ahead, x.encoder_angle[i] - leash, x.encoder_angle[i] + leash)
    x.servo_target[i] = select(by_force, goal, onward)
    x.servo_pace[i] = select(by_force, pace, new)


@inline
def _load_ahead(x, p, w, e, g, i, dt):
    """Speed of the load in the middle of the step, from the forces at its start."""
    v, above, n, inv_n, half = x.load_velocity[i], x.drive_tension[i], w.ratio[i], w.inverse[i], 0.5 * dt
    up, down = above * inv_n - w.resistance[i], above * n - w.resistance[i]
    if e is not None:
        up, down = up - g.up[i], down + g.down[i]
    rises, falls = (v > 0.0) | ((v == 0.0) & (up > 0.0)), (v < 0.0) | ((v == 0.0) & (down < 0.0))
    net, share = select(rises, up, select(falls, down, 0.0)), select(rises, inv_n, n)
    damping = w.resistance_damping[i] + share * w.damping[i]
    stiffness = w.resistance_stiffness[i] + share * w.stiffness[i]
    return v + half * net / (p.load_mass[i] + half * (damping + half * stiffness))


@inline
def hauled(x, p, u, w, e, s, g, i, dt):
    """The drive of one hole, in the place of the ideal one."""
    at, old, half = x.drive_position[i], x.drive_velocity[i], 0.5 * dt
    told(x, p, u, g, i, at, old, dt)
    ahead = _load_ahead(x, p, w, e, g, i, dt)
    tension, end, gap, lead = x.drive_tension[i], 1.0, 0.0, 0.0
    held = tension > 0.0
    by_force = u.mode[i] < 0.5
    if e is not None:
        gap = e.backlash_gap[i]
        nut = nut_before(e, s, i, at, by_force)
        _, end = wound(e, i, nut)
        lead = at - nut
        held = held & (g.imposes[i] < 0.5)
    k, c = select(held, w.stiffness[i], 0.0), select(held, w.damping[i], 0.0)
    speed = x.load_velocity[i]
    stretched = half * (end * old - speed) - ringing_way(2.0 * (ahead - speed), dt)
    middle = maximum(tension + k * stretched + c * (speed - ahead), 0.0)
    new, short = motor_step_in_gap(
        x, p, i, at, old, middle, k * end, c * end, lead, select(by_force, 0.0, gap), dt
    )  # fmt: skip
    carried(x, w, e, s, g, i, new, dt, short, by_force)


@inline
def drive_row(x, p, u, w, e, s, g, i, dt):
    """The drive's speed before the step, in the place of the ideal drive of holes in series."""
    w.rate[0, i] = x.drive_velocity[i]
    w.told[i], w.loops[i], w.old[i] = 0.0, 0.0, x.drive_velocity[i]
    w.most[i], w.alone[i], w.fastest[i] = 0.0, 0.0, 0.0
    w.by_force[i] = select(u.mode[i] < 0.5, 1.0, 0.0)
    if e is not None:
        w.by_force[i] = select(g.follows[i] > 0.5, 0.0, w.by_force[i])


@inline
def first_span(x, p, u, w, e, s, g, i, dt):
    """The span between drive and first hole, then the balance of the drive: the step is solved with its tension."""
    ideal_span(x, p, u, w, e, s, g, i, dt)
    at, old = x.drive_position[i], x.drive_velocity[i]
    told(x, p, u, g, i, at, old, dt)
    forward, backward, cogging, damping = motor_torques(x, p, i, at, old, dt)
    felt = 1.0
    if e is not None:
        by_force = w.by_force[i] > 0.5
        gap, lead = select(by_force, 0.0, e.backlash_gap[i]), at - nut_before(e, s, i, at, by_force)
        felt = felt_share(p, i, old, forward, backward, cogging, damping, lead, gap, dt)
    friction, against = p.drive_friction[i], cogging + p.moved_damping[i] * old
    up, down, pull = forward - friction - against, backward + friction - against, felt * x.drive_tension[i]
    rises = (old > 0.0) | ((old == 0.0) & (up > pull))
    falls = (old < 0.0) | ((old == 0.0) & (down < pull))
    share = 0.5 * dt / (p.moved_inertia[i] + 0.5 * dt * damping)  # of the mean speed, in what moves the drive
    w.by_tension[i] = felt * share
    w.wanted[i] = old + share * select(rises, up, down)
    w.low[i], w.high[i] = select(falls, -p.top_speed[i], 0.0), select(rises, p.top_speed[i], 0.0)
    if e is not None:
        moved = select(g.follows[i] > 0.5, g.target_rate[i], 0.0)
        other = (g.follows[i] > 0.5) | (g.imposes[i] > 0.5)
        w.low[i], w.high[i] = select(other, moved, w.low[i]), select(other, moved, w.high[i])
    w.low[i], w.high[i] = 0.5 * (old + w.low[i]), 0.5 * (old + w.high[i])


@inline
def moved(x, p, u, w, e, s, g, i, dt):
    """State and tensions after the step, and what the motor shows of it."""
    ideal_moved(x, p, u, w, e, s, g, i, dt)
    motor_shows(x, p, i, x.drive_velocity[i], x.drive_tension[i])


def _on_cable(plain: Callable) -> Callable:
    """The plant's ``resolves``, with the drive on the cable too."""

    def resolved(p, e) -> np.ndarray:
        harder = np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * p.load_weight)
        drive = longest_step(p.moved_inertia, p.moved_damping + p.cable_damping, p.cable_stiffness * harder)
        return np.minimum(plain(p, e), drive)

    return resolved


def with_motor(plant: Plant) -> Plant:
    """The plant, of one hole or of several, with a real drive in the place of its ideal one."""
    one = {"_hauled": hauled}
    several = {"drive_row": drive_row, "first_span": first_span, "moved": moved}
    mount = Mount(
        parameters=PARAMETERS,
        signals=SIGNALS,
        measured=ENCODER,
        held=pulling,
        pieces=one if "span_stiffness" not in plant.parameters else several,
        own=lambda value: along(value, value["drive_speed_limit"], value["tension_command_limit"]),
        plain={"inner_kp": 0.0, "inner_kd": 0.0},
        more=("servo_target", "servo_pace"),
        start={"servo_target": "drive_position"},
        gaps=1,
    )
    assert plant.resolves is not None
    return mounted(replace(plant, resolves=_on_cable(plant.resolves)), mount)
