"""Scalar pieces of the cable-hole kernel that hold no effect of a user's own: the drive, the hole, the slip through it.

`cable_envs.plants.hole.plant` has the equations and the symbols, and the pieces into which a user's effects are put. In
what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
"""

from cable_envs.core.kernels import clip, exp, inline, log, maximum, minimum, select, sqrt
from cable_envs.core.lanes import Lanes
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import dry_friction, presliding_step
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.physics.friction import ringing_inertia, ringing_lag, ringing_step, ringing_way
from cable_envs.plants.hole.spool import cable_end, moves_otherwise

HOLE = Lanes("Hole", [
    "end_before", "end_after", "end_speed", "end_speed_after",  # the upper end of the cable: m, m/s
    "end_lag",  # how far it counts as behind its mean in the middle of the step, m
    "resistance", "resistance_stiffness", "resistance_damping",  # of the load: N, N/m, N s/m
    "tension_middle",  # the tension above with which the step is made, N
    "stiffness", "damping",  # of the cable, with what hardens it or takes it away: N/m, N s/m
    "friction", "friction_growth",  # M = mu + K |v|^omega, and dM/d|v| (s/m)
    "wrap_in_contact", "ratio", "inverse", "ratio_slope", "steepest",  # rad; n, 1/n, dn/dM; the n that none exceeds
    "loop_gain", "loop_late", "loop_closed", "loop_rate", "loop_now",  # gains of the drive's closed loop
    "short",  # how far the load falls short of its mean speed where it stops, m
    "elongation",  # with effects: what of the stretch makes tension, m
])  # fmt: skip
"""Scratch of a step."""


@inline
def span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def closed_loop(p, w, i, stiffness, dt):
    """The gains of the drive's inner loop; they change within a control step only where the cable hardens."""
    by_position, by_speed = 0.5 * dt * p.inner_kp[i] * stiffness, p.inner_kp[i] * p.cable_damping[i]
    w.loop_gain[i] = by_position + by_speed + p.inner_kd[i] * stiffness
    w.loop_late[i] = by_position - by_speed
    w.loop_closed[i] = 1.0 / (1.0 + w.loop_gain[i])
    w.loop_rate[i] = p.inner_kd[i] * stiffness
    w.loop_now[i] = 1.0 / (1.0 + by_speed + w.loop_rate[i])


@inline
def stiffness_now(x, p, e, i):
    """Slope of the cable's law at the tension above, N/m."""
    hard = e.stiffness_hardening_coefficient[i]
    return p.cable_stiffness[i] * (1.0 + hard * linear(x.drive_tension[i], hard))


@inline
def open_loop(x, p, u, i):
    """The speed that G35 asks for at the tension of the start of the step."""
    return p.inner_kp[i] * (u.command[i] - x.drive_tension[i]) + p.inner_kd[i] * u.command_rate[i]


@inline
def limited(p, i, old, wanted, dt):
    """Speed of the drive after a step, within its speed and acceleration limits."""
    target = clip(wanted, -p.speed_limit[i], p.speed_limit[i])
    most = p.acceleration_limit[i] * dt
    return old + clip(target - old, -most, most)


@inline
def asked_at_start(x, p, w, i, wanted):
    """The speed that G35 asks for at the start of the step, with the rate of the tension that goes with that speed."""
    by_speed = p.inner_kp[i] * w.damping[i]
    taut = (wanted + by_speed * x.drive_velocity[i] + w.loop_rate[i] * x.load_velocity[i]) * w.loop_now[i]
    return select(x.drive_tension[i] > 0.0, taut, wanted)


@inline
def closed(x, p, w, e, g, i, wanted, dt):
    """(speed of the drive after a step that obeys G35 with the tension that it leads to there, its slope by `early`).

    The algebraic loop through the cable's stiffness is solved, not sampled: with the gains of Table 3 it is 300 times
    faster than the step. The load takes part: its own step (`slip_speed`) gives its speed b at the end as a straight
    line in the drive's a, on the branch of friction on which it slides. At rest it slides on the branch on which the
    tension overcomes what resists, if there is one; it comes to rest where the line asks it to turn round.

    wanted: `open_loop`. The tension grows by dT = k (dt (old + a - v - b) / 2 + early) + c (a - b - old + v) over the
    step, early: how far the drive gets beyond its mean speed, m (`reached_early`); the speed is for none.
    """
    old, v, n, inv_n, half = x.drive_velocity[i], x.load_velocity[i], w.ratio[i], w.inverse[i], 0.5 * dt
    k, c, mass, gain = w.stiffness[i], w.damping[i], p.load_mass[i], w.loop_gain[i]
    apart = wanted + w.loop_late[i] * (v - old)
    alone = apart * w.loop_closed[i]  # where the load stands still
    grows = k * ringing_way(1.0, dt) + 0.5 * c
    fixed = x.drive_tension[i] + (k * half - grows) * old  # of the tension in the middle: the rest is grows times a
    middle = fixed + grows * limited(p, i, old, alone, dt)
    above, below = w.resistance[i], w.resistance[i]
    if e is not None:
        above, below = above + g.up[i], below - g.down[i]
    up = (v > 0.0) | ((v == 0.0) & (middle * inv_n > above))
    down = (v < 0.0) | ((v == 0.0) & (middle * n < below))
    passed, held = select(up, inv_n, n), select(up, above, below)
    steeper = x.drive_tension[i] * w.ratio_slope[i] * w.friction_growth[i] * select(up, inv_n * inv_n, 1.0)
    damping = maximum(w.resistance_damping[i] + c * passed + steeper, -mass / dt)
    stiffness = w.resistance_stiffness[i] + k * passed
    inertia = ringing_inertia(mass, damping, stiffness, dt)  # b = (still + follows a) / inertia
    still = inertia * v + dt * (fixed * passed - held - half * stiffness * v)
    follows = dt * grows * passed
    per, earlier = 1.0 / (inertia + gain * (inertia - follows)), -p.inner_kp[i] * k
    together = (inertia * apart + gain * still) * per
    ends = still + follows * together
    slides = (up & (ends > 0.0)) | (down & (ends < 0.0))
    further = (inertia * earlier + gain * passed * (half * k + c)) * per
    return select(slides, together, alone), select(slides, further, earlier * w.loop_closed[i])


