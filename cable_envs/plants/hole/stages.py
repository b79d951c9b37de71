"""Scalar pieces of the cable-hole kernel that hold no effect of a user's own: the hole, and the slip through it.

`cable_envs.plants.hole.plant` has the equations and the symbols, and the pieces into which a user's effects are put. In
what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
"""

from cable_envs.core.kernels import clip, exp, inline, log, maximum, minimum, power, select, sign, sqrt
from cable_envs.core.lanes import Lanes
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import dry_friction, presliding_step
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.physics.friction import beyond_middle, ringing_step

HOLE = Lanes("Hole", [
    "mu", "rho", "wrap",  # of the hole, as `take_hole` has them: 1, 1, rad
    "end_before", "end_after", "end_speed", "end_speed_after",  # the upper end of the cable: m, m/s
    "end_lag",  # how far it counts as behind its mean in the middle of the step, m
    "resistance", "resistance_stiffness", "resistance_damping",  # of the load: N, N/m, N s/m
    "tension_middle",  # the tension above with which the step is made, N
    "stiffness", "damping",  # of the cable, with what hardens it or takes it away: N/m, N s/m
    "friction", "friction_growth",  # M = mu + K |v|^omega, and dM/d|v| (s/m)
    "wrap_in_contact", "ratio", "inverse", "ratio_slope", "steepest",  # rad; n, 1/n, dn/dM; the n that none exceeds
    "loop_gain", "loop_late", "loop_closed", "loop_rate", "loop_now",  # gains of the drive's closed loop
    "eases",  # that 1/n with which 1/n falls as n grows, over 1/n
    "moves",  # share of the step in which a load that breaks away within it moves
    "bends", "sags",  # of T2/T1: at the end of the step beside a straight line from its start, in its mean beside that
    "steep", "way", "tried", "tried_ratio", "least", "most",  # of steep friction: speeds between which the end's is
    "start_ratio", "start_slope", "start_growth", "start_excess",  # and the friction at the start of the step
    "short",  # how far the load falls short of its mean speed where it stops, m
    "elongation",  # with effects: what of the stretch makes tension, m
])  # fmt: skip
"""Scratch of a step."""


@inline
def span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def take_hole(p, w, i):
    """The hole's numbers in rows of their own: out of a row of a matrix the processor takes one column at a time."""
    w.mu[i], w.rho[i], w.wrap[i] = p.friction_coefficient[0, i], p.radius_ratio[0, i], p.wrap_angle[0, i]


@inline
def ratio(w, i):
    """n and dn/dM with the exact solution of section 1 in docs/physics.md.  G9, G17."""
    w.ratio[i], w.ratio_slope[i] = tension_ratio_and_slope(w.rho[i], w.friction[i], w.wrap_in_contact[i])
    w.inverse[i] = w.eases[i] = 1.0 / w.ratio[i]


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
    straight = select(w.steep[i] > 0.5, w.tried_ratio[i], straight)
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
                w.wrap[i], p.bending_rigidity[i], p.edge_radius[0, i], x.drive_tension[i], x.load_tension[i]
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
def any_of(row, lanes):
    """Whether a column of the block has a flag."""
    found = False
    for i in range(lanes):
        found = found or row[i] > 0.5
    return found


@inline
def load_slides(v, mass, up, down, stiffness, damping_up, damping_down, dt):
    """Speed of the load after a step, which may turn round within it, and what it falls short where it stops."""
    return ringing_step(v, mass, up, down, stiffness, damping_up, damping_down, dt)


@inline
def broken_away(before, middle):
    """(mean over a step of the part of a force that moves a mass from rest, share of the step in which it does).

    The force grows evenly from ``before``, negative where friction still holds the mass at the start of the step. Where
    it moves the mass all along, or not at all, its mean is ``middle``.
    """
    after = 2.0 * middle - before
    breaks = (before < 0.0) & (after > 0.0)
    share = select(breaks, after / select(breaks, after - before, 1.0), 1.0)
    return select(breaks, 0.5 * after * share, middle), share


@inline
def later(w, i, v, mass, damping, stiffness, share, k, c, early, dt):
    """What the load feels besides where friction grows steeply with its speed, N.

    The force acts behind the middle of the step there, and friction is no straight line.
    """
    pulled = k * (0.5 * (w.end_after[i] - w.end_before[i]) + w.end_lag[i]) + c * (w.end_speed_after[i] - w.end_speed[i])
    behind_middle = beyond_middle(mass, damping, stiffness, dt)
    bent = w.tension_middle[i] * (0.5 * (1.0 + behind_middle) * w.bends[i] + (1.0 - behind_middle) * w.sags[i])
    return behind_middle * (share * pulled - 0.5 * dt * stiffness * v - early) + bent


