"""Closed cable-pulley circuit, analytic: the closed forms of Zou et al. 2022 between two moving inertias.

    cables     D = theta_in R0/R5 - theta_out;  EA Delta L_t = EA R5 D = -EA Delta L_b                       Z36-38
               T01t = max(0, (T_pre_t L_t + EA R5 D) / kappa_s1),  T01b = max(0, (T_pre_b L_b - EA R5 D) / kappa_s2)
                                                                                                              Z39-41
    torques    M_in = R0 (T01t - T01b);  M_out = R5 (T01t/K_t - T01b K_b) ccw, R5 (T01t K_t - T01b/K_b) cw   Z32, Z35
    output     J theta_out'' = M_out - load;  moving ccw takes the ccw branch, moving cw the cw branch
    drive      position servo or torque, see `cable_envs.plants.circuit.ends.drive_step`

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

from dataclasses import replace

import numpy as np

from cable_envs.core.inputs import INPUTS
from cable_envs.core.kernels import inline, jit, maximum, minimum, select
from cable_envs.effects import Layout
from cable_envs.effects.own import advance_memory, own_actuate, own_cable, own_load
from cable_envs.effects.seams import actuate, any_builds_up, begin, begin_friction, dry_friction, end
from cable_envs.effects.slow_creep import creeps_on, lasting
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.physics.friction import ringing_lag, ringing_way
from cable_envs.plants.base import Plant, rows_of
from cable_envs.plants.circuit.effects import ACTING, pulley, resolve_idlers, rise, spring
from cable_envs.plants.circuit.ends import (
    ACTION_MODES,
    SIGNALS,
    STILL,
    any_payload,
    cosine,
    drive_step,
    load_torque,
    rest_elongation,
    settle_ends,
)  # fmt: skip
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.stages import (
    MIDDLE,
    ROWS,
    WORN,
    begin_step,
    cw_share,
    derive,
    drive_slope,
    drive_torque,
    guess,
    held_by_flag,
    mean_share,
    mix,
    output_torques,
    output_velocity,
    raise_inertias,
    resolves,
    share_with,
    steepest,
)  # fmt: skip

STEP_ANGLE, STEP_RATE = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, rad and rad/s."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
# A user's own effects take the place of own_cable, own_load and own_actuate (`cable_envs.effects.own`).


@inline
def _stretched(p, e, s, i, d, rate):
    """(T kappa of t, T kappa of b), N m: what both directions divide by their kappas; zero when slack.  Z39-41."""
    top = p.preload_top[i] + p.stretch_stiffness[i] * d
    bottom = p.preload_bottom[i] - p.stretch_stiffness[i] * d
    if e is not None:
        top, _ = hardened(top - s.creep_top[i], e.stiffness_hardening_coefficient[i] / p.length_top[i])
        bottom, _ = hardened(bottom - s.creep_bottom[i], e.stiffness_hardening_coefficient[i] / p.length_bottom[i])
        top, bottom = own_cable(top, e, s, i), own_cable(bottom, e, s, i)
    damped = p.stretch_damping[i] * rate
    return (
        select(top <= 0.0, 0.0, maximum(top + damped, 0.0)),  # so written, a NaN passes on
        select(bottom <= 0.0, 0.0, maximum(bottom - damped, 0.0)),
    )


@inline
def _load_with(x, p, e, s, g, i, angle, v, wanted, load_k, load_c):
    """The load's torque, stiffness and damping with effects; its dry friction goes into g."""
    if e is not None:
        tension = x.tension_output_top[i] + x.tension_output_bottom[i]
        dry_friction(e, g, i, v, p.brake_torque[i], p.output_radius[i] * tension)
        wanted, load_k = spring(e, i, angle, wanted, load_k)
        at = own_load(angle, v, tension, e, s, i)
        k = (own_load(angle + STEP_ANGLE, v, tension, e, s, i) - at) / STEP_ANGLE
        c = (own_load(angle, v + STEP_RATE, tension, e, s, i) - at) / STEP_RATE
        wanted, load_k, load_c = wanted + at, load_k + maximum(k, 0.0), load_c + maximum(c, 0.0)
    return wanted, load_k, load_c


