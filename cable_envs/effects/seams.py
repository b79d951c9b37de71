"""Where effects act on every plant in the same way: the command, the dry friction of the load, its step, a belt.

e: tile of the effects' coefficients (`cable_envs.effects.Layout`); s: of their states; g: scratch of a control step
(`cable_envs.effects.lanes`); i: column.
"""

from cable_envs.core.inputs import FOLLOW, IMPOSED, RAMPED
from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sqrt
from cable_envs.effects.actuator_lag import keep, lagged
from cable_envs.effects.asymmetric_friction import levels
from cable_envs.effects.backlash import dead_zone
from cable_envs.effects.bristles import bent, breakaway, bristle_length, damping_ratio, keeping, set_all
from cable_envs.effects.friction_drift import drifted
from cable_envs.effects.own import begin_memory, own_cable
from cable_envs.effects.presliding_hysteresis import STEEPEST, damping, draw_to, follow, share, slope
from cable_envs.effects.presliding_hysteresis import begin as begin_elements
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import kept
from cable_envs.physics.friction import crossing_step


@inline
def begin(e, s, g, u, i, position, velocity, load, speed, period, dt):
    """What does not change within a control step; position and velocity of the drive, then of the load."""
    ramped = u.mode[i] > RAMPED - 0.5
    mode = select(ramped, u.mode[i] - RAMPED, u.mode[i])
    g.asked[i], g.asked_rate[i], g.ramped[i] = u.command[i], u.command_rate[i], select(ramped, 1.0, 0.0)
    u.mode[i] = mode
    g.follows[i] = select(abs(mode - FOLLOW) < 0.5, 1.0, 0.0)
    g.imposes[i] = select(abs(mode - IMPOSED) < 0.5, 1.0, 0.0)
    fresh = s.started[i] < 0.5
    s.command[i] = select(fresh, u.command[i] - u.command_rate[i] * period, s.command[i])
    s.command_rate[i] = select(fresh, 0.0, s.command_rate[i])
    g.lag_left[i], g.creep_left[i] = keep(e.actuator_lag_time[i], dt), kept(e.viscoelastic_creep_time[i], dt)
    g.slow_left[i] = kept(e.slow_creep_time[i], dt)
    g.lag_late[i] = (1.0 - g.lag_left[i]) * e.actuator_lag_time[i] / dt
    half = 0.5 * period  # what drifts slowly is taken in the middle of the control step
    worn = drifted(
        s.drift[i],
        e.friction_drift_change[i],
        e.friction_drift_time[i],
        e.friction_drift_travel[i],
        half,
        half * abs(speed),
    )
    g.factor[i] = 1.0 + e.friction_drift_change[i] * worn
    g.start[i], g.start_rate[i], g.load_before[i] = position, velocity, load
    g.up[i], g.down[i], g.steep[i] = 0.0, 0.0, 0.0
    g.excess[i], g.contact_excess[i], g.part[i], g.idlers_part[i] = 0.0, 0.0, 1.0, 0.0
    begin_memory(s, i, dt)


@inline
def begin_friction(e, g, i):
    """The same for friction that builds up over a distance, on plants that have such."""
    width, long, angle = e.presliding_hysteresis_displacement[i], bristle_length(e, i), e.partial_slip_angle[i]
    most = STEEPEST / select(width > 0.0, width, 1.0)
    g.most[i] = select(long > 0.0, 0.5 / select(long > 0.0, long, 1.0), most)
    g.idlers_most[i] = STEEPEST / select(angle > 0.0, angle, 1.0)


@inline
def end(e, s, g, i, load, period):
    """What changes slowly: once a control step."""
    moved = abs(load - g.load_before[i])
    s.drift[i] = drifted(
        s.drift[i], e.friction_drift_change[i], e.friction_drift_time[i], e.friction_drift_travel[i], period, moved
    )
    s.started[i] = 1.0


@inline
def _hermite(a, va, b, vb, period, at):
    """Position and velocity at the share ``at`` of a cubic from (a, va) to (b, vb)."""
    rest = 1.0 - at
    x = rest * rest * ((1.0 + 2.0 * at) * a + at * period * va) + at * at * ((3.0 - 2.0 * at) * b - rest * period * vb)
    v = 6.0 * at * rest * (b - a) / period + rest * (1.0 - 3.0 * at) * va + at * (3.0 * at - 2.0) * vb
    return x, v


@inline
def actuate(e, s, g, u, i, n, substeps, dt):
    """The command that acts in the n-th step, behind ramp and lag; the path that the drive follows."""
    period = substeps * dt
    before = g.ramped[i] * g.asked_rate[i]
    command = g.asked[i] - before * (period - (n + 0.5) * dt)
    left = g.lag_left[i]
    late, late_rate = s.command[i], s.command_rate[i]
    s.command[i], s.command_rate[i] = lagged(late, command, left), lagged(late_rate, g.asked_rate[i], left)
    mean = g.lag_late[i]  # not half of it: a lag far shorter than the step would come out as half a step
    u.command[i] = select(left > 0.0, command + (late - command) * mean, command)
    asked = g.asked_rate[i]
    u.command_rate[i] = select(left > 0.0, asked + (late_rate - asked) * mean, asked)
    at = (n + 1.0) / substeps
    x, v = _hermite(g.start[i], g.start_rate[i], g.asked[i], g.asked_rate[i], period, at)
    g.target[i], g.target_rate[i] = x, v


