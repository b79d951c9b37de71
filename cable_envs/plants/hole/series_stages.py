"""Pieces of the kernel of holes in series: what a step hands to the solver, the laws it asks for, what is reported.

`cable_envs.plants.hole.series` has the equations and the symbols, `cable_envs.physics.series` the solver. In what
follows w is the scratch of both; e, s and g are None without effects.
"""

from cable_envs.core.kernels import clip, exp, inline, log, maximum, minimum, power, select, sign, sqrt
from cable_envs.core.lanes import Lanes
from cable_envs.effects.own import own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import begin as begin_elements
from cable_envs.effects.presliding_hysteresis import damping as elastic_damping
from cable_envs.effects.presliding_hysteresis import follow, share, slope
from cable_envs.effects.seams import dry_friction
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.physics.series import series_fields
from cable_envs.plants.hole.drive import told_step
from cable_envs.plants.hole.spool import moves_otherwise, nut_after, nut_before, wound
from cable_envs.plants.hole.stages import creeping

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""
NEAR = 0.1
"""A drive counts as following its loop where it is nearer to it than this share of what it may change in a step."""
SETTLING = 50.0
"""How much later than in the middle of a step its taut spans act, in shares of it per second of its length, 1/s."""


def scratch(holes: int) -> Lanes:
    """Scratch of the plant with so many holes."""
    return Lanes("SeriesOfHoles", [
        *series_fields(holes),
        ("wrap", holes), ("rho", holes), ("mu", holes),  # of the holes: wrap in contact (rad), radius ratio, mu
        ("mine", holes),  # what a user's contact adds to mu
        "skew", "step",  # relative change of mu moving up (asymmetric friction); dt, s
        # first span: growth of its tension with its stretch, and its tension if nothing moves (N/m, N); its end before
        # the step, m; where the drive is without its speed, and how far that takes it, m and s
        "grip", "held", "end_before", "reach", "lever",
        "by_force",  # 1 where a motor is told its force: its gap is taken up
        "straight",  # base of the first span where the cable's end is where the drive is, N
        # whether the drive's speed is told, and what it is after the step, m/s
        "told", "goal",
        # whether a drive follows the inner tension loop; its speed before the step and its limit, by how much it may
        # change in the step, by how much what the loop asks for does, and what it is after the step, m/s; the share of
        # `caught_up` that the step keeps
        "loops", "old", "fastest", "most", "rise", "ends", "alone",
    ])  # fmt: skip


@inline
def _bent(w, e, s, i, n, by_speed, speed):
    """Ratio of a contact whose friction builds up over a distance, half a step on; its growth with the speed."""
    width = e.presliding_hysteresis_displacement[i]
    per = 1.0 / select(width > 0.0, width, 1.0)
    half, part, steep = 0.5 * w.step[i], 0.0, 0.0
    for k in range(s.presliding.shape[0]):
        each = 4.0 * per / (k + 1.0)
        moved = s.presliding[k, i] + each * half * speed
        part += 0.25 * clip(moved, 0.0, 1.0)
        steep += 0.25 * select((moved > 0.0) & (moved < 1.0), each * half, 0.0)
    whole = 2.0 * part - 1.0
    bent = exp(whole * log(n))
    return bent, bent * (2.0 * log(n) * steep + maximum(whole * sign(speed), 0.0) * by_speed / n)


@inline
def friction(p, w, e, s, h, i, speed, way):
    """n of a hole, and its growth with the size of the speed.  G9, G17"""
    size = abs(speed)
    steep = p.extrusion_gain[i] * power(maximum(size, 1e-12), p.extrusion_exponent[i] - 1.0)
    if e is not None:
        mu = w.mu[h, i] * (1.0 + way * w.skew[i]) + w.mine[h, i]
        n, by_mu = tension_ratio_and_slope(w.rho[h, i], mu + steep * size, w.wrap[h, i])
        growth = by_mu * p.extrusion_exponent[i] * steep
        bent, rise = _bent(w, e, s, i, n, growth, speed)
        elastic = (w.elastic[i] > 0.5) & (h == w.ratio.shape[0] - 1)
        return select(elastic, bent, n), select(elastic, rise, growth)
    n, by_mu = tension_ratio_and_slope(w.rho[h, i], w.mu[h, i] + steep * size, w.wrap[h, i])
    return n, by_mu * p.extrusion_exponent[i] * steep


