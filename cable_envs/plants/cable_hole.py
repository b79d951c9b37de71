"""A drive hauls an elastic cable through one or more holes in series; a load hangs, or is held by a spring.

Gu et al. 2024 (equations G), with the reading of docs/physics.md: friction is directional, rho = R / r.

    drive      accelerates within its limits towards a commanded speed, or towards the speed of the inner tension
               loop  v = kp (F - T1) + kd (F' - T1')                                                            G35
    cable      T1 = max(0, k (x - y) + c (x' - y')): the span between drive and hole; slack carries nothing
    hole       T2 = T1 / n sliding up, T1 n sliding down, in between at rest;  n = lambda(rho0 (1 + delta),
               mu + K |v|^omega, theta_e)                                                          G1, G9, G17, G28
    load       m y'' = T2 - m g - k_l y - c_l y' + disturbance, rigidly behind the last hole (v = y')          G28

Holes in series (the paper's future work): between two holes the cable is a spring again and its slip through the
earlier hole is a state of its own, with the lumped mass of the cable there (``guide_mass``). Every hole is the same
contact, every slip the same `stick_slip_step`: trapezoidal for the load, backward Euler for the lumped masses, whose
vibration no step resolves and no measurement shows.

Signs: x > 0 hauls in, y > 0 lifts. SI units throughout.
"""

import math
from functools import cache

import numpy as np

from cable_envs.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.effects import Layout
from cable_envs.effects.own import own_actuate, own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.rows import (
    CONTACT_EXCESS,
    COULOMB,
    CREEP,
    CREEP_T,
    HARDENING,
    PLAY,
    PRE_0,
    PRESLIDING,
    ROWS_E,
    ROWS_S,
    SLACK_LENGTH,
    STARTED,
    STRIBECK_V,
)  # fmt: skip
from cable_envs.effects.seams import (
    CREEP_LEFT,
    DOWN,
    FACTOR,
    FOLLOWS,
    IMPOSES,
    ROWS_G,
    STEEP,
    TARGET,
    TARGET_V,
    UP,
    actuate,
    begin,
    dry_friction,
    end,
    held_back,
    presliding_step,
)  # fmt: skip
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.errors import ConfigurationError
from cable_envs.friction import stick_slip_step
from cable_envs.hole_effects import cable_end, engaged, moves_otherwise, spool_at
from cable_envs.kernels import LANES, clip, inline, jit, load, maximum, power, select, sign, store, tile
from cable_envs.params import Parameter, ParameterTable
from cable_envs.plants.base import COMMAND, COMMAND_RATE, DISTURBANCE, INPUTS, MODE, ActionMode, Plant, Signal

MAX_HOLES = 4

_TABLE_1 = "Table 2 / A1, Gu 2024"
_TABLE_3 = "Table 3, Gu 2024"
_LUMPED = "chosen: 1000 rad/s, above every motion of interest"

