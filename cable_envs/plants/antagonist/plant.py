"""Two drives turn a joint by two tendons that pull against each other; how hard both pull makes the joint stiff.

    joint      J q'' = r_a T_a - r_b T_b - b q' - M_c sign(q') - k_s q - M_w sin q + disturbance
    arms       r_a = r + g q,   r_b = r - g q;      pulled in:  s_a = r q + g q^2 / 2,   s_b = -r q + g q^2 / 2
    tendon     stretch e = x - s - slack - creep of two spans with a contact between them (`plants.tendon`);
               at its drive T_d, at the joint T with 1/n <= T_d / T <= n, and T = k y (1 + hard k y / 2) along a span
    position   x_i'' = w^2 (target_i - x_i) + 2 z w (target_rate_i - x_i'),  within acceleration and speed limits
               target_a = take-up + r command,  target_b = take-up - r command
    torque     m x_i'' = force_i - T_d,i - c x_i',  within the speed limit
               force_a = co-contraction + command / 2 r,  force_b = co-contraction - command / 2 r, 0 at the least

symbol       | meaning                                                                            | unit
------------ | ---------------------------------------------------------------------------------- | ----
q            | angle of the joint, positive where tendon a pulls                                  | rad
x_a, x_b     | drives, positive pulls in                                                          | m
T_a, T_b     | tensions at the joint                                                              | N
n            | ratio of `contact.tension_ratio` at the bend phi of the tendon's way               | 1
take-up      | stretch of a tendon at the tension co-contraction: both drives pull in by that much | m
co-contraction | mean tension: a command of its own, or the rig's parameter                        | N

The joint's stiffness with the drives held, without friction, is

    K = r_a^2 k_a + r_b^2 k_b - g (T_a + T_b) + k_s + M_w cos q,    k_i = k sqrt(1 + 2 hard T_i),  0 where slack

so that co-contraction makes the joint stiffer where the tendon hardens (``tendon_hardening``: springs of
variable stiffness need a law that bends, Hogan, IEEE Trans. Automatic Control 29 (1984) 681) or the arms shrink.
Friction of the tendons grows with co-contraction too: T_i n either way. Where the take-up is less than what the
tendons are too long (effect ``slack``), one of them is slack, and a load that changes sides falls through a gap of
twice the difference over r: backlash, which nothing here declares.

Valid for slow tendons (no waves, no mass), one bend each, and ideal drives, which no tendon turns back in position
mode: `plants.antagonist.motor` has real ones. The sheath's own law (`plants.sheath`) has the friction spread along the
bend; here it is in one place.

The joint and the drives go half a step, the tensions there give the new speeds (linearly implicit), then they go the
other half: order 2 but for the steps in which a contact or the joint stops. One kernel: it has the effects always.
"""