@inline
def caught_up(w, i, asked, alone):
    """(mean speed, speed after the step) of a drive that follows its inner tension loop within its limits.

    Where the cable slips with the drive, the loop asks for more as the drive is faster: for asked + (1 - alone) times
    its mean speed. If the drive were always as fast as it is asked to be, its speed would be a straight line over the
    step, with asked / alone in its middle and w.rise more at its end than at its start. A drive that is not on that
    line gets there as quick as it can, and then follows it. With y for how far it is from the line at the start, and f
    for what of that is beyond what counts as near, it falls short by f^2 / (2 (reach - 2 near)) of its mean.
    """
    most, top = w.most[i], w.fastest[i]
    whole = asked / alone
    rise = select(abs(whole) < top, w.rise[i], 0.0)
    start = w.old[i] + 0.5 * rise
    apart = alone * (clip(whole, -top, top) - start)
    way = select(apart < 0.0, -1.0, 1.0)
    reach = most - way * rise
    near = minimum(NEAR * most, 0.5 * reach)
    wide, over = maximum(reach - 2.0 * near, 1e-300), maximum(abs(apart) - alone * near, 0.0)
    meets = over < 0.5 * (alone + w.alone[i]) * wide
    far = 2.0 * over / (alone + sqrt(maximum(alone * alone + 2.0 * (w.alone[i] - alone) * over / wide, 0.0)))
    line = start + select(over > 0.0, way * (near + far), apart / alone)
    mean, ends = line - 0.5 * way * far * far / wide, clip(line + 0.5 * rise, -top, top)
    return select(meets, mean, w.old[i] + 0.5 * way * most), select(meets, ends, w.old[i] + way * most)


@inline
def pace(w, i, asked, alone):
    """Mean speed of the drive over the step, and what it is after it.

    The share in which the drive's speed comes back to it is that of the step's first set of contacts that slip.
    """
    w.alone[i] = select(w.alone[i] > 0.0, w.alone[i], alone)
    mean, ends = caught_up(w, i, asked, alone)
    loops, limited = w.loops[i] > 0.5, clip(asked / alone, w.low[i], w.high[i])
    other = select(w.told[i] > 0.5, w.goal[i], limited + (limited - w.old[i]))
    w.ends[i] = select(w.pending[i] > 0.5, select(loops, ends, other), w.ends[i])
    return select(loops, mean, limited)


@inline
def end_row(p, w, e, s, i):
    """How the first span feels the drive at its present speed; by how much the tension differs from the row so far.

    Behind a gap, or on an eccentric spool, the cable's end does not simply move as the drive.
    """
    if e is not None:
        speed = w.rate[0, i]
        by_force = w.by_force[i] > 0.5
        nut = nut_after(e, s, i, w.reach[i] + w.lever[i] * speed, by_force)
        at, steep = wound(e, i, nut)
        still = (e.backlash_gap[i] > 0.0) & (nut == s.gap_position[i]) & (not by_force)
        turns = select(still, 0.0, steep)
        before = w.base[0, i] + w.draws[i] * speed
        w.draws[i] = w.grip[i] * turns * w.lever[i]
        end = w.held[i] + w.grip[i] * (at - w.end_before[i]) - w.draws[i] * speed
        w.base[0, i] = select(moves_otherwise(e, i, by_force), end, w.straight[i])
        w.by_end[i] = w.by_first[i] * turns
        return w.base[0, i] + w.draws[i] * speed - before
    return 0.0


@inline
def wrapped(x, p, w, lanes, bends):
    """Wrap that stays in contact, with the tensions before the step; left out where no cable of the block is stiff."""
    holes = p.wrap_angle.shape[0]
    for h in range(holes):
        for i in range(lanes):
            w.wrap[h, i], w.rho[h, i] = p.wrap_angle[h, i], p.radius_ratio[h, i]
            w.mu[h, i] = p.friction_coefficient[h, i]
            if bends:
                above = x.drive_tension[i] if h == 0 else x.span_tension[h - 1, i]
                behind = x.load_tension[i] if h == holes - 1 else x.span_tension[h, i]
                w.wrap[h, i] = wrap_in_contact(
                    p.wrap_angle[h, i], p.bending_rigidity[i], p.edge_radius[h, i], above, behind
                )


@inline
def resistance(p, u, e, s, i, y, v, tension):
    """Force on the load against upward motion, besides its dry friction."""
    resist = p.load_weight[i] + p.load_stiffness[i] * y + p.load_damping[i] * v - u.disturbance[i]
    if e is not None:
        return resist + own_load(y, v, tension, e, s, i)
    return resist