@inline
def _drive_part(x, p, u, w, e, s, g, i, dt):
    """The drive's step, against what the cables pull at the predicted middle of it."""
    gear = p.gear[i]
    a, v_in, b, v = x.drive_angle[i], x.drive_velocity[i], x.output_angle[i], x.output_velocity[i]
    half = b + 0.5 * dt * v
    wanted, load_k, load_c = load_torque(p, u, i, half, v, w.level[i])
    wanted, load_k, load_c = _load_with(x, p, e, s, g, i, half, v, wanted, load_k, load_c)
    along = a + 0.5 * dt * v_in
    if e is not None:
        w.pulley_offset[i], w.pulley_turns[i], _ = pulley(e, s, i, along, x.drive_torque[i], steepest(x, p, e, i))
        along += w.pulley_offset[i]
        gear *= w.pulley_turns[i]
    d, rate = p.gear[i] * along - half, gear * v_in - v
    top, bottom = _stretched(p, e, s, i, d, rate)
    ccw, cw = output_torques(p, i, top, bottom)
    if e is not None:
        resolve_idlers(e, g, i, ccw, cw, p.output_inertia[i], dt)
    change = guess(p, w, g, i, v, ccw - wanted, cw - wanted)
    share = share_with(e, s, g, i, mean_share(v, change, ccw, cw, wanted))
    late = 0.5 * p.stretch_damping[i] * change + p.stretch_stiffness[i] * ringing_way(change, dt)
    m_in = drive_torque(p, i, maximum(top - late, 0.0), bottom + select(bottom > 0.0, late, 0.0), share)
    stiff = drive_slope(p, i, v, top, bottom, ccw, cw, wanted)
    if e is not None:
        m_in *= w.pulley_turns[i]
        stiff *= rise(e, i, maximum(top / p.length_top[i], bottom / p.length_bottom[i]))
    new, short = drive_step(x, p, u, g, i, m_in, stiff, p.stretch_damping[i] * p.drive_slope[i], dt)
    more = 0.5 * (new - v_in)
    w.elongation_angle[i] = d + 0.5 * dt * gear * more - gear * ringing_lag(new - v_in, dt)
    w.elongation_rate[i] = rate + gear * more
    w.load_torque[i], w.load_stiffness[i], w.load_damping[i] = wanted, load_k, load_c
    after = a + 0.5 * dt * (v_in + new) - short
    if e is not None:
        after = select(g.follows[i] > 0.5, g.target[i], after)
    x.drive_angle[i], x.drive_velocity[i] = after, new


@inline
def _output_part(x, p, w, e, s, g, i, dt, builds):
    """The output's step, with the drive's motion known."""
    v = x.output_velocity[i]
    top, bottom = _stretched(p, e, s, i, w.elongation_angle[i], w.elongation_rate[i])
    new, short = output_velocity(
        p, e, s, g, i, v, top, bottom, w.load_torque[i], w.load_stiffness[i], w.load_damping[i], dt, builds
    )
    new = select(held_by_flag(p, i, x.drive_velocity[i], top, bottom), 0.0, new)
    x.output_angle[i], x.output_velocity[i] = x.output_angle[i] + 0.5 * dt * (v + new) - short, new
    if e is not None:
        stretch, keep, slow = p.stretch_stiffness[i] * w.elongation_angle[i], g.creep_left[i], g.slow_left[i]
        elongation_t = maximum(stretch - s.creep_top[i], -p.preload_top[i])
        elongation_b = maximum(-stretch - s.creep_bottom[i], -p.preload_bottom[i])
        creeps_on(s.creep_top, s.slow_creep_top, e, i, elongation_t, keep, slow)
        creeps_on(s.creep_bottom, s.slow_creep_bottom, e, i, elongation_b, keep, slow)


