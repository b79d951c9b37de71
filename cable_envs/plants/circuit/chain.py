"""Closed cable-pulley circuit as a chain: the mechanism behind Fig. 6 of Zou et al. 2022.

Each side is five elastic spans joined by four friction contacts (`cable_envs.physics.chain`); the slip front after a
reversal travels from idler to idler, so that delay, transition and working phases emerge and are reported.

    spans      EA de_0 = R0 dtheta_in - slip_1, ..., EA de_4 = slip_4 - R5 dtheta_out   (cable t; cable b mirrored)
    contacts   1/lambda_i <= T_{i-1}/T_i <= lambda_i, the ratios of the closed forms (Z12, Z30); massless cable
    arcs       a slip arc stretches like w (T_{i-1} + T_i), w = R Phi / (1 + lambda): exactly Z16 when it slides, in
               both directions; l_j is the free length and the two w beside it
    torques    M_in = R0 (T_0t - T_0b), M_out = R5 (T_4t - T_4b)                                            Z32, Z33

Time step: half a step of motion, equilibrium of both chains there, the velocities by linearly implicit kicks with the
chain's own tangents, the other half step: order 2 where nothing starts or stops (cable damping, inside the equilibrium,
is of order 1). The signals show the equilibrium at the end of a control step.

phase: 0 rest: the drive stands and no contact next to the output slid within the control step; 1 delay: the front has
reached the output on neither side; 2 transition: on one; 3 working: on both (a slack side counts as arrived).
"""

import numpy as np  # noqa: I001 (the block below: one name a line would fill the screen)

from cable_envs.plants.circuit.effects import moves_otherwise, output_step, pulley, spring
from cable_envs.plants.circuit.ends import (
    ACTION_MODES, BRAKE, C5, COEFFICIENTS, CONTACT_K, EA5, GEAR, J_OUT, M_IN, M_OUT, OUT_OF_RANGE, PEAK, PHASE,
    PRE_B, PRE_T, R0, R5, SHARED, SIGNALS, SLACK, STILL, T01_B, T01_T, T45_B, T45_T, THETA_IN, THETA_OUT, V_IN, V_OUT,
    cosine, drive_step, effect_rows, load_torque, resolve, rest_elongation, rest_signals, shared_coefficients,
)  # fmt: skip
from cable_envs.plants.circuit.parameters import CIRCUIT, SIDES
from cable_envs.plants.circuit.statics import Statics
from cable_envs.physics.chain import (
    CONTACTS, LENGTH, PASSES, PENDING, RELEASE, ROWS_P as SIDE_P, ROWS_S as SIDE_S, ROWS_X as SIDE_X, SPANS, STATE,
    STRETCH, T, TANGENT_0, TANGENT_4, relax, settle, stretch_ends, sweep,
)  # fmt: skip
from cable_envs.effects import Layout
from cable_envs.effects.own import own_actuate, own_load
from cable_envs.effects.rows import (
    CREEP, CREEP_T, CREEP_TIME, DRIFT, HARDENING, PLAY, PLAYED, ROWS_E, ROWS_S as ROWS_H,
)  # fmt: skip
from cable_envs.effects.rows import WORN as WORN_STATE
from cable_envs.effects.seams import (
    FOLLOWS, ROWS_G as SHARED_G, TARGET, actuate, begin, dry_friction, end,
)  # fmt: skip
from cable_envs.effects.viscoelastic_creep import crept, kept
from cable_envs.physics.friction import stick_slip_step
from cable_envs.core.kernels import LANES, inline, jit, load, maximum, minimum, select, store, tile
from cable_envs.plants.base import COMMAND, INPUTS, Plant, Signal

_CHAIN = tuple(
    signal
    for side in SIDES
    for signal in (
        *(Signal(f"stretch_{side}_{j}", "N m", f"EA times the elongation of span {j}, cable {side[0]}")
          for j in range(SPANS)),
        *(Signal(f"slip_{side}_{k}", "1", f"contact {k}, cable {side[0]}: 1 slides to the drive, -1 to the output")
          for k in range(1, CONTACTS + 1)),
    )
)  # fmt: skip
FIRST_X, LAST = len(SIGNALS), STATE + CONTACTS - 1  # row of a side's contact next to the output
D_IN, D_OUT, SLID = 2 * SIDE_S, 2 * SIDE_S + 1, 2 * SIDE_S + 2
ROWS_X, ROWS_P, ROWS_S, ROWS_U = FIRST_X + 2 * SIDE_X, SHARED + 2 * SIDE_P, 2 * SIDE_S + 4, len(INPUTS)
S_T, S_B = 0, SIDE_S