@inline
def late(dt):
    """Where within a step a taut span acts: 1/2, and a bit more, so that what does not fit the laws settles."""
    return minimum(0.5 + SETTLING * dt, 1.0)


@inline
def drive_row(x, p, u, w, e, s, g, i, dt):
    """The drive within its speed and acceleration limits; in tension mode the inner tension loop.  G35"""
    old = x.drive_velocity[i]
    most = p.acceleration_limit[i] * dt
    told = u.mode[i] > 0.5
    target, early = told_step(p, u, g, i, old, dt)
    wanted = p.inner_kp[i] * u.command[i] + p.inner_kd[i] * u.command_rate[i]
    way = 0.5 * (old + target) + early / dt
    if e is not None:
        moves = (g.follows[i] > 0.5) | (g.imposes[i] > 0.5)
        target = select(moves, select(g.imposes[i] > 0.5, 0.0, g.target_rate[i]), target)
        told, way = told | moves, select(moves, target, way)
    w.wanted[i], w.told[i], w.goal[i] = wanted, select(told, 1.0, 0.0), target
    w.low[i], w.high[i] = select(told, way, -p.speed_limit[i]), select(told, way, p.speed_limit[i])
    w.rate[0, i], w.old[i], w.loops[i], w.alone[i] = old, old, select(told, 0.0, 1.0), 0.0
    w.most[i], w.fastest[i], w.by_force[i] = most, p.speed_limit[i], 0.0


@inline
def first_span(x, p, u, w, e, s, g, i, dt):
    """The span between drive and first hole, and how the drive feels it.

    A damper counts as much as acting later in the step does: the span rings no more with it than without.
    """
    k, c = p.cable_stiffness[i], p.cable_damping[i]
    stretch = x.drive_position[i] - x.slip_position[0, i]
    pull = k * stretch
    if e is not None:
        w.end_before[i], _ = wound(e, i, nut_before(e, s, i, x.drive_position[i], w.by_force[i] > 0.5))
        stretch = w.end_before[i] - e.slack_length[i] - s.creep_top[i] - x.slip_position[0, i]
        pull, rise = hardened(k * maximum(stretch, 0.0), e.stiffness_hardening_coefficient[i])
        pull, k = own_cable(pull, e, s, i), k * rise
    taut = stretch > 0.0
    share = select(taut, late(dt), 1.0)
    grip = maximum(share * k - c / dt, select(taut, 0.5, 1.0) * k) + c / dt
    held = select(taut, pull, grip * stretch)
    w.base[0, i], w.draws[i], w.steep[0, i] = held, dt * grip, dt * grip
    # the inner loop is in time to order 2, or damped where it is quicker than the step; the rate of the tension that it
    # takes is k (x' - s_1'), of a slack span what it is at the end over dt
    by_rate = p.inner_kd[i] * select(taut, k, 0.0)
    quick = dt * p.inner_kp[i] * k / (1.0 + by_rate)
    when = select(taut, maximum(0.5, 1.0 - 1.0 / maximum(quick, 1e-9)), 1.0)
    by_rate += p.inner_kp[i] * (dt * (when * k - grip) + c)
    w.by_end[i], w.by_first[i] = by_rate, by_rate
    w.by_tension[i] = p.inner_kp[i] + select(taut, 0.0, p.inner_kd[i] * k / (grip * dt))
    w.pull[0, i] = x.drive_tension[i]
    if e is not None:
        imposed, follows = g.imposes[i] > 0.5, g.follows[i] > 0.5
        w.held[i], w.grip[i] = select(imposed, maximum(u.command[i], 0.0), held), select(imposed, 0.0, grip)
        w.pull[0, i], w.steep[0, i] = select(imposed, w.held[i], w.pull[0, i]), dt * w.grip[i]
        straight = select(follows, held + grip * (g.target[i] - x.drive_position[i]), w.base[0, i])
        w.straight[i] = select(imposed, w.held[i], straight)
        w.reach[i] = select(follows, g.target[i], x.drive_position[i])
        w.lever[i], w.step[i] = select(follows, 0.0, dt), dt
        end_row(p, w, e, s, i)


@inline
def inner_span(x, p, w, h, i, dt):
    """The span behind hole h + 1, which ends at the next hole."""
    k, last = p.span_stiffness[i], h == x.slip_position.shape[0] - 1
    beyond = x.load_position[i] if last else x.slip_position[h + 1, i]
    stretch = x.slip_position[h, i] - beyond
    w.base[h + 1, i], w.steep[h + 1, i] = k * stretch, select(stretch > 0.0, late(dt), 1.0) * k * dt
    w.rate[h + 1, i], w.pull[h + 1, i] = x.slip_velocity[h, i], x.span_tension[h, i]


