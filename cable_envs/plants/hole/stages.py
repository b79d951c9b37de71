"""Scalar pieces of the cable-hole kernel: the drive, one hole, the span behind it. They hold no effect of a user's own.

`cable_envs.plants.hole.plant` has the equations and the symbols, and the pieces into which a user's effects are put. In
what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
"""

from cable_envs.core.kernels import clip, exp, inline, log, maximum, select
from cable_envs.core.lanes import Lanes
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import dry_friction, presliding_step
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.physics.friction import stick_slip_step
from cable_envs.plants.hole.spool import cable_end, engaged, moves_otherwise

HOLE = Lanes("Hole", [
    "slip", "speed", "tension_behind",  # of the cable in this hole: paid through (m), m/s, N
    "wrap", "rho", "mu", "edge_radius",  # geometry and friction of this hole
    "end_before", "end_after", "end_speed", "end_speed_after",  # the upper end of the cable above: m, m/s
    "tension_above", "stiffness_above", "damping_above",
    "resistance", "resistance_stiffness", "resistance_damping", "inertia",  # behind the hole: N, N/m, N s/m, kg
    "tension_middle",  # the tension above with which the step is made, N
    "friction", "friction_growth",  # M = mu + K |v|^omega, and dM/d|v| (s/m)
    "wrap_in_contact", "ratio", "ratio_slope",  # rad; n and dn/dM
    "loop_gain", "loop_late", "loop_closed", "per_mass",  # gains of the drive's closed loop
    # with effects, of the cable above: its hardening, the length that makes no tension, its stiffness over K, its
    # elongation; and 1 where the drive is what ends it
    "hardening", "lost_length", "rise", "elongation", "drive_ends_it",
])  # fmt: skip
"""Scratch: the hole that is being solved."""


@inline
def span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def closed_loop(p, w, i, stiffness, dt):
    """The gains of `drive`; they change within a control step only where the cable hardens."""
    by_position, by_speed = 0.5 * dt * p.inner_kp[i] * stiffness, p.inner_kp[i] * p.cable_damping[i]
    w.loop_gain[i] = by_position + by_speed + p.inner_kd[i] * stiffness
    w.loop_late[i] = by_position - by_speed
    w.loop_closed[i] = 1.0 / (1.0 + w.loop_gain[i])
    w.per_mass[i] = 1.0 / p.load_mass[i]


@inline
def drive(x, p, u, w, e, s, g, i, ahead, dt):
    """Drive within its speed and acceleration limits; it becomes what is above the first hole.  G35 in tension mode.

    The speed at the end of the step obeys G35 with the tension that it leads to there, and with the tension's rate from
    the span itself; ``ahead`` is the cable's speed at the first hole by then. The algebraic loop through the cable's
    stiffness is solved, not sampled: with the gains of Table 3 it is 300 times faster than the step.
    """
    old = x.drive_velocity[i]
    wanted = p.inner_kp[i] * (u.command[i] - x.drive_tension[i]) + p.inner_kd[i] * u.command_rate[i]
    loop = (wanted + w.loop_late[i] * (w.speed[i] - old) + w.loop_gain[i] * ahead) * w.loop_closed[i]
    loop = select(x.drive_tension[i] > 0.0, loop, wanted)
    if e is not None:
        loop = select(engaged(e, s, i, x.drive_position[i], wanted), loop, wanted)
    target = clip(select(u.mode[i] > 0.5, u.command[i], loop), -p.speed_limit[i], p.speed_limit[i])
    most = p.acceleration_limit[i] * dt
    new = old + clip(target - old, -most, most)
    w.end_before[i] = x.drive_position[i]
    w.end_speed[i] = 0.5 * (old + new)
    if e is not None:
        new = select(g.follows[i] > 0.5, g.target_rate[i], new)
        w.end_speed[i] = select(g.follows[i] > 0.5, (g.target[i] - x.drive_position[i]) / dt, w.end_speed[i])
    w.end_speed_after[i] = new
    w.end_after[i] = x.drive_position[i] + dt * w.end_speed[i]
    w.tension_above[i], w.stiffness_above[i], w.damping_above[i] = (
        x.drive_tension[i],
        p.cable_stiffness[i],
        p.cable_damping[i],
    )
    if e is not None:
        w.end_after[i] = select(g.follows[i] > 0.5, g.target[i], w.end_after[i])
    x.drive_position[i], x.drive_velocity[i] = w.end_after[i], new
    if e is not None:
        before, after, mean, drawn = cable_end(e, s, i, w.end_before[i], w.end_after[i], new, dt)
        other = moves_otherwise(e, i)
        w.end_before[i], w.end_after[i] = select(other, before, w.end_before[i]), select(other, after, w.end_after[i])
        w.end_speed[i], w.end_speed_after[i] = (
            select(other, mean, w.end_speed[i]),
            select(other, drawn, w.end_speed_after[i]),
        )
        w.hardening[i], w.lost_length[i], w.drive_ends_it[i] = (
            e.stiffness_hardening_coefficient[i],
            e.slack_length[i] + s.creep_top[i],
            1.0,
        )


@inline
def ratio(w, i):
    """n and dn/dM with the exact solution of section 1 in docs/physics.md.  G9, G17."""
    w.ratio[i], w.ratio_slope[i] = tension_ratio_and_slope(w.rho[i], w.friction[i], w.wrap_in_contact[i])


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
def drawn_in(x, p, w, e, s, g, i, dt):
    """The drive where the tension is imposed: the cable's end must be where its law asks for it."""
    stretch = linear(x.drive_tension[i], e.stiffness_hardening_coefficient[i]) / p.cable_stiffness[i]
    position = w.slip[i] + stretch + e.slack_length[i] + s.creep_top[i]
    imposed = g.imposes[i] > 0.5
    x.drive_velocity[i] = select(imposed, (position - x.drive_position[i]) / dt, x.drive_velocity[i])
    x.drive_position[i] = select(imposed, position, x.drive_position[i])


