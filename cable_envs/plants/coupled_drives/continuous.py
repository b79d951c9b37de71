"""Two motors, a belt and a sprung pulley in continuous time.

m x''     = force_per_volt u - b - viscous x' - F_c sign(x'),   b = k (x - x_p) + c (x' - x_p')
m_p x_p'' = b + disturbance
"""

from cable_envs.effects.seams import dry_friction, sprung
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, driven, rubbed
from cable_envs.plants.coupled_drives.plant import _reading, _resist


def _law(state, rows: Rows, way):
    y, v, yp, vp = state
    p, u, e, s, g, _, _ = rows
    pull, _, _, _ = sprung(e, s, 0, p.belt_stiffness[0], p.belt_damping[0], yp - y, vp - v)
    resist, _, _ = _resist(e, s, 0, y, v, p.viscous[0])
    dry_friction(e, g, 0, along(v, way), p.coulomb[0], 0.0)
    net = rubbed(p.force_per_volt[0] * u.command[0] + pull - resist, g.up[0], g.down[0], way)
    rates = (v, net / p.mass[0], vp, (u.disturbance[0] - pull) / p.pulley_mass[0])
    return rates, (y, v, yp, vp, -pull, _reading(p, e, 0, vp))


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of coupled drives."""
    return Equations(
        states=("motor_position", "motor_velocity", "pulley_position", "pulley_velocity"),
        inputs=driven(mode, False, Signal("disturbance", "N", "force that helps the pulley")),
        outputs=(
            "motor_position", "motor_velocity", "pulley_position", "pulley_velocity", "belt_force", "speed_reading",
        ),
        law=_law,
        place="motor_position",
        slides=("motor_velocity",),
        effects=(
            "stribeck_friction", "asymmetric_friction", "stiffness_hardening", "position_ripple",
            "position_dependent_load", "sensor_rectification", "detector_power",
        ),
    )  # fmt: skip
