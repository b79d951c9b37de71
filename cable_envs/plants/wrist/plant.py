"""Two drives move a wrist of two joints by cables; those of the yaw joint run over the pitch joint's pulleys.

    yaw        J_y y'' = r_y (T_a - T_b) - b_y y' - M_c sign(y') - k_s y + disturbance
    pitch      J_p p'' = r_p (P_a - P_b) + r_c (T_a - T_b) - b_p p' - F sign(p')
               F = pitch_friction + bearing_arm (T_a + T_b + P_a + P_b)
    yaw cable  stretch e_a = take-up + r_y d - (r_y y + r_c p),    e_b = take-up - r_y d + (r_y y + r_c p)
    pitch      the same with r_p, d_p and p alone
    cable      two spans with a contact between them (`plants.tendon`): at its drive T_d, at its joint T
    drive      d'' = w^2 (command - d) + 2 z w (command_rate - d'),    within acceleration and speed limits

symbol | meaning                                                                                  | unit
------ | ---------------------------------------------------------------------------------------- | ----
y, p   | angles of the yaw and of the pitch joint                                                 | rad
d, d_p | what the drives have wound up, at the scale of their joints                              | rad
T, P   | tensions of the yaw and of the pitch cables, at their joints                             | N
r_c    | distance from the pitch axis at which the yaw cables pass it                             | m
n      | ratio of `contact.tension_ratio`; the wrap of yaw cable a grows with the pitch, b's falls | 1

Were the cables rigid, y = d - (r_c / r_y) p: the pitch moves the yaw joint unless the yaw drive follows it by the
coupling ratio r_c / r_y. Of a da Vinci Large Needle Driver it is 0.8306 / 1.0186 = 0.815, from the coupling matrix that
the da Vinci Research Kit publishes (Kazanzides et al., An open-source research kit for the da Vinci Surgical System,
IEEE ICRA 2014). The same cables pull on the pitch joint (coupling torque), and load its bearing.

The pitch drive is told ``pitch_angle`` of the rig, or a second command, and the ``posture`` besides.

Valid for joints whose axes are at right angles and whose bodies are small: none accelerates the other but by cables.
Cables have no mass, one contact each, and ideal drives, which no cable turns back: `plants.wrist.motor` has real ones.
Steps as of the joint with two tendons: half way, tensions and new speeds there (linearly implicit), the other half. One
kernel: it has the effects always.
"""

