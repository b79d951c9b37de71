"""Scalar pieces of the analytic circuit's kernel: its two branches, their mixture at rest, the output's step.

`circuit.closed_form` has the equations and the symbols, and the pieces into which a user's effects are
put. In what follows e, s and g are None without effects: what asks for them is then left out before anything is
compiled.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.core.kernels import clip, inline, maximum, select
from cable_envs.core.lanes import Lanes
from cable_envs.effects.presliding_hysteresis import share as share_of
from cable_envs.effects.seams import between
from cable_envs.plants.circuit.effects import output_slides, output_step, rise
from cable_envs.plants.circuit.ends import COEFFICIENTS, largest, moving, raised, resolved, shared_coefficients
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.statics import Statics
from cable_envs.plants.peaks import peak_at_start

BRANCHES = (
    "drive_top_ccw", "drive_bottom_ccw", "drive_top_cw", "drive_bottom_cw",
    "output_top_ccw", "output_bottom_ccw", "output_top_cw", "output_bottom_cw",
)  # fmt: skip
"""What the tension times kappa of a cable becomes at either end, moving either way, 1/m: 1/kappa and 1/(kappa K)."""

ROWS = Lanes("Coefficients", [
    *COEFFICIENTS, *BRANCHES, "drive_stiffness", "drive_slope", "load_stiffness", "output_slope", "hold_rule",
    "length_top", "length_bottom",
])  # fmt: skip

WORN = tuple(f"worn_{name}" for name in BRANCHES)
"""Rows behind those of the effects: the branches again, with all friction drifted."""

MIDDLE = Lanes("Middle", [
    "elongation_angle", "elongation_rate",  # D at the middle of the step, rad and rad/s
    "load_torque", "load_stiffness", "load_damping",  # of the load there: N m, N m/rad, N m s
    "level",  # cosine of the output angle; 0 where no column of the block has a payload
    "pulley_offset", "pulley_turns",  # with effects: the pulley's angle less the drive's, and how it turns with it
    "gain",  # change of the output's velocity for one N m in a step, roughly: rad/s
])  # fmt: skip
"""Scratch."""


@inline
def output_torques(p, i, top, bottom):
    """(M_out ccw, M_out cw).  Z35."""
    r5 = p.output_radius[i]
    return r5 * (top * p.output_top_ccw[i] - bottom * p.output_bottom_ccw[i]), r5 * (
        top * p.output_top_cw[i] - bottom * p.output_bottom_cw[i]
    )


@inline
def cw_share(v, ccw, cw, wanted):
    """Share of the cw branch: 0 moving ccw, 1 moving cw, at rest the one that balances ``wanted``."""
    stuck = clip((wanted - ccw) / maximum(cw - ccw, 1e-12), 0.0, 1.0)
    return select(v > 0.0, 0.0, select(v < 0.0, 1.0, stuck))


@inline
def mean_share(v, change, ccw, cw, wanted):
    """Mean of `cw_share` over a step in which the output's speed is to change by ``change``.

    Where it stops within the step, the drive feels the torque of the rest from then on.
    """
    share = cw_share(v, ccw, cw, wanted)
    stops = v * (v + change) < 0.0
    left = 1.0 + v / select(stops, change, 1.0)
    return select(stops, mix(left, share, cw_share(0.0, ccw, cw, wanted)), share)


@inline
def share_with(e, s, g, i, share):
    """The share where the idlers' friction turns round over an angle."""
    if e is not None:
        turned = select(s.started[i] > 0.5, 1.0 - share_of(s.partial, i), share)
        share = between(share, turned, g.idlers_part[i])
    return share


@inline
def mix(share, a, b):
    """From a at share 0 to b at share 1."""
    return a + share * (b - a)


@inline
def drive_torque(p, i, top, bottom, share):
    """M_in.  Z32."""
    return p.drive_radius[i] * (
        top * mix(share, p.drive_top_ccw[i], p.drive_top_cw[i])
        - bottom * mix(share, p.drive_bottom_ccw[i], p.drive_bottom_cw[i])
    )


