"""Scalar pieces of the analytic circuit's kernel: its two branches, their mixture at rest, the output's step.

`circuit.closed_form` has the equations and the symbols, and the pieces into which a user's effects are
put. In what follows e, s and g are None without effects: what asks for them is then left out before anything is
compiled.
"""

import numpy as np  # noqa: I001 (the blocks below: one name a line would fill the screen)

from cable_envs.plants.circuit.effects import output_step, rise
from cable_envs.plants.circuit.ends import (
    BRAKE, B_OUT, C5, CONTACT_D, CONTACT_K, EA5, GEAR, J_OUT, PEAK, R0, R5, SHARED, SLACK, T01_B, T01_T, resolve,
    shared_coefficients,
)  # fmt: skip
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.statics import Statics
from cable_envs.effects.presliding_hysteresis import share as share_of
from cable_envs.effects.rows import DRIFT, PARTIAL, PARTIAL_0, ROWS_E, STARTED, WORN
from cable_envs.effects.seams import DOWN, UP
from cable_envs.physics.friction import stick_slip_step
from cable_envs.core.kernels import clip, inline, maximum, minimum, select

OWN = (
    "drive_top_ccw", "drive_bottom_ccw", "drive_top_cw", "drive_bottom_cw",
    "output_top_ccw", "output_bottom_ccw", "output_top_cw", "output_bottom_cw",
    "drive_stiffness", "drive_slope", "load_stiffness", "output_slope", "hold_rule", "length_top",
    "length_bottom",
)  # fmt: skip
(DT1, DB1, DT2, DB2, OT1, OB1, OT2, OB2, K_IN, C_TURN, K_OUT, SWING, HOLD, LENGTH_T,
 LENGTH_B) = range(SHARED, SHARED + len(OWN))  # fmt: skip
ROWS_P = SHARED + len(OWN)
GAIN, TILE_P = ROWS_P, ROWS_P + 1  # one more row in the tile, which depends on dt
BRANCHES = 8
"""The rows DT1 .. OB2; behind those of the effects they come again, with all friction drifted."""

D, RATE, WANTED, LOAD_K, LOAD_C, LEVEL, OFFSET, TURNS = range(8)
ROWS_W = 8
"""Rows of the scratch tile w: elongation angle, its rate and the load's torque, stiffness and damping at the middle of
the step; cosine of the output angle (0 where no column of the block has a payload); with effects the pulley's angle
less the drive's, and how it turns with it."""


@inline
def output_torques(p, i, top, bottom):
    """(M_out ccw, M_out cw).  Z35."""
    r5 = p[R5, i]
    return r5 * (top * p[OT1, i] - bottom * p[OB1, i]), r5 * (top * p[OT2, i] - bottom * p[OB2, i])


@inline
def cw_share(v, ccw, cw, wanted):
    """Share of the cw branch: 0 moving ccw, 1 moving cw, at rest the one that balances ``wanted``."""
    stuck = clip((wanted - ccw) / maximum(cw - ccw, 1e-12), 0.0, 1.0)
    return select(v > 0.0, 0.0, select(v < 0.0, 1.0, stuck))


@inline
def share_with(e, s, i, share):
    """The share where the idlers' friction turns round over an angle."""
    if e is not None:
        turned = select(s[STARTED, i] > 0.5, 1.0 - share_of(s, PARTIAL_0, i), share)
        share = select(e[PARTIAL, i] > 0.0, turned, share)
    return share


@inline
def mix(share, a, b):
    return a + share * (b - a)


@inline
def drive_torque(p, i, top, bottom, share):
    """M_in.  Z32."""
    return p[R0, i] * (top * mix(share, p[DT1, i], p[DT2, i]) - bottom * mix(share, p[DB1, i], p[DB2, i]))


@inline
def held_by_flag(p, i, v_in, top, bottom):
    """True where Z47 (with its lost minus) holds the output: `circuit_statics.hold_flag` on the drive's branch."""
    share = select(v_in > 0.0, 0.0, 1.0)
    m_in = drive_torque(p, i, top, bottom, share)
    m_out = top * mix(share, p[OT1, i], p[OT2, i]) - bottom * mix(share, p[OB1, i], p[OB2, i])
    return (p[HOLD, i] > 0.5) & (v_in * m_in < 0.0) & (v_in * m_out < 0.0)