@inline
def _report(x, p, u, e, s, g, i, level):
    """Torques and tensions of the new state; ``level``: cosine of the output angle."""
    v_in, b, v = x.drive_velocity[i], x.output_angle[i], x.output_velocity[i]
    angle, gear = x.drive_angle[i], p.gear[i]
    if e is not None:
        offset, turns, inside = pulley(e, s, i, angle, x.drive_torque[i], steepest(x, p, e, i))
        s.gap_position[i] = inside
        angle += offset
        gear *= turns
    top, bottom = _stretched(p, e, s, i, p.gear[i] * angle - b, gear * v_in - v)
    wanted, load_k, load_c = load_torque(p, u, i, b, v, level)
    wanted, load_k, load_c = _load_with(x, p, e, s, g, i, b, v, wanted, load_k, load_c)
    ccw, cw = output_torques(p, i, top, bottom)
    share = share_with(e, s, g, i, cw_share(v, ccw, cw, wanted))
    t01_t, t01_b = (
        top * mix(share, p.drive_top_ccw[i], p.drive_top_cw[i]),
        bottom * mix(share, p.drive_bottom_ccw[i], p.drive_bottom_cw[i]),
    )
    t45_t, t45_b = (
        top * mix(share, p.output_top_ccw[i], p.output_top_cw[i]),
        bottom * mix(share, p.output_bottom_ccw[i], p.output_bottom_cw[i]),
    )
    x.tension_drive_top[i], x.tension_drive_bottom[i], x.tension_output_top[i], x.tension_output_bottom[i] = (
        t01_t,
        t01_b,
        t45_t,
        t45_b,
    )
    x.drive_torque[i] = p.drive_radius[i] * (t01_t - t01_b)
    x.output_torque[i] = p.output_radius[i] * (t45_t - t45_b)
    slack = select(minimum(top, bottom) <= 0.0, 1.0, 0.0)
    x.out_of_range[i] = slack
    x.slack_fraction[i] += slack
    x.peak_tension[i] = maximum(maximum(maximum(t01_t, t45_t), maximum(t01_b, t45_b)), x.peak_tension[i])
    x.phase[i] = select(v != 0.0, 3.0, select(abs(v_in) > STILL, 1.0, 0.0))


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, in short loops: so the processor works on several columns at once (see cable_hole)."""
    payload, builds = any_payload(p, lanes), False
    if e is not None:  # what no column of a block has is left out for all of them
        builds = any_builds_up(e, lanes)
    for i in range(lanes):
        begin_step(x, p, w, e, s, i, dt)
        if e is not None:
            begin(
                e,
                s,
                g,
                u,
                i,
                x.drive_angle[i],
                x.drive_velocity[i],
                x.output_angle[i],
                x.output_velocity[i],
                substeps * dt,
                dt,
            )
            begin_friction(e, g, i)
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], x.drive_angle[i], x.drive_velocity[i], e, s, i)
        if payload:
            for i in range(lanes):
                w.level[i] = cosine(x.output_angle[i] + 0.5 * dt * x.output_velocity[i])
        for i in range(lanes):
            _drive_part(x, p, u, w, e, s, g, i, dt)
        if builds:
            for i in range(lanes):
                _output_part(x, p, w, e, s, g, i, dt, True)
        else:
            for i in range(lanes):
                _output_part(x, p, w, e, s, g, i, dt, False)
        if payload:
            for i in range(lanes):
                w.level[i] = cosine(x.output_angle[i])
        for i in range(lanes):
            _report(x, p, u, e, s, g, i, w.level[i])
            if e is not None:
                tension = x.tension_output_top[i] + x.tension_output_bottom[i]
                advance_memory(
                    u.command[i], x.drive_angle[i], x.drive_velocity[i], x.output_angle[i], x.output_velocity[i],
                    tension, tension, e, s, i,
                )  # fmt: skip
                s.started[i] = 1.0
    for i in range(lanes):
        x.slack_fraction[i] /= substeps
        if e is not None:
            end(e, s, g, i, x.output_angle[i], substeps * dt)


@jit
def _refresh(x, p, u):
    """What the kernel reports for states at rest without a disturbance."""
    for i in range(x.phase.shape[0]):
        x.slack_fraction[i] = 0.0
        _report(x, p, u, None, None, None, i, cosine(x.output_angle[i]))


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the output at ``position`` (rad, [n]), its load balanced.

    D is that of equal tensions along each cable, inside the hold; torques and tensions are the kernel's for that D.
    """
    elongation, top, bottom = rest_elongation(p, p.length_top, p.length_bottom, position, e)
    settle_ends(x, s, p, e, position, elongation, top, bottom)
    plain = (
        (lasting(e) == 0.0)
        & (e.stiffness_hardening_coefficient == 0.0)
        & (e.position_dependent_load_stiffness == 0.0)
        & (x.drive_angle == (position + elongation) / p.gear)
    )
    seen = x.rows.copy()
    _refresh(PLANT.signal_rows.over(seen), p, INPUTS.zeros(len(position)))
    x.rows[:] = np.where(plain, seen, x.rows)


_ACTING = replace(ACTING, effects={**ACTING.effects, "partial_slip": ("angle",)}, several=("cable",))

PLANT = Plant(
    name="pulley_circuit",
    parameters=CIRCUIT,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=ROWS,
    scratch=MIDDLE,
    action_modes=ACTION_MODES,
    derive=derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("pulley_circuit", CIRCUIT, _ACTING, worn=WORN),
    resolves=resolves,
    raised=raise_inertias,
)