@inline
def actuate_second(e, s, g, u, i, n, substeps, dt):
    """(second command, its rate) that act in the n-th step, behind ramp and lag as the first."""
    late = u.second_rate[i] * (substeps * dt - (n + 0.5) * dt)
    asked = u.second[i] - select(g.ramped[i] > 0.5, late, 0.0)
    fresh, left, mean = s.started[i] < 0.5, g.lag_left[i], g.lag_late[i]
    before = select(fresh, u.second[i] - u.second_rate[i] * (substeps * dt), s.second[i])
    before_rate = select(fresh, 0.0, s.second_rate[i])
    s.second[i], s.second_rate[i] = lagged(before, asked, left), lagged(before_rate, u.second_rate[i], left)
    return (
        select(left > 0.0, asked + (before - asked) * mean, asked),
        select(left > 0.0, u.second_rate[i] + (before_rate - u.second_rate[i]) * mean, u.second_rate[i]),
    )


@inline
def dry_friction(e, g, i, v, level, tension):
    """Dry friction of the load into g: moving up, moving down, and its growth with |v| (negative where it falls)."""
    extra, steep = excess_at(e.stribeck_friction_excess[i], e.stribeck_friction_velocity[i], v)
    up, down = levels(e.asymmetric_friction_difference[i])
    plain = g.factor[i] * (level + extra) + e.load_dependent_friction_coefficient[i] * tension
    g.up[i], g.down[i], g.steep[i] = plain + up, plain + down, g.factor[i] * steep
    g.excess[i] = g.factor[i] * extra


@inline
def held_back(g, i, net, v):
    """The net force less the dry friction; zero at rest where friction holds it."""
    low, high = -g.down[i], g.up[i]
    at_rest = net - select(net < low, low, select(net > high, high, net))
    with_none = select((g.up[i] == 0.0) & (g.down[i] == 0.0), net, at_rest)
    return select(v > 0.0, net - high, select(v < 0.0, net - low, with_none))


@inline
def elastic(part, steep, up, down, beside=0.0, steeper=0.0):
    """(force, stiffness) of a friction between ``up`` and ``down`` that builds up: its share, the growth of this.

    Where the force is not in proportion to the share: what it has more, and its growth with the share.
    """
    spread = down - up
    return down - part * spread + beside, (spread - steeper) * steep


@inline
def elastic_step(v, mass, force, stiffness, damping, own, dt, theta=0.5):
    """Velocity after dt where friction is elastic: as `friction.stick_slip_step`, without its sticking.

    ``stiffness`` has that of the friction in it; ``own`` is the damping that comes with it, which ``force`` lacks.
    """
    part = theta * dt
    gain = dt / (mass + part * (damping + own + part * stiffness))
    return v + gain * (force - own * v - part * stiffness * v)


@inline
def builds_up(e, i):
    """Whether dry friction builds up over a distance, in whatever formulation."""
    return (e.presliding_hysteresis_displacement[i] > 0.0) | (bristle_length(e, i) > 0.0)


@inline
def any_builds_up(e, lanes):
    """Whether dry friction of a column of the block builds up over a distance, sliding on idlers included."""
    found = False
    for i in range(lanes):
        found = found or builds_up(e, i) or (e.partial_slip_angle[i] > 0.0)
    return found


@inline
def mobilising(e, s, i, v, most):
    """(share of the friction that opposes upward motion, its growth with the position; share of the motion that bends).

    ``most``: its largest growth; the last is that of bristles.
    """
    part = share(s.presliding, i)
    bristles, width = bristle_length(e, i) > 0.0, e.presliding_hysteresis_displacement[i]
    bends = keeping(part, v, breakaway(e, i))
    return part, select(bristles, most * maximum(bends, 0.0), slope(s.presliding, i, v, width)), bends


@inline
def moved_on(e, s, i, moved, over):
    """What `mobilising` looks at, after a motion."""
    long = over * bristle_length(e, i)
    follow(s.presliding, i, moved, e.presliding_hysteresis_displacement[i])
    new = bent(share(s.presliding, i), moved / select(long > 0.0, long, 1.0), breakaway(e, i))
    set_all(s.presliding, i, long > 0.0, new)


@inline
def raised(e, s, i, band, excess):
    """A band of friction over what it were without Stribeck's part, for bristles, which keep their force as it changes.

    Their deflection at full friction grows with it.
    """
    bristles = bristle_length(e, i) > 0.0
    over = select(bristles, band / maximum(band - excess, 1e-3 * band), 1.0)
    before = select(s.started[i] > 0.5, s.raised[i], over)
    kept = 0.5 + (share(s.presliding, i) - 0.5) * before / over
    set_all(s.presliding, i, bristles & (before != over), kept)
    s.raised[i] = over
    return over