WORN_RATIO, PLAIN_LENGTH = ROWS_E, ROWS_E + 2 * CONTACTS
TILE_E = PLAIN_LENGTH + 2 * SPANS
LAYOUT = Layout("pulley_chain", CIRCUIT, worn=TILE_E - ROWS_E)
TURN, TURNS = range(SHARED_G, SHARED_G + 2)
ROWS_G = SHARED_G + 2
STEP_ANGLE, STEP_RATE = 1e-7, 1e-6
"""Effects: behind their rows the tension ratios with all friction drifted and the lengths of the spans without tension;
in g the pulley's turn since the last equilibrium and how it turns with the drive. The
steps of the differences that give the slopes of a user's own load are in rad and rad/s.
In what follows e, h (their states) and g are None without effects."""


@inline
def _wind(x, p, e, h, g, i, step, more):
    """How the driving pulley turns to the place where the next equilibrium is taken."""
    if e is not None:
        angle = x[THETA_IN, i] + more * x[V_IN, i]
        c = SHARED
        most = (p[EA5, i] + p[C5, i] / step) * p[GEAR, i] * p[R0, i]
        slope = most * (1.0 / p[c, i] + 1.0 / p[c + SIDE_P, i])  # as steep as it can be: a softer one overshoots
        offset, turns, inside = pulley(e, h, i, angle, x[M_IN, i], slope)
        g[TURN, i], g[TURNS, i] = angle + offset - h[PLAYED, i], turns
        h[PLAYED, i], h[PLAY, i] = angle + offset, inside


@inline
def _soften(x, p, e, i, side):
    """The spans' secant lengths for the stretch that they have."""
    if e is not None:
        q, c, hard = FIRST_X + side * SIDE_X, SHARED + side * SIDE_P, e[HARDENING, i]
        for j in range(SPANS):
            length = e[PLAIN_LENGTH + side * SPANS + j, i]
            secant = length / (1.0 + 0.5 * hard * maximum(x[q + j, i] / length, 0.0))
            p[c + j, i] = select(hard > 0.0, secant, p[c + j, i])


@inline
def _creep(x, p, e, h, i, side, step):
    """Creep of a side over a step, from its mean elongation; each span loses stretch by its share of the length."""
    if e is not None:
        q, first = FIRST_X + side * SIDE_X, PLAIN_LENGTH + side * SPANS
        total, length = 0.0, 0.0
        for j in range(SPANS):
            total += x[q + j, i]
            length += e[first + j, i]
        preload = select(side == 0, p[PRE_T, i], p[PRE_B, i])
        old = h[CREEP_T + side, i]
        new = crept(old, e[CREEP, i], maximum(total, 0.0) - preload, kept(e[CREEP_TIME, i], step))
        h[CREEP_T + side, i] = new
        for j in range(SPANS):
            x[q + j, i] -= (new - old) * e[first + j, i] / length


@inline
def _worn(p, e, h, i):
    """Friction that has drifted: the ratios go in a straight line to those of the final friction."""
    if e is not None:
        d = select(e[DRIFT, i] != 0.0, h[WORN_STATE, i], 0.0)
        for side in range(2):
            c = SHARED + side * SIDE_P + SPANS
            for k in range(CONTACTS):
                final = e[WORN_RATIO + side * CONTACTS + k, i]
                ratio = p[c + k, i] + d * (final - p[c + k, i])
                p[c + k, i] = select(d > 0.0, ratio, p[c + k, i])
                p[c + CONTACTS + k, i] = select(d > 0.0, 1.0 / ratio, p[c + CONTACTS + k, i])


@inline
def _move_ends(x, p, s, e, g, i, side, step, more):
    """Wind a side's two ends by the motion since its last equilibrium and ``more`` seconds at the present speeds."""
    turn_in = p[EA5, i] * p[GEAR, i] * (s[D_IN, i] + more * x[V_IN, i])
    if e is not None:
        other = moves_otherwise(e, i) | (g[FOLLOWS, i] > 0.5)
        turn_in = select(other, p[EA5, i] * p[GEAR, i] * g[TURN, i], turn_in)
    turn_out = p[EA5, i] * (s[D_OUT, i] + more * x[V_OUT, i])
    pull = 1.0 - 2.0 * side
    eta = p[C5, i] / (p[EA5, i] * step)
    stretch_ends(x, s, i, FIRST_X + side * SIDE_X, side * SIDE_S, pull * turn_in, -pull * turn_out, eta)


