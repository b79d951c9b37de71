"""Scalar pieces of the cable-hole kernel for the drive: its limits, its inner loop, the cable's end that goes along.

As in `cable_envs.plants.hole.stages`, e, s and g are None without effects.
"""

from cable_envs.core.kernels import clip, inline, maximum, select
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.physics.friction import beyond_middle, ringing_inertia, ringing_lag, ringing_way
from cable_envs.plants.hole.spool import cable_end, moves_otherwise


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
    step, early: how far the drive gets beyond its mean speed, m (`caught_early`); the speed is for none.
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
    late = dt * beyond_middle(mass, damping, stiffness, dt)  # what `later` adds
    turned = k * ringing_lag(1.0, dt) + 0.5 * c
    still += late * (passed * old * (0.5 * k * half - turned) - half * stiffness * v)
    follows += late * passed * (0.5 * k * half + turned)
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
def told_speeds(u, g, i, dt):
    """Speeds that a drive is told at the start and at the end of a step: where commands go in straight lines, two."""
    if g is None:
        return u.command[i], u.command[i]
    change = 0.5 * dt * g.ramped[i] * u.command_rate[i]
    return u.command[i] - change, u.command[i] + change


@inline
def told_step(p, u, g, i, old, dt):
    """(speed after a step of a drive that is told its speed, how far it gets beyond the mean of both, m).

    A jump of the command takes it on as fast as it can: it reaches the new speed on the way.
    """
    first, last = told_speeds(u, g, i, dt)
    start, new = limited(p, i, old, first, dt), limited(p, i, old, last, dt)
    return new, caught_early(p, i, start - old, new - start, dt)


@inline
def carried(x, w, e, s, g, i, new, dt, short=0.0, by_force=False):
    """The drive moves on with the speed ``new`` after the step, and the end of the cable with it.

    ``short``: how far it falls short of its mean speed where friction stops it, m; negative: how far it gets beyond.
    ``by_force``: whether it is told its force (`cable_envs.effects.backlash.pulled_end`).
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
        taken_up = by_force & (g.follows[i] < 0.5)
        at, after, mean, drawn = cable_end(e, s, i, w.end_before[i], w.end_after[i], new, dt, taken_up)
        other = moves_otherwise(e, i, taken_up)
        w.end_lag[i] = select(other | (g.follows[i] > 0.5), 0.0, w.end_lag[i])
        w.end_before[i], w.end_after[i] = select(other, at, w.end_before[i]), select(other, after, w.end_after[i])
        w.end_speed[i], w.end_speed_after[i] = (
            select(other, mean, w.end_speed[i]),
            select(other, drawn, w.end_speed_after[i]),
        )
