"""A real drive for the tendon that rubs at contacts: its friction is solved together with them.

The drive obeys, like the load, an inertia with set-valued friction. In a step of dt it goes by

    d = clip(F(T), low, high),    F(T) = up - g T       where that is beyond dt v / 2, forward
                                         down - g T     where that is beyond dt v / 2, backward
                                         dt v / 2       where neither is: it stops, or stays at rest
    g (2 J / dt + b) / dt = the share of the step's end in T

with T the tension at its end behind the step. ``up`` and ``down`` differ by twice the friction and by what the gear
takes either way: F falls with T, and never jumps. The tendon's end goes by the same, or by less where there is a gap:
within it the drive feels no tendon, neither at the start of a step nor at its end.
"""

from cable_envs.core.kernels import clip, inline, maximum, minimum, select
from cable_envs.effects.backlash import apart
from cable_envs.plants.servo_stages import motor_shows, motor_torques, servo_reads
from cable_envs.plants.sheath.contact_stages import at_speeds as ideal_at_speeds
from cable_envs.plants.sheath.contact_stages import end_share, rings, room, weight

SCRATCH = ("reach_down", "coast", "cogging")
"""``down`` and dt v / 2, m; the motor's cogging, N. ``up``, g and both limits are those of an ideal drive."""


@inline
def drive_row(x, p, u, w, e, s, g, i, dt):
    """What encoder, servo and motor make of the step, in the place of `contact_stages.drive_row`."""
    at, speed, half = x.drive_position[i], x.drive_velocity[i], 0.5 * dt
    servo_reads(x, p, i, at, speed, u.mode[i] > 0.5, u.command[i], u.command_rate[i], dt)
    forward, backward, cogging, damping = motor_torques(x, p, i, at, speed, dt)
    friction, mass = p.drive_friction[i], rings(p.moved_inertia[i], p, w, 0, i, dt) / dt
    late = end_share(p.moved_inertia[i], 2.0 * x.slip_position.shape[0] * p.stiffness[i], dt)
    late = maximum(late, weight(w, i))
    per = half / (mass + 0.5 * damping)
    began = (1.0 - late) * x.drive_pull[i]
    w.ahead[i], w.back[i] = 0.0, 0.0
    if e is not None:
        by_force, gap = (u.mode[i] > 0.5) & (g.follows[i] < 0.5), e.backlash_gap[i]
        nut = select(gap > 0.0, s.gap_position[i], at)
        w.ahead[i], w.back[i] = room(by_force, nut, at, gap)
        began = select(apart(by_force, nut, at, gap), 0.0, began)
    net = (2.0 * mass + damping - p.moved_damping[i]) * speed - began - cogging
    w.reach[i], w.reach_down[i] = (net + forward - friction) * per, (net + backward + friction) * per
    w.give[i], w.coast[i], w.cogging[i], w.placed[i] = late * per, half * speed, cogging, 0.0
    fastest = p.top_speed[i]
    w.low[i], w.high[i] = half * (speed - fastest), half * (speed + fastest)
    if e is not None:
        follows, way = g.follows[i] > 0.5, g.target[i] - at
        w.low[i], w.high[i] = select(follows, way, w.low[i]), select(follows, way, w.high[i])
        w.placed[i] = g.target_rate[i]
    w.drive_state[i] = 0.0


@inline
def _motion(w, i, up, down):
    """1, -1 or 0: the drive goes forward, backward, or stops, where friction one way or the other takes it there."""
    rises, falls = (up > w.coast[i]) & (w.coast[i] >= 0.0), (down < w.coast[i]) & (w.coast[i] <= 0.0)
    return select(rises, 1.0, select(falls, -1.0, 0.0))


@inline
def _gone(w, i, tension):
    """F(T) within the limits."""
    back = w.give[i] * tension
    up, down = w.reach[i] - back, w.reach_down[i] - back
    motion = _motion(w, i, up, down)
    d = select(motion > 0.0, up, select(motion < 0.0, down, w.coast[i]))
    return clip(d, w.low[i], w.high[i])


@inline
def drive_end(x, w, e, s, i, c, r):
    """The drive's end against T_0 c = r + d_0, in the place of `contact_stages.drive_end`."""
    off, moves, side = 0.0, 1.0, 0.0
    if e is not None:
        free, still = _gone(w, i, 0.0), _gone(w, i, maximum(r, 0.0) / c)
        side = select(still > w.ahead[i], 1.0, select(free < -w.back[i], -1.0, 0.0))
        side = select(w.ahead[i] + w.back[i] > 0.0, side, 2.0)
        moves = select(side == 0.0, 0.0, 1.0)
        off = select(side == 1.0, w.ahead[i], select(side == -1.0, -w.back[i], 0.0))
    up, down, give, rest = w.reach[i] - off, w.reach_down[i] - off, w.give[i], w.coast[i] - off
    with_up = up - give * maximum(r + up, 0.0) / (c + give)
    with_down = down - give * maximum(r + down, 0.0) / (c + give)
    motion = _motion(w, i, with_up + off, with_down + off)
    d = select(motion > 0.0, with_up, select(motion < 0.0, with_down, rest))
    end = clip(d, w.low[i] - off, w.high[i] - off)
    at = select(d > end, 1.0, select(d < end, -1.0, 0.0))
    free = select(motion > 0.0, up, select(motion < 0.0, down, rest))
    w.drive_reach[i] = moves * select(at == 0.0, free, end)
    w.drive_give[i] = moves * select((at == 0.0) & (motion != 0.0), give, 0.0)
    return 16.0 * side + 4.0 * motion + at


@inline
def drive_way(x, w, g, i, tension, dt):
    """(way of the drive, its speed behind the step), in the place of `contact_stages.drive_way`."""
    free, d = _gone(w, i, 0.0), _gone(w, i, tension)
    crosses = (w.ahead[i] + w.back[i] > 0.0) & (free >= -w.back[i])  # the tension holds it at the edge ahead only
    d = select(crosses, minimum(free, maximum(d, w.ahead[i])), d)
    speed = select(d == w.coast[i], 0.0, 2.0 * d / dt - x.drive_velocity[i])
    return d, select(w.low[i] < w.high[i], speed, w.placed[i])


@inline
def at_speeds(x, w, i, dt):
    """Both ends go on at their speeds, in the place of `contact_stages.at_speeds`."""
    ideal_at_speeds(x, w, i, dt)
    w.reach_down[i] = w.coast[i] = w.reach[i]


@inline
def drive_shows(x, p, w, i):
    """The motor's force, in the place of `contact_stages.drive_shows`."""
    motor_shows(x, p, i, x.drive_velocity[i], x.drive_tension[i] + w.cogging[i])