PARAMETERS = ParameterTable(
    Parameter("load_mass", "kg", 5.0, 1e-3, 1e4, "mass of the load", "inferred from the tension ranges of 5.3"),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("load_gravity", "1", 1.0, 0.0, 1.0, "share of gravity along the cable: 1 hanging, 0 horizontal"),
    Parameter("load_stiffness", "N/m", 0.0, 0.0, 1e7, "spring between load and ground, relaxed at y = 0"),
    Parameter("load_damping", "N s/m", 0.0, 0.0, 1e5, "viscous damping of the load"),
    Parameter("cable_stiffness", "N/m", 60e3, 1.0, 1e9, "EA / L of the span between drive and hole"),
    Parameter("cable_damping", "N s/m", 100.0, 0.0, 1e6, "viscous damping of that span"),
    Parameter("wrap_angle", "rad", math.pi / 3, 0.0, 4 * math.pi, "wrap of the cable in the hole", "5.3, Gu 2024"),
    Parameter("radius_ratio", "1", 1.5, 1e-3, 1e6, "rho0 = hole radius / cable radius", "inferred, docs/physics.md"),
    Parameter("cable_radius", "m", 1e-3, 1e-6, 0.1, "cable radius r"),
    Parameter("bending_rigidity", "N m^2", 0.0, 0.0, 10.0, "flexural rigidity B of the cable, G1"),
    Parameter("friction_coefficient", "1", 0.43, 0.0, 5.0, "Coulomb coefficient mu", _TABLE_1),
    Parameter("extrusion_delta", "1", 0.02, -0.5, 1.0, "change of the radius ratio by extrusion, delta", _TABLE_1),
    Parameter("extrusion_gain", "SI", 6574.0, 0.0, 1e7, "K in C = K v^omega", _TABLE_1),
    Parameter("extrusion_exponent", "1", 2.03, 0.2, 10.0, "omega in C = K v^omega", _TABLE_1),
    Parameter("drive_speed_limit", "m/s", 0.1, 1e-6, 10.0, "largest drive speed"),
    Parameter("drive_acceleration_limit", "m/s^2", 2.0, 1e-6, 1e3, "largest drive acceleration"),
    Parameter("inner_kp", "m/(s N)", 0.1, 0.0, 100.0, "proportional gain of the inner tension loop", _TABLE_3),
    Parameter("inner_kd", "m/N", 0.005, 0.0, 100.0, "derivative gain of the inner tension loop", _TABLE_3),
    Parameter("tension_command_limit", "N", 120.0, 1e-3, 1e5, "largest driving tension that can be commanded"),
    Parameter("tension_limit", "N", 100.0, 1e-3, 1e6, "safety limit", "range of the tension sensor, 5.1, Gu 2024"),
    Parameter("breaking_tension", "N", 1000.0, 1e-3, 1e7, "the cable tears above this tension"),
)

_EXTRA_HOLE = ("wrap_angle", "radius_ratio", "friction_coefficient")


def _series_parameters(holes: int) -> ParameterTable:
    extra = [
        Parameter(f"{q.name}_{h}", q.unit, q.default, q.low, q.high, f"{q.meaning}; hole {h} from the drive", q.source)
        for h in range(2, holes + 1)
        for q in (PARAMETERS[name] for name in _EXTRA_HOLE)
    ]
    if holes > 1:
        extra.append(Parameter("span_stiffness", "N/m", 120e3, 1.0, 1e9, "EA / L of a span between two holes"))
        extra.append(Parameter("guide_mass", "kg", 0.02, 1e-6, 1e3, "lumped cable mass at an inner hole", _LUMPED))
    return ParameterTable(*PARAMETERS, *extra)


_SIGNALS = (
    Signal("drive_position", "m", "position of the drive, positive hauls in"),
    Signal("drive_velocity", "m/s", "speed of the drive"),
    Signal("drive_tension", "N", "cable tension on the drive side, T1"),
    Signal("load_position", "m", "position of the load, positive lifted"),
    Signal("load_velocity", "m/s", "speed of the load"),
    Signal("load_tension", "N", "cable tension on the load side, T2"),
    Signal("sliding", "1", "direction in which the cable slides at the load: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which the drive span was slack"),
    Signal("peak_tension", "N", "largest drive-side tension within the last control step"),
)

COEFFICIENTS = (
    "speed_limit", "acceleration_limit", "inner_kp", "inner_kd", "cable_stiffness", "cable_damping",
    "load_mass", "load_weight", "load_stiffness", "load_damping", "extrusion_gain", "extrusion_exponent",
    "bending_rigidity", "span_stiffness", "guide_mass",
)  # fmt: skip
_OF_EACH_HOLE = ("wrap_angle", "radius_ratio", "friction_coefficient", "edge_radius")
"""radius_ratio is rho0 (1 + delta), edge_radius is rho0 r in m."""
(V_MAX, A_MAX, KP, KD, K_CABLE, C_CABLE, MASS, WEIGHT, LOAD_K, LOAD_C, GAIN, OMEGA, RIGIDITY, SPAN_K,
 GUIDE) = range(len(COEFFICIENTS))  # fmt: skip
BASE_P, HOLE_P = len(COEFFICIENTS), len(_OF_EACH_HOLE)

X, VX, T1, Y, VY, T2, SLIDING, SLACK, PEAK = range(len(_SIGNALS))
BASE_X, HOLE_X = len(_SIGNALS), 3

