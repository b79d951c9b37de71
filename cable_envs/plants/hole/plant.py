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

from functools import cache

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import inline, maximum, power, select, sign
from cable_envs.effects import Layout
from cable_envs.effects.own import own_actuate, own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import actuate, begin, dry_friction, end, held_back
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.plants.hole.parameters import (
    ACTING,
    MAX_HOLES,
    coefficient_rows,
    derive,
    series_parameters,
    series_signals,
    signal_rows,
)  # fmt: skip
from cable_envs.plants.hole.spool import spool_at
from cable_envs.plants.hole.stages import (
    HOLE,
    any_stiff,
    closed_loop,
    drawn_in,
    drive,
    guide_moved,
    keep_hole,
    mobilised,
    ratio,
    record,
    slip_speed,
    span,
    span_behind,
    take_hole,
    transmitted,
    wrapped,
)  # fmt: skip

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
# A user's own effects take the place of own_cable, own_contact, own_load and own_actuate (`cable_envs.effects.own`).


@inline
def _pulled(w, e, i, stretch, rate):
    """Tension of the span above the hole."""
    if e is not None:
        elongation = stretch - w.lost_length[i]
        pull, rise = hardened(w.stiffness_above[i] * elongation, w.hardening[i])
        pull = select(w.drive_ends_it[i] > 0.5, own_cable(pull, e, i), pull)
        w.rise[i], w.elongation[i] = rise, maximum(elongation, 0.0)
        return select(elongation > 0.0, maximum(pull + w.damping_above[i] * rate, 0.0), 0.0)
    return span(w.stiffness_above[i], w.damping_above[i], stretch, rate)


@inline
def _load_resistance(p, u, w, e, i, y, v):
    resist = p.load_weight[i] + p.load_stiffness[i] * y + p.load_damping[i] * v - u.disturbance[i]
    if e is not None:
        return resist + own_load(y, v, w.tension_behind[i], e, i)
    return resist


@inline
def _ahead(p, u, w, e, g, i, dt):
    """Speed of the load at the end of the step, from the balance of forces at its start (zero where it sticks)."""
    net = w.tension_behind[i] - _load_resistance(p, u, w, e, i, w.slip[i], w.speed[i])
    if e is not None:
        net = held_back(g, i, net, w.speed[i])
    return w.speed[i] + dt * w.per_mass[i] * net


@inline
def _pull(p, u, w, e, g, i, theta):
    """Tension above once what is above has moved for theta dt; M = mu + K |v|^omega and dM/d|v| at the start.  G17."""
    v = w.speed[i]
    stretch = w.end_before[i] + theta * (w.end_after[i] - w.end_before[i]) - w.slip[i]
    w.tension_middle[i] = _pulled(w, e, i, stretch, w.end_speed[i] - v)
    speed = abs(v)
    steep = p.extrusion_gain[i] * power(maximum(speed, 1e-12), p.extrusion_exponent[i] - 1.0)
    if e is not None:
        imposed = (w.drive_ends_it[i] > 0.5) & (g.imposes[i] > 0.5)
        w.tension_middle[i] = select(imposed, maximum(u.command[i], 0.0), w.tension_middle[i])
        w.rise[i], w.damping_above[i] = select(imposed, 0.0, w.rise[i]), select(imposed, 0.0, w.damping_above[i])
        extra, growth = excess_at(e.stribeck_friction_contact[i], e.stribeck_friction_velocity[i], v)
        exponent, over = (
            e.load_dependent_friction_exponent[i],
            maximum(w.tension_middle[i], 0.1) / maximum(p.load_weight[i], 0.1),
        )
        factor = g.factor[i] * select(exponent != 0.0, power(over, exponent), 1.0)
        towards = select(v == 0.0, w.tension_middle[i] - w.resistance[i], v)  # at rest: where it would break away to
        factor *= 1.0 + e.asymmetric_friction_contact[i] * sign(towards)
        coulomb = (w.mu[i] + extra) * factor + own_contact(speed, w.tension_middle[i], e, i)
        w.friction[i] = coulomb + steep * speed
        w.friction_growth[i] = p.extrusion_exponent[i] * steep + factor * growth
    else:
        w.friction[i] = w.mu[i] + steep * speed
        w.friction_growth[i] = p.extrusion_exponent[i] * steep


