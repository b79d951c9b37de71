"""The band brake in continuous time: the drum's place and what has slipped under the band; the law is the kernel's.

x' = v,   z' = v where the band is stretched as far as it grips and the drum moves on, else 0
"""

from cable_envs.effects.asymmetric_friction import levels
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.plants.band_brake.plant import _reach, _step
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.plants.continuous import Equations, Input, Rows, Values, contained


def _law(state, rows: Rows):
    at, slipped = state
    p, u, e, s, g, _, x = rows
    v = u.command_rate[0]
    extra, _ = excess_at(e.stribeck_friction_excess[0], e.stribeck_friction_velocity[0], v)
    more, less = levels(e.asymmetric_friction_difference[0])
    up, down = _reach(e, 0, p.grip[0] + extra + more), _reach(e, 0, p.grip[0] + extra + less)
    g.target[0], g.target_rate[0], x.slip[0], s.started[0] = at, v, slipped, 1.0
    _step(x, p, u, e, s, g, 0)
    return (v, contained(0.0, slipped, at - up, at + down, v, v)), (x.force[0], x.band_tension_difference[0])


def equations(plant: Plant, mode: ActionMode | None, value: Values) -> Equations:
    """The equations of a band brake whose drum is moved."""
    return Equations(
        states=("position", "slip"),
        inputs=(Input("velocity", "m/s", "speed of the drum's surface", "command_rate"),),
        outputs=("force", "band_tension_difference"),
        law=_law,
        place="position",
        effects=(
            "load_dependent_friction", "backlash", "cable_elongation", "stiffness_hardening", "viscous_friction",
            "stribeck_friction", "asymmetric_friction", "position_dependent_load",
        ),
    )  # fmt: skip