@inline
def _take_over(x, p, s, i, side, step):
    """Stretches of a side's new equilibrium; whether its slip front has reached the output."""
    q, r = FIRST_X + side * SIDE_X, side * SIDE_S
    settle(x, p, s, i, q, SHARED + side * SIDE_P, r, p[C5, i] / (p[EA5, i] * step))
    slack = select(s[r + T + 4, i] <= 0.0, 1.0, 0.0)
    s[SLID + side, i] = maximum(s[SLID + side, i], maximum(abs(x[q + LAST, i]), slack))


@inline
def _equilibrium(x, p, s, e, h, g, lanes, side, step, more):
    """Move the ends of one side of a tile and solve: active-set passes until no column changes."""
    q, c, r = FIRST_X + side * SIDE_X, SHARED + side * SIDE_P, side * SIDE_S
    for i in range(lanes):
        _soften(x, p, e, i, side)
        _move_ends(x, p, s, e, g, i, side, step, more)
    changed = 1
    for _ in range(PASSES):
        if changed:
            changed = 0
            for i in range(lanes):
                changed |= relax(x, p, s, i, q, c, r)
    if changed:
        for i in range(lanes):
            if s[r + PENDING, i] > 0.5:
                sweep(x, p, s, i, q, c, r)
    for i in range(lanes):
        _take_over(x, p, s, i, side, step)
        _creep(x, p, e, h, i, side, step)


@inline
def _watch(x, p, s, e, i):
    """What the control step has seen of the tensions."""
    if e is not None:
        x[M_IN, i] = p[R0, i] * (s[S_T + T, i] - s[S_B + T, i])
    t0, t4 = s[S_T + T, i], s[S_T + T + 4, i]
    b0, b4 = s[S_B + T, i], s[S_B + T + 4, i]
    x[SLACK, i] += select(minimum(t0, b0) <= 0.0, 1.0, 0.0)
    x[PEAK, i] = maximum(maximum(maximum(t0, t4), maximum(b0, b4)), x[PEAK, i])


@inline
def _kick(x, p, u, s, e, h, g, i, dt):
    """Velocities of drive and output from the tensions in the middle of the step; its second half of motion."""
    v_in, v = x[V_IN, i], x[V_OUT, i]
    r5, ea_in, ea_out = p[R5, i], p[EA5, i] * p[GEAR, i] * p[R0, i], p[EA5, i] * p[R5, i]
    late = p[C5, i] / p[EA5, i]
    torque = p[R0, i] * (s[S_T + T, i] - s[S_B + T, i])
    tangent = ea_in * (s[S_T + TANGENT_0, i] + s[S_B + TANGENT_0, i])
    if e is not None:
        torque, tangent = g[TURNS, i] * torque, g[TURNS, i] * tangent
    v_in_new = drive_step(x, p, u, g, i, torque, tangent, late * tangent, dt)

    half = x[THETA_OUT, i] + 0.5 * dt * v
    wanted, load_k, load_c = load_torque(p, u, i, half, v, cosine(half))
    if e is not None:
        tension = s[S_T + T + 4, i] + s[S_B + T + 4, i]
        dry_friction(e, g, i, v, p[BRAKE, i], r5 * tension)
        wanted, load_k = spring(e, i, half, wanted, load_k)
        at = own_load(half, v, tension, e, i)
        k = (own_load(half + STEP_ANGLE, v, tension, e, i) - at) / STEP_ANGLE
        c = (own_load(half, v + STEP_RATE, tension, e, i) - at) / STEP_RATE
        wanted, load_k, load_c = wanted + at, load_k + maximum(k, 0.0), load_c + maximum(c, 0.0)
    net = r5 * (s[S_T + T + 4, i] - s[S_B + T + 4, i]) - wanted
    tangent = ea_out * (s[S_T + TANGENT_4, i] + s[S_B + TANGENT_4, i])
    stiffness, damping = tangent + load_k, late * tangent + load_c
    net += 0.5 * dt * stiffness * v  # the forces are those of the predicted middle already
    if e is not None:
        v_new = output_step(e, h, g, i, v, p[J_OUT, i], net, net, 0.0, 0.0, stiffness, damping, damping, dt)
    else:
        v_new = stick_slip_step(v, p[J_OUT, i], net - p[BRAKE, i], net + p[BRAKE, i], stiffness, damping, damping, dt)

    x[THETA_IN, i] += 0.5 * dt * (v_in + v_in_new)
    x[THETA_OUT, i] += 0.5 * dt * (v + v_new)
    x[V_IN, i], x[V_OUT, i] = v_in_new, v_new
    s[D_IN, i], s[D_OUT, i] = 0.5 * dt * v_in_new, 0.5 * dt * v_new
    if e is not None:
        x[THETA_IN, i] = select(g[FOLLOWS, i] > 0.5, g[TARGET, i], x[THETA_IN, i])


