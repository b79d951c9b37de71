"""Scalar pieces of the cable-hole kernel: the drive, one hole, the span behind it. They hold no effect of a user's own.

`cable_envs.plants.hole.plant` has the equations and the symbols, and the pieces into which a user's effects are put. In
what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
"""

from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact  # noqa: I001
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.rows import COULOMB, CREEP_T, HARDENING, PRESLIDING, PRE_0, SLACK_LENGTH
from cable_envs.effects.seams import DOWN, FOLLOWS, IMPOSES, STEEP, TARGET, TARGET_V, UP, dry_friction, presliding_step
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.physics.friction import stick_slip_step
from cable_envs.plants.hole.spool import cable_end, engaged, moves_otherwise
from cable_envs.plants.hole.parameters import (
    A_MAX, C_CABLE, GUIDE, KD, KP, K_CABLE, MASS, PEAK, RIGIDITY, SLACK, SPAN_K, T1, T2, VX, V_MAX, X,
)  # fmt: skip
from cable_envs.core.kernels import clip, exp, inline, log, maximum, select
from cable_envs.plants.base import COMMAND, COMMAND_RATE, MODE

(S, V, OUT, WRAP, RHO, MU, EDGE, ABOVE_OLD, ABOVE_NEW, ABOVE_V, ABOVE_V_NEW, ABOVE_T, K, C, BEHIND, BEHIND_K, BEHIND_C,
 INERTIA, MIDDLE, FRICTION, GROWTH, WRAPPED, RATIO, SLOPE, FEED, LATE, CLOSED, PER_MASS, HARD, LOST, RISE, ELASTIC,
 ENDS) = range(33)  # fmt: skip
"""Rows of the scratch tile w, the hole that is being solved: its slip position and speed and the tension behind it; its
geometry; the cable above it (position and speed before and after, tension, stiffness, damping); what resists behind it;
the tension above with which the step is made, M = mu + C and its growth with speed, wrap in contact, n and dn/dM; the
gains of the drive's closed loop. With effects also, of the cable above: its hardening, the length that makes no
tension, its stiffness over K, its elongation; and 1 where the drive is what ends it."""
ROWS_W = 33


@inline
def span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def closed_loop(p, w, i, stiffness, dt):
    """The gains of `drive`; they change within a control step only where the cable hardens."""
    by_position, by_speed = 0.5 * dt * p[KP, i] * stiffness, p[KP, i] * p[C_CABLE, i]
    w[FEED, i] = by_position + by_speed + p[KD, i] * stiffness
    w[LATE, i] = by_position - by_speed
    w[CLOSED, i] = 1.0 / (1.0 + w[FEED, i])
    w[PER_MASS, i] = 1.0 / p[MASS, i]


@inline
def drive(x, p, u, w, e, s, g, i, ahead, dt):
    """Drive within its speed and acceleration limits; it becomes what is above the first hole.  G35 in tension mode.

    The speed at the end of the step obeys G35 with the tension that it leads to there, and with the tension's rate from
    the span itself; ``ahead`` is the cable's speed at the first hole by then. The algebraic loop through the cable's
    stiffness is solved, not sampled: with the gains of Table 3 it is 300 times faster than the step.
    """
    old = x[VX, i]
    wanted = p[KP, i] * (u[COMMAND, i] - x[T1, i]) + p[KD, i] * u[COMMAND_RATE, i]
    loop = (wanted + w[LATE, i] * (w[V, i] - old) + w[FEED, i] * ahead) * w[CLOSED, i]
    loop = select(x[T1, i] > 0.0, loop, wanted)
    if e is not None:
        loop = select(engaged(e, s, i, x[X, i], wanted), loop, wanted)
    target = clip(select(u[MODE, i] > 0.5, u[COMMAND, i], loop), -p[V_MAX, i], p[V_MAX, i])
    most = p[A_MAX, i] * dt
    new = old + clip(target - old, -most, most)
    w[ABOVE_OLD, i] = x[X, i]
    w[ABOVE_V, i] = 0.5 * (old + new)
    if e is not None:
        new = select(g[FOLLOWS, i] > 0.5, g[TARGET_V, i], new)
        w[ABOVE_V, i] = select(g[FOLLOWS, i] > 0.5, (g[TARGET, i] - x[X, i]) / dt, w[ABOVE_V, i])
    w[ABOVE_V_NEW, i] = new
    w[ABOVE_NEW, i] = x[X, i] + dt * w[ABOVE_V, i]
    w[ABOVE_T, i], w[K, i], w[C, i] = x[T1, i], p[K_CABLE, i], p[C_CABLE, i]
    if e is not None:
        w[ABOVE_NEW, i] = select(g[FOLLOWS, i] > 0.5, g[TARGET, i], w[ABOVE_NEW, i])
    x[X, i], x[VX, i] = w[ABOVE_NEW, i], new
    if e is not None:
        before, after, mean, drawn = cable_end(e, s, i, w[ABOVE_OLD, i], w[ABOVE_NEW, i], new, dt)
        other = moves_otherwise(e, i)
        w[ABOVE_OLD, i], w[ABOVE_NEW, i] = select(other, before, w[ABOVE_OLD, i]), select(other, after, w[ABOVE_NEW, i])
        w[ABOVE_V, i], w[ABOVE_V_NEW, i] = select(other, mean, w[ABOVE_V, i]), select(other, drawn, w[ABOVE_V_NEW, i])
        w[HARD, i], w[LOST, i], w[ENDS, i] = e[HARDENING, i], e[SLACK_LENGTH, i] + s[CREEP_T, i], 1.0


