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

import numpy as np  # noqa: I001 (the block below: one name a line would fill the screen)

from cable_envs.circuit_ends import (
    ACTION_MODES, B_OUT, BRAKE, C5, COEFFICIENTS, CONTACT_D, CONTACT_K, EA5, GEAR, J_OUT, M_IN, M_OUT, OUT_OF_RANGE,
    PEAK, PHASE, PRE_B, PRE_T, R0, R5, SHARED, SIGNALS, SLACK, STILL, T01_B, T01_T, T45_B, T45_T, THETA_IN, THETA_OUT,
    V_IN, V_OUT, any_payload, cosine, drive_step, load_torque, resolve, rest_elongation, rest_signals,
    shared_coefficients,
)  # fmt: skip
from cable_envs.circuit_parameters import CIRCUIT
from cable_envs.circuit_statics import Statics
from cable_envs.friction import stick_slip_step
from cable_envs.kernels import LANES, clip, inline, jit, load, maximum, minimum, select, store, tile
from cable_envs.plants.base import INPUTS, Plant

_OWN = (
    "drive_top_ccw", "drive_bottom_ccw", "drive_top_cw", "drive_bottom_cw",
    "output_top_ccw", "output_bottom_ccw", "output_top_cw", "output_bottom_cw",
    "drive_stiffness", "drive_slope", "load_stiffness", "output_slope", "hold_rule", "length_top",
    "length_bottom",
)  # fmt: skip
(DT1, DB1, DT2, DB2, OT1, OB1, OT2, OB2, K_IN, C_TURN, K_OUT, SWING, HOLD, LENGTH_T,
 LENGTH_B) = range(SHARED, SHARED + len(_OWN))  # fmt: skip
ROWS_P, ROWS_X, ROWS_U = SHARED + len(_OWN), len(SIGNALS), len(INPUTS)
GAIN, TILE_P = ROWS_P, ROWS_P + 1  # one more row in the tile, which depends on dt
D, RATE, WANTED, LOAD_K, LOAD_C, LEVEL = range(6)
ROWS_W = 6
"""Rows of the scratch tile w: elongation angle, its rate and the load's torque, stiffness and damping at the middle of
the step; cosine of the output angle (0 where no column of the block has a payload)."""


@inline
def _stretched(p, i, d, rate):
    """(T kappa of t, T kappa of b), N m: what both directions divide by their kappas; zero when slack.  Z39-41."""
    top = p[PRE_T, i] + p[EA5, i] * d
    bottom = p[PRE_B, i] - p[EA5, i] * d
    damped = p[C5, i] * rate
    return (
        select(top <= 0.0, 0.0, maximum(top + damped, 0.0)),  # so written, a NaN passes on
        select(bottom <= 0.0, 0.0, maximum(bottom - damped, 0.0)),
    )


@inline
def _output_torques(p, i, top, bottom):
    """(M_out ccw, M_out cw).  Z35."""
    r5 = p[R5, i]
    return r5 * (top * p[OT1, i] - bottom * p[OB1, i]), r5 * (top * p[OT2, i] - bottom * p[OB2, i])


@inline
def _share(v, ccw, cw, wanted):
    """Share of the cw branch: 0 moving ccw, 1 moving cw, at rest the one that balances ``wanted``."""
    stuck = clip((wanted - ccw) / maximum(cw - ccw, 1e-12), 0.0, 1.0)
    return select(v > 0.0, 0.0, select(v < 0.0, 1.0, stuck))


@inline
def _mix(share, a, b):
    return a + share * (b - a)


@inline
def _drive_torque(p, i, top, bottom, share):
    """M_in.  Z32."""
    return p[R0, i] * (top * _mix(share, p[DT1, i], p[DT2, i]) - bottom * _mix(share, p[DB1, i], p[DB2, i]))


@inline
def _held_by_flag(p, i, v_in, top, bottom):
    """True where Z47 (with its lost minus) holds the output: `circuit_statics.hold_flag` on the drive's branch."""
    share = select(v_in > 0.0, 0.0, 1.0)
    m_in = _drive_torque(p, i, top, bottom, share)
    m_out = top * _mix(share, p[OT1, i], p[OT2, i]) - bottom * _mix(share, p[OB1, i], p[OB2, i])
    return (p[HOLD, i] > 0.5) & (v_in * m_in < 0.0) & (v_in * m_out < 0.0)


