"""A real drive for the tendon in a sheath: a motor that turns a spool (`cable_envs.plants.servo`).

In position mode the command is the servo's reference; in tension mode it is what the motor is to pull with. The sheath
with contacts has its pieces in `cable_envs.plants.sheath.contact_motor`.
"""

from dataclasses import replace

from cable_envs.core.kernels import inline, select
from cable_envs.plants.base import Plant
from cable_envs.plants.servo import ALONG, ENCODER, QUICKLY, Mount, along, mounted, pulling, servo_signals
from cable_envs.plants.servo_stages import motor_step_in_gap, servo_reads
from cable_envs.plants.sheath import contact_motor
from cable_envs.plants.sheath.plant import felt, load_onward


@inline
def drive_speed(x, p, u, e, s, i, ahead, dt):
    """Speed of the drive after dt, in the place of `sheath.plant.drive_speed`."""
    at, speed, half = x.drive_position[i], x.drive_velocity[i], 0.5 * dt
    by_force = u.mode[i] > 0.5
    servo_reads(x, p, i, at, speed, by_force, u.command[i], u.command_rate[i], dt)
    gap = select(by_force, 0.0, e.backlash_gap[i])
    k, c = felt(x, p, u, e, s, i)
    v = x.load_velocity[i]
    pull = x.drive_tension[i] + k * half * (speed - load_onward(v, ahead)) + c * (v - ahead)
    return motor_step_in_gap(x, p, i, at, speed, pull, k, c, at - s.gap_position[i], gap, dt)


CONTACTS = {
    name: getattr(contact_motor, name) for name in ("drive_row", "drive_end", "drive_way", "drive_shows", "at_speeds")
}  # fmt: skip
"""Pieces of the sheath with contacts."""


def with_motor(plant: Plant) -> Plant:
    """The plant, with contacts or without, with a real drive in the place of its ideal one."""
    several = "slip_position" in plant.signal_rows
    if several:
        plant = replace(plant, scratch=plant.scratch.extended(contact_motor.SCRATCH))
    mount = Mount(
        parameters=ALONG,
        signals=servo_signals("position", "m", "force", "N"),
        measured=ENCODER,
        held=pulling,
        pieces=CONTACTS if several else {"drive_speed": drive_speed},
        own=lambda value: along(value, value["drive_speed_limit"], value["tension_command_limit"]),
        total="drive_mass",
        gaps=1,
        reading=QUICKLY,
    )
    return mounted(plant, mount)
