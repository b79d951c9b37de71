"""A one-axis drive with friction, rigid or behind a belt."""

from cable_envs.core.params import Parameter
from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    from cable_envs.plants.drive.plant import PLANT

    return PLANT


FAMILY = Family(
    name="linear_drive",
    title="Linear drive",
    build=_build,
    tasks="LinearDrive",
    outputs={"position": Output("position_reference")},
    view="cable_envs.plants.drive.view:DriveView",
    continuous="cable_envs.plants.drive.continuous:equations",
    scene="cable_envs.plants.drive.scene:DriveScene",
    shown=("position", "motor_position", "belt_force", "force", "sliding"),
    # speed_reading is what a speed sensor reads whose scale is not known and which may rectify (coupled drives); the
    # band tensions are those at the two ends of a band around a drum that ``position`` turns (band brake)
    channels={
        "time": "s", "position": "m", "velocity": "m/s", "force": "N", "voltage": "V", "position_reference": "m",
        "motor_position": "m", "speed_reading": "V", "band_tension_1": "N", "band_tension_2": "N",
    },
    limits={"force": "force_limit", "voltage": "voltage_limit", "position": "position_limit"},
    needs=(("position",), ("force", "voltage")),
    beside=(
        Parameter("force_offset", "N", 0.0, -1e4, 1e4, "constant force: amplifier's offset, a tilted axis"),
        Parameter("speed_scale", "V s/m", 1.0, 1e-9, 1e9, "reading of the speed sensor for 1 m/s"),
    ),
)  # fmt: skip