@inline
def _drive_part(x, p, u, w, i, dt):
    """The drive's step, against what the cables pull at the predicted middle of it."""
    gear = p[GEAR, i]
    a, v_in, b, v = x[THETA_IN, i], x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i]
    half = b + 0.5 * dt * v
    wanted, load_k, load_c = load_torque(p, u, i, half, v, w[LEVEL, i])
    d, rate = gear * (a + 0.5 * dt * v_in) - half, gear * v_in - v
    top, bottom = _stretched(p, i, d, rate)
    ccw, cw = _output_torques(p, i, top, bottom)
    share = _share(v, ccw, cw, wanted)
    late = 0.5 * p[C5, i] * _guess(p, i, v, ccw - wanted, cw - wanted)
    m_in = _drive_torque(p, i, maximum(top - late, 0.0), bottom + select(bottom > 0.0, late, 0.0), share)
    new = drive_step(x, p, u, i, m_in, p[K_IN, i], p[C5, i] * p[C_TURN, i], dt)
    change = 0.5 * (new - v_in)
    w[D, i], w[RATE, i] = d + 0.5 * dt * gear * change, rate + gear * change
    w[WANTED, i], w[LOAD_K, i], w[LOAD_C, i] = wanted, load_k, load_c
    x[THETA_IN, i], x[V_IN, i] = a + 0.5 * dt * (v_in + new), new


@inline
def _output_part(x, p, w, i, dt):
    """The output's step, with the drive's motion known."""
    v = x[V_OUT, i]
    top, bottom = _stretched(p, i, w[D, i], w[RATE, i])
    new = _output_step(p, i, v, top, bottom, w[WANTED, i], w[LOAD_K, i], w[LOAD_C, i], dt)
    new = select(_held_by_flag(p, i, x[V_IN, i], top, bottom), 0.0, new)
    x[THETA_OUT, i], x[V_OUT, i] = x[THETA_OUT, i] + 0.5 * dt * (v + new), new


@inline
def _guess(p, i, v, up, down):
    """Change of the output's velocity in the step, roughly: the drive feels half of it through the cables' damping."""
    up, down = up - p[BRAKE, i], down + p[BRAKE, i]
    net = select(v > 0.0, up, select(v < 0.0, down, maximum(up, 0.0) + minimum(down, 0.0)))
    return p[GAIN, i] * net


@inline
def _output_step(p, i, v, top, bottom, wanted, load_k, load_c, dt):
    """Output velocity after dt, from the stretches and the load at the predicted middle of the step."""
    r5 = p[R5, i]
    ccw, cw = _output_torques(p, i, top, bottom)
    up, down = ccw - wanted - p[BRAKE, i], cw - wanted + p[BRAKE, i]
    taut_t, taut_b = select(top > 0.0, r5, 0.0), select(bottom > 0.0, r5, 0.0)
    slope_up = taut_t * p[OT1, i] + taut_b * p[OB1, i]
    slope_down = taut_t * p[OT2, i] + taut_b * p[OB2, i]
    slope = select(select(v == 0.0, up, v) > 0.0, slope_up, slope_down)
    stiffness = p[EA5, i] * slope + load_k
    ahead = 0.5 * dt * stiffness * v  # what the step subtracts: these forces are those of the middle already
    return stick_slip_step(
        v, p[J_OUT, i], up + ahead, down + ahead, stiffness,
        p[C5, i] * slope_up + load_c, p[C5, i] * slope_down + load_c, dt,
    )  # fmt: skip


@inline
def _report(x, p, u, i, level):
    """Torques and tensions of the new state; ``level``: cosine of the output angle."""
    v_in, b, v = x[V_IN, i], x[THETA_OUT, i], x[V_OUT, i]
    top, bottom = _stretched(p, i, p[GEAR, i] * x[THETA_IN, i] - b, p[GEAR, i] * v_in - v)
    wanted, _, _ = load_torque(p, u, i, b, v, level)
    ccw, cw = _output_torques(p, i, top, bottom)
    share = _share(v, ccw, cw, wanted)
    t01_t, t01_b = top * _mix(share, p[DT1, i], p[DT2, i]), bottom * _mix(share, p[DB1, i], p[DB2, i])
    t45_t, t45_b = top * _mix(share, p[OT1, i], p[OT2, i]), bottom * _mix(share, p[OB1, i], p[OB2, i])
    x[T01_T, i], x[T01_B, i], x[T45_T, i], x[T45_B, i] = t01_t, t01_b, t45_t, t45_b
    x[M_IN, i] = p[R0, i] * (t01_t - t01_b)
    x[M_OUT, i] = p[R5, i] * (t45_t - t45_b)
    slack = select(minimum(top, bottom) <= 0.0, 1.0, 0.0)
    x[OUT_OF_RANGE, i] = slack
    x[SLACK, i] += slack
    x[PEAK, i] = maximum(maximum(maximum(t01_t, t45_t), maximum(t01_b, t45_b)), x[PEAK, i])
    x[PHASE, i] = select(v != 0.0, 3.0, select(abs(v_in) > STILL, 1.0, 0.0))


