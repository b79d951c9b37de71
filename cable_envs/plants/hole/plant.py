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

from functools import cache  # noqa: I001 (the blocks below: one name a line would fill the screen)

import numpy as np

from cable_envs.effects import Layout
from cable_envs.effects.own import own_actuate, own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.rows import (
    CONTACT_EXCESS, COULOMB, CREEP, CREEP_T, HARDENING, LOAD_EXPONENT, LOPSIDED, PLAY, PRESLIDING, PRE_0, ROWS_E,
    ROWS_S, SLACK_LENGTH, STARTED, STRIBECK_V,
)  # fmt: skip
from cable_envs.effects.seams import CREEP_LEFT, FACTOR, IMPOSES, ROWS_G, actuate, begin, dry_friction, end, held_back
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.hole.spool import spool_at
from cable_envs.plants.hole.parameters import (
    BASE_P, BASE_X, COEFFICIENTS, GAIN, HOLE_P, HOLE_X, K_CABLE, LOAD_C, LOAD_K, MASS, MAX_HOLES, OF_EACH_HOLE,
    OMEGA, PARAMETERS, PEAK, ROWS_P, ROWS_X, SLACK, SLIDING, SPAN_K, T1, T2, VX, VY, WEIGHT, X, Y, coefficients,
    series_parameters, series_signals,
)  # fmt: skip
from cable_envs.plants.hole.stages import (
    ABOVE_NEW, ABOVE_OLD, ABOVE_V, ABOVE_V_NEW, BEHIND, BEHIND_C, BEHIND_K, C, ELASTIC, ENDS, FRICTION, GROWTH,
    HARD, INERTIA, K, LOST, MIDDLE, MU, OUT, PER_MASS, RATIO, RISE, ROWS_W, S, SLOPE, V, any_stiff, closed_loop,
    drawn_in, drive, guide_moved, keep_hole, mobilised, ratio, record, slip_speed, span, span_behind, take_hole,
    transmitted, wrapped,
)  # fmt: skip
from cable_envs.core.kernels import LANES, inline, jit, load, maximum, power, select, sign, store, tile
from cable_envs.plants.base import COMMAND, DISTURBANCE, INPUTS, ActionMode, Plant

ROWS_U = len(INPUTS)
STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
# A user's own effects (`plants.own_effects`) replace own_cable, own_contact, own_load and own_actuate in a copy of
# this file: what calls one of them must stay here.


@inline
def _pulled(w, e, i, stretch, rate):
    """Tension of the span above the hole."""
    if e is not None:
        elongation = stretch - w[LOST, i]
        pull, rise = hardened(w[K, i] * elongation, w[HARD, i])
        pull = select(w[ENDS, i] > 0.5, own_cable(pull, e, i), pull)
        w[RISE, i], w[ELASTIC, i] = rise, maximum(elongation, 0.0)
        return select(elongation > 0.0, maximum(pull + w[C, i] * rate, 0.0), 0.0)
    return span(w[K, i], w[C, i], stretch, rate)


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
        exponent, over = e[LOAD_EXPONENT, i], maximum(w[MIDDLE, i], 0.1) / maximum(p[WEIGHT, i], 0.1)
        factor = g[FACTOR, i] * select(exponent != 0.0, power(over, exponent), 1.0)
        towards = select(v == 0.0, w[MIDDLE, i] - w[BEHIND, i], v)  # at rest: where it would break away to
        factor *= 1.0 + e[LOPSIDED, i] * sign(towards)
        coulomb = (w[MU, i] + extra) * factor + own_contact(speed, w[MIDDLE, i], e, i)
        w[FRICTION, i] = coulomb + steep * speed
        w[GROWTH, i] = p[OMEGA, i] * steep + factor * growth
    else:
        w[FRICTION, i] = w[MU, i] + steep * speed
        w[GROWTH, i] = p[OMEGA, i] * steep


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
    x[T2, i] = transmitted(v, tension, w[RATIO, i], inv_n, _load_resistance(p, u, w, e, i, y, v))
    if e is not None:
        bent = tension * mobilised(w[RATIO, i], inv_n, share(s, PRE_0, i))[0]
        x[T2, i] = select(e[PRESLIDING, i] > 0.0, bent, x[T2, i])
        s[STARTED, i] = 1.0


@inline
def _slip(w, e, s, g, i, dt, theta, last):
    """One slip through a hole; (tension above after the step, 1 / n).  G28"""
    v, middle, n = w[V, i], w[MIDDLE, i], w[RATIO, i]
    v_new = slip_speed(w, e, s, g, i, dt, theta, last)
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
def _substeps(x, p, u, w, e, s, g, lanes, holes, substeps, dt):
    """A block of columns. Short loops, one for each stage: the processor then works on several columns at once, which
    the long chain of dependent operations of a whole step would prevent."""
    bends = any_stiff(p, lanes)
    for i in range(lanes):
        closed_loop(p, w, i, p[K_CABLE, i], dt)
        take_hole(x, p, w, i, BASE_P, Y)
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
                closed_loop(p, w, i, p[K_CABLE, i] * rise, dt)
        for h in range(holes):
            last = h == holes - 1
            row = Y if last else BASE_X + HOLE_X * h
            theta = 0.5 if last else 1.0  # the lumped masses of the cable are no part of the motion of interest
            if holes == 1:
                for i in range(lanes):
                    keep_hole(x, w, i)
            else:
                for i in range(lanes):
                    take_hole(x, p, w, i, BASE_P + HOLE_P * h, row)
            if h == 0:
                for i in range(lanes):
                    ahead = _ahead(p, u, w, e, g, i, dt) if holes == 1 else w[V, i]
                    drive(x, p, u, w, e, s, g, i, ahead, dt)
            following = Y if h >= holes - 2 else row + HOLE_X
            if last:
                for i in range(lanes):
                    _load_behind(p, u, w, e, i)
            else:
                for i in range(lanes):
                    span_behind(x, p, w, i, following, dt)
            for i in range(lanes):
                _pull(p, u, w, e, g, i, theta)
            wrapped(p, w, lanes, bends)
            for i in range(lanes):
                ratio(w, i)
            if last:
                for i in range(lanes):
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, True)
                    _load_moved(x, p, u, w, e, s, i, tension, inv_n)
                    if holes == 1:
                        record(x, i, tension)
                        if e is not None:
                            drawn_in(x, p, w, e, s, g, i, dt)
            else:
                for i in range(lanes):
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, False)
                    guide_moved(x, p, w, i, row, tension, inv_n)
                    if h == 0:
                        record(x, i, tension)
                        if e is not None:
                            drawn_in(x, p, w, e, s, g, i, dt)
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
_MOST = len(series_parameters(MAX_HOLES))


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows [len(Plant.coefficients), n] of parameter columns [len(Plant.parameters), n].

    Columns of the whole `Plant.table` give the rows of the effects too. Raises ConfigurationError for what the bounds
    of single parameters cannot exclude.
    """
    effects = values[-len(LAYOUT.null) :] if len(values) > _MOST else None
    rows = coefficients(values if effects is None else values[: -len(effects)])
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
    parameters = series_parameters(holes)
    return Plant(
        name="cable_hole",
        parameters=parameters,
        coefficients=COEFFICIENTS + tuple(f"{name}_{h}" for h in range(1, holes + 1) for name in OF_EACH_HOLE),
        signals=series_signals(holes),
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
