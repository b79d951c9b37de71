"""A band around a drum that is driven to and fro, between a displacement and a force sensor."""

from cable_envs.plants.family import Family


def _build(variant: str, holes: int):
    from cable_envs.plants.band_brake.plant import PLANT

    return PLANT


FAMILY = Family(
    name="band_brake",
    title="Band brake",
    build=_build,
    continuous="cable_envs.plants.band_brake.continuous:equations",
    scene="cable_envs.plants.band_brake.scene:BandBrakeScene",
    shown=("position", "velocity", "slip", "force", "band_tension_difference"),
)
