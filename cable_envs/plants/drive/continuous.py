"""The one-axis drive in continuous time: one body, or motor and carriage with a belt between them.

rigid    (m + m_m) x'' = F - viscous x' - F_c sign(x') - m g share + disturbance
belt     m_m x_m'' = F - b,   m x'' = b - viscous x' - F_c sign(x') - m g share + disturbance
"""

from cable_envs.effects.seams import dry_friction, sprung
from cable_envs.effects.unilateral_contact import met_friction
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, driven, rubbed
from cable_envs.plants.drive.plant import _load, _motor_force

EFFECTS = (
    "stribeck_friction", "asymmetric_friction", "stiffness_hardening", "position_ripple", "position_dependent_load",
    "unilateral_contact",
)  # fmt: skip


def _rigid(state, rows: Rows, way):
    y, v = state
    p, u, e, s, g, _, _ = rows
    force, _, _ = _motor_force(p, u, e, 0, y, v)
    resist, _, _ = _load(p, u, e, s, 0, y, v, 0.0)
    dry_friction(e, g, 0, along(v, way), p.coulomb[0] + met_friction(e, 0, y, 0.0), 0.0)
    faster = rubbed(force - resist, g.up[0], g.down[0], way) / (p.mass[0] + p.motor_mass[0])
    return (v, faster), (y, v, force, force - p.motor_mass[0] * faster)


def _belted(state, rows: Rows, way):
    xm, vm, y, v = state
    p, u, e, s, g, _, _ = rows
    force, _, _ = _motor_force(p, u, e, 0, xm, vm)
    pull, _, _, _ = sprung(e, s, 0, p.belt_stiffness[0], p.belt_damping[0], xm - y, vm - v)
    resist, _, _ = _load(p, u, e, s, 0, y, v, 0.0)
    dry_friction(e, g, 0, along(v, way), p.coulomb[0] + met_friction(e, 0, y, 0.0), 0.0)
    net = rubbed(pull - resist, g.up[0], g.down[0], way)
    return (vm, (force - pull) / p.motor_mass[0], v, net / p.mass[0]), (y, v, force, pull, xm, vm)


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a drive without a belt, or with one."""
    belt = value["belt_stiffness"] > 0.0
    motor = ("motor_position", "motor_velocity") if belt else ()
    return Equations(
        states=(*motor, "position", "velocity"),
        inputs=driven(mode, mode.name == "position", Signal("disturbance", "N", "force that helps the carriage")),
        outputs=("position", "velocity", "force", "belt_force", *motor),
        law=_belted if belt else _rigid,
        place="position",
        slides=("velocity",),
        effects=EFFECTS,
    )