from cable_envs.core.kernels import inline, maximum, minimum, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.effects import Layout
from cable_envs.effects.backlash import play
from cable_envs.effects.own import advance_memory, own_actuate, own_load
from cable_envs.effects.seams import actuate, actuate_second, begin, begin_friction, end, slide
from cable_envs.physics.contact import tension_ratio
from cable_envs.physics.friction import crossing_step, in_time
from cable_envs.physics.servo import placed
from cable_envs.plants.base import ActionMode, Plant, SecondCommand, rows_of
from cable_envs.plants.peaks import peak_at_start
from cable_envs.plants.tendon import balanced, span_slope
from cable_envs.plants.wrist.parameters import ACTING, COEFFICIENTS, PARAMETERS, SIGNALS, derive, resolves, settle

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, rad and rad/s."""

WRIST = Lanes("Wrist", [
    "factor",  # on the friction coefficient, by drift
    "pitch_ratio",  # n of the pitch cables
    "second", "second_rate",  # what the pitch drive is told: rad, rad/s
    "seen", "pitch_seen",  # what both joints had pulled in when the tensions were last balanced, m
    "yaw_new", "pitch_new",  # speeds of the joints after the step, rad/s
    # of the drives: where they are in the middle of the step and behind it, rad; their speeds behind it, rad/s
    "middle", "pitch_middle", "after", "pitch_after", "speed_after", "pitch_speed_after",
])  # fmt: skip
"""Scratch of a control step."""


@inline
def ratios(p, i, pitch, factor):
    """Limits of the tension ratios of yaw cables a and b."""
    rho, mu, more = p.radius_ratio[i], p.friction_coefficient[i] * factor, p.wrap_growth[i] * pitch
    na = tension_ratio(rho, mu, maximum(p.yaw_wrap[i] + more, 0.0))
    nb = tension_ratio(rho, mu, maximum(p.yaw_wrap[i] - more, 0.0))
    return na, nb


@inline
def pitch_ratio(p, i, factor):
    """Limit of the tension ratio of the pitch cables."""
    return tension_ratio(p.radius_ratio[i], p.friction_coefficient[i] * factor, p.pitch_wrap[i])


@inline
def taken(p, i, yaw, pitch):
    """What the joints have pulled in of the yaw cables and of the pitch cables, m."""
    return p.yaw_radius[i] * yaw + p.coupling_radius[i] * pitch, p.pitch_radius[i] * pitch


@inline
def stretches(p, e, i, yaw, pitch, wound, pitch_wound):
    """Stretches of yaw cable a and b and of pitch cable a and b, m."""
    now, pitch_now = taken(p, i, yaw, pitch)
    held, long = p.take_up[i] - p.yaw_radius[i] * e.slack_length[i], p.pitch_radius[i] * pitch_wound - pitch_now
    drawn = p.yaw_radius[i] * wound
    return held + drawn - now, held - drawn + now, p.pitch_take_up[i] + long, p.pitch_take_up[i] - long


@inline
def _balance(x, p, w, e, i, yaw, pitch, wound, pitch_wound):
    """Tensions with the joints and the drives at these angles; moves the contacts on."""
    now, pitch_now = taken(p, i, yaw, pitch)
    ea, eb, pa, pb = stretches(p, e, i, yaw, pitch, wound, pitch_wound)
    na, nb = ratios(p, i, pitch, w.factor[i])
    k1, k2, moved = p.drive_stiffness[i], p.end_stiffness[i], now - w.seen[i]
    t1, t2, y = balanced(ea, x.stretch_end_a[i] - moved, k1, k2, 0.0, na)
    x.tension_drive_a[i], x.tension_end_a[i], x.stretch_end_a[i] = t1, t2, y
    t1, t2, y = balanced(eb, x.stretch_end_b[i] + moved, k1, k2, 0.0, nb)
    x.tension_drive_b[i], x.tension_end_b[i], x.stretch_end_b[i] = t1, t2, y
    k1, k2, n = p.pitch_drive_stiffness[i], p.pitch_end_stiffness[i], w.pitch_ratio[i]
    moved = pitch_now - w.pitch_seen[i]
    t1, t2, y = balanced(pa, x.pitch_stretch_end_a[i] - moved, k1, k2, 0.0, n)
    x.pitch_tension_drive_a[i], x.pitch_tension_end_a[i], x.pitch_stretch_end_a[i] = t1, t2, y
    t1, t2, y = balanced(pb, x.pitch_stretch_end_b[i] + moved, k1, k2, 0.0, n)
    x.pitch_tension_drive_b[i], x.pitch_tension_end_b[i], x.pitch_stretch_end_b[i] = t1, t2, y
    w.seen[i], w.pitch_seen[i] = now, pitch_now


@inline
def _resist(p, u, e, s, i, y, v):
    """Torque that resists the yaw joint besides dry friction and cables, N m."""
    return p.yaw_stiffness[i] * y + p.yaw_damping[i] * v + own_load(y, v, 0.0, e, s, i) - u.disturbance[i]


@inline
def _turn_yaw(x, p, u, w, e, s, g, i, y, dt):
    """Speed of the yaw joint after dt; y is the middle of the step, as the tensions are."""
    v, r, ta, tb = x.yaw_velocity[i], p.yaw_radius[i], x.tension_end_a[i], x.tension_end_b[i]
    at = _resist(p, u, e, s, i, y, v)
    k = maximum((_resist(p, u, e, s, i, y + STEP_Y, v) - at) / STEP_Y, 0.0)
    c = maximum((_resist(p, u, e, s, i, y, v + STEP_V) - at) / STEP_V, 0.0)
    k += r * r * (span_slope(p.end_stiffness[i], ta, 0.0) + span_slope(p.end_stiffness[i], tb, 0.0))
    torque = r * (ta - tb) + 0.5 * dt * k * v  # the torques are those of the middle already
    w.yaw_new[i] = slide(e, s, g, i, v, in_time(p.yaw_inertia[i], k, dt), p.yaw_friction[i], torque, at, k, c, dt)


@inline
def _turn_pitch(x, p, w, i, dt):
    """Speed of the pitch joint after dt."""
    v, rp, rc, b = x.pitch_velocity[i], p.pitch_radius[i], p.coupling_radius[i], p.pitch_damping[i]
    ta, tb, pa, pb = x.tension_end_a[i], x.tension_end_b[i], x.pitch_tension_end_a[i], x.pitch_tension_end_b[i]
    k = rp * rp * (span_slope(p.pitch_end_stiffness[i], pa, 0.0) + span_slope(p.pitch_end_stiffness[i], pb, 0.0))
    k += rc * rc * (span_slope(p.end_stiffness[i], ta, 0.0) + span_slope(p.end_stiffness[i], tb, 0.0))
    net = rp * (pa - pb) + rc * (ta - tb) - b * v + 0.5 * dt * k * v
    dry = p.pitch_friction[i] + p.bearing_arm[i] * (ta + tb + pa + pb)
    w.pitch_new[i] = crossing_step(v, in_time(p.pitch_inertia[i], k, dt), net - dry, net + dry, k, b, dt)


@inline
def go_half(x, p, u, w, g, i, dt):
    """Takes both drives to the middle of the step; ideal ones are where their servos have them, whatever pulls."""
    half, follows = 0.5 * dt, g.follows[i] > 0.5
    k, c, most, limit = (
        p.servo_stiffness[i], p.servo_damping[i], p.drive_acceleration_limit[i], p.drive_speed_limit[i],
    )  # fmt: skip
    wound, speed = x.drive_angle[i], x.drive_velocity[i]
    new = placed(wound, speed, u.command[i], u.command_rate[i], k, c, most, limit, dt)
    after = select(follows, g.target[i], wound + half * (speed + new))
    w.middle[i], w.after[i], w.speed_after[i] = 0.5 * (wound + after), after, select(follows, g.target_rate[i], new)
    wound, speed = x.pitch_drive_angle[i], x.pitch_drive_velocity[i]
    new = placed(wound, speed, w.second[i], w.second_rate[i], k, c, most, limit, dt)
    after = wound + half * (speed + new)
    w.pitch_middle[i], w.pitch_after[i], w.pitch_speed_after[i] = 0.5 * (wound + after), after, new


@inline
def go_on(x, p, u, w, e, g, i, lead, dt):
    """Takes both drives on from there, with the tensions there; ideal ones know already.

    ``lead``: by how much the yaw drive was ahead of the middle of its gap's nut before the step, rad.
    """


@inline
def encoders(x, p, i):
    """What encoders show; ideal drives have none."""


@inline
def _step(x, p, u, w, e, s, g, i, dt):
    half, gap, lead = 0.5 * dt, e.backlash_gap[i], x.drive_angle[i] - s.gap_position[i]
    y_half, pitch_half = x.yaw_angle[i] + half * x.yaw_velocity[i], x.pitch_angle[i] + half * x.pitch_velocity[i]
    go_half(x, p, u, w, g, i, dt)
    s.gap_position[i] = select(gap > 0.0, play(s.gap_position[i], w.middle[i], gap), w.middle[i])
    _balance(x, p, w, e, i, y_half, pitch_half, s.gap_position[i], w.pitch_middle[i])
    _turn_yaw(x, p, u, w, e, s, g, i, y_half, dt)
    _turn_pitch(x, p, w, i, dt)
    go_on(x, p, u, w, e, g, i, lead, dt)
    x.yaw_angle[i], x.yaw_velocity[i] = y_half + half * w.yaw_new[i], w.yaw_new[i]
    x.pitch_angle[i], x.pitch_velocity[i] = pitch_half + half * w.pitch_new[i], w.pitch_new[i]
    x.drive_angle[i], x.drive_velocity[i] = w.after[i], w.speed_after[i]
    x.pitch_drive_angle[i], x.pitch_drive_velocity[i] = w.pitch_after[i], w.pitch_speed_after[i]
    s.gap_position[i] = select(gap > 0.0, play(s.gap_position[i], w.after[i], gap), w.after[i])
    _balance(x, p, w, e, i, x.yaw_angle[i], x.pitch_angle[i], s.gap_position[i], w.pitch_after[i])


@inline
def _largest(x, i):
    """The largest tension of all four tendons, N."""
    yaw_a, yaw_b = maximum(x.tension_drive_a[i], x.tension_end_a[i]), maximum(x.tension_drive_b[i], x.tension_end_b[i])
    a, b = (
        maximum(x.pitch_tension_drive_a[i], x.pitch_tension_end_a[i]),
        maximum(x.pitch_tension_drive_b[i], x.pitch_tension_end_b[i]),
    )
    return maximum(maximum(yaw_a, yaw_b), maximum(a, b))


@inline
def _watch(x, i):
    """What a control step keeps of the tensions of a substep."""
    a, b, pa, pb = x.tension_drive_a[i], x.tension_drive_b[i], x.pitch_tension_drive_a[i], x.pitch_tension_drive_b[i]
    x.slack_fraction[i] += select(minimum(minimum(a, b), minimum(pa, pb)) <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], _largest(x, i))


@inline
def _report(x, p, u, i):
    """What is seen of the state at the end of a control step."""
    apart = x.tension_end_a[i] - x.tension_end_b[i]
    x.yaw_torque[i], x.coupling_torque[i] = p.yaw_radius[i] * apart, p.coupling_radius[i] * apart
    x.pitch_torque[i] = p.pitch_radius[i] * (x.pitch_tension_end_a[i] - x.pitch_tension_end_b[i])
    x.pitch_command[i], x.sliding[i] = u.second[i] + u.posture[i], sign(x.yaw_velocity[i])
    encoders(x, p, i)
    x.out_of_range[i] = select(p.yaw_wrap[i] < abs(p.wrap_growth[i] * x.pitch_angle[i]), 1.0, 0.0)


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        begin(
            e, s, g, u, i, x.drive_angle[i], x.drive_velocity[i], x.yaw_angle[i], x.yaw_velocity[i], substeps * dt, dt
        )
        begin_friction(e, g, i)
        w.factor[i] = g.factor[i]
        w.pitch_ratio[i] = pitch_ratio(p, i, g.factor[i])
        w.seen[i], w.pitch_seen[i] = taken(p, i, x.yaw_angle[i], x.pitch_angle[i])
        x.slack_fraction[i], x.peak_tension[i] = 0.0, peak_at_start(_largest(x, i))
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            second, w.second_rate[i] = actuate_second(e, s, g, u, i, n, substeps, dt)
            w.second[i] = second + u.posture[i]
            u.command[i] = own_actuate(u.command[i], x.drive_angle[i], x.drive_velocity[i], e, s, i)
        for i in range(lanes):
            _step(x, p, u, w, e, s, g, i, dt)
            _watch(x, i)
            advance_memory(
                u.command[i], x.drive_angle[i], x.drive_velocity[i], x.yaw_angle[i], x.yaw_velocity[i],
                x.tension_drive_a[i], 0.0, e, s, i,
            )  # fmt: skip
            s.started[i] = 1.0
    for i in range(lanes):
        _report(x, p, u, i)
        x.slack_fraction[i] /= substeps
        end(e, s, g, i, x.yaw_angle[i], substeps * dt)


PITCH = SecondCommand("pitch", "rad", "pitch_limit", rest_signal="pitch_command")

PLANT = Plant(
    name="wrist",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=WRIST,
    action_modes=(
        position := ActionMode("position", "rad", "drive_angle_limit", rest_signal="drive_angle", second=PITCH),
        position.with_second(),
    ),
    derive=derive,
    settle=settle,
    solve=_solve,
    effects=Layout("wrist", PARAMETERS, ACTING),
    resolves=resolves,
    plain=False,
    replays=("follow",),
    posture="pitch_command",
)
