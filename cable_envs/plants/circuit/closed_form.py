"""Closed cable-pulley circuit, analytic: the closed forms of Zou et al. 2022 between two moving inertias.

    cables     D = theta_in R0/R5 - theta_out;  EA Delta L_t = EA R5 D = -EA Delta L_b                       Z36-38
               T01t = max(0, (T_pre_t L_t + EA R5 D) / kappa_s1),  T01b = max(0, (T_pre_b L_b - EA R5 D) / kappa_s2)
                                                                                                              Z39-41
    torques    M_in = R0 (T01t - T01b);  M_out = R5 (T01t/K_t - T01b K_b) ccw, R5 (T01t K_t - T01b/K_b) cw   Z32, Z35
    output     J theta_out'' = M_out - load;  moving ccw takes the ccw branch, moving cw the cw branch
    drive      position servo or torque, see `circuit_ends.drive_step`

At one D the ccw branch never exceeds the cw branch: their difference is the friction of all idlers, lumped at the
output and set-valued at rest. The output therefore sticks, exactly, while M_out_ccw(D) <= load <= M_out_cw(D). There
it holds its angle and its torque while the drive moves: delay and transition of Fig. 6 in one hold, as in Eq. (47), but
ended by the balance and not by signs. The share of friction mobilised in the hold, sigma in [0, 1], is the one that
makes M_out equal the load torque, and it sets M_in and all tensions, which are then continuous through every reversal.
``hold_rule`` 1 adds the paper's own rule: the output is also held while the flag of Eq. (47) is set
(`circuit_statics.hold_flag`). Against a load that pushes back this holds too long: the output lets go only where M_in
changes sign, and then follows the drive in small jumps along M_in = 0.

Limits: tensions follow D without waves; friction inside the hold is stored as if elastic, so M_in traces no loop there
(the chain plant does); with a slack cable the other one carries on, ``out_of_range`` says so.
"""

import numpy as np  # noqa: I001 (the blocks below: one name a line would fill the screen)

from cable_envs.plants.circuit.effects import pulley, rise, spring
from cable_envs.plants.circuit.ends import (
    ACTION_MODES, BRAKE, C5, COEFFICIENTS, EA5, GEAR, M_IN, M_OUT, OUT_OF_RANGE, PEAK, PHASE, PRE_B, PRE_T, R0, R5,
    SIGNALS, SLACK, STILL, T01_B, T01_T, T45_B, T45_T, THETA_IN, THETA_OUT, V_IN, V_OUT, any_payload, cosine,
    drive_step, effect_rows, load_torque, rest_elongation, rest_signals,
)  # fmt: skip
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.stages import (
    BRANCHES, C_TURN, D, DB1, DB2, DT1, DT2, K_IN, LENGTH_B, LENGTH_T, LEVEL, LOAD_C, LOAD_K, OB1, OB2, OFFSET, OT1,
    OT2, OWN, RATE, ROWS_P, ROWS_W, TILE_P, TURNS, WANTED, begin_step, coefficients, cw_share, drive_torque, guess,
    held_by_flag, mix, output_torques, output_velocity, share_with, steepest,
)  # fmt: skip
from cable_envs.effects import Layout
from cable_envs.effects.own import own_actuate, own_cable, own_load
from cable_envs.effects.rows import CREEP, CREEP_B, CREEP_T, DRIFT, HARDENING, PLAY, ROWS_E, ROWS_S, SPRING, STARTED
from cable_envs.effects.seams import CREEP_LEFT, FOLLOWS, ROWS_G, TARGET, actuate, begin, dry_friction, end
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.core.kernels import LANES, inline, jit, load, maximum, minimum, select, store, tile
from cable_envs.plants.base import COMMAND, INPUTS, Plant

ROWS_X, ROWS_U = len(SIGNALS), len(INPUTS)
LAYOUT = Layout("pulley_circuit", CIRCUIT, worn=BRANCHES)
TILE_E = ROWS_E + BRANCHES
STEP_ANGLE, STEP_RATE = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, rad and rad/s."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
# A user's own effects (`plants.own_effects`) replace own_cable, own_load and own_actuate in a copy of this file:
# what calls one of them must stay here.