(S, V, OUT, WRAP, RHO, MU, EDGE, ABOVE_OLD, ABOVE_NEW, ABOVE_V, ABOVE_V_NEW, ABOVE_T, K, C, BEHIND, BEHIND_K, BEHIND_C,
 INERTIA, MIDDLE, FRICTION, GROWTH, WRAPPED, RATIO, SLOPE, FEED, LATE, CLOSED, PER_MASS, HARD, LOST, RISE, ELASTIC,
 ENDS) = range(33)  # fmt: skip
"""Rows of the scratch tile w, the hole that is being solved: its slip position and speed and the tension behind it; its
geometry; the cable above it (position and speed before and after, tension, stiffness, damping); what resists behind it;
the tension above with which the step is made, M = mu + C and its growth with speed, wrap in contact, n and dn/dM; the
gains of the drive's closed loop. With effects also, of the cable above: its hardening, the length that makes no
tension, its stiffness over K, its elongation; and 1 where the drive is what ends it."""

ROWS_P, ROWS_X, ROWS_W = BASE_P + HOLE_P * MAX_HOLES, BASE_X + HOLE_X * (MAX_HOLES - 1), 33
ROWS_U = len(INPUTS)
STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.


@inline
def _span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def _pulled(w, e, i, stretch, rate):
    """Tension of the span above the hole."""
    if e is not None:
        elongation = stretch - w[LOST, i]
        pull, rise = hardened(w[K, i] * elongation, w[HARD, i])
        pull = select(w[ENDS, i] > 0.5, own_cable(pull, e, i), pull)
        w[RISE, i], w[ELASTIC, i] = rise, maximum(elongation, 0.0)
        return select(elongation > 0.0, maximum(pull + w[C, i] * rate, 0.0), 0.0)
    return _span(w[K, i], w[C, i], stretch, rate)


@inline
def _closed_loop(p, w, i, stiffness, dt):
    """The gains of `_drive`; they change within a control step only where the cable hardens."""
    by_position, by_speed = 0.5 * dt * p[KP, i] * stiffness, p[KP, i] * p[C_CABLE, i]
    w[FEED, i] = by_position + by_speed + p[KD, i] * stiffness
    w[LATE, i] = by_position - by_speed
    w[CLOSED, i] = 1.0 / (1.0 + w[FEED, i])
    w[PER_MASS, i] = 1.0 / p[MASS, i]


@inline
def _load_resistance(p, u, w, e, i, y, v):
    resist = p[WEIGHT, i] + p[LOAD_K, i] * y + p[LOAD_C, i] * v - u[DISTURBANCE, i]
    if e is not None:
        return resist + own_load(y, v, w[OUT, i], e, i)
    return resist


@inline
def _ahead(p, u, w, e, g, i, dt):
    """Speed of the load at the end of the step, from the balance of forces at its start (zero where it sticks)."""
    net = w[OUT, i] - _load_resistance(p, u, w, e, i, w[S, i], w[V, i])
    if e is not None:
        net = held_back(g, i, net, w[V, i])
    return w[V, i] + dt * w[PER_MASS, i] * net


@inline
def _drive(x, p, u, w, e, s, g, i, ahead, dt):
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
def _pull(p, u, w, e, g, i, theta):
    """Tension above once what is above has moved for theta dt; M = mu + K |v|^omega and dM/d|v| at the start.  G17."""
    v = w[V, i]
    stretch = w[ABOVE_OLD, i] + theta * (w[ABOVE_NEW, i] - w[ABOVE_OLD, i]) - w[S, i]
    w[MIDDLE, i] = _pulled(w, e, i, stretch, w[ABOVE_V, i] - v)
    speed = abs(v)
    steep = p[GAIN, i] * power(maximum(speed, 1e-12), p[OMEGA, i] - 1.0)
    if e is not None:
        imposed = (w[ENDS, i] > 0.5) & (g[IMPOSES, i] > 0.5)
        w[MIDDLE, i] = select(imposed, maximum(u[COMMAND, i], 0.0), w[MIDDLE, i])
        w[RISE, i], w[C, i] = select(imposed, 0.0, w[RISE, i]), select(imposed, 0.0, w[C, i])
        extra, growth = excess_at(e[CONTACT_EXCESS, i], e[STRIBECK_V, i], v)
        coulomb = (w[MU, i] + extra) * g[FACTOR, i] + own_contact(speed, w[MIDDLE, i], e, i)
        w[FRICTION, i] = coulomb + steep * speed
        w[GROWTH, i] = p[OMEGA, i] * steep + g[FACTOR, i] * growth
    else:
        w[FRICTION, i] = w[MU, i] + steep * speed
        w[GROWTH, i] = p[OMEGA, i] * steep