@inline
def _begin(x, p, w, i, dt):
    x[SLACK, i] = 0.0
    x[PEAK, i] = 0.0
    w[LEVEL, i] = 0.0
    resolve(p, i, p[K_IN, i], p[K_OUT, i], dt)
    c_out = p[C5, i] * p[SWING, i] + p[B_OUT, i] + p[CONTACT_D, i]
    p[GAIN, i] = dt / (p[J_OUT, i] + 0.5 * dt * c_out + 0.25 * dt * dt * p[K_OUT, i])


@inline
def _substeps(x, p, u, w, lanes, substeps, dt):
    """A block of columns, in short loops: so the processor works on several columns at once (see cable_hole)."""
    payload = any_payload(p, lanes)
    for i in range(lanes):
        _begin(x, p, w, i, dt)
    for _ in range(substeps):
        if payload:
            for i in range(lanes):
                w[LEVEL, i] = cosine(x[THETA_OUT, i] + 0.5 * dt * x[V_OUT, i])
        for i in range(lanes):
            _drive_part(x, p, u, w, i, dt)
        for i in range(lanes):
            _output_part(x, p, w, i, dt)
        if payload:
            for i in range(lanes):
                w[LEVEL, i] = cosine(x[THETA_OUT, i])
        for i in range(lanes):
            _report(x, p, u, i, w[LEVEL, i])
    for i in range(lanes):
        x[SLACK, i] /= substeps


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place."""
    xt, pt, ut, wt = tile(ROWS_X), tile(TILE_P), tile(ROWS_U), tile(ROWS_W)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x, first, lanes)
        load(pt, p, first, lanes)
        load(ut, u, first, lanes)
        _substeps(xt, pt, ut, wt, lanes, substeps, dt)
        store(xt, x, first, lanes)


@jit
def _refresh(x, p):
    """What the kernel reports for states at rest without a disturbance."""
    u = np.zeros((ROWS_U, x.shape[1]))
    for i in range(x.shape[1]):
        x[SLACK, i] = 0.0
        _report(x, p, u, i, cosine(x[THETA_OUT, i]))


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows [len(PLANT.coefficients), n] of parameter columns [len(CIRCUIT), n]."""
    statics = Statics.from_values(values)
    shared = shared_coefficients(values, statics)
    per_t, per_b = 1.0 / statics.kappa[:, 0], 1.0 / statics.kappa[:, 1]
    k_t, k_b = statics.product
    turn = statics.drive_radius * shared[GEAR] * (per_t + per_b).max(axis=0)
    swing = statics.output_radius * np.maximum(per_t[0] / k_t + per_b[0] * k_b, per_t[1] * k_t + per_b[1] / k_b)
    own = np.array([
        per_t[0], per_b[0], per_t[1], per_b[1],
        per_t[0] / k_t, per_b[0] * k_b, per_t[1] * k_t, per_b[1] / k_b,
        1.5 * shared[EA5] * turn,  # in the hold M_in is steeper than on a branch; too much costs no accuracy
        turn, shared[EA5] * swing + shared[CONTACT_K], swing,
        values[CIRCUIT.index("hold_rule")], *statics.length,
    ])  # fmt: skip
    return np.ascontiguousarray(np.concatenate([shared, own]))


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(PLANT.signals), n] at rest with the output at ``position`` (rad, [n]), its load balanced.

    D is that of equal tensions along each cable, inside the hold; torques and tensions are the kernel's for that D.
    """
    position = np.asarray(position, dtype=np.float64)
    x = rest_signals(p, ROWS_X, position, *rest_elongation(p, p[LENGTH_T], p[LENGTH_B], position))
    _refresh(x, p)
    return x


PLANT = Plant(
    name="pulley_circuit",
    parameters=CIRCUIT,
    coefficients=COEFFICIENTS + _OWN,
    signals=SIGNALS,
    action_modes=ACTION_MODES,
    prepare=prepare,
    rest=rest,
    advance=advance,
)