@inline
def _stretched(p, e, s, i, d, rate):
    """(T kappa of t, T kappa of b), N m: what both directions divide by their kappas; zero when slack.  Z39-41."""
    top = p[PRE_T, i] + p[EA5, i] * d
    bottom = p[PRE_B, i] - p[EA5, i] * d
    if e is not None:
        top, _ = hardened(top - s[CREEP_T, i], e[HARDENING, i] / p[LENGTH_T, i])
        bottom, _ = hardened(bottom - s[CREEP_B, i], e[HARDENING, i] / p[LENGTH_B, i])
        top, bottom = own_cable(top, e, i), own_cable(bottom, e, i)
    damped = p[C5, i] * rate
    return (
        select(top <= 0.0, 0.0, maximum(top + damped, 0.0)),  # so written, a NaN passes on
        select(bottom <= 0.0, 0.0, maximum(bottom - damped, 0.0)),
    )


@inline
def _load_with(x, p, w, e, g, i, angle, v, wanted, load_k, load_c):
    """The load's torque, stiffness and damping with effects; its dry friction goes into g."""
    if e is not None:
        tension = x[T45_T, i] + x[T45_B, i]
        dry_friction(e, g, i, v, p[BRAKE, i], p[R5, i] * tension)
        wanted, load_k = spring(e, i, angle, wanted, load_k)
        at = own_load(angle, v, tension, e, i)
        k = (own_load(angle + STEP_ANGLE, v, tension, e, i) - at) / STEP_ANGLE
        c = (own_load(angle, v + STEP_RATE, tension, e, i) - at) / STEP_RATE
        wanted, load_k, load_c = wanted + at, load_k + maximum(k, 0.0), load_c + maximum(c, 0.0)
    return wanted, load_k, load_c


@inline
def _drive_part(x, p, u, w, e, s, g, i, dt):
    """The drive's step, against what the cables pull at the predicted middle of it."""
    gear = p[GEAR, i]
    a, v_in, b, v = x[THETA_IN, i], x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i]
    half = b + 0.5 * dt * v
    wanted, load_k, load_c = load_torque(p, u, i, half, v, w[LEVEL, i])
    wanted, load_k, load_c = _load_with(x, p, w, e, g, i, half, v, wanted, load_k, load_c)
    along = a + 0.5 * dt * v_in
    if e is not None:
        w[OFFSET, i], w[TURNS, i], _ = pulley(e, s, i, along, x[M_IN, i], steepest(x, p, e, i))
        along += w[OFFSET, i]
        gear *= w[TURNS, i]
    d, rate = p[GEAR, i] * along - half, gear * v_in - v
    top, bottom = _stretched(p, e, s, i, d, rate)
    ccw, cw = output_torques(p, i, top, bottom)
    share = share_with(e, s, i, cw_share(v, ccw, cw, wanted))
    late = 0.5 * p[C5, i] * guess(p, g, i, v, ccw - wanted, cw - wanted)
    m_in = drive_torque(p, i, maximum(top - late, 0.0), bottom + select(bottom > 0.0, late, 0.0), share)
    stiff = p[K_IN, i]
    if e is not None:
        m_in *= w[TURNS, i]
        stiff *= rise(e, i, maximum(top / p[LENGTH_T, i], bottom / p[LENGTH_B, i]))
    new = drive_step(x, p, u, g, i, m_in, stiff, p[C5, i] * p[C_TURN, i], dt)
    change = 0.5 * (new - v_in)
    w[D, i], w[RATE, i] = d + 0.5 * dt * gear * change, rate + gear * change
    w[WANTED, i], w[LOAD_K, i], w[LOAD_C, i] = wanted, load_k, load_c
    after = a + 0.5 * dt * (v_in + new)
    if e is not None:
        after = select(g[FOLLOWS, i] > 0.5, g[TARGET, i], after)
    x[THETA_IN, i], x[V_IN, i] = after, new


