"""The cable drawn through one or more holes of Gu et al. 2024."""

from cable_envs.core.params import Parameter
from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    from cable_envs.plants.hole.plant import cable_hole

    return cable_hole(holes)


def _as_v0(plant):
    from cable_envs.plants.hole.v0 import as_v0

    return as_v0(plant)


def _with_motor(plant):
    from cable_envs.plants.hole.motor import with_motor

    return with_motor(plant)


FAMILY = Family(
    name="cable_hole",
    title="Cable through a hole",
    build=_build,
    as_v0=_as_v0,
    with_motor=_with_motor,
    series=True,
    tasks="CableHole",
    outputs={
        "position": Output("position_reference"),
        "tension": Output(
            "tension_reference", start=lambda value, wanted: wanted / value["load_stiffness"], needs=("load_stiffness",)
        ),
    },
    observe="output",
    continuous="cable_envs.plants.hole.continuous:equations",
    scene="cable_envs.plants.hole.scene:HoleScene",
    shown=("drive_position", "drive_tension", "load_position", "load_tension", "sliding"),
    channels={
        "time": "s", "drive_position": "m", "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m",
        "load_tension": "N", "wrap_angle": "rad", "drive_velocity_command": "m/s", "drive_tension_command": "N",
        "position_reference": "m", "tension_reference": "N",
    },
    commands={"tension": "drive_tension_command", "speed": "drive_velocity_command"},
    known=("load_mass", "gravity", "load_gravity", "wrap_angle", "radius_ratio", "cable_radius", "hole_radius"),
    nominal=(
        "friction_coefficient", "extrusion_delta", "extrusion_gain", "extrusion_exponent", "cable_stiffness",
        "cable_damping", "bending_rigidity", "load_stiffness", "load_damping",
    ),
    beside=(Parameter("hole_radius", "m", 1.5e-3, 1e-6, 1.0, "radius R of the hole's edge"),),
    needs=(
        ("drive_velocity_command", "drive_position"), ("drive_tension", "load_position", "load_tension"),
    ),
    ways=("lifting", "lowering"),
)  # fmt: skip