@inline
def _ratio(w, i):
    """n and dn/dM with the exact solution of section 1 in docs/physics.md.  G9, G17."""
    w[RATIO, i], w[SLOPE, i] = tension_ratio_and_slope(w[RHO, i], w[FRICTION, i], w[WRAPPED, i])


@inline
def _slip(w, e, s, g, i, dt, theta, last):
    """One slip through a hole, tension above against what resists behind it; the tension above after the step.  G28"""
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
            bent = presliding_step(
                e, s, i, v, w[INERTIA, i], up, down, w[BEHIND_K, i] + k * n, k * (inv_n - n), damping_up, damping_down,
                dt, theta,
            )  # fmt: skip
            v_new = select(e[PRESLIDING, i] > 0.0, bent, v_new)
    moved = v + theta * (v_new - v)
    s_new = w[S, i] + dt * moved
    if e is not None:
        target = w[ELASTIC, i]
    tension = _pulled(w, e, i, w[ABOVE_NEW, i] - s_new, w[ABOVE_V_NEW, i] - v_new)
    if e is not None:
        first = w[ENDS, i] > 0.5
        tension = select(first & (g[IMPOSES, i] > 0.5), middle, tension)
        crept_to = crept(s[CREEP_T, i], e[CREEP, i], target, g[CREEP_LEFT, i])
        s[CREEP_T, i] = select(first, crept_to, s[CREEP_T, i])
        w[ENDS, i] = 0.0
    # what is above the next hole, if there is one
    w[ABOVE_OLD, i], w[ABOVE_NEW, i] = w[S, i], s_new
    w[ABOVE_V, i], w[ABOVE_V_NEW, i] = moved, v_new
    w[S, i], w[V, i] = s_new, v_new
    w[RATIO, i] = n + w[SLOPE, i] * w[GROWTH, i] * (abs(v_new) - abs(v))
    if e is not None:
        w[RATIO, i] = select(w[GROWTH, i] < 0.0, maximum(w[RATIO, i], 1.0), w[RATIO, i])
        w[HARD, i], w[LOST, i] = 0.0, 0.0
    return tension, 1.0 / w[RATIO, i]


@inline
def _transmitted(v, above, n, inv_n, resist):
    """Tension behind a hole: on the friction limit when sliding, what keeps the balance when stuck."""
    low, high = above * inv_n, above * n
    return select(v > 0.0, low, select(v < 0.0, high, clip(resist, low, high)))


@inline
def _record(x, i, tension):
    x[T1, i] = tension
    x[SLACK, i] += select(tension <= 0.0, 1.0, 0.0)
    x[PEAK, i] = maximum(x[PEAK, i], tension)


@inline
def _drawn_in(x, p, w, e, s, g, i, dt):
    """The drive where the tension is imposed: the cable's end must be where its law asks for it."""
    stretch = linear(x[T1, i], e[HARDENING, i]) / p[K_CABLE, i]
    position = w[S, i] + stretch + e[SLACK_LENGTH, i] + s[CREEP_T, i]
    imposed = g[IMPOSES, i] > 0.5
    x[VX, i] = select(imposed, (position - x[X, i]) / dt, x[VX, i])
    x[X, i] = select(imposed, position, x[X, i])


