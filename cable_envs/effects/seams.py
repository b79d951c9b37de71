"""Where effects act on every plant in the same way: the command, the dry friction of the load, its step.

e: tile of the effects' coefficients, s: of their states (`cable_envs.effects.rows`), g: scratch of a control step.
"""

from cable_envs.core.kernels import clip, inline, maximum, select
from cable_envs.effects.actuator_lag import keep, lagged
from cable_envs.effects.asymmetric_friction import levels
from cable_envs.effects.friction_drift import drifted
from cable_envs.effects.presliding_hysteresis import begin as begin_elements
from cable_envs.effects.presliding_hysteresis import damping as elastic_damping
from cable_envs.effects.presliding_hysteresis import follow, share, slope
from cable_envs.effects.rows import (
    COMMAND_STATE,
    CREEP_TIME,
    DIFFERENCE,
    DRIFT,
    DRIFT_TIME,
    DRIFT_TRAVEL,
    EXCESS,
    LAG,
    LOAD_SHARE,
    PRE_0,
    PRESLIDING,
    RATE_STATE,
    STARTED,
    STRIBECK_V,
    WORN,
)  # fmt: skip
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import kept
from cable_envs.plants.base import COMMAND, COMMAND_RATE, FOLLOW, IMPOSED, MODE, RAMPED

(ASKED, ASKED_RATE, RAMP, MEAN, LAG_LEFT, CREEP_LEFT, FACTOR, FOLLOWS, IMPOSES, START, START_V, TARGET, TARGET_V, UP,
 DOWN, STEEP, FROM, LATE) = range(18)  # fmt: skip
"""Rows of g: the command asked for, its rate, and whether it is ramped; the command that acts; what lag and creep keep
over a step; factor on dry friction; whether the drive follows a path or its tension is imposed; the drive at the start
of the control step and at the end of the step; dry friction up and down with its growth; the load's position at first;
share of the lagged command's distance to the command that is left in the mean over a step.
"""
ROWS_G = 20


@inline
def begin(e, s, g, u, i, position, velocity, load, speed, period, dt):
    """What does not change within a control step; position and velocity of the drive, then of the load."""
    ramped = u[MODE, i] > RAMPED - 0.5
    mode = select(ramped, u[MODE, i] - RAMPED, u[MODE, i])
    g[ASKED, i], g[ASKED_RATE, i], g[RAMP, i] = u[COMMAND, i], u[COMMAND_RATE, i], select(ramped, 1.0, 0.0)
    u[MODE, i] = mode
    g[FOLLOWS, i] = select(abs(mode - FOLLOW) < 0.5, 1.0, 0.0)
    g[IMPOSES, i] = select(abs(mode - IMPOSED) < 0.5, 1.0, 0.0)
    fresh = s[STARTED, i] < 0.5
    s[COMMAND_STATE, i] = select(fresh, u[COMMAND, i] - u[COMMAND_RATE, i] * period, s[COMMAND_STATE, i])
    s[RATE_STATE, i] = select(fresh, 0.0, s[RATE_STATE, i])
    g[LAG_LEFT, i], g[CREEP_LEFT, i] = keep(e[LAG, i], dt), kept(e[CREEP_TIME, i], dt)
    g[LATE, i] = (1.0 - g[LAG_LEFT, i]) * e[LAG, i] / dt
    half = 0.5 * period  # what drifts slowly is taken in the middle of the control step
    worn = drifted(s[WORN, i], e[DRIFT, i], e[DRIFT_TIME, i], e[DRIFT_TRAVEL, i], half, half * abs(speed))
    g[FACTOR, i] = 1.0 + e[DRIFT, i] * worn
    g[START, i], g[START_V, i], g[FROM, i] = position, velocity, load
    g[UP, i], g[DOWN, i], g[STEEP, i] = 0.0, 0.0, 0.0