@inline
def take_hole(x, p, w, i, h, last):
    """State and geometry of hole ``h``; behind the last one is the load."""
    if last:
        w.slip[i], w.speed[i], w.tension_behind[i] = x.load_position[i], x.load_velocity[i], x.load_tension[i]
    else:
        w.slip[i], w.speed[i] = x.slip_position[h, i], x.slip_velocity[h, i]
        w.tension_behind[i] = x.span_tension[h, i]
    w.wrap[i], w.rho[i] = p.wrap_angle[h, i], p.radius_ratio[h, i]
    w.mu[i], w.edge_radius[i] = p.friction_coefficient[h, i], p.edge_radius[h, i]


@inline
def keep_hole(x, w, i):
    """The only hole after its step: its geometry is in place already."""
    w.tension_behind[i] = x.load_tension[i]


@inline
def span_behind(x, p, w, i, h, before_load, ahead):
    """The span behind hole ``h`` to the next hole, and the cable's own lumped mass.

    The next hole is taken ``ahead`` seconds from now at its present speed: it moves on within the step.
    ``before_load``: the next hole is the last, whose slip is the load's motion.
    """
    if before_load:
        following, speed = x.load_position[i], x.load_velocity[i]
    else:
        following, speed = x.slip_position[h + 1, i], x.slip_velocity[h + 1, i]
    resist = span(p.span_stiffness[i], 0.0, w.slip[i] - following - ahead * speed, 0.0)
    w.resistance[i], w.resistance_damping[i], w.inertia[i] = resist, 0.0, p.guide_mass[i]
    w.resistance_stiffness[i] = select(resist > 0.0, p.span_stiffness[i], 0.0)


@inline
def guide_moved(x, p, w, i, h, tension, inv_n):
    """An inner hole after its step; its span is above the next hole."""
    x.slip_position[h, i], x.slip_velocity[h, i] = w.slip[i], w.speed[i]
    x.span_tension[h, i] = transmitted(w.speed[i], tension, w.ratio[i], inv_n, w.resistance[i])
    w.tension_above[i], w.stiffness_above[i], w.damping_above[i] = x.span_tension[h, i], p.span_stiffness[i], 0.0


@inline
def wrapped(p, w, lanes, bends):
    """Wrap that stays in contact; the loop is left out where no cable of the block is stiff.  G1"""
    if bends:
        for i in range(lanes):
            w.wrap_in_contact[i] = wrap_in_contact(
                w.wrap[i], p.bending_rigidity[i], w.edge_radius[i], w.tension_above[i], w.tension_behind[i]
            )
    else:
        for i in range(lanes):
            w.wrap_in_contact[i] = w.wrap[i]


@inline
def any_stiff(p, lanes):
    """Whether a cable of the block has a bending stiffness."""
    found = False
    for i in range(lanes):
        found = found or p.bending_rigidity[i] > 0.0
    return found


@inline
def slip_speed(w, e, s, g, i, dt, theta, last):
    """Speed of a slip after the step: the tension above against what resists behind the hole.  G28"""
    v, middle, n = w.speed[i], w.tension_middle[i], w.ratio[i]
    inv_n, growth = 1.0 / n, middle * w.ratio_slope[i] * w.friction_growth[i]
    taut = middle > 0.0
    if e is not None:
        k, c = select(taut, w.stiffness_above[i] * w.rise[i], 0.0), select(taut, w.damping_above[i], 0.0)
    else:
        k, c = select(taut, w.stiffness_above[i], 0.0), select(taut, w.damping_above[i], 0.0)
    up, down = middle * inv_n - w.resistance[i], middle * n - w.resistance[i]
    stiffness = w.resistance_stiffness[i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
    damping_up = w.resistance_damping[i] + (c + growth * inv_n) * inv_n
    damping_down = w.resistance_damping[i] + c * n + growth
    if e is not None:
        least = -w.inertia[i] / dt  # falling friction drives; what is left must still resist
        if last:
            dry_friction(e, g, i, v, e.coulomb_friction_level[i], middle)
            up, down = up - g.up[i], down + g.down[i]
            damping_up, damping_down = damping_up + g.steep[i], damping_down + g.steep[i]
            stiffness = w.resistance_stiffness[i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
        damping_up, damping_down = maximum(damping_up, least), maximum(damping_down, least)
    v_new = stick_slip_step(v, w.inertia[i], up, down, stiffness, damping_up, damping_down, dt, theta)
    if e is not None:  # noqa: SIM102 (this alone is decided before the compiler sees it)
        if last:
            _, beside, steeper = mobilised(n, inv_n, share(s.presliding, i))
            at_rest = 0.5 + 0.5 * (middle - w.resistance[i]) / maximum(middle * log(n), 1e-12)
            bent = presliding_step(
                e, s, i, v, w.inertia[i], up, down, w.resistance_stiffness[i] + k * n, k * (inv_n - n), damping_up,
                damping_down,                dt, theta, middle * beside, middle * steeper, maximum(at_rest, 0.0),
            )  # fmt: skip
            v_new = select(e.presliding_hysteresis_displacement[i] > 0.0, bent, v_new)
    return v_new