@inline
def _load_behind(p, u, w, e, i):
    w[BEHIND, i] = _load_resistance(p, u, w, e, i, w[S, i], w[V, i])
    w[BEHIND_K, i], w[BEHIND_C, i], w[INERTIA, i] = p[LOAD_K, i], p[LOAD_C, i], p[MASS, i]
    if e is not None:
        at = own_load(w[S, i], w[V, i], w[OUT, i], e, i)
        k = (own_load(w[S, i] + STEP_Y, w[V, i], w[OUT, i], e, i) - at) / STEP_Y
        c = (own_load(w[S, i], w[V, i] + STEP_V, w[OUT, i], e, i) - at) / STEP_V
        w[BEHIND_K, i], w[BEHIND_C, i] = w[BEHIND_K, i] + maximum(k, 0.0), w[BEHIND_C, i] + maximum(c, 0.0)


@inline
def _load_moved(x, p, u, w, e, s, i, tension, inv_n):
    y, v = w[S, i], w[V, i]
    x[Y, i], x[VY, i], x[SLIDING, i] = y, v, sign(v)
    x[T2, i] = _transmitted(v, tension, w[RATIO, i], inv_n, _load_resistance(p, u, w, e, i, y, v))
    if e is not None:
        low, high = tension * inv_n, tension * w[RATIO, i]
        bent = high + share(s, PRE_0, i) * (low - high)
        x[T2, i] = select(e[PRESLIDING, i] > 0.0, bent, x[T2, i])
        s[STARTED, i] = 1.0


@inline
def _take_hole(x, p, w, i, geometry, row):
    """State and geometry of a hole; ``row``: where its slip position, speed and tension are in x."""
    w[S, i], w[V, i], w[OUT, i] = x[row, i], x[row + 1, i], x[row + 2, i]
    w[WRAP, i], w[RHO, i] = p[geometry, i], p[geometry + 1, i]
    w[MU, i], w[EDGE, i] = p[geometry + 2, i], p[geometry + 3, i]


@inline
def _keep_hole(x, w, i):
    """The only hole after its step: its geometry is in place already."""
    w[OUT, i] = x[T2, i]


@inline
def _span_behind(x, p, w, i, following, ahead):
    """A span to the next hole, whose slip position is row ``following`` of x, and the cable's own lumped mass.

    The next hole is taken ``ahead`` seconds from now at its present speed: it moves on within the step.
    """
    resist = _span(p[SPAN_K, i], 0.0, w[S, i] - x[following, i] - ahead * x[following + 1, i], 0.0)
    w[BEHIND, i], w[BEHIND_C, i], w[INERTIA, i] = resist, 0.0, p[GUIDE, i]
    w[BEHIND_K, i] = select(resist > 0.0, p[SPAN_K, i], 0.0)


@inline
def _guide_moved(x, p, w, i, row, tension, inv_n):
    """An inner hole after its step; its span is above the next hole."""
    x[row, i], x[row + 1, i] = w[S, i], w[V, i]
    x[row + 2, i] = _transmitted(w[V, i], tension, w[RATIO, i], inv_n, w[BEHIND, i])
    w[ABOVE_T, i], w[K, i], w[C, i] = x[row + 2, i], p[SPAN_K, i], 0.0


@inline
def _wrapped(p, w, lanes, bends):
    """Wrap that stays in contact; the loop is left out where no cable of the block is stiff.  G1"""
    if bends:
        for i in range(lanes):
            w[WRAPPED, i] = wrap_in_contact(w[WRAP, i], p[RIGIDITY, i], w[EDGE, i], w[ABOVE_T, i], w[OUT, i])
    else:
        for i in range(lanes):
            w[WRAPPED, i] = w[WRAP, i]


@inline
def _any_stiff(p, lanes):
    found = False
    for i in range(lanes):
        found = found or p[RIGIDITY, i] > 0.0
    return found