@inline
def _report(x, p, s, i):
    t0, t4 = s[S_T + T, i], s[S_T + T + 4, i]
    b0, b4 = s[S_B + T, i], s[S_B + T + 4, i]
    x[T01_T, i], x[T45_T, i], x[T01_B, i], x[T45_B, i] = t0, t4, b0, b4
    x[M_IN, i] = p[R0, i] * (t0 - b0)
    x[M_OUT, i] = p[R5, i] * (t4 - b4)
    x[OUT_OF_RANGE, i] = select(minimum(t0, b0) <= 0.0, 1.0, 0.0)
    arrived = s[SLID, i] + s[SLID + 1, i]
    x[PHASE, i] = select(abs(x[V_IN, i]) > STILL, 1.0 + arrived, select(arrived > 1.5, 3.0, 0.0))


@inline
def _resolve(p, i, dt):
    """`circuit_ends.resolve` with the stiffness of the whole cables and a quarter of that of the end spans alone.

    All of the end spans' would be too careful: they are this stiff only until their contact slides.
    """
    per_in, per_out = 0.0, 0.0
    for side in range(2):
        c = SHARED + side * SIDE_P
        whole = 1.0 / (p[c, i] + p[c + 1, i] + p[c + 2, i] + p[c + 3, i] + p[c + 4, i])
        per_in += whole + 0.25 / p[c, i]
        per_out += whole + 0.25 / p[c + 4, i]
    turn = p[EA5, i] * p[GEAR, i] * p[R0, i]
    resolve(p, i, turn * per_in, p[EA5, i] * p[R5, i] * per_out + p[CONTACT_K, i], dt)