from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sign, sine_cosine
from cable_envs.core.lanes import Lanes
from cable_envs.effects import Layout
from cable_envs.effects.backlash import pulled_end
from cable_envs.effects.own import advance_memory, own_actuate, own_load
from cable_envs.effects.seams import actuate, actuate_second, begin, begin_friction, end, slide
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.physics.contact import tension_ratio
from cable_envs.physics.friction import in_time
from cable_envs.physics.servo import placed
from cable_envs.plants.antagonist.parameters import ACTING, COEFFICIENTS, PARAMETERS, SIGNALS, derive, resolves, settle
from cable_envs.plants.base import ActionMode, Plant, SecondCommand, rows_of
from cable_envs.plants.peaks import peak_at_start
from cable_envs.plants.tendon import balanced, pulled, series, span_slope

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, rad and rad/s."""

JOINT = Lanes("Joint", [
    "ratio",  # n
    "second", "second_rate",  # co-contraction that acts: N, N/s
    "seen",  # angle at which the tensions were last balanced, rad
    "creep_a", "creep_b",  # creep that they were balanced with, m
])  # fmt: skip
"""Scratch of a control step."""


@inline
def arms(p, i, q):
    """Moment arms of both tendons, m."""
    return p.moment_arm[i] + p.moment_arm_growth[i] * q, p.moment_arm[i] - p.moment_arm_growth[i] * q


@inline
def pulled_in(p, i, q):
    """How far the joint has pulled both tendons in, m."""
    turned, grown = p.moment_arm[i] * q, 0.5 * p.moment_arm_growth[i] * q * q
    return turned + grown, -turned + grown


@inline
def asked_of(p, e, i, command, rate, second, second_rate):
    """Targets of both drives with their rates, m and m/s."""
    hard, k, r = p.tendon_hardening[i], p.tendon_stiffness[i], p.moment_arm[i]
    line = linear(maximum(second, 0.0), hard)
    take_up, takes = line / k, second_rate / (k * hardened(line, hard)[1])
    return take_up + r * command, take_up - r * command, takes + r * rate, takes - r * rate


@inline
def forces(p, i, command, second):
    """Forces of both drives in torque mode, N."""
    half = 0.5 * command / p.moment_arm[i]
    return clip(second + half, 0.0, p.drive_force_limit[i]), clip(second - half, 0.0, p.drive_force_limit[i])


@inline
def resistance(p, u, e, s, i, q, v):
    """Torque that resists the joint besides dry friction and tendons, N m."""
    sine, _ = sine_cosine(q)
    own = own_load(q, v, 0.0, e, s, i)
    return p.spring_stiffness[i] * q + p.weight_torque[i] * sine + p.joint_damping[i] * v + own - u.disturbance[i]


@inline
def _balance(x, p, w, e, s, i, q, end_a, end_b):
    """Tensions with the joint at q and the drives' ends of the tendons there; moves the contacts on."""
    hard, k1, k2 = p.tendon_hardening[i], p.drive_stiffness[i], p.end_stiffness[i]
    slack, behind = p.moment_arm[i] * e.slack_length[i], k1 / (k1 + k2)
    now_a, now_b = pulled_in(p, i, q)
    was_a, was_b = pulled_in(p, i, w.seen[i])
    held_a = x.stretch_joint_a[i] - (now_a - was_a) - behind * (s.creep_top[i] - w.creep_a[i])
    held_b = x.stretch_joint_b[i] - (now_b - was_b) - behind * (s.creep_bottom[i] - w.creep_b[i])
    long_a, long_b = end_a - now_a - slack - s.creep_top[i], end_b - now_b - slack - s.creep_bottom[i]
    a, b, y = balanced(long_a, held_a, k1, k2, hard, w.ratio[i])
    x.tension_drive_a[i], x.tension_joint_a[i], x.stretch_joint_a[i] = a, b, y
    a, b, y = balanced(long_b, held_b, k1, k2, hard, w.ratio[i])
    x.tension_drive_b[i], x.tension_joint_b[i], x.stretch_joint_b[i] = a, b, y
    w.seen[i], w.creep_a[i], w.creep_b[i] = q, s.creep_top[i], s.creep_bottom[i]


@inline
def _ends(p, u, e, s, g, i, at_a, at_b):
    """Where the drives hold the tendons, with play between them."""
    gap, by_force = p.moment_arm[i] * e.backlash_gap[i], (u.mode[i] > 0.5) & (g.follows[i] < 0.5)
    s.gap_position[i] = select(gap > 0.0, pulled_end(by_force, s.gap_position[i], at_a, gap), at_a)
    s.gap_opposed[i] = select(gap > 0.0, pulled_end(by_force, s.gap_opposed[i], at_b, gap), at_b)
    return s.gap_position[i], s.gap_opposed[i]


@inline
def _turned(x, p, u, e, s, g, i, q, dt):
    """Speed of the joint after dt; q is the middle of the step, as the tensions are."""
    v, hard = x.joint_velocity[i], p.tendon_hardening[i]
    ra, rb = arms(p, i, q)
    ta, tb = x.tension_joint_a[i], x.tension_joint_b[i]
    at = resistance(p, u, e, s, i, q, v)
    k = maximum((resistance(p, u, e, s, i, q + STEP_Y, v) - at) / STEP_Y, 0.0)
    c = maximum((resistance(p, u, e, s, i, q, v + STEP_V) - at) / STEP_V, 0.0)
    k += ra * ra * span_slope(p.end_stiffness[i], ta, hard) + rb * rb * span_slope(p.end_stiffness[i], tb, hard)
    torque = ra * ta - rb * tb + 0.5 * dt * k * v  # the torques are those of the middle already
    return slide(e, s, g, i, v, in_time(p.joint_inertia[i], k, dt), p.joint_friction[i], torque, at, k, c, dt)


