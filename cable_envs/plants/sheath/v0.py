"""The tendon in a sheath as the ids ``-v0`` have it, kept so that what was measured on them can be replayed.

In the middle of a step the drive has moved on and the load has not, so that a tendon that goes out under a small
tension counts as slack there. Where the load would turn round within a step it stops, and goes the other way in the
next one. The peak of a control step leaves its start out. A gap of the drive is crossed under the tendon's tension in
both modes.
"""

from dataclasses import replace

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import inline
from cable_envs.effects.backlash import play
from cable_envs.physics.friction import no_way, stick_slip_whole, trapezoidal_inertia
from cable_envs.plants.base import Plant
from cable_envs.plants.peaks import no_peak
from cable_envs.plants.sheath.plant import PLANT


@inline
def _nut(told_force, nut, drive, gap):
    return play(nut, drive, gap)


@inline
def _apart(told_force, nut, drive, gap):
    return abs(drive - nut) < 0.4999995 * gap


@inline
def _still(x, i, dt):
    return 0.0


@inline
def _ahead(speed, ahead):
    return ahead


_SOLVE = specialised(
    PLANT.solve, load_ahead=_still, load_onward=_ahead, load_slides=stick_slip_whole, peak_at_start=no_peak,
    ringing_inertia=trapezoidal_inertia, ringing_lag=no_way, pulled_end=_nut, apart=_apart,
)  # fmt: skip


def as_v0(plant: Plant) -> Plant:
    """The plant with the kernel of the ids ``-v0``."""
    return replace(plant, version="v0", solve=_SOLVE, resolves=None)