@inline
def _load_behind(p, u, w, e, i):
    w.resistance[i] = _load_resistance(p, u, w, e, i, w.slip[i], w.speed[i])
    w.resistance_stiffness[i], w.resistance_damping[i], w.inertia[i] = (
        p.load_stiffness[i],
        p.load_damping[i],
        p.load_mass[i],
    )
    if e is not None:
        at = own_load(w.slip[i], w.speed[i], w.tension_behind[i], e, i)
        k = (own_load(w.slip[i] + STEP_Y, w.speed[i], w.tension_behind[i], e, i) - at) / STEP_Y
        c = (own_load(w.slip[i], w.speed[i] + STEP_V, w.tension_behind[i], e, i) - at) / STEP_V
        w.resistance_stiffness[i], w.resistance_damping[i] = (
            w.resistance_stiffness[i] + maximum(k, 0.0),
            w.resistance_damping[i] + maximum(c, 0.0),
        )


@inline
def _load_moved(x, p, u, w, e, s, i, tension, inv_n):
    y, v = w.slip[i], w.speed[i]
    x.load_position[i], x.load_velocity[i], x.sliding[i] = y, v, sign(v)
    x.load_tension[i] = transmitted(v, tension, w.ratio[i], inv_n, _load_resistance(p, u, w, e, i, y, v))
    if e is not None:
        bent = tension * mobilised(w.ratio[i], inv_n, share(s.presliding, i))[0]
        x.load_tension[i] = select(e.presliding_hysteresis_displacement[i] > 0.0, bent, x.load_tension[i])
        s.started[i] = 1.0