@inline
def _substeps(x, p, u, w, e, s, g, lanes, holes, substeps, dt):
    """A block of columns. Short loops, one for each stage: the processor then works on several columns at once, which
    the long chain of dependent operations of a whole step would prevent."""
    bends = _any_stiff(p, lanes)
    for i in range(lanes):
        _closed_loop(p, w, i, p[K_CABLE, i], dt)
        _take_hole(x, p, w, i, BASE_P, Y)
        x[SLACK, i] = 0.0
        x[PEAK, i] = 0.0
        if e is not None:
            begin(e, s, g, u, i, x[X, i], x[VX, i], x[Y, i], x[VY, i], substeps * dt, dt)
            dry_friction(e, g, i, x[VY, i], e[COULOMB, i], x[T1, i])
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u[COMMAND, i] = own_actuate(u[COMMAND, i], e, i)
                rise = 1.0 + e[HARDENING, i] * linear(x[T1, i], e[HARDENING, i])
                _closed_loop(p, w, i, p[K_CABLE, i] * rise, dt)
        for h in range(holes):
            last = h == holes - 1
            row = Y if last else BASE_X + HOLE_X * h
            theta = 0.5 if last else 1.0  # the lumped masses of the cable are no part of the motion of interest
            if holes == 1:
                for i in range(lanes):
                    _keep_hole(x, w, i)
            else:
                for i in range(lanes):
                    _take_hole(x, p, w, i, BASE_P + HOLE_P * h, row)
            if h == 0:
                for i in range(lanes):
                    ahead = _ahead(p, u, w, e, g, i, dt) if holes == 1 else w[V, i]
                    _drive(x, p, u, w, e, s, g, i, ahead, dt)
            for i in range(lanes):
                _pull(p, u, w, e, g, i, theta)
            _wrapped(p, w, lanes, bends)
            for i in range(lanes):
                _ratio(w, i)
            if last:
                for i in range(lanes):
                    _load_behind(p, u, w, e, i)
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, True)
                    _load_moved(x, p, u, w, e, s, i, tension, inv_n)
                    if holes == 1:
                        _record(x, i, tension)
                        if e is not None:
                            _drawn_in(x, p, w, e, s, g, i, dt)
            else:
                following = Y if h == holes - 2 else row + HOLE_X
                for i in range(lanes):
                    _span_behind(x, p, w, i, following, dt)
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, False)
                    _guide_moved(x, p, w, i, row, tension, inv_n)
                    if h == 0:
                        _record(x, i, tension)
                        if e is not None:
                            _drawn_in(x, p, w, e, s, g, i, dt)
    for i in range(lanes):
        x[SLACK, i] /= substeps
        if e is not None:
            end(e, s, g, i, x[Y, i], substeps * dt)


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; without effects."""
    rows = p.shape[0] - EFFECTS if p.shape[0] > ROWS_P else p.shape[0]  # effects have more rows than all holes
    holes = (rows - BASE_P) // HOLE_P
    seen = BASE_X + HOLE_X * (holes - 1)
    xt, pt, ut, wt = tile(ROWS_X), tile(ROWS_P), tile(ROWS_U), tile(ROWS_W)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:seen], first, lanes)
        load(pt, p[:rows], first, lanes)
        load(ut, u, first, lanes)
        _substeps(xt, pt, ut, wt, None, None, None, lanes, holes, substeps, dt)
        store(xt, x[:seen], first, lanes)


@jit
def advance_with_effects(x, p, u, lo, hi, substeps, dt):
    """The same with effects; x and p have their rows."""
    rows = p.shape[0] - EFFECTS
    holes = (rows - BASE_P) // HOLE_P
    seen = BASE_X + HOLE_X * (holes - 1)
    xt, pt, ut, wt = tile(ROWS_X), tile(ROWS_P), tile(ROWS_U), tile(ROWS_W)
    et, st, gt = tile(ROWS_E), tile(ROWS_S), tile(ROWS_G)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:seen], first, lanes)
        load(pt, p[:rows], first, lanes)
        load(ut, u, first, lanes)
        load(et, p[rows : rows + ROWS_E], first, lanes)
        load(st, x[seen:], first, lanes)
        _substeps(xt, pt, ut, wt, et, st, gt, lanes, holes, substeps, dt)
        store(xt, x[:seen], first, lanes)
        store(st, x[seen:], first, lanes)


LAYOUT = Layout("cable_hole", PARAMETERS)
EFFECTS = LAYOUT.count
_MOST = len(_series_parameters(MAX_HOLES))


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows [len(Plant.coefficients), n] of parameter columns [len(Plant.parameters), n].

    Columns of the whole `Plant.table` give the rows of the effects too. Raises ConfigurationError for what the bounds
    of single parameters cannot exclude.
    """
    effects = values[-len(LAYOUT.null) :] if len(values) > _MOST else None
    values = values if effects is None else values[: -len(effects)]
    holes = 1 if len(values) == len(PARAMETERS) else 1 + (len(values) - len(PARAMETERS) - 2) // len(_EXTRA_HOLE)
    value = dict(zip(_series_parameters(holes).names, values, strict=True))
    weight = value["load_mass"] * value["gravity"] * value["load_gravity"]
    if np.any((weight == 0.0) & (value["load_stiffness"] == 0.0)):
        raise ConfigurationError("the load is free: give it load_gravity > 0 or load_stiffness > 0")
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    none = np.zeros_like(weight)
    rows = [
        value["drive_speed_limit"], value["drive_acceleration_limit"], value["inner_kp"], value["inner_kd"],
        value["cable_stiffness"], value["cable_damping"], value["load_mass"], weight, value["load_stiffness"],
        value["load_damping"], value["extrusion_gain"], value["extrusion_exponent"], value["bending_rigidity"],
        value.get("span_stiffness", none), value.get("guide_mass", none),
    ]  # fmt: skip
    for h in range(holes):
        wrap, rho, mu = (value[name if h == 0 else f"{name}_{h + 1}"] for name in _EXTRA_HOLE)
        rows += [wrap, rho * (1.0 + value["extrusion_delta"]), mu, rho * value["cable_radius"]]
    if effects is not None:
        rows += list(LAYOUT.coefficients(effects))
    return np.ascontiguousarray(rows, dtype=np.float64)


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(signals), n] of mechanisms at rest with the load at ``position`` (m, [n]); equal tensions."""
    known = p.shape[0] > ROWS_P
    e = p[-EFFECTS:] if known else np.zeros((ROWS_E, p.shape[1]))
    holes = (p.shape[0] - known * EFFECTS - BASE_P) // HOLE_P
    seen = BASE_X + HOLE_X * (holes - 1)
    x = np.zeros((seen + known * ROWS_S, p.shape[1]))
    tension = np.maximum(p[WEIGHT] + p[LOAD_K] * position, 0.0)
    x[Y] = position
    x[T1] = x[T2] = x[PEAK] = tension
    s = np.array(position, dtype=np.float64)
    for h in reversed(range(holes - 1)):
        s = s + tension / p[SPAN_K]
        x[BASE_X + HOLE_X * h], x[BASE_X + HOLE_X * h + 2] = s, tension
    stretch = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * e[HARDENING] * tension)) / p[K_CABLE]
    end = s + stretch * (1.0 + e[CREEP]) + e[SLACK_LENGTH]
    x[X] = end
    if known:
        x[X] = spool_at(end, e)
        x[seen + CREEP_T], x[seen + PLAY] = e[CREEP] * stretch, x[X]
    return x


@cache
def cable_hole(holes: int = 1) -> Plant:
    """The plant with ``holes`` holes in series (1 to 4)."""
    if not 1 <= holes <= MAX_HOLES:
        raise ConfigurationError(f"holes = {holes} is outside [1, {MAX_HOLES}]")
    parameters = _series_parameters(holes)
    inner = tuple(
        Signal(f"{name}_{h}", unit, f"{meaning} hole {h}")
        for h in range(1, holes)
        for name, unit, meaning in (
            ("slip_position", "m", "cable paid through"),
            ("slip_velocity", "m/s", "sliding speed in"),
            ("span_tension", "N", "tension behind"),
        )
    )
    return Plant(
        name="cable_hole",
        parameters=parameters,
        coefficients=COEFFICIENTS + tuple(f"{name}_{h}" for h in range(1, holes + 1) for name in _OF_EACH_HOLE),
        signals=_SIGNALS + inner,
        action_modes=(
            ActionMode("tension", "N", "tension_command_limit", one_sided=True, rest_signal="drive_tension"),
            ActionMode("speed", "m/s", "drive_speed_limit"),
        ),
        prepare=prepare,
        rest=rest,
        kernels=(advance, advance_with_effects),
        effects=Layout("cable_hole", parameters),
    )


PLANT = cable_hole()