@inline
def _output_part(x, p, w, e, s, g, i, dt):
    """The output's step, with the drive's motion known."""
    v = x[V_OUT, i]
    top, bottom = _stretched(p, e, s, i, w[D, i], w[RATE, i])
    new = output_velocity(p, e, s, g, i, v, top, bottom, w[WANTED, i], w[LOAD_K, i], w[LOAD_C, i], dt)
    new = select(held_by_flag(p, i, x[V_IN, i], top, bottom), 0.0, new)
    x[THETA_OUT, i], x[V_OUT, i] = x[THETA_OUT, i] + 0.5 * dt * (v + new), new
    if e is not None:
        stretch, keep = p[EA5, i] * w[D, i], g[CREEP_LEFT, i]
        elongation_t = maximum(stretch - s[CREEP_T, i], -p[PRE_T, i])
        elongation_b = maximum(-stretch - s[CREEP_B, i], -p[PRE_B, i])
        s[CREEP_T, i] = crept(s[CREEP_T, i], e[CREEP, i], elongation_t, keep)
        s[CREEP_B, i] = crept(s[CREEP_B, i], e[CREEP, i], elongation_b, keep)


@inline
def _report(x, p, u, w, e, s, g, i, level):
    """Torques and tensions of the new state; ``level``: cosine of the output angle."""
    v_in, b, v = x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i]
    angle, gear = x[THETA_IN, i], p[GEAR, i]
    if e is not None:
        offset, turns, inside = pulley(e, s, i, angle, x[M_IN, i], steepest(x, p, e, i))
        s[PLAY, i] = inside
        angle += offset
        gear *= turns
    top, bottom = _stretched(p, e, s, i, p[GEAR, i] * angle - b, gear * v_in - v)
    wanted, load_k, load_c = load_torque(p, u, i, b, v, level)
    wanted, load_k, load_c = _load_with(x, p, w, e, g, i, b, v, wanted, load_k, load_c)
    ccw, cw = output_torques(p, i, top, bottom)
    share = share_with(e, s, i, cw_share(v, ccw, cw, wanted))
    t01_t, t01_b = top * mix(share, p[DT1, i], p[DT2, i]), bottom * mix(share, p[DB1, i], p[DB2, i])
    t45_t, t45_b = top * mix(share, p[OT1, i], p[OT2, i]), bottom * mix(share, p[OB1, i], p[OB2, i])
    x[T01_T, i], x[T01_B, i], x[T45_T, i], x[T45_B, i] = t01_t, t01_b, t45_t, t45_b
    x[M_IN, i] = p[R0, i] * (t01_t - t01_b)
    x[M_OUT, i] = p[R5, i] * (t45_t - t45_b)
    slack = select(minimum(top, bottom) <= 0.0, 1.0, 0.0)
    x[OUT_OF_RANGE, i] = slack
    x[SLACK, i] += slack
    x[PEAK, i] = maximum(maximum(maximum(t01_t, t45_t), maximum(t01_b, t45_b)), x[PEAK, i])
    x[PHASE, i] = select(v != 0.0, 3.0, select(abs(v_in) > STILL, 1.0, 0.0))


@inline
def _substeps(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, in short loops: so the processor works on several columns at once (see cable_hole)."""
    payload = any_payload(p, lanes)
    for i in range(lanes):
        begin_step(x, p, w, e, s, i, dt)
        if e is not None:
            begin(e, s, g, u, i, x[THETA_IN, i], x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i], substeps * dt, dt)
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u[COMMAND, i] = own_actuate(u[COMMAND, i], e, i)
        if payload:
            for i in range(lanes):
                w[LEVEL, i] = cosine(x[THETA_OUT, i] + 0.5 * dt * x[V_OUT, i])
        for i in range(lanes):
            _drive_part(x, p, u, w, e, s, g, i, dt)
        for i in range(lanes):
            _output_part(x, p, w, e, s, g, i, dt)
        if payload:
            for i in range(lanes):
                w[LEVEL, i] = cosine(x[THETA_OUT, i])
        for i in range(lanes):
            _report(x, p, u, w, e, s, g, i, w[LEVEL, i])
            if e is not None:
                s[STARTED, i] = 1.0
    for i in range(lanes):
        x[SLACK, i] /= substeps
        if e is not None:
            end(e, s, g, i, x[THETA_OUT, i], substeps * dt)


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; without effects."""
    xt, pt, ut, wt = tile(ROWS_X), tile(TILE_P), tile(ROWS_U), tile(ROWS_W)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:ROWS_X], first, lanes)
        load(pt, p[:ROWS_P], first, lanes)
        load(ut, u, first, lanes)
        _substeps(xt, pt, ut, wt, None, None, None, lanes, substeps, dt)
        store(xt, x[:ROWS_X], first, lanes)