@inline
def _advance_tile(x, p, u, s, e, h, g, lanes, substeps, dt):
    for i in range(lanes):
        _worn(p, e, h, i)
        _resolve(p, i, dt)
        x[SLACK, i], x[PEAK, i] = 0.0, 0.0
        s[SLID, i], s[SLID + 1, i] = 0.0, 0.0
        s[D_IN, i], s[D_OUT, i] = 0.0, 0.0
        if e is not None:
            begin(e, h, g, u, i, x[THETA_IN, i], x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i], substeps * dt, dt)
    for n in range(substeps + 1):
        step = 0.5 * dt if (n == 0) | (n == substeps) else dt
        more = 0.5 * dt if n < substeps else 0.0
        for i in range(lanes):
            _wind(x, p, e, h, g, i, step, more)
        for side in range(2):
            _equilibrium(x, p, s, e, h, g, lanes, side, step, more)
        for i in range(lanes):
            _watch(x, p, s, e, i)
        if n < substeps:
            for i in range(lanes):
                if e is not None:
                    actuate(e, h, g, u, i, n, substeps, dt)
                    u[COMMAND, i] = own_actuate(u[COMMAND, i], e, i)
                _kick(x, p, u, s, e, h, g, i, dt)
    for i in range(lanes):
        x[SLACK, i] /= substeps + 1.0
        _report(x, p, s, i)
        if e is not None:
            end(e, h, g, i, x[THETA_OUT, i], substeps * dt)


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; without effects."""
    xt, pt, ut, st = tile(ROWS_X), tile(ROWS_P), tile(ROWS_U), tile(ROWS_S)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:ROWS_X], first, lanes)
        load(pt, p[:ROWS_P], first, lanes)
        load(ut, u, first, lanes)
        _advance_tile(xt, pt, ut, st, None, None, None, lanes, substeps, dt)
        store(xt, x[:ROWS_X], first, lanes)


@jit
def advance_with_effects(x, p, u, lo, hi, substeps, dt):
    """The same with effects; x and p have their rows."""
    xt, pt, ut, st = tile(ROWS_X), tile(ROWS_P), tile(ROWS_U), tile(ROWS_S)
    et, ht, gt = tile(TILE_E), tile(ROWS_H), tile(ROWS_G)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:ROWS_X], first, lanes)
        load(pt, p[:ROWS_P], first, lanes)
        load(ut, u, first, lanes)
        load(et, p[ROWS_P : ROWS_P + TILE_E], first, lanes)
        load(ht, x[ROWS_X:], first, lanes)
        _advance_tile(xt, pt, ut, st, et, ht, gt, lanes, substeps, dt)
        store(xt, x[:ROWS_X], first, lanes)
        store(ht, x[ROWS_X:], first, lanes)


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows [len(PLANT.coefficients), n] of parameter columns [len(CIRCUIT), n].

    Columns of the whole `PLANT.table` give the rows of the effects too.
    """
    if len(values) == len(CIRCUIT):
        return _prepare(values, None)
    e = LAYOUT.coefficients(values[len(CIRCUIT) :])
    p = np.concatenate([_prepare(values, e), e])
    drifting = np.flatnonzero(e[DRIFT])
    if drifting.size:
        final = values[:, drifting].copy()
        final[CIRCUIT.index("cable_friction")] *= 1.0 + e[DRIFT, drifting]
        final[CIRCUIT.index("shaft_friction")] *= 1.0 + e[DRIFT, drifting]
        ratio = Statics.from_values(final).ratio.reshape(2 * CONTACTS, -1)
        p[ROWS_P + WORN_RATIO : ROWS_P + WORN_RATIO + 2 * CONTACTS, drifting] = ratio
    for side in range(2):
        first = ROWS_P + PLAIN_LENGTH + side * SPANS
        p[first : first + SPANS] = p[SHARED + side * SIDE_P : SHARED + side * SIDE_P + SPANS]
    return np.ascontiguousarray(p)


def _prepare(values: np.ndarray, effects: np.ndarray | None) -> np.ndarray:
    statics = Statics.from_values(values)
    arc = statics.radius * statics.integral / (1.0 + statics.ratio)
    length = statics.span.copy()
    length[:, :-1] += arc
    length[:, 1:] += arc
    before, after = length[:, :-1], length[:, 1:]
    small = RELEASE * before * after / (before + after)
    sides = [np.concatenate([length[k], statics.ratio[k], 1.0 / statics.ratio[k], small[k]]) for k in range(2)]
    return np.ascontiguousarray(np.concatenate([shared_coefficients(values, statics, effects), *sides]))


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(PLANT.signals), n] at rest with the output at ``position`` (rad, [n]), its load balanced."""
    position = np.asarray(position, dtype=np.float64)
    length = [p[c + LENGTH : c + LENGTH + SPANS] for c in (SHARED, SHARED + SIDE_P)]
    e = effect_rows(p, ROWS_P)
    elongation, top, bottom = rest_elongation(p, length[0].sum(axis=0), length[1].sum(axis=0), position, e)
    x = rest_signals(p, ROWS_X, ROWS_P, position, elongation, top, bottom)
    stretch = p[EA5] * elongation
    for side, tension, total in ((0, top, p[PRE_T] + stretch), (1, bottom, p[PRE_B] - stretch)):
        q = FIRST_X + side * SIDE_X + STRETCH
        linear = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * e[HARDENING] * tension))
        x[q : q + SPANS] = linear * length[side]
        x[q] += np.minimum(total, 0.0)  # a slack side: the missing stretch
    return x


PLANT = Plant(
    name="pulley_chain",
    parameters=CIRCUIT,
    coefficients=(
        *COEFFICIENTS,
        *(f"{name}_{side}_{k}" for side in SIDES
          for name, first in (("length", 0), ("ratio", 1), ("inverse", 1), ("small", 1))
          for k in range(first, SPANS)),
    ),
    signals=SIGNALS + _CHAIN,
    action_modes=ACTION_MODES,
    prepare=prepare,
    rest=rest,
    kernels=(advance, advance_with_effects),
    effects=LAYOUT,
)  # fmt: skip
