"""The circuits as the ids ``-v0`` have them, kept so that what was measured on them can be replayed.

Where the output would turn round within a step it stops, and goes the other way in the next one: a light output that
rings through its friction loses part of a step at each reversal, and its vibrations are late by (w dt)^2 / 12 of every
turn. The step need not fit the rig.
"""

from dataclasses import replace

from cable_envs.core.compiling.templates import specialised
from cable_envs.physics.friction import stick_slip_step
from cable_envs.plants.base import Plant
from cable_envs.plants.family import coarse


def as_v0(plant: Plant) -> Plant:
    """The plant with the kernel of the ids ``-v0``."""
    return replace(coarse(plant), solve=specialised(plant.solve, output_slides=stick_slip_step))
