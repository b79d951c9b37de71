"""The wrist in continuous time: both drives, both joints, and what of the four cables has slipped at their contacts.

    drive      d'' = w^2 (command - d) + 2 z w (command_rate - d'),    within acceleration and speed limits
    joints     as in `cable_envs.plants.wrist.plant`, which has the symbols: each has a dry friction of its own
    cable      y_i' by `cable_envs.plants.tendon_rates`, y the stretch between contact and joint

With motors the drives are those of `cable_envs.plants.servo_rates`; their coordinate is the cable that they wind up.

The limits of the yaw cables' tension ratios change with the pitch. A posture has no input here: it adds to the command
of the pitch. When a joint turns its positive way, its cable a slides to the drive and its cable b to the joint; where
the yaw joint is held, its cables slide with the pitch.
"""

from cable_envs.core.kernels import select
from cable_envs.effects.seams import dry_friction
from cable_envs.physics.servo import placing
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, driven, limited, nudged, rubbed, rubs
from cable_envs.plants.servo_rates import hauled, served, with_motors
from cable_envs.plants.servo_stages import drive_of
from cable_envs.plants.tendon import spanned
from cable_envs.plants.tendon_rates import rubbing, slid
from cable_envs.plants.wrist.plant import _resist, pitch_ratio, ratios, stretches

STEP_PITCH = 1e-5
"""Step of the difference that says how the limit of the tension ratio changes with the pitch, rad."""


def _drawn(p, at, v, target, rate):
    """Acceleration of a drive."""
    servo = placing(at, v, target, rate, p.servo_stiffness[0], p.servo_damping[0], p.drive_acceleration_limit[0])
    return limited(v, servo, p.drive_speed_limit[0])


def _hauled(rows: Rows, k, radius, at, v, way, target, rate, pull, servo):
    """(acceleration of a drive with a motor, rates of its servo, what its motor shows); its coordinate is the cable."""
    p, d = rows.p, drive_of(rows.x, k)
    force, rates = served(p, radius * at, radius * v, radius * target, radius * rate, servo)
    faster = hauled(d, p, radius * at, radius * v, way, force, pull) / radius
    return limited(v, faster, p.drive_speed_limit[0]), rates, (d.motor_current[0], d.motor_torque[0])


def _changing(p, pitch, rate):
    """Rates of the limits of both yaw cables' ratios."""
    ahead, behind = ratios(p, 0, pitch + STEP_PITCH, 1.0), ratios(p, 0, pitch - STEP_PITCH, 1.0)
    per = rate / (2.0 * STEP_PITCH)
    return (ahead[0] - behind[0]) * per, (ahead[1] - behind[1]) * per


def _law(state, rows: Rows, way, pitch_way, *drive_ways):
    d, vd, dp, vdp, y, v, q, vq, ya, yb, qa, qb, *servos = state
    p, u, e, s, g, _, _ = rows
    ry, rp, rc, hard = p.yaw_radius[0], p.pitch_radius[0], p.coupling_radius[0], 0.0
    yawing, pitching = nudged(v, way), nudged(vq, pitch_way)
    ea, eb, pa, pb = stretches(p, e, 0, y, q, d, dp)
    wound, turned = ry * vd, ry * yawing + rc * pitching
    (na, nb), n = ratios(p, 0, q, 1.0), pitch_ratio(p, 0, 1.0)
    na_rate, nb_rate = _changing(p, q, pitching)
    k1, k2 = p.drive_stiffness[0], p.end_stiffness[0]
    tda, ta, ya_rate = rubbing(ea, wound - turned, ya, -turned, k1, k2, hard, na, na_rate, ry)
    tdb, tb, yb_rate = rubbing(eb, turned - wound, yb, turned, k1, k2, hard, nb, nb_rate, ry)
    k1, k2, wound, turned = p.pitch_drive_stiffness[0], p.pitch_end_stiffness[0], rp * vdp, rp * pitching
    pda, pea, qa_rate = rubbing(pa, wound - turned, qa, -turned, k1, k2, hard, n, 0.0, rp)
    pdb, peb, qb_rate = rubbing(pb, turned - wound, qb, turned, k1, k2, hard, n, 0.0, rp)

    dry_friction(e, g, 0, along(v, way), p.yaw_friction[0], 0.0)
    yaw = rubbed(ry * (ta - tb) - _resist(p, u, e, s, 0, y, v), g.up[0], g.down[0], way)
    dry = p.pitch_friction[0] + p.bearing_arm[0] * (ta + tb + pea + peb)
    pitch = rubbed(rp * (pea - peb) + rc * (ta - tb) - p.pitch_damping[0] * vq, dry, dry, pitch_way)
    told, second = (u.command[0], u.command_rate[0]), (u.second[0], u.second_rate[0])
    servo_rates, motors = (), ()
    if drive_ways:
        way_d, way_p, half = *drive_ways, len(servos) // 2
        wind, of_d, motor_d = _hauled(rows, 0, ry, d, vd, way_d, *told, tda - tdb, servos[:half])
        pitch_wind, of_p, motor_p = _hauled(rows, 1, rp, dp, vdp, way_p, *second, pda - pdb, servos[half:])
        servo_rates, motors = (*of_d, *of_p), (*motor_d, *motor_p)
    else:
        wind, pitch_wind = _drawn(p, d, vd, *told), _drawn(p, dp, vdp, *second)
    rates = (
        vd, wind, vdp, pitch_wind, v, yaw / p.yaw_inertia[0], vq, pitch / p.pitch_inertia[0], ya_rate, yb_rate, qa_rate,
        qb_rate, *servo_rates,
    )  # fmt: skip
    shown = (y, v, q, vq, d, dp, ry * (ta - tb), rp * (pea - peb), rc * (ta - tb))
    return rates, (*shown, tda, ta, tdb, tb, pda, pea, pdb, peb, *motors)


