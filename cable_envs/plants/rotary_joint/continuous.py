"""The rotary joint in continuous time.

(J + m l^2 + J_l) v' = k_t i - viscous v - F_c sign(v) - m g l sin(q - q_0) + disturbance,   i by the bridge's duty
"""

from cable_envs.effects.position_ripple import wave
from cable_envs.effects.seams import dry_friction
from cable_envs.effects.unilateral_contact import met_friction
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, driven, rubbed
from cable_envs.plants.rotary_joint.plant import _load, _motor, _through


def _law(state, rows: Rows, way):
    y, v = state
    p, u, e, s, g, _, _ = rows
    torque, _, _, current, duty = _motor(p, u, e, 0, y, v, 0.0)
    load, _, _ = _load(p, u, e, s, 0, y, v, 0.0)
    ripple, _ = wave(y, e.position_ripple_amplitude[0], e.position_ripple_period[0], e.position_ripple_phase[0])
    dry_friction(e, g, 0, along(v, way), p.coulomb[0] + met_friction(e, 0, y, 0.0), 0.0)
    net = torque + ripple - p.viscous[0] * v
    up, rising = _through(p, e, 0, net - g.up[0], load, v)
    down, falling = _through(p, e, 0, -net - g.down[0], -load, v)
    # what the gear takes counts as dry friction, each way with its own mass
    whole = net - load
    slowed = rubbed(whole, whole - up, -down - whole, way)
    faster = slowed / (falling + 0.5 * (1.0 + way) * (rising - falling))
    return (v, faster), (y, v, duty, current, torque, load)


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a rotary joint whose winding stays cold."""
    return Equations(
        states=("position", "velocity"),
        inputs=driven(mode, mode.name == "position", Signal("disturbance", "N m", "torque that helps the joint")),
        outputs=("position", "velocity", "duty", "current", "torque", "load_torque"),
        law=_law,
        place="position",
        slides=("velocity",),
        effects=(
            "stribeck_friction", "asymmetric_friction", "gear_friction", "position_ripple", "position_dependent_load",
            "unilateral_contact", "supply_sag", "torque_saturation", "dead_band",
        ),
    )  # fmt: skip
