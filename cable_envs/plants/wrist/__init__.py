"""A wrist of two joints driven by cables: those of the second joint run over the first, and are moved by it."""

from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    from cable_envs.plants.wrist.plant import PLANT

    return PLANT


def _with_motor(plant):
    from cable_envs.plants.wrist.motor import with_motor

    return with_motor(plant)


FAMILY = Family(
    name="wrist",
    title="Coupled wrist",
    build=_build,
    with_motor=_with_motor,
    tasks="Wrist",
    outputs={"position": Output("angle_reference")},
    observe="output",
    view="cable_envs.plants.wrist.view:WristView",
    continuous="cable_envs.plants.wrist.continuous:equations",
    scene="cable_envs.plants.wrist.scene:WristScene",
    shown=(
        "yaw_angle", "pitch_angle", "drive_angle", "pitch_drive_angle", "tension_end_a", "tension_end_b",
        "pitch_tension_end_a", "pitch_tension_end_b",
    ),
    ways=("turning to a", "turning to b"),
)  # fmt: skip
