"""Two motors that turn a sprung pulley through a belt, seen by a speed sensor that may rectify."""

from cable_envs.plants.family import Family


def _build(variant: str, holes: int):
    from cable_envs.plants.coupled_drives.plant import PLANT

    return PLANT


FAMILY = Family(
    name="coupled_drives",
    title="Coupled electric drives",
    build=_build,
    continuous="cable_envs.plants.coupled_drives.continuous:equations",
    scene="cable_envs.plants.coupled_drives.scene:CoupledDrivesScene",
    shown=("motor_position", "pulley_position", "belt_force", "voltage", "speed_reading"),
)
