"""The joint with two tendons in continuous time.

    joint      J q'' = r_a T_a - r_b T_b - b q' - M_c sign(q') - k_s q - M_w sin q + disturbance
    drives     as the plant's, within acceleration and speed limits
    slip       y2' = -s' where a contact holds; at a limit the rate with which the ratio of the tensions stays there

The stretch y2 of each tendon behind its bend is a state; the contact slips where holding would exceed the limit.
"""

from cable_envs.core.kernels import clip, maximum, minimum, select
from cable_envs.effects.seams import dry_friction
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.physics.contact import tension_ratio
from cable_envs.plants.antagonist.plant import arms, asked_of, forces, pulled_in, resistance
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Input, Rows, Values, along, driven, limited, rubbed
from cable_envs.plants.tendon import span_slope

_NEAR = 1e-9
"""Share by which the ratio of the tensions may be off its limit where a contact counts as sliding."""


def _tendon(p, e, end, end_rate, at, at_rate, y2):
    """(T at the drive, T at the joint, rate of y2) of a tendon whose ends move."""
    hard, k1, k2 = p.tendon_hardening[0], p.drive_stiffness[0], p.end_stiffness[0]
    whole = end - at - p.moment_arm[0] * e.slack_length[0]
    t1, t2 = hardened(k1 * maximum(whole - y2, 0.0), hard)[0], hardened(k2 * maximum(y2, 0.0), hard)[0]
    n = tension_ratio(p.radius_ratio[0], p.friction_coefficient[0], p.wrap_angle[0])
    d1, d2, longer = span_slope(k1, t1, hard), span_slope(k2, t2, hard), end_rate - at_rate
    some = maximum(d1 + n * d2, 1e-12)
    to_drive, to_joint = d1 * longer / some, n * d1 * longer / maximum(n * d1 + d2, 1e-12)
    held = -at_rate
    up, down = t1 >= n * t2 * (1.0 - _NEAR), t2 >= n * t1 * (1.0 - _NEAR)
    rate = select(up, maximum(held, to_drive), held)
    rate = select(down, minimum(rate, to_joint), rate)
    return select(whole > 0.0, t1, 0.0), select(whole > 0.0, t2, 0.0), rate


def _drawn(p, u, told, rate, force, x, v, tension):
    """Acceleration of a drive."""
    servo = p.servo_stiffness[0] * (told - x) + p.servo_damping[0] * (rate - v)
    servo = clip(servo, -p.drive_acceleration_limit[0], p.drive_acceleration_limit[0])
    pulled = (force - p.drive_damping[0] * v - tension) / p.drive_mass[0]
    return limited(v, select(u.mode[0] > 0.5, pulled, servo), p.drive_speed_limit[0])


def _law(state, rows: Rows, way):
    q, v, xa, va, xb, vb, ya, yb = state
    p, u, e, s, g, _, _ = rows
    ra, rb = arms(p, 0, q)
    at_a, at_b = pulled_in(p, 0, q)
    da, ta, slip_a = _tendon(p, e, xa, va, at_a, ra * v, ya)
    db, tb, slip_b = _tendon(p, e, xb, vb, at_b, -rb * v, yb)
    to_a, to_b, rate_a, rate_b = asked_of(p, e, 0, u.command[0], u.command_rate[0], u.second[0], u.second_rate[0])
    force_a, force_b = forces(p, 0, u.command[0], u.second[0])
    dry_friction(e, g, 0, along(v, way), p.joint_friction[0], 0.0)
    net = rubbed(ra * ta - rb * tb - resistance(p, u, e, s, 0, q, v), g.up[0], g.down[0], way)
    rates = (
        v, net / p.joint_inertia[0], va, _drawn(p, u, to_a, rate_a, force_a, xa, va, da), vb,
        _drawn(p, u, to_b, rate_b, force_b, xb, vb, db), slip_a, slip_b,
    )  # fmt: skip
    return rates, (q, v, ra * ta - rb * tb, da, ta, db, tb)


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of a joint with two tendons."""
    return Equations(
        states=(
            "joint_angle", "joint_velocity", "drive_a_position", "drive_a_velocity", "drive_b_position",
            "drive_b_velocity", "stretch_joint_a", "stretch_joint_b",
        ),
        inputs=driven(mode, mode.of == "position" or mode.name == "position", Signal(
            "disturbance", "N m", "torque that helps tendon a"
        )),
        outputs=(
            "joint_angle", "joint_velocity", "joint_torque", "tension_drive_a", "tension_joint_a", "tension_drive_b",
            "tension_joint_b",
        ),
        law=_law,
        place="joint_angle",
        slides="joint_velocity",
        effects=("stribeck_friction", "asymmetric_friction", "slack"),
    )  # fmt: skip