@jit
def advance_with_effects(x, p, u, lo, hi, substeps, dt):
    """The same with effects; x and p have their rows."""
    xt, pt, ut, wt = tile(ROWS_X), tile(TILE_P), tile(ROWS_U), tile(ROWS_W)
    et, st, gt = tile(TILE_E), tile(ROWS_S), tile(ROWS_G)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:ROWS_X], first, lanes)
        load(pt, p[:ROWS_P], first, lanes)
        load(ut, u, first, lanes)
        load(et, p[ROWS_P : ROWS_P + TILE_E], first, lanes)
        load(st, x[ROWS_X:], first, lanes)
        _substeps(xt, pt, ut, wt, et, st, gt, lanes, substeps, dt)
        store(xt, x[:ROWS_X], first, lanes)
        store(st, x[ROWS_X:], first, lanes)


@jit
def _refresh(x, p):
    """What the kernel reports for states at rest without a disturbance."""
    u = np.zeros((ROWS_U, x.shape[1]))
    for i in range(x.shape[1]):
        x[SLACK, i] = 0.0
        _report(x, p, u, None, None, None, None, i, cosine(x[THETA_OUT, i]))


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows [len(PLANT.coefficients), n] of parameter columns [len(CIRCUIT), n].

    Columns of the whole `PLANT.table` give the rows of the effects too.
    """
    if len(values) == len(CIRCUIT):
        return coefficients(values, None)
    e = LAYOUT.coefficients(values[len(CIRCUIT) :])
    p = np.concatenate([coefficients(values, e), e])
    drifting = np.flatnonzero(e[DRIFT])
    if drifting.size:
        final = values[:, drifting].copy()
        final[CIRCUIT.index("cable_friction")] *= 1.0 + e[DRIFT, drifting]
        final[CIRCUIT.index("shaft_friction")] *= 1.0 + e[DRIFT, drifting]
        worn = coefficients(final, e[:, drifting])[DT1 : DT1 + BRANCHES]
        p[ROWS_P + ROWS_E : ROWS_P + TILE_E, drifting] = worn
    return np.ascontiguousarray(p)


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(PLANT.signals), n] at rest with the output at ``position`` (rad, [n]), its load balanced.

    D is that of equal tensions along each cable, inside the hold; torques and tensions are the kernel's for that D.
    """
    position = np.asarray(position, dtype=np.float64)
    e = effect_rows(p, ROWS_P)
    elongation = rest_elongation(p, p[LENGTH_T], p[LENGTH_B], position, e)
    x = rest_signals(p, ROWS_X, ROWS_P, position, *elongation)
    plain = (
        (e[CREEP] == 0.0)
        & (e[HARDENING] == 0.0)
        & (e[SPRING] == 0.0)
        & (x[THETA_IN] == (position + elongation[0]) / p[GEAR])
    )
    seen = x.copy()
    _refresh(seen, p)
    return np.where(plain, seen, x)


PLANT = Plant(
    name="pulley_circuit",
    parameters=CIRCUIT,
    coefficients=COEFFICIENTS + OWN,
    signals=SIGNALS,
    action_modes=ACTION_MODES,
    prepare=prepare,
    rest=rest,
    kernels=(advance, advance_with_effects),
    effects=LAYOUT,
)
