"""Real drives for the wrist: a motor behind either joint turns a spool that winds its two cables.

The motors are alike (`cable_envs.plants.servo`). Their coordinate is the cable that is wound up, r_y d and r_p d_p, so
that ``spool_radius`` is that of the discs in the instrument's foot; what a motor feels is the difference of its cables'
tensions. The commands are the references of both servos.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cable_envs.core.kernels import clip, inline, select
from cable_envs.core.params import Parameter
from cable_envs.physics.modes import COUPLED, longest_step
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.servo import ALONG, Mount, along, mounted, servo_signals
from cable_envs.plants.servo_stages import drive_of, motor_step_in_gap, servo_reads
from cable_envs.plants.tendon import span_slope

PARAMETERS = (
    *ALONG,
    Parameter("drive_mass", "kg", 0.01, 0.0, 1e4, "mass that moves along with a pair of cables", "chosen: its rods"),
    Parameter("drive_damping", "N s/m", 20.0, 0.0, 1e5, "viscous friction of a drive, at the cable", "chosen"),
    Parameter("drive_force_limit", "N", 90.0, 1e-3, 1e5, "largest force of a drive, at the cable", "chosen"),
)

SIGNALS = (
    *servo_signals("position", "m", "force", "N", {"{}_{}": "yaw drive", "pitch_{}_{}": "pitch drive"}),
    Signal("encoder_angle", "rad", "what the encoder of the yaw drive shows, over r_y"),
    Signal("encoder_rate", "rad/s", "rate of the encoder of the yaw drive, over r_y"),
    Signal("pitch_encoder_angle", "rad", "what the encoder of the pitch drive shows, over r_p"),
)


@inline
def go_half(x, p, u, w, g, i, dt):
    """Takes both drives to the middle of the step with the speed that they have, in the place of the ideal ones."""
    half, follows, wound = 0.5 * dt, g.follows[i] > 0.5, x.drive_angle[i]
    w.middle[i] = select(follows, 0.5 * (wound + g.target[i]), wound + half * x.drive_velocity[i])
    w.pitch_middle[i] = x.pitch_drive_angle[i] + half * x.pitch_drive_velocity[i]


@inline
def _hauled(d, p, i, radius, wound, speed, target, rate, ta, tb, stiffness, lead, gap, dt):
    """Speed of one drive after dt, rad/s, and what it falls short where it stops, rad.

    ``d`` are its rows, the tensions those of the middle of the step; ``lead`` as of `wrist.plant.go_on`.
    """
    at, v, fastest = radius * wound, radius * speed, radius * p.drive_speed_limit[i]
    servo_reads(d, p, i, at, v, False, radius * target, radius * rate, dt)
    steep = span_slope(stiffness, ta, 0.0) + span_slope(stiffness, tb, 0.0)
    new, short = motor_step_in_gap(d, p, i, at, v, ta - tb, steep, 0.0, radius * lead, radius * gap, dt)
    return clip(new, -fastest, fastest) / radius, short / radius


@inline
def go_on(x, p, u, w, e, g, i, lead, dt):
    """Takes both drives on with the tensions there, in the place of the ideal ones."""
    half, follows = 0.5 * dt, g.follows[i] > 0.5
    new, short = _hauled(
        drive_of(x, 0), p, i, p.yaw_radius[i], x.drive_angle[i], x.drive_velocity[i], u.command[i], u.command_rate[i],
        x.tension_drive_a[i], x.tension_drive_b[i], p.drive_stiffness[i], lead, e.backlash_gap[i], dt,
    )  # fmt: skip
    pitch_new, pitch_short = _hauled(
        drive_of(x, 1), p, i, p.pitch_radius[i], x.pitch_drive_angle[i], x.pitch_drive_velocity[i], w.second[i],
        w.second_rate[i], x.pitch_tension_drive_a[i], x.pitch_tension_drive_b[i], p.pitch_drive_stiffness[i], 0.0, 0.0,
        dt,
    )  # fmt: skip
    w.after[i] = select(follows, g.target[i], w.middle[i] + half * new - short)
    w.speed_after[i] = select(follows, g.target_rate[i], new)
    w.pitch_after[i], w.pitch_speed_after[i] = w.pitch_middle[i] + half * pitch_new - pitch_short, pitch_new


@inline
def encoders(x, p, i):
    """What both encoders show at the scale of the joints, in the place of `wrist.plant.encoders`."""
    x.shown_angle[i] = x.encoder_angle[0, i] / p.yaw_radius[i]
    x.shown_rate[i] = x.encoder_velocity[0, i] / p.yaw_radius[i]
    x.pitch_shown_angle[i] = x.encoder_angle[1, i] / p.pitch_radius[i]


def _held(x, p):
    return (
        (p.yaw_radius * x.drive_angle, x.tension_drive_a - x.tension_drive_b),
        (p.pitch_radius * x.pitch_drive_angle, x.pitch_tension_drive_a - x.pitch_tension_drive_b),
    )


def _own(value):
    fastest = value["drive_speed_limit"] * np.maximum(value["yaw_radius"], value["pitch_radius"])
    return along(value, fastest, value["drive_force_limit"])


def _on_cables(plain: Callable) -> Callable:
    """The plant's ``resolves``, with the drives on their cables too."""

    def resolved(p, e) -> np.ndarray:
        stiffness = 2.0 * np.maximum(p.drive_stiffness, p.pitch_drive_stiffness)
        return np.minimum(plain(p, e), COUPLED * longest_step(p.moved_inertia, p.moved_damping, stiffness))

    return resolved


def with_motor(plant: Plant) -> Plant:
    """The plant with two real drives in the place of its ideal ones."""
    assert plant.resolves is not None
    mount = Mount(
        parameters=PARAMETERS,
        signals=SIGNALS,
        measured={
            "drive_angle": "encoder_angle", "drive_velocity": "encoder_rate",
            "pitch_drive_angle": "pitch_encoder_angle",
        },
        held=_held,
        pieces={"go_half": go_half, "go_on": go_on, "encoders": encoders},
        own=_own,
        more=("shown_angle", "shown_rate", "pitch_shown_angle"),
        start={"shown_angle": "drive_angle", "pitch_shown_angle": "pitch_drive_angle"},
        gaps=1,
    )  # fmt: skip
    return mounted(replace(plant, resolves=_on_cables(plant.resolves)), mount)
