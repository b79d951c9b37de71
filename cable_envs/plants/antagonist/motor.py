"""Real drives for the joint with two tendons: each tendon has a motor that turns a spool (`cable_envs.plants.servo`).

Both motors are alike. In position mode the drives' targets are the references of their servos; in torque mode their
forces are what the motors are to pull with: friction and gear take their share, and a tendon drags an idle motor along.
"""

from cable_envs.core.kernels import inline, select
from cable_envs.plants.antagonist.plant import asked_of, forces
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.servo import ALONG, Mount, along, mounted, servo_signals
from cable_envs.plants.servo_stages import drive_of, motor_step_in_gap, servo_reads
from cable_envs.plants.tendon import span_slope

SIGNALS = (
    *servo_signals("position", "m", "force", "N", {"{}_a_{}": "drive a", "{}_b_{}": "drive b"}),
    Signal("encoder_angle", "rad", "what the encoders show, as drive_angle is the drives' positions"),
)


@inline
def _hauled(d, p, i, at, speed, by_force, target, rate, tension, lead, gap, dt):
    """Speed of one drive after dt; ``d`` are its rows, ``lead`` is how far it is ahead of the middle of its nut."""
    servo_reads(d, p, i, at, speed, by_force, target, rate, dt)
    stiffness = span_slope(p.drive_stiffness[i], tension, p.tendon_hardening[i])
    gap = select(by_force, 0.0, gap)
    return motor_step_in_gap(d, p, i, at, speed, tension, stiffness, 0.0, lead, gap, dt)


@inline
def driven(x, p, u, w, e, g, i, lead_a, lead_b, dt):
    """Speeds of both drives after dt and what they fall short, in the place of `antagonist.plant.driven`."""
    to_a, to_b, rate_a, rate_b = asked_of(p, e, i, u.command[i], u.command_rate[i], w.second[i], w.second_rate[i])
    force_a, force_b = forces(p, i, u.command[i], w.second[i])
    by_force, ta, tb = u.mode[i] > 0.5, x.tension_drive_a[i], x.tension_drive_b[i]
    told_a, told_b = select(by_force, force_a, to_a), select(by_force, force_b, to_b)
    va, vb = x.drive_a_velocity[i], x.drive_b_velocity[i]
    xa, xb, gap = x.drive_a_position[i], x.drive_b_position[i], p.moment_arm[i] * e.backlash_gap[i]
    new_a, short_a = _hauled(drive_of(x, 0), p, i, xa, va, by_force, told_a, rate_a, ta, lead_a, gap, dt)
    new_b, short_b = _hauled(drive_of(x, 1), p, i, xb, vb, by_force, told_b, rate_b, tb, lead_b, gap, dt)
    return new_a, new_b, short_a, short_b


@inline
def encoders(x, p, i):
    """What both encoders show, in the place of `antagonist.plant.encoders`."""
    x.shown_angle[i] = 0.5 * (x.encoder_angle[0, i] - x.encoder_angle[1, i]) / p.moment_arm[i]


def _held(x, p):
    return (x.drive_a_position, x.tension_drive_a), (x.drive_b_position, x.tension_drive_b)


def with_motor(plant: Plant) -> Plant:
    """The plant with two real drives in the place of its ideal ones."""
    mount = Mount(
        parameters=ALONG,
        signals=SIGNALS,
        measured={"drive_angle": "encoder_angle"},
        held=_held,
        pieces={"driven": driven, "encoders": encoders},
        own=lambda value: along(value, value["drive_speed_limit"], value["drive_force_limit"]),
        total="drive_mass",
        more=("shown_angle",),
        start={"shown_angle": "drive_angle"},
        gaps=2,
    )
    return mounted(plant, mount)