@inline
def elastic_damping(e, i, mass, stiffness, whole, bends, dt):
    """Damping that goes with a friction's stiffness while it is elastic; ``whole``: where nothing slips."""
    of_bristles = maximum(damping_ratio(e, i) * bends * sqrt(whole * mass), -0.5 * mass / dt)
    return select(bristle_length(e, i) > 0.0, of_bristles, damping(stiffness, mass))


@inline
def resolved(most, band, mass, dt):
    """How much of a friction that builds up is taken as that, and how much as set-valued, in [0, 1].

    All of it where a step resolves its vibration; below, in proportion to the distance. The limit is friction that does
    not build up. most: largest growth of the share that is mobilised; band: friction up and down together.
    """
    return minimum(mass / maximum(most * band * dt * dt, 1e-300), 1.0)


@inline
def between(plain, other, part):
    """``other`` where ``part`` is 1, to the bit, and ``plain`` where it is 0."""
    return select(part < 1.0, plain + part * (other - plain), other)


@inline
def reported(e, g, i, plain, other):
    """What is shown of a friction: ``other`` where it builds up and a step resolves that, ``plain`` without it."""
    return select(builds_up(e, i), between(plain, other, g.part[i]), plain)


@inline
def presliding_step(
    e, s, g, i, v, mass, up, down, sliding, stiffness, turning, damping_up, damping_down, dt, theta=0.5, beside=0.0,
    steeper=0.0, first=-1.0, excess=0.0, builds=True,
):  # fmt: skip
    """Velocity after a step with dry friction, which may build up over a distance; its elements are moved on.

    up, down: net force with all friction against upward and against downward motion; ``sliding``: velocity where the
    friction is set-valued; ``stiffness`` of the rest where friction is all downward, and what it has more (``turning``)
    where it is all upward. beside, steeper: as `elastic`; first: share at the start, if not the one at which a force in
    proportion to it is in balance; excess: Stribeck's part of down - up; builds: `any_builds_up`.
    """
    if not builds:
        return sliding
    band = maximum(down - up, 1e-12)
    even = select(first >= 0.0, first, down / band)
    begin_elements(s.presliding, i, s.started[i], clip(even, 0.0, 1.0))
    over = raised(e, s, i, band, excess)
    most = g.most[i] / over
    part, steep, bends = mobilising(e, s, i, v, most)
    force, own = elastic(part, steep, up, down, beside, steeper)
    c = damping_down + part * (damping_up - damping_down)
    slowed = elastic_damping(e, i, mass, own, most * band, bends, dt)
    smooth = elastic_step(v, mass, force, stiffness + part * turning + own, c, slowed, dt, theta)
    # what no step resolves stays set-valued, and holds a mass at rest as far as it goes
    g.part[i] = some = resolved(most, band, mass, dt)
    holds = (sliding == 0.0) & (between(up, force, some) <= 0.0) & (between(down, force, some) >= 0.0) & (some < 1.0)
    v_new = select(builds_up(e, i) & (not holds), between(sliding, smooth, some), sliding)
    moved_on(e, s, i, dt * (v + theta * (v_new - v)), over)
    draw_to(s.presliding, i, select(builds_up(e, i) & holds, 1.0 - some, 0.0), clip(even, 0.0, 1.0))
    return v_new


@inline
def slide(e, s, g, i, v, mass, level, drive, resist, stiffness, damping, dt):
    """Speed after dt of a load under the net of drive and resistance and its dry friction, elastic or set-valued.

    ``level``: its Coulomb friction; ``stiffness`` and ``damping`` of drive and resistance, at the middle of the step.
    """
    dry_friction(e, g, i, v, level, 0.0)
    up, down = drive - resist - g.up[i], drive - resist + g.down[i]
    return slid(e, s, g, i, v, mass, up, down, stiffness, damping, dt)


@inline
def slid(e, s, g, i, v, mass, up, down, stiffness, damping, dt):
    """`slide` of given net forces against all friction moving up and moving down; ``g`` has that of `dry_friction`."""
    falling = maximum(damping + g.steep[i], -mass / dt)
    sliding = crossing_step(v, mass, up, down, stiffness, falling, dt)
    more = 2.0 * g.excess[i]
    return presliding_step(e, s, g, i, v, mass, up, down, sliding, stiffness, 0.0, falling, falling, dt, excess=more)


@inline
def sprung(e, s, i, stiffness, damping, stretch, rate):
    """(force, stiffness, damping, elastic stretch) of a belt that pushes as well as it pulls, with what acts on it."""
    taken = dead_zone(stretch, e.backlash_gap[i]) - s.creep_top[i]
    pull, rise = hardened(stiffness * abs(taken), e.stiffness_hardening_coefficient[i])
    pull = own_cable(pull, e, s, i)
    touching = (e.backlash_gap[i] <= 0.0) | (abs(stretch) > 0.5 * e.backlash_gap[i])
    c = select(touching, damping, 0.0)
    return select(taken < 0.0, -pull, pull) + c * rate, select(touching, stiffness * rise, 0.0), c, taken