@inline
def load_row(x, p, u, w, e, s, g, i, dt):
    """What the load takes behind the last hole."""
    holes, v, above = w.ratio.shape[0], x.load_velocity[i], x.span_tension[w.ratio.shape[0] - 2, i]
    w.rate[holes, i], w.speed[i], w.inertia[i] = v, v, p.load_mass[i]
    w.resist[i] = p.load_weight[i] + p.load_stiffness[i] * x.load_position[i] - u.disturbance[i]
    w.damper[i], w.spring[i] = p.load_damping[i], p.load_stiffness[i]
    w.rub_up[i], w.rub_down[i], w.elastic[i] = 0.0, 0.0, 0.0
    if e is not None:
        y, behind = x.load_position[i], x.load_tension[i]
        at = own_load(y, v, behind, e, s, i)
        k = maximum((own_load(y + STEP_Y, v, behind, e, s, i) - at) / STEP_Y, 0.0)
        c = maximum((own_load(y, v + STEP_V, behind, e, s, i) - at) / STEP_V, 0.0)
        dry_friction(e, g, i, v, e.coulomb_friction_level[i], above)
        falling = maximum(g.steep[i] + c + w.damper[i], -w.inertia[i] / w.step[i]) - w.damper[i]
        _build_up(p, w, e, s, g, i, v, above, w.resist[i] + at)
        w.resist[i] += at - falling * v
        w.damper[i], w.spring[i] = w.damper[i] + falling, w.spring[i] + k
    rub = select(v > 0.0, w.rub_up[i], -w.rub_down[i])
    net = select(v != 0.0, x.load_tension[i] - w.resist[i] - w.damper[i] * v - rub, 0.0)
    w.rise[i] = clip(dt * net / w.inertia[i], -w.most[i], w.most[i])


@inline
def _build_up(p, w, e, s, g, i, v, above, resist):
    """Dry friction of the load: set-valued, or of a size that builds up over a distance."""
    last, width = w.ratio.shape[0] - 1, e.presliding_hysteresis_displacement[i]
    elastic = width > 0.0
    mu = w.mu[last, i] * (1.0 + w.skew[i]) + w.mine[last, i]
    power = maximum(log(tension_ratio_and_slope(w.rho[last, i], mu, w.wrap[last, i])[0]), 1e-12)
    first = 0.5 + 0.5 * log(maximum(above, 1e-9) / maximum(resist, 1e-9)) / power
    begin_elements(s.presliding, i, s.started[i], clip(first, 0.0, 1.0))
    part, spread = share(s.presliding, i), g.up[i] + g.down[i]
    rises = slope(s.presliding, i, v, width)
    stiffness = (spread + 2.0 * above * power) * rises
    more = spread * rises * 0.5 * w.step[i] + elastic_damping(stiffness, w.inertia[i])
    w.resist[i] += select(elastic, part * spread - g.down[i], 0.0)
    w.damper[i] += select(elastic, more, 0.0)
    w.elastic[i] = select(elastic, 1.0, 0.0)
    w.rub_up[i], w.rub_down[i] = select(elastic, 0.0, g.up[i]), select(elastic, 0.0, g.down[i])


@inline
def rub(x, p, w, e, s, g, h, i):
    """Friction coefficients of a hole that hold over a step: what depends on its start only."""
    speed = x.load_velocity[i] if h == w.ratio.shape[0] - 1 else x.slip_velocity[h, i]
    above = x.drive_tension[i] if h == 0 else x.span_tension[h - 1, i]
    excess, _ = excess_at(e.stribeck_friction_contact[i], e.stribeck_friction_velocity[i], speed)
    exponent, over = e.load_dependent_friction_exponent[i], maximum(above, 0.1) / maximum(p.load_weight[i], 0.1)
    factor = g.factor[i] * select(exponent != 0.0, power(over, exponent), 1.0)
    last = h == w.ratio.shape[0] - 1
    at = x.load_position[i] if last else x.slip_position[h, i]
    beyond = x.load_tension[i] if last else x.span_tension[h, i]
    w.mu[h, i] = (p.friction_coefficient[h, i] + excess) * factor
    w.mine[h, i] = own_contact(at, speed, above, beyond, e, s, i)
    w.skew[i] = e.asymmetric_friction_contact[i]


