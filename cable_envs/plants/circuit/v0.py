"""The circuits as the ids ``-v0`` have them, kept so that what was measured on them can be replayed.

Where the output would turn round within a step it stops, and goes the other way in the next one: a light output that
rings through its friction loses part of a step at each reversal, and its vibrations are late by (w dt)^2 / 12 of every
turn. Within a step no end of a chain feels how the other changes its speed, and no drive that the output stops. The
peak of a control step leaves its start out. The step need not fit the rig.
"""

from dataclasses import replace

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import inline
from cable_envs.physics.friction import no_way, stick_slip_whole
from cable_envs.plants.base import Plant
from cable_envs.plants.circuit.stages import cw_share
from cable_envs.plants.family import coarse
from cable_envs.plants.peaks import no_peak


@inline
def _share(v, change, ccw, cw, wanted):
    return cw_share(v, ccw, cw, wanted)


@inline
def _trapezoidal(inertia, damping, stiffness, dt):
    return inertia + 0.5 * dt * damping + 0.25 * dt * dt * stiffness


@inline
def _steepest(p, i, v, top, bottom, ccw, cw, wanted):
    return p.drive_stiffness[i]


@inline
def _apart(slips, i):
    return 0.0


_AS_BEFORE = {
    "output_slides": stick_slip_whole, "mean_share": _share, "passes": _apart, "peak_at_start": no_peak,
    "ringing_inertia": _trapezoidal, "drive_slope": _steepest, "ringing_way": no_way, "ringing_lag": no_way,
}  # fmt: skip


def as_v0(plant: Plant) -> Plant:
    """The plant with the kernel of the ids ``-v0``."""
    return replace(coarse(plant), solve=specialised(plant.solve, **_AS_BEFORE))