@inline
def end(e, s, g, i, load, period):
    """What changes slowly: once a control step."""
    moved = abs(load - g[FROM, i])
    s[WORN, i] = drifted(s[WORN, i], e[DRIFT, i], e[DRIFT_TIME, i], e[DRIFT_TRAVEL, i], period, moved)
    s[STARTED, i] = 1.0


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
    before = g[RAMP, i] * g[ASKED_RATE, i]
    command = g[ASKED, i] - before * (period - (n + 0.5) * dt)
    left = g[LAG_LEFT, i]
    late, late_rate = s[COMMAND_STATE, i], s[RATE_STATE, i]
    s[COMMAND_STATE, i], s[RATE_STATE, i] = lagged(late, command, left), lagged(late_rate, g[ASKED_RATE, i], left)
    mean = g[LATE, i]  # not half of it: a lag far shorter than the step would come out as half a step
    u[COMMAND, i] = select(left > 0.0, command + (late - command) * mean, command)
    asked = g[ASKED_RATE, i]
    u[COMMAND_RATE, i] = select(left > 0.0, asked + (late_rate - asked) * mean, asked)
    at = (n + 1.0) / substeps
    x, v = _hermite(g[START, i], g[START_V, i], g[ASKED, i], g[ASKED_RATE, i], period, at)
    g[TARGET, i], g[TARGET_V, i] = x, v


@inline
def dry_friction(e, g, i, v, level, tension):
    """Dry friction of the load into g: moving up, moving down, and its growth with |v| (negative where it falls)."""
    extra, steep = excess_at(e[EXCESS, i], e[STRIBECK_V, i], v)
    up, down = levels(e[DIFFERENCE, i])
    plain = g[FACTOR, i] * (level + extra) + e[LOAD_SHARE, i] * tension
    g[UP, i], g[DOWN, i], g[STEEP, i] = plain + up, plain + down, g[FACTOR, i] * steep


@inline
def held_back(g, i, net, v):
    """The net force less the dry friction; zero at rest where friction holds it."""
    low, high = -g[DOWN, i], g[UP, i]
    at_rest = net - select(net < low, low, select(net > high, high, net))
    with_none = select((g[UP, i] == 0.0) & (g[DOWN, i] == 0.0), net, at_rest)
    return select(v > 0.0, net - high, select(v < 0.0, net - low, with_none))


@inline
def elastic(s, first, i, v, up, down, width, beside=0.0, steeper=0.0):
    """(force, stiffness) of a friction between ``up`` and ``down`` that builds up over ``width``.

    Where the force is not in proportion to the share: what it has more, and its growth with the share.
    """
    spread = down - up
    return down - share(s, first, i) * spread + beside, (spread - steeper) * slope(s, first, i, v, width)


@inline
def elastic_step(v, mass, force, stiffness, damping, friction_stiffness, dt, theta=0.5):
    """Velocity after dt where friction is elastic: as `friction.stick_slip_step`, without its sticking.

    ``friction_stiffness`` is the part of ``stiffness`` that the friction has; it comes with a damping of its own.
    """
    own = elastic_damping(friction_stiffness, mass)
    part = theta * dt
    gain = dt / (mass + part * (damping + own + part * stiffness))
    return v + gain * (force - own * v - part * stiffness * v)


@inline
def presliding_step(
    e, s, i, v, mass, up, down, stiffness, turning, damping_up, damping_down, dt, theta=0.5, beside=0.0, steeper=0.0,
    first=-1.0,
):  # fmt: skip
    """Velocity after a step with dry friction that builds up over a distance; its elements are moved on.

    up, down: net force with all friction against upward and against downward motion; ``stiffness`` of the rest where
    friction is all downward, and what it has more (``turning``) where it is all upward. beside, steeper: as `elastic`;
    first: share at the start, if not the one at which a force in proportion to it is in balance.
    """
    width = e[PRESLIDING, i]
    even = select(first >= 0.0, first, down / maximum(down - up, 1e-12))
    begin_elements(s, PRE_0, i, s[STARTED, i], clip(even, 0.0, 1.0))
    force, own = elastic(s, PRE_0, i, v, up, down, width, beside, steeper)
    part = share(s, PRE_0, i)
    damping = damping_down + part * (damping_up - damping_down)
    v_new = elastic_step(v, mass, force, stiffness + part * turning + own, damping, own, dt, theta)
    follow(s, PRE_0, i, dt * (v + theta * (v_new - v)), width)
    return v_new