@inline
def slipped(x, w, h, i, dt):
    """Inner hole h + 1 after the step."""
    x.slip_position[h, i] += dt * w.rate[h + 1, i]
    x.slip_velocity[h, i] = w.rate[h + 1, i]


@inline
def moved(x, p, u, w, e, s, g, i, dt):
    """Drive and load after the step, and the tension at the drive; the holes have moved on."""
    holes = w.ratio.shape[0]
    drive = x.drive_position[i] + dt * w.rate[0, i]
    stretched = drive - x.drive_position[i] - dt * w.rate[1, i]
    if e is not None:
        drive = select(g.follows[i] > 0.5, g.target[i], drive)
        s.gap_position[i] = nut_after(e, s, i, drive, w.by_force[i] > 0.5)
    x.drive_position[i] = drive
    x.drive_velocity[i] = w.ends[i]
    mean, v = w.rate[holes, i], w.speed[i]
    x.load_position[i] += dt * mean
    x.load_velocity[i] = select(w.theta[i] < 1.0, v + (mean - v) / w.theta[i], mean)
    x.sliding[i] = sign(x.load_velocity[i])
    k, stretch = p.cable_stiffness[i], drive - x.slip_position[0, i]
    pull = k * stretch
    if e is not None:
        follow(s.presliding, i, dt * mean, e.presliding_hysteresis_displacement[i])
        end, _ = wound(e, i, s.gap_position[i])
        stretch = end - e.slack_length[i] - s.creep_top[i] - x.slip_position[0, i]
        stretched = end - w.end_before[i] - dt * w.rate[1, i]
        pull, _ = hardened(k * maximum(stretch, 0.0), e.stiffness_hardening_coefficient[i])
        pull = own_cable(pull, e, s, i)
    tension = select(stretch > 0.0, maximum(pull + p.cable_damping[i] * stretched / dt, 0.0), 0.0)
    if e is not None:
        tension = select(g.imposes[i] > 0.5, w.held[i], tension)
    x.drive_tension[i] = tension
    x.slack_fraction[i] += select(tension <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], tension)
    if e is not None:
        _stretched(x, p, e, s, g, i, stretch, dt)


@inline
def _stretched(x, p, e, s, g, i, stretch, dt):
    """Creep of the first span after the step; the drive where the tension is imposed."""
    imposed, hard = g.imposes[i] > 0.5, e.stiffness_hardening_coefficient[i]
    whole = linear(x.drive_tension[i], hard) / p.cable_stiffness[i]
    elongation = select(imposed, whole, maximum(stretch, 0.0))
    creeping(e, s, g, i, elongation)
    position = x.slip_position[0, i] + whole + e.slack_length[i] + s.creep_top[i]
    x.drive_velocity[i] = select(imposed, (position - x.drive_position[i]) / dt, x.drive_velocity[i])
    x.drive_position[i] = select(imposed, position, x.drive_position[i])
    s.started[i] = 1.0


@inline
def spans(x, p, w, h, i):
    """Tension after the step in the span behind hole h + 1: at its limit where it slides, else that of its stretch."""
    above = x.drive_tension[i] if h == 0 else x.span_tension[h - 1, i]
    last, n, speed = h == x.slip_position.shape[0] - 1, w.ratio[h, i], x.slip_velocity[h, i]
    beyond = x.load_position[i] if last else x.slip_position[h + 1, i]
    own = p.span_stiffness[i] * (x.slip_position[h, i] - beyond)
    held = clip(own, above / w.rest_up[h, i], above * w.rest_down[h, i])
    x.span_tension[h, i] = select(speed > 0.0, above / n, select(speed < 0.0, above * n, held))


@inline
def behind(x, p, u, w, e, s, i):
    """Tension behind the last hole: at the limit for the load's speed where it slides, else what holds the load."""
    last = w.ratio.shape[0] - 1
    v, above = x.load_velocity[i], x.span_tension[last - 1, i]
    n, growth = friction(p, w, e, s, last, i, v, select(v < 0.0, -1.0, 1.0))
    held = clip(
        resistance(p, u, e, s, i, x.load_position[i], v, x.load_tension[i]),
        above / w.rest_up[last, i],
        above * w.rest_down[last, i],
    )
    x.load_tension[i] = select(v > 0.0, above / n, select(v < 0.0, above * n, held))
    if e is not None:  # what builds up over a distance: as in the middle of the step
        x.load_tension[i] = select(w.elastic[i] > 0.5, above / w.ratio[last, i], x.load_tension[i])
    w.ratio[last, i], w.growth[last, i] = n, growth
