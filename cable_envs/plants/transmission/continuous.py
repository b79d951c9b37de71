"""The transmission in continuous time: its state is the angle of the drive, and its law is that of the kernel.

Without a memory: the contacts follow the sign of the motion (``presliding_hysteresis.share`` 0), and where the drive
rests its direction is opening, as the kernel begins.
"""

from cable_envs.plants.base import ActionMode, Plant
from cable_envs.plants.continuous import Equations, Input, Rows, Values, along
from cable_envs.plants.transmission.plant import _step


def _law(state, rows: Rows, way):
    (angle,) = state
    p, u, e, s, g, _, x = rows
    v = u.command_rate[0]
    g.target[0], g.target_rate[0], x.direction[0] = angle, along(v, way), way
    _step(x, p, u, e, s, g, 0)  # a fresh one: no play has been taken anywhere yet
    return (v,), (x.output_angle[0], x.output_torque[0], x.drive_torque[0])


def equations(plant: Plant, mode: ActionMode | None, value: Values) -> Equations:
    """The equations of a transmission whose drive is moved."""
    return Equations(
        states=("drive_angle",),
        inputs=(
            Input("drive_velocity", "rad/s", "speed of the drive", "command_rate"),
            Input("drive_reading", "N m", "reading of the drive's torque sensor: torque or current", "disturbance"),
        ),
        outputs=("output_angle", "output_torque", "drive_torque"),
        law=_law,
        place="drive_angle",
        slides=("drive_velocity",),
        effects=(
            "cable_elongation", "stiffness_hardening", "coulomb_friction", "load_dependent_friction", "partial_slip",
            "viscous_friction", "stribeck_friction", "position_ripple", "position_dependent_load",
        ),
        speed=1e-2,
    )  # fmt: skip