@inline
def _slip(w, e, s, g, i, dt, theta, last):
    """One slip through a hole; (tension above after the step, 1 / n).  G28"""
    v, middle, n = w.speed[i], w.tension_middle[i], w.ratio[i]
    v_new = slip_speed(w, e, s, g, i, dt, theta, last)
    moved = v + theta * (v_new - v)
    s_new = w.slip[i] + dt * moved
    if e is not None:
        target = w.elongation[i]
    tension = _pulled(w, e, i, w.end_after[i] - s_new, w.end_speed_after[i] - v_new)
    if e is not None:
        first = w.drive_ends_it[i] > 0.5
        tension = select(first & (g.imposes[i] > 0.5), middle, tension)
        crept_to = crept(s.creep_top[i], e.viscoelastic_creep_share[i], target, g.creep_left[i])
        s.creep_top[i] = select(first, crept_to, s.creep_top[i])
        w.drive_ends_it[i] = 0.0
    # what is above the next hole, if there is one
    w.end_before[i], w.end_after[i] = w.slip[i], s_new
    w.end_speed[i], w.end_speed_after[i] = moved, v_new
    w.slip[i], w.speed[i] = s_new, v_new
    w.ratio[i] = n + w.ratio_slope[i] * w.friction_growth[i] * (abs(v_new) - abs(v))
    if e is not None:
        w.ratio[i] = select(w.friction_growth[i] < 0.0, maximum(w.ratio[i], 1.0), w.ratio[i])
        w.hardening[i], w.lost_length[i] = 0.0, 0.0
    return tension, 1.0 / w.ratio[i]


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, stage by stage.

    Short loops, one for each stage: the processor then works on several columns at once, which the long chain of
    dependent operations of a whole step would prevent.
    """
    bends, holes = any_stiff(p, lanes), p.wrap_angle.shape[0]
    for i in range(lanes):
        closed_loop(p, w, i, p.cable_stiffness[i], dt)
        take_hole(x, p, w, i, 0, True)
        x.slack_fraction[i] = 0.0
        x.peak_tension[i] = 0.0
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
            dry_friction(e, g, i, x.load_velocity[i], e.coulomb_friction_level[i], x.drive_tension[i])
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], e, i)
                hard = e.stiffness_hardening_coefficient[i]
                closed_loop(p, w, i, p.cable_stiffness[i] * (1.0 + hard * linear(x.drive_tension[i], hard)), dt)
        for h in range(holes):
            last = h == holes - 1
            theta = 0.5 if last else 1.0  # the lumped masses of the cable are no part of the motion of interest
            if holes == 1:
                for i in range(lanes):
                    keep_hole(x, w, i)
            else:
                for i in range(lanes):
                    take_hole(x, p, w, i, h, last)
            if h == 0:
                for i in range(lanes):
                    ahead = _ahead(p, u, w, e, g, i, dt) if holes == 1 else w.speed[i]
                    drive(x, p, u, w, e, s, g, i, ahead, dt)
            if last:
                for i in range(lanes):
                    _load_behind(p, u, w, e, i)
            else:
                for i in range(lanes):
                    span_behind(x, p, w, i, h, h == holes - 2, dt)
            for i in range(lanes):
                _pull(p, u, w, e, g, i, theta)
            wrapped(p, w, lanes, bends)
            for i in range(lanes):
                ratio(w, i)
            if last:
                for i in range(lanes):
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, True)
                    _load_moved(x, p, u, w, e, s, i, tension, inv_n)
                    if h == 0:
                        record(x, i, tension)
                        if e is not None:
                            drawn_in(x, p, w, e, s, g, i, dt)
            else:
                for i in range(lanes):
                    tension, inv_n = _slip(w, e, s, g, i, dt, theta, False)
                    guide_moved(x, p, w, i, h, tension, inv_n)
                    if h == 0:
                        record(x, i, tension)
                        if e is not None:
                            drawn_in(x, p, w, e, s, g, i, dt)
    for i in range(lanes):
        x.slack_fraction[i] /= substeps
        if e is not None:
            end(e, s, g, i, x.load_position[i], substeps * dt)


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the load at ``position`` (m, [n]); equal tensions on both sides of every hole."""
    tension = np.maximum(p.load_weight + p.load_stiffness * position, 0.0)
    x.load_position[:] = position
    x.drive_tension[:] = x.load_tension[:] = x.peak_tension[:] = tension
    slip = np.array(position, dtype=np.float64)
    for h in reversed(range(len(x.slip_position))):
        slip = slip + tension / p.span_stiffness
        x.slip_position[h], x.span_tension[h] = slip, tension
    hard = e.stiffness_hardening_coefficient
    stretch = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * hard * tension)) / p.cable_stiffness
    end = slip + stretch * (1.0 + e.viscoelastic_creep_share) + e.slack_length
    x.drive_position[:] = spool_at(end, e)
    s.creep_top[:], s.gap_position[:] = e.viscoelastic_creep_share * stretch, x.drive_position


@cache
def cable_hole(holes: int = 1) -> Plant:
    """The plant with ``holes`` holes in series (1 to 4)."""
    if not 1 <= holes <= MAX_HOLES:
        raise ConfigurationError(f"holes = {holes} is outside [1, {MAX_HOLES}]")
    parameters = series_parameters(holes)
    return Plant(
        name="cable_hole",
        parameters=parameters,
        signals=series_signals(holes),
        signal_rows=signal_rows(holes),
        coefficient_rows=coefficient_rows(holes),
        scratch=HOLE,
        action_modes=(
            ActionMode("tension", "N", "tension_command_limit", one_sided=True, rest_signal="drive_tension"),
            ActionMode("speed", "m/s", "drive_speed_limit"),
        ),
        derive=derive,
        settle=_settle,
        solve=_solve,
        effects=Layout("cable_hole", parameters, ACTING),
    )


PLANT = cable_hole()
