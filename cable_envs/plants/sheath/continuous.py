"""The tendon in a sheath in continuous time.

    position   x'' = w^2 (command - x) + 2 z w (command_rate - x'),   within acceleration and speed limits
    tension    m_d x'' = command - T1 - c_d x',                       within the speed limit
    load       m y'' = T2 - preload - k_l y - c_l y' - F_c sign(y') + disturbance

With contacts it is `cable_envs.plants.sheath.contact_continuous` that gives tensions, load and slips.

With a motor the drive is that of `cable_envs.plants.servo_rates`, and has a friction of its own.

T1 and T2 are those of the mean tension Tm = k (x - y) + c (x' - y') and the mobilised friction: that of the sliding
direction, and at rest the one with which T2 balances the load.
"""

from dataclasses import replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import clip, select
from cable_envs.effects.seams import dry_friction
from cable_envs.physics.servo import placing
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Input, Rows, Values, along, driven, limited, rubbed, rubs
from cable_envs.plants.servo_rates import driven_by, with_motors
from cable_envs.plants.sheath.capstan import leaving, mobilised
from cable_envs.plants.sheath.contact_continuous import carried, slid, unrolled
from cable_envs.plants.sheath.plant import _resist, _rub, _tension


def _drawn(p, u, x, v, tension):
    """Acceleration of the drive."""
    k, d, most = p.servo_stiffness[0], p.servo_damping[0], p.drive_acceleration_limit[0]
    servo = placing(x, v, u.command[0], u.command_rate[0], k, d, most)
    pulled = (u.command[0] - p.drive_damping[0] * v - tension) / p.drive_mass[0]
    return limited(v, select(u.mode[0] > 0.5, pulled, servo), p.drive_speed_limit[0])


def _carried(rows: Rows, x, v_d, y, v, way):
    """(tension at the drive, at the load, acceleration of the load)."""
    p, u, e, s, g, w, signals = rows
    mean = w.mean[0] = _tension(p, e, s, w, 0, x - y, v_d - v)
    resist, speed = _resist(p, u, e, s, 0, y, v, 0.0), along(v, way)
    dry_friction(e, g, 0, speed, p.load_friction[0], 0.0)
    _rub(signals, p, w, e, s, g, 0, speed, resist)
    a = w.friction[0]
    low = leaving(a)
    held = clip(resist, mean * low, mean * (low + a))
    stuck = select(mean > 0.0, mobilised(held / select(mean > 0.0, mean, 1.0), a), 0.0)
    r = select(way > 0.0, a, select(way < 0.0, -a, stuck))
    behind = mean * leaving(r)
    net = rubbed(behind - resist, g.up[0], g.down[0], way)
    return behind + r * mean, behind, net / p.load_mass[0]


def _law(state, rows: Rows, way):
    x, v_d, y, v = state
    ahead, behind, faster = _carried(rows, x, v_d, y, v, way)
    return (v_d, _drawn(rows.p, rows.u, x, v_d, ahead), v, faster), (x, v_d, ahead, y, v, behind)


def _motor_law(state, rows: Rows, way, drive_way):
    x, v_d, y, v, *servo = state
    ahead, behind, faster = _carried(rows, x, v_d, y, v, way)
    d = rows.x
    hauled, rates = driven_by(d, rows.p, rows.u, x, v_d, drive_way, ahead, servo)
    shown = (x, v_d, ahead, y, v, behind, d.motor_current[0], d.motor_torque[0])
    return (v_d, hauled, v, faster, *rates), shown


def _contacts_law(state, rows: Rows, way, *drive_way):
    x, v_d, y, v = state[:4]
    d, contacts = rows.x, len(rows.x.slip_position)
    slips, servo = state[4 : 4 + contacts], state[4 + contacts :]
    ahead, behind, faster, slides = carried(rows, x, v_d, slips, y, v, way, *drive_way)
    shown = (x, v_d, ahead, y, v, behind)
    if not drive_way:
        return (v_d, _drawn(rows.p, rows.u, x, v_d, ahead), v, faster, *slides), shown
    hauled, rates = driven_by(d, rows.p, rows.u, x, v_d, drive_way[0], ahead, servo)
    return (v_d, hauled, v, faster, *slides, *rates), (*shown, d.motor_current[0], d.motor_torque[0])


def _contacts_verge(state, rows: Rows, way, *drive_way):
    contacts = len(rows.x.slip_position)
    slips = slid(rows, state[0], state[4 : 4 + contacts], state[2], state[3], way)
    return (*state[:4], *slips, *state[4 + contacts :])


def _with_contacts(plain: Equations, plant: Plant, value: Values) -> Equations:
    """The equations with a state for every contact, and the posture among the inputs."""
    if value["tendon_damping"] <= 0.0:
        raise ConfigurationError(
            "a sheath with contacts needs a tendon_damping above 0 in continuous time: without it the rates of its "
            "slips do not follow from its state"
        )
    slips = [s.name for s in plant.signals if s.name.startswith("slip_position")]
    posture = Input("posture", "rad", "by how much the sheath is bent more than its rig says", "posture")
    return replace(
        plain, states=(*plain.states, *slips), inputs=(*plain.inputs, posture), law=_contacts_law,
        verge=_contacts_verge, free=() if rubs(value, "load_friction") else ("load_velocity",), slack={},
        symbolic={"settled": unrolled},
    )  # fmt: skip


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a tendon in a sheath, whose friction is in one place or at contacts."""
    one = Equations(
        states=("drive_position", "drive_velocity", "load_position", "load_velocity"),
        inputs=driven(mode, mode.name == "position", Signal("disturbance", "N", "force that helps to pull in")),
        outputs=(
            "drive_position", "drive_velocity", "drive_tension", "load_position", "load_velocity", "load_tension",
        ),
        law=_law,
        place="load_position",
        slides=("load_velocity",),
        effects=("stribeck_friction", "asymmetric_friction", "stiffness_hardening", "slack"),
        slack={_tension: ""},
    )  # fmt: skip
    ideal = _with_contacts(one, plant, value) if plant.posture else one
    if plant.drive == "ideal":
        return ideal
    return with_motors(ideal if plant.posture else replace(ideal, law=_motor_law), value, mode.name == "position")