@inline
def driven(x, p, u, w, e, g, i, lead_a, lead_b, dt):
    """Speeds of both drives after dt, and what each falls short where it stops; tensions are those of the middle.

    ``lead_a``, ``lead_b``: by how much the drives were ahead of the middles of their nuts before the step, m.
    """
    va, vb, limit, most = (
        x.drive_a_velocity[i], x.drive_b_velocity[i], p.drive_speed_limit[i], p.drive_acceleration_limit[i],
    )  # fmt: skip
    to_a, to_b, rate_a, rate_b = asked_of(p, e, i, u.command[i], u.command_rate[i], w.second[i], w.second_rate[i])
    k, c = p.servo_stiffness[i], p.servo_damping[i]
    servo_a = placed(x.drive_a_position[i], va, to_a, rate_a, k, c, most, limit, dt)
    servo_b = placed(x.drive_b_position[i], vb, to_b, rate_b, k, c, most, limit, dt)
    force_a, force_b = forces(p, i, u.command[i], w.second[i])
    hard, k1, mass, c = p.tendon_hardening[i], p.drive_stiffness[i], p.drive_mass[i], p.drive_damping[i]
    ta, tb = x.tension_drive_a[i], x.tension_drive_b[i]
    told_a = pulled(va, force_a, ta, mass, c, span_slope(k1, ta, hard), limit, dt)
    told_b = pulled(vb, force_b, tb, mass, c, span_slope(k1, tb, hard), limit, dt)
    by_force = u.mode[i] > 0.5
    return select(by_force, told_a, servo_a), select(by_force, told_b, servo_b), 0.0, 0.0


@inline
def _step(x, p, u, w, e, s, g, i, dt):
    half, follows, r = 0.5 * dt, g.follows[i] > 0.5, p.moment_arm[i]
    q, v, xa, xb = x.joint_angle[i], x.joint_velocity[i], x.drive_a_position[i], x.drive_b_position[i]
    lead_a, lead_b = xa - s.gap_position[i], xb - s.gap_opposed[i]
    both = 0.5 * (xa + xb)  # a drive that follows a path keeps what it takes up
    path_a, path_b = both + r * g.target[i], both - r * g.target[i]
    q_half = q + half * v
    half_a = select(follows, 0.5 * (xa + path_a), xa + half * x.drive_a_velocity[i])
    half_b = select(follows, 0.5 * (xb + path_b), xb + half * x.drive_b_velocity[i])
    end_a, end_b = _ends(p, u, e, s, g, i, half_a, half_b)
    _balance(x, p, w, e, s, i, q_half, end_a, end_b)
    new = _turned(x, p, u, e, s, g, i, q_half, dt)
    new_a, new_b, short_a, short_b = driven(x, p, u, w, e, g, i, lead_a, lead_b, dt)
    x.drive_a_velocity[i] = select(follows, r * g.target_rate[i], new_a)
    x.drive_b_velocity[i] = select(follows, -r * g.target_rate[i], new_b)
    x.drive_a_position[i] = select(follows, path_a, half_a + half * new_a - short_a)
    x.drive_b_position[i] = select(follows, path_b, half_b + half * new_b - short_b)
    x.joint_angle[i], x.joint_velocity[i] = q_half + half * new, new
    end_a, end_b = _ends(p, u, e, s, g, i, x.drive_a_position[i], x.drive_b_position[i])
    _balance(x, p, w, e, s, i, x.joint_angle[i], end_a, end_b)
    left, slow = g.creep_left[i], g.slow_left[i]
    all_of = (p.drive_stiffness[i] + p.end_stiffness[i]) / (p.drive_stiffness[i] * p.end_stiffness[i])
    hard = p.tendon_hardening[i]
    mean_a = 0.5 * (x.tension_drive_a[i] + x.tension_joint_a[i])
    mean_b = 0.5 * (x.tension_drive_b[i] + x.tension_joint_b[i])
    creeps_on(s.creep_top, s.slow_creep_top, e, i, all_of * linear(mean_a, hard), left, slow)
    creeps_on(s.creep_bottom, s.slow_creep_bottom, e, i, all_of * linear(mean_b, hard), left, slow)


@inline
def _largest(x, i):
    """The largest tension of both tendons, N."""
    a, b = maximum(x.tension_drive_a[i], x.tension_joint_a[i]), maximum(x.tension_drive_b[i], x.tension_joint_b[i])
    return maximum(a, b)


@inline
def encoders(x, p, i):
    """What encoders show; ideal drives have none."""


@inline
def _watch(x, i):
    """What a control step keeps of the tensions of a substep."""
    a, b = x.tension_drive_a[i], x.tension_drive_b[i]
    x.slack_fraction[i] += select(minimum(a, b) <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], _largest(x, i))