@inline
def steepest(x, p, e, i):
    """Slope of M_in over the pulley's angle, not less than it is anywhere."""
    return p[K_IN, i] * rise(e, i, maximum(x[T01_T, i], x[T01_B, i]))


@inline
def guess(p, g, i, v, up, down):
    """Change of the output's velocity in the step, roughly: the drive feels half of it through the cables' damping."""
    if g is not None:
        up, down = up - g[UP, i], down + g[DOWN, i]
    else:
        up, down = up - p[BRAKE, i], down + p[BRAKE, i]
    net = select(v > 0.0, up, select(v < 0.0, down, maximum(up, 0.0) + minimum(down, 0.0)))
    return p[GAIN, i] * net


@inline
def output_velocity(p, e, s, g, i, v, top, bottom, wanted, load_k, load_c, dt):
    """Output velocity after dt, from the stretches and the load at the predicted middle of the step."""
    r5 = p[R5, i]
    ccw, cw = output_torques(p, i, top, bottom)
    up, down = ccw - wanted - p[BRAKE, i], cw - wanted + p[BRAKE, i]
    taut_t, taut_b = select(top > 0.0, r5, 0.0), select(bottom > 0.0, r5, 0.0)
    slope_up = taut_t * p[OT1, i] + taut_b * p[OB1, i]
    slope_down = taut_t * p[OT2, i] + taut_b * p[OB2, i]
    if e is not None:
        hard = rise(e, i, maximum(top / p[LENGTH_T, i], bottom / p[LENGTH_B, i]))
        slope_up, slope_down = slope_up * hard, slope_down * hard
        up, down = ccw - wanted - g[UP, i], cw - wanted + g[DOWN, i]
    slope = select(select(v == 0.0, up, v) > 0.0, slope_up, slope_down)
    stiffness = p[EA5, i] * slope + load_k
    ahead = 0.5 * dt * stiffness * v  # what the step subtracts: these forces are those of the middle already
    if e is not None:
        return output_step(
            e, s, g, i, v, p[J_OUT, i], ccw, cw, wanted, ahead, stiffness,
            p[C5, i] * slope_up + load_c, p[C5, i] * slope_down + load_c, dt,
        )  # fmt: skip
    return stick_slip_step(
        v, p[J_OUT, i], up + ahead, down + ahead, stiffness,
        p[C5, i] * slope_up + load_c, p[C5, i] * slope_down + load_c, dt,
    )  # fmt: skip


@inline
def worn(p, e, s, i):
    """Friction that has drifted: the branches go in a straight line to those of the final friction."""
    if e is not None:
        d = select(e[DRIFT, i] != 0.0, s[WORN, i], 0.0)
        for k in range(BRANCHES):
            final = e[ROWS_E + k, i]
            p[DT1 + k, i] = select(d > 0.0, p[DT1 + k, i] + d * (final - p[DT1 + k, i]), p[DT1 + k, i])


@inline
def begin_step(x, p, w, e, s, i, dt):
    x[SLACK, i] = 0.0
    x[PEAK, i] = 0.0
    w[LEVEL, i] = 0.0
    worn(p, e, s, i)
    resolve(p, i, p[K_IN, i], p[K_OUT, i], dt)
    c_out = p[C5, i] * p[SWING, i] + p[B_OUT, i] + p[CONTACT_D, i]
    p[GAIN, i] = dt / (p[J_OUT, i] + 0.5 * dt * c_out + 0.25 * dt * dt * p[K_OUT, i])


def coefficients(values: np.ndarray, effects: np.ndarray | None) -> np.ndarray:
    """Rows [ROWS_P, n] of parameter columns of the circuit; ``effects``: coefficient rows of the effects, or None."""
    statics = Statics.from_values(values)
    shared = shared_coefficients(values, statics, effects)
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