@inline
def caught_early(p, i, jump, change, dt):
    """How far a drive that is asked for another speed gets beyond the mean of the step, m: it is there on the way.

    jump: how much faster it is to be at the start of the step. change: how much that changes within the step.
    """
    catches = p.acceleration_limit[i] * dt - select(jump < 0.0, -change, change)
    return 0.5 * dt * jump * (1.0 - abs(jump) / maximum(catches, maximum(abs(jump), 1e-300)))


@inline
def reached_early(p, i, old, new, dt):
    """How far a drive that is told its speed gets beyond the mean of both, m: it reaches the new one on the way."""
    return caught_early(p, i, new - old, 0.0, dt)


@inline
def carried(x, w, e, s, g, i, new, dt, short=0.0):
    """The drive moves on with the speed ``new`` after the step, and the end of the cable with it.

    ``short``: how far it falls short of its mean speed where friction stops it, m; negative: how far it gets beyond.
    """
    old, before = x.drive_velocity[i], x.drive_position[i]
    w.end_before[i] = before
    w.end_speed[i] = 0.5 * (old + new) - short / dt
    w.end_lag[i] = ringing_lag(new - old, dt)
    if e is not None:
        new = select(g.follows[i] > 0.5, g.target_rate[i], new)
        w.end_speed[i] = select(g.follows[i] > 0.5, (g.target[i] - before) / dt, w.end_speed[i])
    w.end_speed_after[i] = new
    w.end_after[i] = before + dt * w.end_speed[i]
    if e is not None:
        w.end_after[i] = select(g.follows[i] > 0.5, g.target[i], w.end_after[i])
    x.drive_position[i], x.drive_velocity[i] = w.end_after[i], new
    if e is not None:
        at, after, mean, drawn = cable_end(e, s, i, w.end_before[i], w.end_after[i], new, dt)
        other = moves_otherwise(e, i)
        w.end_lag[i] = select(other | (g.follows[i] > 0.5), 0.0, w.end_lag[i])
        w.end_before[i], w.end_after[i] = select(other, at, w.end_before[i]), select(other, after, w.end_after[i])
        w.end_speed[i], w.end_speed_after[i] = (
            select(other, mean, w.end_speed[i]),
            select(other, drawn, w.end_speed_after[i]),
        )


@inline
def ratio(p, w, i):
    """n and dn/dM with the exact solution of section 1 in docs/physics.md.  G9, G17."""
    w.ratio[i], w.ratio_slope[i] = tension_ratio_and_slope(p.radius_ratio[0, i], w.friction[i], w.wrap_in_contact[i])
    w.inverse[i] = 1.0 / w.ratio[i]


@inline
def steepest_ratio(p, i):
    """The ratio that no friction exceeds: cosh(sqrt(rho) phi), the limit of `tension_ratio` for mu to infinity."""
    turned = sqrt(p.radius_ratio[0, i]) * p.wrap_angle[0, i]
    return 0.5 * (exp(turned) + exp(-turned))


@inline
def extrapolated(w, e, i, v, v_new):
    """n at the new speed in a straight line from the old one, within what friction can do.

    It is good to the second order, and for what goes on within the control step only: what is reported at its end is
    the contact's law at the speed there.
    """
    straight = w.ratio[i] + w.ratio_slope[i] * w.friction_growth[i] * (abs(v_new) - abs(v))
    return minimum(maximum(straight, 1.0), w.steepest[i])


@inline
def transmitted(v, above, n, inv_n, resist):
    """Tension behind a hole: on the friction limit when sliding, what keeps the balance when stuck."""
    low, high = above * inv_n, above * n
    return select(v > 0.0, low, select(v < 0.0, high, clip(resist, low, high)))