@inline
def sliding(x, p, w, e, s, g, i, ahead, dt):
    """(net force upwards, downwards, damping upwards, downwards, stiffness) of the load, as of `ringing_step`.  G28

    The tension is that with the load moved on by ``ahead``; the step counts the same motion in the cable's stiffness.
    """
    v, middle, n, inv_n = x.load_velocity[i], w.tension_middle[i], w.ratio[i], w.inverse[i]
    mass, growth = p.load_mass[i], middle * w.ratio_slope[i] * w.friction_growth[i]
    taut = middle > 0.0
    k, c = select(taut, w.stiffness[i], 0.0), select(taut, w.damping[i], 0.0)
    back = k * ahead
    up, down = (middle + back) * inv_n - w.resistance[i], (middle + back) * n - w.resistance[i]
    above = select(v == 0.0, up, v) > 0.0
    stiffness = w.resistance_stiffness[i] + k * select(above, inv_n, n)
    damping_up = w.resistance_damping[i] + (c + growth * w.eases[i]) * inv_n
    damping_down = w.resistance_damping[i] + c * n + growth
    if e is not None:
        least = -mass / dt  # falling friction drives; what is left must still resist
        dry_friction(e, g, i, v, e.coulomb_friction_level[i], middle)
        up, down = up - g.up[i], down + g.down[i]
        damping_up, damping_down = damping_up + g.steep[i], damping_down + g.steep[i]
        above = select(v == 0.0, up, v) > 0.0
        stiffness = w.resistance_stiffness[i] + k * select(above, inv_n, n)
        damping_up, damping_down = maximum(damping_up, least), maximum(damping_down, least)
    start = x.drive_tension[i] - middle
    rising, moves_up = broken_away(up + start * inv_n, up)
    falling, moves_down = broken_away(-down - start * n, -down)
    more_up, more_down = select(v == 0.0, rising - up, 0.0), select(v == 0.0, falling + down, 0.0)
    up, down = up + more_up, down - more_down
    above = select(v == 0.0, up, v) > 0.0
    w.moves[i] = select(v == 0.0, select(above, moves_up, moves_down), 1.0)
    grown = later(
        w, i, v, mass, select(above, damping_up, damping_down), stiffness, select(above, inv_n, n), k, c,
        select(above, more_up, -more_down), dt,
    )  # fmt: skip
    up, down = up + grown, down + grown
    return up, down, damping_up, damping_down, stiffness


@inline
def at_start(x, w, i):
    """Tension above before the first step, from which a friction that builds up begins in balance."""
    return x.drive_tension[i]


@inline
def slip_speed(x, p, w, e, s, g, i, ahead, dt, builds):
    """Speed of the load after the step: the tension above against what resists behind the hole."""
    v, mass = x.load_velocity[i], p.load_mass[i]
    up, down, damping_up, damping_down, stiffness = sliding(x, p, w, e, s, g, i, ahead, dt)
    v_new, w.short[i] = load_slides(v, mass, up, down, stiffness, damping_up, damping_down, dt)
    if e is not None:
        middle, n, inv_n = w.tension_middle[i], w.ratio[i], w.inverse[i]
        k = select(middle > 0.0, w.stiffness[i], 0.0)
        _, beside, steeper = mobilised(n, inv_n, share(s.presliding, i))
        before = at_start(x, w, i)
        at_rest = 0.5 + 0.5 * (before - w.resistance[i]) / maximum(before * log(n), 1e-12)
        v_new = presliding_step(
            e, s, g, i, v, mass, up, down, v_new, w.resistance_stiffness[i] + k * n, k * (inv_n - n), damping_up,
            damping_down, dt, 0.5, middle * beside, middle * steeper, maximum(at_rest, 0.0),
            2.0 * g.excess[i] + middle * (n - inv_n) * g.contact_excess[i], builds,
        )  # fmt: skip
        w.short[i] = select(v_new == 0.0, w.short[i], 0.0)
    return v_new


@inline
def steepness(x, p, i, dt):
    """How many times friction that grows with the speed would take the load's whole speed within the step, at most.

    The speed is that at which extrusion adds as much to the friction coefficient as that is, or 0.2.
    """
    mu, omega = maximum(p.friction_coefficient[0, i], 0.2), p.extrusion_exponent[i]
    speed = power(mu / maximum(p.extrusion_gain[i], 1e-300), 1.0 / omega)
    _, slope = tension_ratio_and_slope(p.radius_ratio[0, i], 2.0 * mu, p.wrap_angle[0, i])
    pull = maximum(maximum(x.drive_tension[i], x.load_tension[i]), p.load_weight[i])
    return dt * pull * slope * omega * mu / (speed * p.load_mass[i])