def _verge(state, rows: Rows, way, pitch_way, *drive_ways):
    d, vd, dp, vdp, y, v, q, vq, ya, yb, qa, qb, *servos = state
    p = rows.p
    ea, eb, pa, pb = stretches(p, rows.e, 0, y, q, d, dp)
    (na, nb), n = ratios(p, 0, q, 1.0), pitch_ratio(p, 0, 1.0)
    k1, k2 = p.drive_stiffness[0], p.end_stiffness[0]
    yaw_way = select(way == 0.0, pitch_way, way)
    ya, yb = slid(ea, ya, k1, k2, 0.0, na, yaw_way), slid(eb, yb, k1, k2, 0.0, nb, -yaw_way)
    k1, k2 = p.pitch_drive_stiffness[0], p.pitch_end_stiffness[0]
    qa, qb = slid(pa, qa, k1, k2, 0.0, n, pitch_way), slid(pb, qb, k1, k2, 0.0, n, -pitch_way)
    return d, vd, dp, vdp, y, v, q, vq, ya, yb, qa, qb, *servos


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a wrist."""
    has = {
        "yaw_velocity": rubs(value, "yaw_friction"),
        "pitch_velocity": value["pitch_friction"] > 0.0 or value["bearing_arm"] > 0.0,
    }
    ideal = Equations(
        states=(
            "drive_angle", "drive_velocity", "pitch_drive_angle", "pitch_drive_velocity", "yaw_angle", "yaw_velocity",
            "pitch_angle", "pitch_velocity", "stretch_end_a", "stretch_end_b", "pitch_stretch_end_a",
            "pitch_stretch_end_b",
        ),
        inputs=driven(mode, True, Signal("disturbance", "N m", "torque that helps the yaw joint")),
        outputs=(
            "yaw_angle", "yaw_velocity", "pitch_angle", "pitch_velocity", "drive_angle", "pitch_drive_angle",
            "yaw_torque", "pitch_torque", "coupling_torque", "tension_drive_a", "tension_end_a", "tension_drive_b",
            "tension_end_b", "pitch_tension_drive_a", "pitch_tension_end_a", "pitch_tension_drive_b",
            "pitch_tension_end_b",
        ),
        law=_law,
        place="yaw_angle",
        slides=tuple(has),
        free=tuple(name for name, rubbed_there in has.items() if not rubbed_there),
        verge=_verge,
        effects=("stribeck_friction", "asymmetric_friction", "slack"),
        slack={spanned: ""},
        speed=1e-2,
    )  # fmt: skip
    if plant.drive == "ideal":
        return ideal
    return with_motors(ideal, value, True, ("{}_{}", "pitch_{}_{}"))