@inline
def _report(x, p, u, e, i):
    """What is seen of the state at the end of a control step."""
    q, hard = x.joint_angle[i], p.tendon_hardening[i]
    ra, rb = arms(p, i, q)
    ta, tb, da, db = x.tension_joint_a[i], x.tension_joint_b[i], x.tension_drive_a[i], x.tension_drive_b[i]
    k1, k2, (_, cosine) = p.drive_stiffness[i], p.end_stiffness[i], sine_cosine(q)
    own = ra * ra * series(k1, k2, da, ta, hard) + rb * rb * series(k1, k2, db, tb, hard)
    x.joint_torque[i] = ra * ta - rb * tb
    x.joint_stiffness[i] = (
        own - p.moment_arm_growth[i] * (ta + tb) + p.spring_stiffness[i] + p.weight_torque[i] * cosine
    )
    x.drive_angle[i] = 0.5 * (x.drive_a_position[i] - x.drive_b_position[i]) / p.moment_arm[i]
    x.drive_torque[i], x.co_contraction[i] = p.moment_arm[i] * (da - db), 0.5 * (da + db)
    encoders(x, p, i)
    taken = maximum(0.5 * (x.drive_a_position[i] + x.drive_b_position[i]), 0.0)
    x.pretension[i], _ = hardened(p.tendon_stiffness[i] * taken, hard)
    x.sliding[i], x.co_contraction_command[i] = sign(x.joint_velocity[i]), u.second[i]
    x.out_of_range[i] = select(minimum(ra, rb) < 0.1 * p.moment_arm[i], 1.0, 0.0)


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        speed = 0.5 * (x.drive_a_velocity[i] - x.drive_b_velocity[i]) / p.moment_arm[i]
        begin(
            e, s, g, u, i, x.drive_angle[i], speed, x.joint_angle[i], x.joint_velocity[i], substeps * dt, dt,
        )  # fmt: skip
        begin_friction(e, g, i)
        w.ratio[i] = tension_ratio(p.radius_ratio[i], p.friction_coefficient[i] * g.factor[i], p.wrap_angle[i])
        w.seen[i], w.creep_a[i], w.creep_b[i] = x.joint_angle[i], s.creep_top[i], s.creep_bottom[i]
        x.slack_fraction[i], x.peak_tension[i] = 0.0, peak_at_start(_largest(x, i))
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            w.second[i], w.second_rate[i] = actuate_second(e, s, g, u, i, n, substeps, dt)
            speed = 0.5 * (x.drive_a_velocity[i] - x.drive_b_velocity[i]) / p.moment_arm[i]
            at = 0.5 * (x.drive_a_position[i] - x.drive_b_position[i]) / p.moment_arm[i]
            u.command[i] = own_actuate(u.command[i], at, speed, e, s, i)
        for i in range(lanes):
            _step(x, p, u, w, e, s, g, i, dt)
            _watch(x, i)
            speed = 0.5 * (x.drive_a_velocity[i] - x.drive_b_velocity[i]) / p.moment_arm[i]
            at = 0.5 * (x.drive_a_position[i] - x.drive_b_position[i]) / p.moment_arm[i]
            advance_memory(
                u.command[i], at, speed, x.joint_angle[i], x.joint_velocity[i], x.tension_drive_a[i], 0.0, e, s, i,
            )  # fmt: skip
            s.started[i] = 1.0
    for i in range(lanes):
        _report(x, p, u, e, i)
        x.slack_fraction[i] /= substeps
        end(e, s, g, i, x.joint_angle[i], substeps * dt)


TAKE_UP = SecondCommand("co_contraction", "N", "co_contraction_limit", one_sided=True, rest_signal="pretension")
PULL = SecondCommand("co_contraction", "N", "co_contraction_limit", one_sided=True, rest_signal="co_contraction")

PLANT = Plant(
    name="antagonistic_joint",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=JOINT,
    action_modes=(
        position := ActionMode("position", "rad", "drive_angle_limit", rest_signal="drive_angle", second=TAKE_UP),
        torque := ActionMode("torque", "N m", "torque_command_limit", rest_signal="drive_torque", second=PULL),
        position.with_second(),
        torque.with_second(),
    ),
    derive=derive,
    settle=settle,
    solve=_solve,
    effects=Layout("antagonistic_joint", PARAMETERS, ACTING),
    resolves=resolves,
    plain=False,
    replays=("follow",),
)