@inline
def begin_steep(x, w, g, i):
    """Before the speed at the end of a step against steep friction is sought: the friction at its start is kept."""
    w.start_ratio[i], w.start_slope[i], w.start_growth[i] = w.ratio[i], w.ratio_slope[i], w.friction_growth[i]
    w.least[i], w.most[i], w.tried_ratio[i] = 0.0, 1e9, w.ratio[i]
    if g is not None:
        w.start_excess[i] = g.contact_excess[i]


@inline
def _slid(x, p, w, e, s, g, i, ahead, dt):
    """The speed to which friction as it stands in a straight line leads."""
    up, down, damping_up, damping_down, stiffness = sliding(x, p, w, e, s, g, i, ahead, dt)
    return load_slides(x.load_velocity[i], p.load_mass[i], up, down, stiffness, damping_up, damping_down, dt)[0]


@inline
def try_speed(x, p, w, e, s, g, i, ahead, dt):
    """The speed at which friction is to be asked for next; 0 where the load would turn round."""
    v, new = x.load_velocity[i], _slid(x, p, w, e, s, g, i, ahead, dt)
    w.way[i] = select(v == 0.0, sign(new), sign(v))
    w.tried[i] = maximum(w.way[i] * new, 0.0)


@inline
def end_weight(before, after, grew, grows, omega):
    """Weight of the end in the mean of K v^omega, by its slopes ``grew`` and ``grows``, while v changes evenly."""
    a, b, more = grew * before / omega, grows * after / omega, after - before
    changes = abs(b - a) > 1e-9 * (a + b)
    mean = (b * after - a * before) / select(changes, (omega + 1.0) * more, 1.0)
    return select(changes, clip((mean - a) / select(changes, b - a, 1.0), 0.0, 1.0), 0.5)


@inline
def tangent_there(x, p, w, e, s, g, i, ahead, dt):
    """Friction in a straight line that touches its law at the speed that was tried (Newton), or that cuts it there.

    The chord from the start of the step is taken where the tangent leads out of the speeds between which that of the
    end is known to be: friction that levels off with the speed has it between the start and the chord's.
    """
    n, after, speed = w.start_ratio[i], w.ratio[i], abs(x.load_velocity[i])
    inv_n, inv_after, more, rises = 1.0 / n, w.inverse[i], w.tried[i] - speed, w.way[i] > 0.0
    growth, omega, steep = w.friction_growth[i], p.extrusion_exponent[i], w.steep[i] > 0.5
    slope = w.ratio_slope[i] * growth
    tangent_bends = select(rises, inv_after - inv_n + slope * inv_after * inv_after * more, after - n - slope * more)
    some = select(abs(more) > 1e-12, more, 1.0)
    chord = select(abs(more) > 1e-12, select(rises, (inv_n - inv_after) * n * n, after - n) / some, slope)
    w.tried_ratio[i], w.ratio[i], w.inverse[i] = select(steep, after, n), n, inv_n
    w.ratio_slope[i] = select(steep, 1.0, w.start_slope[i])
    w.friction_growth[i] = select(steep, slope, w.start_growth[i])
    w.eases[i] = select(steep, inv_after * inv_after * n, inv_n)
    w.bends[i] = select(steep, tangent_bends, 0.0)
    weight = end_weight(speed, w.tried[i], w.start_growth[i], growth, omega)
    weight = select(
        w.moves[i] < 1.0, w.moves[i] / (2.0 * omega + 1.0), weight
    )  # then its speed grows with time squared
    change = select(rises, inv_after - inv_n, after - n)
    w.sags[i] = select(steep, change * (weight - 0.5), 0.0)
    if g is not None:
        g.contact_excess[i] = w.start_excess[i]
    leads = w.way[i] * _slid(x, p, w, e, s, g, i, ahead, dt)
    w.least[i] = select(leads > w.tried[i], maximum(w.tried[i], w.least[i]), w.least[i])
    w.most[i] = select(leads > w.tried[i], w.most[i], minimum(w.tried[i], w.most[i]))
    stops = (w.tried[i] == 0.0) & (leads <= 0.0)
    fits = (leads > w.least[i]) & (leads < w.most[i]) | (leads == w.tried[i]) | stops
    cuts = steep & (not fits)
    w.friction_growth[i] = select(cuts, chord, w.friction_growth[i])
    w.eases[i] = select(cuts, inv_n, w.eases[i])
    w.bends[i] = select(cuts, 0.0, w.bends[i])


@inline
def creeping(e, s, g, i, elongation):
    """The cable's lasting elongation after a step in which it was stretched by ``elongation``."""
    creeps_on(s.creep_top, s.slow_creep_top, e, i, elongation, g.creep_left[i], g.slow_left[i])
