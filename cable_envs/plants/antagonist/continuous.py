"""The joint with two tendons in continuous time: drives, joint, and what of both tendons has slipped at their bends.

    position   x_i'' = w^2 (target_i - x_i) + 2 z w (target_rate_i - x_i'),  within acceleration and speed limits
    torque     m x_i'' = force_i - T_d,i - c x_i',                           within the speed limit
    joint      J q'' = r_a T_a - r_b T_b - resistance - M_c sign(q')
    tendon     y_i' by `cable_envs.plants.tendon_rates`, y the stretch between bend and joint

With motors the drives are those of `cable_envs.plants.servo_rates`. `cable_envs.plants.antagonist.plant` has the
symbols. When the joint moves its positive way, tendon a slides to its drive and tendon b to the joint.
"""

from dataclasses import replace

from cable_envs.core.kernels import select
from cable_envs.effects.seams import dry_friction
from cable_envs.physics.contact import tension_ratio
from cable_envs.physics.servo import placing
from cable_envs.plants.antagonist.plant import _report, arms, asked_of, forces, pulled_in, resistance
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, driven, limited, nudged, rubbed, rubs
from cable_envs.plants.servo_rates import hauled, served, with_motors
from cable_envs.plants.servo_stages import drive_of
from cable_envs.plants.tendon import spanned
from cable_envs.plants.tendon_rates import rubbing, slid

SHOWN = (
    "joint_angle", "joint_velocity", "joint_torque", "joint_stiffness", "drive_angle", "drive_torque", "co_contraction",
    "tension_drive_a", "tension_joint_a", "tension_drive_b", "tension_joint_b",
)  # fmt: skip


def _stretched(p, e, xa, xb, q):
    """(stretch of tendon a, of tendon b, limit of their tension ratio)."""
    in_a, in_b = pulled_in(p, 0, q)
    slack = p.moment_arm[0] * e.slack_length[0]
    n = tension_ratio(p.radius_ratio[0], p.friction_coefficient[0], p.wrap_angle[0])
    return xa - in_a - slack, xb - in_b - slack, n


def _drawn(p, u, e, xa, va, ta, xb, vb, tb):
    """Accelerations of both ideal drives."""
    command, second = u.command[0], u.second[0]
    to_a, to_b, rate_a, rate_b = asked_of(p, e, 0, command, u.command_rate[0], second, u.second_rate[0])
    k, d, most = p.servo_stiffness[0], p.servo_damping[0], p.drive_acceleration_limit[0]
    force_a, force_b = forces(p, 0, command, second)
    mass, c, limit, by_force = p.drive_mass[0], p.drive_damping[0], p.drive_speed_limit[0], u.mode[0] > 0.5
    a = select(by_force, (force_a - ta - c * va) / mass, placing(xa, va, to_a, rate_a, k, d, most))
    b = select(by_force, (force_b - tb - c * vb) / mass, placing(xb, vb, to_b, rate_b, k, d, most))
    return limited(va, a, limit), limited(vb, b, limit)


def _hauled(rows: Rows, xa, va, ta, way_a, xb, vb, tb, way_b, servos):
    """(accelerations of both drives with a motor, rates of their servos, what the motors show)."""
    p, u, e, x = rows.p, rows.u, rows.e, rows.x
    a, b = drive_of(x, 0), drive_of(x, 1)
    force_a, force_b = forces(p, 0, u.command[0], u.second[0])
    rates = ()
    if servos:
        to_a, to_b, rate_a, rate_b = asked_of(
            p, e, 0, u.command[0], u.command_rate[0], u.second[0], u.second_rate[0]
        )  # fmt: skip
        half = len(servos) // 2
        force_a, of_a = served(p, xa, va, to_a, rate_a, servos[:half])
        force_b, of_b = served(p, xb, vb, to_b, rate_b, servos[half:])
        rates = (*of_a, *of_b)
    drives = hauled(a, p, xa, va, way_a, force_a, ta), hauled(b, p, xb, vb, way_b, force_b, tb)
    return drives, rates, (a.motor_current[0], a.motor_torque[0], b.motor_current[0], b.motor_torque[0])


def _law(state, rows: Rows, way, *drive_ways):
    xa, va, xb, vb, q, v, ya, yb, *servos = state
    p, u, e, s, g, _, x = rows
    (ra, rb), (ea, eb, n) = arms(p, 0, q), _stretched(p, e, xa, xb, q)
    k1, k2, hard, r = p.drive_stiffness[0], p.end_stiffness[0], p.tendon_hardening[0], p.moment_arm[0]
    moves = nudged(v, way)
    da, ta, ya_rate = rubbing(ea, va - ra * moves, ya, -ra * moves, k1, k2, hard, n, 0.0, r)
    db, tb, yb_rate = rubbing(eb, vb + rb * moves, yb, rb * moves, k1, k2, hard, n, 0.0, r)
    dry_friction(e, g, 0, along(v, way), p.joint_friction[0], 0.0)
    net = rubbed(ra * ta - rb * tb - resistance(p, u, e, s, 0, q, v), g.up[0], g.down[0], way)
    if drive_ways:
        (a, b), rates, motors = _hauled(rows, xa, va, da, drive_ways[0], xb, vb, db, drive_ways[1], servos)
    else:
        (a, b), rates, motors = _drawn(p, u, e, xa, va, da, xb, vb, db), (), ()
    x.joint_angle[0], x.joint_velocity[0], x.drive_a_position[0], x.drive_b_position[0] = q, v, xa, xb
    x.tension_drive_a[0], x.tension_joint_a[0], x.tension_drive_b[0], x.tension_joint_b[0] = da, ta, db, tb
    _report(x, p, u, e, 0)
    shown = (
        q, v, x.joint_torque[0], x.joint_stiffness[0], x.drive_angle[0], x.drive_torque[0], x.co_contraction[0],
        da, ta, db, tb,
    )  # fmt: skip
    return (va, a, vb, b, v, net / p.joint_inertia[0], ya_rate, yb_rate, *rates), (*shown, *motors)


def _verge(state, rows: Rows, way, *drive_ways):
    xa, va, xb, vb, q, v, ya, yb, *servos = state
    p, e = rows.p, rows.e
    ea, eb, n = _stretched(p, e, xa, xb, q)
    k1, k2, hard = p.drive_stiffness[0], p.end_stiffness[0], p.tendon_hardening[0]
    return xa, va, xb, vb, q, v, slid(ea, ya, k1, k2, hard, n, way), slid(eb, yb, k1, k2, hard, n, -way), *servos


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a joint with two tendons."""
    closed = (mode.of or mode.name) == "position"
    ideal = Equations(
        states=(
            "drive_a_position", "drive_a_velocity", "drive_b_position", "drive_b_velocity", "joint_angle",
            "joint_velocity", "stretch_joint_a", "stretch_joint_b",
        ),
        inputs=driven(mode, closed, Signal("disturbance", "N m", "torque that helps tendon a")),
        outputs=SHOWN,
        law=_law,
        place="joint_angle",
        slides=("joint_velocity",),
        free=() if rubs(value, "joint_friction") else ("joint_velocity",),
        verge=_verge,
        effects=("stribeck_friction", "asymmetric_friction", "slack"),
        slack={spanned: ""},
        speed=1e-2,
    )  # fmt: skip
    if plant.drive == "ideal":
        return ideal
    return with_motors(replace(ideal, against=("drive_b_velocity",)), value, closed, ("{}_a_{}", "{}_b_{}"))
