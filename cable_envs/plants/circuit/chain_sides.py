"""The two sides of the chain within a step: their ends are moved, then each is solved for its equilibrium.

Hardening, creep and drifted friction act here, where a side has its lengths and ratios. In what follows e, s (their
states) and g are None without effects.
"""

from cable_envs.core.kernels import inline, maximum, select
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.effects.viscoelastic_creep import kept
from cable_envs.physics.chain import CONTACTS, PASSES, SPANS, Side, relax, settle, stretch_ends, sweep
from cable_envs.plants.circuit.effects import moves_otherwise, pulley


@inline
def top_side(x, p, w):
    """The rows of cable t."""
    return Side(
        x.stretch_top, x.slip_top, p.length_top, p.ratio_top, p.inverse_top, p.small_top, w.pull_top, w.tension_top,
        w.tangent_0_top, w.tangent_4_top, w.pending_top,
    )  # fmt: skip


@inline
def bottom_side(x, p, w):
    """The rows of cable b."""
    return Side(
        x.stretch_bottom, x.slip_bottom, p.length_bottom, p.ratio_bottom, p.inverse_bottom, p.small_bottom,
        w.pull_bottom, w.tension_bottom, w.tangent_0_bottom, w.tangent_4_bottom, w.pending_bottom,
    )  # fmt: skip


@inline
def wind(x, p, e, s, g, i, step, more, apart):
    """How the driving pulley turns to the place where the next equilibrium is taken.

    apart: whether the pulley of a column of the block is elsewhere than its drive.
    """
    if e is not None:
        angle = x.drive_angle[i] + more * x.drive_velocity[i]
        most = (p.stretch_stiffness[i] + p.stretch_damping[i] / step) * p.gear[i] * p.drive_radius[i]
        # as steep as it can be: a softer one overshoots
        slope = most * (1.0 / p.length_top[0, i] + 1.0 / p.length_bottom[0, i])
        offset, turns, inside = 0.0, 1.0, angle
        if apart:
            offset, turns, inside = pulley(e, s, i, angle, x.drive_torque[i], slope)
        g.turn[i], g.turns[i] = angle + offset - s.pulley_angle[i], turns
        s.pulley_angle[i], s.gap_position[i] = angle + offset, inside


@inline
def _soften(side, plain_length, hard, i):
    """The spans' secant lengths for the stretch that they have."""
    for j in range(SPANS):
        length = plain_length[j, i]
        secant = length / (1.0 + 0.5 * hard * maximum(side.stretch[j, i] / length, 0.0))
        side.length[j, i] = select(hard > 0.0, secant, side.length[j, i])


@inline
def _creep(side, plain_length, creep, slow, preload, e, i, step):
    """Creep of a side over a step, from its mean elongation; each span loses stretch by its share of the length."""
    total, length = 0.0, 0.0
    for j in range(SPANS):
        total += side.stretch[j, i]
        length += plain_length[j, i]
    old = creep[i]
    left, slow_left = kept(e.viscoelastic_creep_time[i], step), kept(e.slow_creep_time[i], step)
    creeps_on(creep, slow, e, i, maximum(total, 0.0) - preload, left, slow_left)
    new = creep[i]
    for j in range(SPANS):
        side.stretch[j, i] -= (new - old) * plain_length[j, i] / length


@inline
def worn(side, worn_ratio, drift, i):
    """Friction that has drifted: the ratios go in a straight line to those of the final friction."""
    for k in range(CONTACTS):
        ratio = side.limit[k, i] + drift * (worn_ratio[k, i] - side.limit[k, i])
        side.limit[k, i] = select(drift > 0.0, ratio, side.limit[k, i])
        side.inverse[k, i] = select(drift > 0.0, 1.0 / ratio, side.inverse[k, i])


@inline
def _move_ends(x, p, w, e, g, side, pull, i, step, more):
    """Wind a side's two ends by the motion since its last equilibrium and ``more`` seconds at the present speeds.

    ``pull`` is 1 for cable t, which the drive's positive motion pulls, and -1 for cable b.
    """
    turn_in = p.stretch_stiffness[i] * p.gear[i] * (w.turned_in[i] + more * x.drive_velocity[i])
    if e is not None:
        other = moves_otherwise(e, i) | (g.follows[i] > 0.5)
        turn_in = select(other, p.stretch_stiffness[i] * p.gear[i] * g.turn[i], turn_in)
    turn_out = p.stretch_stiffness[i] * (w.turned_out[i] + more * x.output_velocity[i])
    eta = p.stretch_damping[i] / (p.stretch_stiffness[i] * step)
    stretch_ends(side, i, pull * turn_in, -pull * turn_out, eta)


@inline
def _take_over(p, side, arrived, i, step):
    """Stretches of a side's new equilibrium; whether its slip front has reached the output."""
    settle(side, i, p.stretch_damping[i] / (p.stretch_stiffness[i] * step))
    slack = select(side.tension[SPANS - 1, i] <= 0.0, 1.0, 0.0)
    arrived[i] = maximum(arrived[i], maximum(abs(side.state[CONTACTS - 1, i]), slack))


@inline
def _solve_side(side, lanes):
    """Active-set passes until no column of a tile changes; what goes in circles is swept."""
    changed = 1
    for _ in range(PASSES):
        if changed:
            changed = 0
            for i in range(lanes):
                changed |= relax(side, i)
    if changed:
        for i in range(lanes):
            if side.pending[i] > 0.5:
                sweep(side, i)


@inline
def equilibrium(x, p, w, e, s, g, lanes, step, more, hardens, creeps):
    """Move the ends of both sides of a tile, and solve; ``hardens``, ``creeps``: whether a cable of the block does."""
    top, bottom = top_side(x, p, w), bottom_side(x, p, w)
    if e is not None and hardens:
        for i in range(lanes):
            _soften(top, e.plain_length_top, e.stiffness_hardening_coefficient[i], i)
            _soften(bottom, e.plain_length_bottom, e.stiffness_hardening_coefficient[i], i)
    for i in range(lanes):
        _move_ends(x, p, w, e, g, top, 1.0, i, step, more)
        _move_ends(x, p, w, e, g, bottom, -1.0, i, step, more)
    _solve_side(top, lanes)
    _solve_side(bottom, lanes)
    for i in range(lanes):
        _take_over(p, top, w.arrived_top, i, step)
    for i in range(lanes):
        _take_over(p, bottom, w.arrived_bottom, i, step)
    if e is not None and creeps:
        for i in range(lanes):
            _creep(top, e.plain_length_top, s.creep_top, s.slow_creep_top, p.preload_top[i], e, i, step)
            _creep(bottom, e.plain_length_bottom, s.creep_bottom, s.slow_creep_bottom, p.preload_bottom[i], e, i, step)