@inline
def drive_slope(p, i, v, top, bottom, ccw, cw, wanted):
    """Slope of M_in over the drive's angle, N m/rad: on a branch, or at rest where M_out keeps its balance."""
    r0, taut_t, taut_b = p.drive_radius[i], select(top > 0.0, 1.0, 0.0), select(bottom > 0.0, 1.0, 0.0)
    share = cw_share(v, ccw, cw, wanted)
    t, b = p.drive_top_ccw[i], p.drive_bottom_ccw[i]
    more_t, more_b = p.drive_top_cw[i] - t, p.drive_bottom_cw[i] - b
    straight = taut_t * (t + share * more_t) + taut_b * (b + share * more_b)
    out_ccw = taut_t * p.output_top_ccw[i] + taut_b * p.output_bottom_ccw[i]
    out_cw = taut_t * p.output_top_cw[i] + taut_b * p.output_bottom_cw[i]
    grows = -p.output_radius[i] * mix(share, out_ccw, out_cw) / maximum(cw - ccw, 1e-12)
    bends = select((v == 0.0) & (share > 0.0) & (share < 1.0), grows * (top * more_t - bottom * more_b), 0.0)
    return p.stretch_stiffness[i] * p.gear[i] * r0 * maximum(straight + bends, 0.0)


@inline
def held_by_flag(p, i, v_in, top, bottom):
    """True where Z47 (with its lost minus) holds the output: `circuit_statics.hold_flag` on the drive's branch."""
    share = select(v_in > 0.0, 0.0, 1.0)
    m_in = drive_torque(p, i, top, bottom, share)
    m_out = top * mix(share, p.output_top_ccw[i], p.output_top_cw[i]) - bottom * mix(
        share, p.output_bottom_ccw[i], p.output_bottom_cw[i]
    )
    return (p.hold_rule[i] > 0.5) & (v_in * m_in < 0.0) & (v_in * m_out < 0.0)


@inline
def steepest(x, p, e, i):
    """Slope of M_in over the pulley's angle, not less than it is anywhere."""
    return p.drive_stiffness[i] * rise(e, i, maximum(x.tension_drive_top[i], x.tension_drive_bottom[i]))


@inline
def guess(p, w, g, i, v, up, down):
    """Change of the output's velocity in the step, roughly: the drive feels half of it through the cables' damping."""
    if g is not None:
        up, down = up - g.up[i], down + g.down[i]
    else:
        up, down = up - p.brake_torque[i], down + p.brake_torque[i]
    return w.gain[i] * moving(v, up, down)


@inline
def output_velocity(p, e, s, g, i, v, top, bottom, wanted, load_k, load_c, dt, builds):
    """Output velocity after dt, and how far the output falls short of its mean speed where it stops.

    The stretches and the load are those at the predicted middle of the step.
    """
    r5 = p.output_radius[i]
    ccw, cw = output_torques(p, i, top, bottom)
    up, down = ccw - wanted - p.brake_torque[i], cw - wanted + p.brake_torque[i]
    taut_t, taut_b = select(top > 0.0, r5, 0.0), select(bottom > 0.0, r5, 0.0)
    slope_up = taut_t * p.output_top_ccw[i] + taut_b * p.output_bottom_ccw[i]
    slope_down = taut_t * p.output_top_cw[i] + taut_b * p.output_bottom_cw[i]
    if e is not None:
        hard = rise(e, i, maximum(top / p.length_top[i], bottom / p.length_bottom[i]))
        slope_up, slope_down = slope_up * hard, slope_down * hard
        up, down = ccw - wanted - g.up[i], cw - wanted + g.down[i]
    slope = select(select(v == 0.0, up, v) > 0.0, slope_up, slope_down)
    stiffness = p.stretch_stiffness[i] * slope + load_k
    ahead = 0.5 * dt * stiffness * v  # what the step subtracts: these forces are those of the middle already
    if e is not None:
        return output_step(
            e, s, g, i, v, p.output_inertia[i], ccw, cw, wanted, ahead, stiffness,
            p.stretch_damping[i] * slope_up + load_c, p.stretch_damping[i] * slope_down + load_c, dt, builds,
        )  # fmt: skip
    return output_slides(
        v, p.output_inertia[i], up + ahead, down + ahead, stiffness,
        p.stretch_damping[i] * slope_up + load_c, p.stretch_damping[i] * slope_down + load_c, dt,
    )  # fmt: skip


