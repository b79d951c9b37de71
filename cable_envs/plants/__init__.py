"""One folder per plant; `plant_for` finds them by name."""

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.plants.base import Plant

NAMES = ("cable_hole", "pulley_circuit", "linear_drive")
VARIANTS = ("analytic", "chain")


def plant_for(name: str, variant: str = "analytic", holes: int = 1) -> Plant:
    """The plant ``name``; ``variant`` chooses the circuit's closed form or its span-and-contact chain."""
    if variant not in VARIANTS:
        raise ConfigurationError(f"unknown plant variant '{variant}'; {nearest(variant, VARIANTS)}")
    if name == "cable_hole":
        from cable_envs.plants.hole.plant import cable_hole

        return cable_hole(holes)
    if name in NAMES and holes != 1:
        raise ConfigurationError("'holes' belongs to cable_hole rigs only")
    if name == "pulley_circuit":
        if variant == "chain":
            from cable_envs.plants.circuit import chain

            return chain.PLANT
        from cable_envs.plants.circuit import closed_form

        return closed_form.PLANT
    if name == "linear_drive":
        from cable_envs.plants.drive import plant

        return plant.PLANT
    raise ConfigurationError(f"unknown plant '{name}'; {nearest(name, NAMES)}")