@inline
def ratio(w, i):
    """n and dn/dM with the exact solution of section 1 in docs/physics.md.  G9, G17."""
    w[RATIO, i], w[SLOPE, i] = tension_ratio_and_slope(w[RHO, i], w[FRICTION, i], w[WRAPPED, i])


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
    x[T1, i] = tension
    x[SLACK, i] += select(tension <= 0.0, 1.0, 0.0)
    x[PEAK, i] = maximum(x[PEAK, i], tension)


@inline
def drawn_in(x, p, w, e, s, g, i, dt):
    """The drive where the tension is imposed: the cable's end must be where its law asks for it."""
    stretch = linear(x[T1, i], e[HARDENING, i]) / p[K_CABLE, i]
    position = w[S, i] + stretch + e[SLACK_LENGTH, i] + s[CREEP_T, i]
    imposed = g[IMPOSES, i] > 0.5
    x[VX, i] = select(imposed, (position - x[X, i]) / dt, x[VX, i])
    x[X, i] = select(imposed, position, x[X, i])


@inline
def take_hole(x, p, w, i, geometry, row):
    """State and geometry of a hole; ``row``: where its slip position, speed and tension are in x."""
    w[S, i], w[V, i], w[OUT, i] = x[row, i], x[row + 1, i], x[row + 2, i]
    w[WRAP, i], w[RHO, i] = p[geometry, i], p[geometry + 1, i]
    w[MU, i], w[EDGE, i] = p[geometry + 2, i], p[geometry + 3, i]


@inline
def keep_hole(x, w, i):
    """The only hole after its step: its geometry is in place already."""
    w[OUT, i] = x[T2, i]


@inline
def span_behind(x, p, w, i, following, ahead):
    """A span to the next hole, whose slip position is row ``following`` of x, and the cable's own lumped mass.

    The next hole is taken ``ahead`` seconds from now at its present speed: it moves on within the step.
    """
    resist = span(p[SPAN_K, i], 0.0, w[S, i] - x[following, i] - ahead * x[following + 1, i], 0.0)
    w[BEHIND, i], w[BEHIND_C, i], w[INERTIA, i] = resist, 0.0, p[GUIDE, i]
    w[BEHIND_K, i] = select(resist > 0.0, p[SPAN_K, i], 0.0)


@inline
def guide_moved(x, p, w, i, row, tension, inv_n):
    """An inner hole after its step; its span is above the next hole."""
    x[row, i], x[row + 1, i] = w[S, i], w[V, i]
    x[row + 2, i] = transmitted(w[V, i], tension, w[RATIO, i], inv_n, w[BEHIND, i])
    w[ABOVE_T, i], w[K, i], w[C, i] = x[row + 2, i], p[SPAN_K, i], 0.0


@inline
def wrapped(p, w, lanes, bends):
    """Wrap that stays in contact; the loop is left out where no cable of the block is stiff.  G1"""
    if bends:
        for i in range(lanes):
            w[WRAPPED, i] = wrap_in_contact(w[WRAP, i], p[RIGIDITY, i], w[EDGE, i], w[ABOVE_T, i], w[OUT, i])
    else:
        for i in range(lanes):
            w[WRAPPED, i] = w[WRAP, i]


@inline
def any_stiff(p, lanes):
    found = False
    for i in range(lanes):
        found = found or p[RIGIDITY, i] > 0.0
    return found


@inline
def slip_speed(w, e, s, g, i, dt, theta, last):
    """Speed of a slip after the step: the tension above against what resists behind the hole.  G28"""
    v, middle, n = w[V, i], w[MIDDLE, i], w[RATIO, i]
    inv_n, growth = 1.0 / n, middle * w[SLOPE, i] * w[GROWTH, i]
    taut = middle > 0.0
    if e is not None:
        k, c = select(taut, w[K, i] * w[RISE, i], 0.0), select(taut, w[C, i], 0.0)
    else:
        k, c = select(taut, w[K, i], 0.0), select(taut, w[C, i], 0.0)
    up, down = middle * inv_n - w[BEHIND, i], middle * n - w[BEHIND, i]
    stiffness = w[BEHIND_K, i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
    damping_up = w[BEHIND_C, i] + (c + growth * inv_n) * inv_n
    damping_down = w[BEHIND_C, i] + c * n + growth
    if e is not None:
        least = -w[INERTIA, i] / dt  # falling friction drives; what is left must still resist
        if last:
            dry_friction(e, g, i, v, e[COULOMB, i], middle)
            up, down = up - g[UP, i], down + g[DOWN, i]
            damping_up, damping_down = damping_up + g[STEEP, i], damping_down + g[STEEP, i]
            stiffness = w[BEHIND_K, i] + k * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
        damping_up, damping_down = maximum(damping_up, least), maximum(damping_down, least)
    v_new = stick_slip_step(v, w[INERTIA, i], up, down, stiffness, damping_up, damping_down, dt, theta)
    if e is not None:  # noqa: SIM102 (this alone is decided before the compiler sees it)
        if last:
            _, beside, steeper = mobilised(n, inv_n, share(s, PRE_0, i))
            at_rest = 0.5 + 0.5 * (middle - w[BEHIND, i]) / maximum(middle * log(n), 1e-12)
            bent = presliding_step(
                e, s, i, v, w[INERTIA, i], up, down, w[BEHIND_K, i] + k * n, k * (inv_n - n), damping_up, damping_down,
                dt, theta, middle * beside, middle * steeper, maximum(at_rest, 0.0),
            )  # fmt: skip
            v_new = select(e[PRESLIDING, i] > 0.0, bent, v_new)
    return v_new
