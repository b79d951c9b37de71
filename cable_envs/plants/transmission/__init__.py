"""A cable transmission between two torque sensors whose geometry is not known, lumped into contacts and springs."""

from cable_envs.plants.family import Family


def _build(variant: str, holes: int):
    from cable_envs.plants.transmission.plant import PLANT

    return PLANT


FAMILY = Family(
    name="transmission",
    title="Cable transmission of unknown geometry",
    build=_build,
    continuous="cable_envs.plants.transmission.continuous:equations",
    scene="cable_envs.plants.transmission.scene:TransmissionScene",
    shown=("drive_angle", "output_angle", "drive_torque", "output_torque", "direction"),
)