@inline
def worn(p, e, s, i):
    """Friction that has drifted: the branches go in a straight line to those of the final friction."""
    if e is not None:
        d = select(e.friction_drift_change[i] != 0.0, s.drift[i], 0.0)
        p.drive_top_ccw[i] = _faded(p.drive_top_ccw[i], e.worn_drive_top_ccw[i], d)
        p.drive_bottom_ccw[i] = _faded(p.drive_bottom_ccw[i], e.worn_drive_bottom_ccw[i], d)
        p.drive_top_cw[i] = _faded(p.drive_top_cw[i], e.worn_drive_top_cw[i], d)
        p.drive_bottom_cw[i] = _faded(p.drive_bottom_cw[i], e.worn_drive_bottom_cw[i], d)
        p.output_top_ccw[i] = _faded(p.output_top_ccw[i], e.worn_output_top_ccw[i], d)
        p.output_bottom_ccw[i] = _faded(p.output_bottom_ccw[i], e.worn_output_bottom_ccw[i], d)
        p.output_top_cw[i] = _faded(p.output_top_cw[i], e.worn_output_top_cw[i], d)
        p.output_bottom_cw[i] = _faded(p.output_bottom_cw[i], e.worn_output_bottom_cw[i], d)


@inline
def _faded(now, final, part):
    return select(part > 0.0, now + part * (final - now), now)


@inline
def begin_step(x, p, w, e, s, i, dt):
    """Before the substeps of a control step: peaks begin anew, friction has drifted, the output's gain is set."""
    x.slack_fraction[i] = 0.0
    x.peak_tension[i] = peak_at_start(largest(x, i))
    w.level[i] = 0.0
    worn(p, e, s, i)
    c_out = p.stretch_damping[i] * p.output_slope[i] + p.output_damping[i] + p.contact_damping[i]
    w.gain[i] = dt / (p.output_inertia[i] + 0.5 * dt * c_out + 0.25 * dt * dt * p.load_stiffness[i])


def resolves(p, e) -> np.ndarray:
    """Longest steps, s."""
    return resolved(p, e, p.drive_stiffness, p.load_stiffness, p.length_top, p.length_bottom)


def raise_inertias(p, dt: float) -> None:
    """See `circuit.ends.raised`."""
    raised(p, p.drive_stiffness, p.load_stiffness, dt)


def derive(value: Mapping[str, np.ndarray], e) -> dict[str, np.ndarray]:
    """Rows of `ROWS` from the circuit's parameters; where friction drifts, the rows `WORN` of the effects too."""
    if e is not None:
        drifting = np.flatnonzero(e.friction_drift_change)
        if drifting.size:
            grown = 1.0 + e.friction_drift_change[drifting]
            final = {name: row[drifting] for name, row in value.items()}
            final["cable_friction"] = final["cable_friction"] * grown
            final["shaft_friction"] = final["shaft_friction"] * grown
            worn = _branches(Statics.from_values(np.array([final[name] for name in CIRCUIT.names])))
            for name in BRANCHES:
                getattr(e, f"worn_{name}")[drifting] = worn[name]
    statics = Statics.from_values(np.array([value[name] for name in CIRCUIT.names]))
    shared, branches = shared_coefficients(value, statics, e), _branches(statics)
    per_t, per_b = 1.0 / statics.kappa[:, 0], 1.0 / statics.kappa[:, 1]
    turn = statics.drive_radius * shared["gear"] * (per_t + per_b).max(axis=0)
    swing = statics.output_radius * np.maximum(
        branches["output_top_ccw"] + branches["output_bottom_ccw"],
        branches["output_top_cw"] + branches["output_bottom_cw"],
    )
    stretch = shared["stretch_stiffness"]
    return {
        **shared,
        **branches,
        "drive_stiffness": 1.5 * stretch * turn,  # in the hold M_in is steeper than on a branch; too much costs nothing
        "drive_slope": turn,
        "load_stiffness": stretch * swing + shared["contact_stiffness"],
        "output_slope": swing,
        "hold_rule": value["hold_rule"],
        "length_top": statics.length[0],
        "length_bottom": statics.length[1],
    }


def _branches(statics: Statics) -> dict[str, np.ndarray]:
    """Rows named by `BRANCHES`.  Z32, Z35, Z39-41"""
    (ccw_t, cw_t), (ccw_b, cw_b) = 1.0 / statics.kappa[:, 0], 1.0 / statics.kappa[:, 1]
    k_t, k_b = statics.product
    return {
        "drive_top_ccw": ccw_t, "drive_bottom_ccw": ccw_b, "drive_top_cw": cw_t, "drive_bottom_cw": cw_b,
        "output_top_ccw": ccw_t / k_t, "output_bottom_ccw": ccw_b * k_b,
        "output_top_cw": cw_t * k_t, "output_bottom_cw": cw_b / k_b,
    }  # fmt: skip