@inline
def mobilised(n, inv_n, part):
    """(T2/T1, how much that is above a straight line from n to 1/n, growth of this with ``part``).

    ``part``: share of the friction that opposes upward motion, in [0, 1]. With the friction coefficient mobilised by
    2 part - 1 everywhere in the contact, the tension changes by n^(1 - 2 part).
    """
    power = log(n)
    bent = exp((1.0 - 2.0 * part) * power)
    return bent, bent - n - part * (inv_n - n), n - inv_n - 2.0 * power * bent


@inline
def record(x, i, tension):
    """The tension above and what the control step keeps of it: its peak, and the share of substeps without any."""
    x.drive_tension[i] = tension
    x.slack_fraction[i] += select(tension <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], tension)


@inline
def drawn_in(x, p, e, s, g, i, dt):
    """The drive where the tension is imposed: the cable's end must be where its law asks for it."""
    stretch = linear(x.drive_tension[i], e.stiffness_hardening_coefficient[i]) / p.cable_stiffness[i]
    position = x.load_position[i] + stretch + e.slack_length[i] + s.creep_top[i]
    imposed = g.imposes[i] > 0.5
    x.drive_velocity[i] = select(imposed, (position - x.drive_position[i]) / dt, x.drive_velocity[i])
    x.drive_position[i] = select(imposed, position, x.drive_position[i])


@inline
def wrapped(x, p, w, lanes, bends):
    """Wrap that stays in contact; the loop is left out where no cable of the block is stiff.  G1"""
    if bends:
        for i in range(lanes):
            w.wrap_in_contact[i] = wrap_in_contact(
                p.wrap_angle[0, i], p.bending_rigidity[i], p.edge_radius[0, i], x.drive_tension[i], x.load_tension[i]
            )
    else:
        for i in range(lanes):
            w.wrap_in_contact[i] = p.wrap_angle[0, i]


@inline
def any_stiff(p, lanes):
    """Whether a cable of the block has a bending stiffness."""
    found = False
    for i in range(lanes):
        found = found or p.bending_rigidity[i] > 0.0
    return found


@inline
def load_slides(v, mass, up, down, stiffness, damping_up, damping_down, dt):
    """Speed of the load after a step, which may turn round within it, and what it falls short where it stops."""
    return ringing_step(v, mass, up, down, stiffness, damping_up, damping_down, dt)


@inline
def slip_speed(x, p, w, e, s, g, i, ahead, dt):
    """Speed of the load after the step: the tension above against what resists behind the hole.  G28

    The tension is that with the load moved on by ``ahead``; the step counts the same motion in the cable's stiffness.
    """
    v, middle, n, inv_n = x.load_velocity[i], w.tension_middle[i], w.ratio[i], w.inverse[i]
    mass, growth = p.load_mass[i], middle * w.ratio_slope[i] * w.friction_growth[i]
    taut = middle > 0.0
    k, c = select(taut, w.stiffness[i], 0.0), select(taut, w.damping[i], 0.0)
    back = k * ahead
    up, down = (middle + back) * inv_n - w.resistance[i], (middle + back) * n - w.resistance[i]
    stiffness = w.resistance_stiffness[i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
    damping_up = w.resistance_damping[i] + (c + growth * inv_n) * inv_n
    damping_down = w.resistance_damping[i] + c * n + growth
    if e is not None:
        least = -mass / dt  # falling friction drives; what is left must still resist
        dry_friction(e, g, i, v, e.coulomb_friction_level[i], middle)
        up, down = up - g.up[i], down + g.down[i]
        damping_up, damping_down = damping_up + g.steep[i], damping_down + g.steep[i]
        stiffness = w.resistance_stiffness[i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
        damping_up, damping_down = maximum(damping_up, least), maximum(damping_down, least)
    v_new, w.short[i] = load_slides(v, mass, up, down, stiffness, damping_up, damping_down, dt)
    if e is not None:
        _, beside, steeper = mobilised(n, inv_n, share(s.presliding, i))
        at_rest = 0.5 + 0.5 * (middle - w.resistance[i]) / maximum(middle * log(n), 1e-12)
        v_new = presliding_step(
            e, s, g, i, v, mass, up, down, v_new, w.resistance_stiffness[i] + k * n, k * (inv_n - n), damping_up,
            damping_down, dt, 0.5, middle * beside, middle * steeper, maximum(at_rest, 0.0),
            2.0 * g.excess[i] + middle * (n - inv_n) * g.contact_excess[i],
        )  # fmt: skip
        w.short[i] = select(v_new == 0.0, w.short[i], 0.0)
    return v_new


@inline
def creeping(e, s, g, i, elongation):
    """The cable's lasting elongation after a step in which it was stretched by ``elongation``."""
    s.creep_top[i] = crept(s.creep_top[i], e.viscoelastic_creep_share[i], elongation, g.creep_left[i])
