"""A drive hauls an elastic cable through a hole; a load hangs, or is held by a spring.

Gu et al. 2024 (equations G), with the reading of docs/physics.md: friction is directional, rho = R / r.

    drive      accelerates within its limits towards a commanded speed, or towards the speed of the inner tension
               loop  v = kp (F - T1) + kd (F' - T1')                                                            G35
    cable      T1 = max(0, k (x - y) + c (x' - y')): the span between drive and hole; slack carries nothing
    hole       T2 = T1 / n sliding up, T1 n sliding down, in between at rest;  n = lambda(rho0 (1 + delta),
               mu + K |v|^omega, theta_e)                                                          G1, G9, G17, G28
    load       m y'' = T2 - m g - k_l y - c_l y' + disturbance, rigidly behind the hole (v = y')          G28

The load's and the drive's speeds at the end of a step are solved together: the drive's inner loop through the cable's
stiffness is far faster than a step, and so is a light load. Where friction grows so steeply that a step is long for it,
the load's speed at the end is sought on the law itself (Newton's method between bounds).

Tensions that are reported obey the contact's law at the speeds that are reported with them. Several holes in series are
in `cable_envs.plants.hole.series`.

Signs: x > 0 hauls in, y > 0 lifts. SI units throughout.
"""

from functools import cache

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import inline, maximum, power, select, sign
from cable_envs.effects import Layout
from cable_envs.effects.own import advance_memory, own_actuate, own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import actuate, any_builds_up, begin, begin_friction, dry_friction, end, reported
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.plants.hole.drive import (
    asked_at_start,
    carried,
    caught_early,
    closed,
    closed_loop,
    limited,
    open_loop,
    stiffness_now,
    told_speeds,
)
from cable_envs.plants.hole.parameters import (
    ACTING,
    MAX_HOLES,
    RANGES,
    coefficient_rows,
    derive,
    resolves,
    series_parameters,
    series_signals,
    signal_rows,
)  # fmt: skip
from cable_envs.plants.hole.series import holes_in_series
from cable_envs.plants.hole.spool import idle_share, settle_drive
from cable_envs.plants.hole.stages import (
    HOLE,
    any_of,
    any_stiff,
    begin_steep,
    creeping,
    drawn_in,
    extrapolated,
    mobilised,
    ratio,
    record,
    slip_speed,
    span,
    steepest_ratio,
    steepness,
    take_hole,
    tangent_there,
    transmitted,
    try_speed,
    wrapped,
)
from cable_envs.plants.peaks import peak_at_start

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""

STEEP = 0.6
"""How many times friction may take the load's speed within a step before its growth is no straight line there."""

SOUGHT = 5
"""Rounds in which the speed at the end of a step is found then."""

REPORTED = 3
"""Rounds in which the tension behind the hole and the wrap of a stiff cable, each of which follows from the other, are
found for what is reported."""

# In what follows e, s and g are None without effects: what asks for them is then left out before anything is compiled.
# A user's own effects take the place of own_cable, own_contact, own_load and own_actuate (`cable_envs.effects.own`).


@inline
def pulled(p, w, e, s, i, stretch, rate):
    """Tension of the span above the hole; its stiffness and damping there are kept."""
    if e is not None:
        elongation = stretch - (e.slack_length[i] + s.creep_top[i])
        pull, rise = hardened(p.cable_stiffness[i] * elongation, e.stiffness_hardening_coefficient[i])
        pull = own_cable(pull, e, s, i)
        w.stiffness[i], w.damping[i] = p.cable_stiffness[i] * rise, p.cable_damping[i]
        w.elongation[i] = maximum(elongation, 0.0)
        return select(elongation > 0.0, maximum(pull + p.cable_damping[i] * rate, 0.0), 0.0)
    w.stiffness[i], w.damping[i] = p.cable_stiffness[i], p.cable_damping[i]
    return span(p.cable_stiffness[i], p.cable_damping[i], stretch, rate)


@inline
def load_resistance(p, u, e, s, i, y, v, tension):
    """Force on the load against upward motion, N."""
    resist = p.load_weight[i] + p.load_stiffness[i] * y + p.load_damping[i] * v - u.disturbance[i]
    if e is not None:
        return resist + own_load(y, v, tension, e, s, i)
    return resist


@inline
def load_behind(x, p, u, w, e, s, i):
    """What resists behind the hole at the start of the step, and its slopes."""
    y, v, tension = x.load_position[i], x.load_velocity[i], x.load_tension[i]
    w.resistance[i] = load_resistance(p, u, e, s, i, y, v, tension)
    w.resistance_stiffness[i], w.resistance_damping[i] = p.load_stiffness[i], p.load_damping[i]
    if e is not None:
        at = own_load(y, v, tension, e, s, i)
        k = (own_load(y + STEP_Y, v, tension, e, s, i) - at) / STEP_Y
        c = (own_load(y, v + STEP_V, tension, e, s, i) - at) / STEP_V
        w.resistance_stiffness[i], w.resistance_damping[i] = (
            w.resistance_stiffness[i] + maximum(k, 0.0),
            w.resistance_damping[i] + maximum(c, 0.0),
        )


@inline
def pulled_midway(x, p, u, w, e, s, g, i, ahead):
    """Tension above once the cable's end has gone half its way, and the load by ``ahead``."""
    end = w.end_before[i] + 0.5 * (w.end_after[i] - w.end_before[i]) - w.end_lag[i]
    stretch = end - x.load_position[i] - ahead
    w.tension_middle[i] = pulled(p, w, e, s, i, stretch, w.end_speed[i] - x.load_velocity[i])
    if e is not None:
        imposed = g.imposes[i] > 0.5
        w.tension_middle[i] = select(imposed, maximum(u.command[i], 0.0), w.tension_middle[i])
        w.stiffness[i], w.damping[i] = select(imposed, 0.0, w.stiffness[i]), select(imposed, 0.0, w.damping[i])


@inline
def rubbed(x, p, w, e, s, g, i, v, tension):
    """M = mu + K |v|^omega and dM/d|v| at a speed and a tension above the hole.  G17"""
    speed = abs(v)
    steep = p.extrusion_gain[i] * power(maximum(speed, 1e-12), p.extrusion_exponent[i] - 1.0)
    mu = w.mu[i]
    if e is not None:
        extra, growth = excess_at(e.stribeck_friction_contact[i], e.stribeck_friction_velocity[i], v)
        exponent, over = (
            e.load_dependent_friction_exponent[i],
            maximum(tension, 0.1) / maximum(p.load_weight[i], 0.1),
        )
        factor = g.factor[i] * select(exponent != 0.0, power(over, exponent), 1.0)
        towards = select(v == 0.0, tension - w.resistance[i], v)  # at rest: where it would break away to
        factor *= 1.0 + e.asymmetric_friction_contact[i] * sign(towards)
        own = own_contact(x.load_position[i], v, tension, x.load_tension[i], e, s, i)
        coulomb = (mu + extra) * factor + own
        w.friction[i] = coulomb + steep * speed
        w.friction_growth[i] = p.extrusion_exponent[i] * steep + factor * growth
        g.contact_excess[i] = factor * extra / maximum(w.friction[i], 1e-12)
    else:
        w.friction[i] = mu + steep * speed
        w.friction_growth[i] = p.extrusion_exponent[i] * steep


@inline
def _hauled(x, p, u, w, e, s, g, i, dt):
    """The drive within its limits: towards a commanded speed, or in tension mode towards that of G35.

    A jump of the command takes it on as fast as it can, until it has the speed that is asked for. So it gets further
    within the step than with the mean of its speeds before and after, and the tension has grown with that.
    """
    old, told, wanted, taut = x.drive_velocity[i], u.mode[i] > 0.5, open_loop(x, p, u, i), x.drive_tension[i] > 0.0
    asked, further = closed(x, p, w, e, g, i, wanted, dt)
    first, last = told_speeds(u, g, i, dt)
    start = limited(p, i, old, select(told, first, asked_at_start(x, p, w, i, wanted)), dt)
    end = limited(p, i, old, select(told, last, select(taut, asked, wanted)), dt)
    early = caught_early(p, i, start - old, end - start, dt)
    loop = select(taut, asked + further * early, wanted)
    if e is not None:
        idle = idle_share(e, s, i, x.drive_position[i], wanted, dt)
        loop = loop + idle * (wanted - loop)
    new = limited(p, i, old, select(told, last, loop), dt)
    carried(x, w, e, s, g, i, new, dt, -early)


@inline
def slipped(x, p, u, w, e, s, g, i, ahead, dt, builds=True):
    """The load's step, and the tension above to which it leads; ``ahead`` as of `pulled_midway`."""
    y, v = x.load_position[i], x.load_velocity[i]
    v_new = slip_speed(x, p, w, e, s, g, i, ahead, dt, builds)
    y_new = y + dt * (v + 0.5 * (v_new - v)) - w.short[i]
    if e is not None:
        stretched = w.elongation[i]
    tension = pulled(p, w, e, s, i, w.end_after[i] - y_new, w.end_speed_after[i] - v_new)
    if e is not None:
        tension = select(g.imposes[i] > 0.5, w.tension_middle[i], tension)
        creeping(e, s, g, i, stretched)
    x.load_position[i], x.load_velocity[i], x.sliding[i] = y_new, v_new, sign(v_new)
    record(x, i, tension)
    w.ratio[i] = extrapolated(w, e, i, v, v_new)
    if e is not None:
        s.started[i] = 1.0
        drawn_in(x, p, e, s, g, i, dt)


@inline
def _against_steep_friction(x, p, u, w, e, s, g, lanes, bends, dt):
    """Friction in a straight line that leads to the same speed at the end of the step as its law does."""
    for i in range(lanes):
        begin_steep(x, w, g, i)
    for _ in range(SOUGHT):
        for i in range(lanes):
            try_speed(x, p, w, e, s, g, i, 0.5 * dt * x.load_velocity[i], dt)
            rubbed(x, p, w, e, s, g, i, w.way[i] * w.tried[i], x.drive_tension[i])
        wrapped(x, p, w, lanes, bends)
        for i in range(lanes):
            ratio(w, i)
            tangent_there(x, p, w, e, s, g, i, 0.5 * dt * x.load_velocity[i], dt)


@inline
def behind(x, p, u, w, e, s, g, i):
    """The tension behind the hole, from the one above and the ratio."""
    v, above, n = x.load_velocity[i], x.drive_tension[i], w.ratio[i]
    inv_n = 1.0 / n
    resist = load_resistance(p, u, e, s, i, x.load_position[i], v, x.load_tension[i])
    tension = transmitted(v, above, n, inv_n, resist)
    if e is not None:
        bent = above * mobilised(n, inv_n, share(s.presliding, i))[0]
        tension = reported(e, g, i, tension, bent)
    x.load_tension[i] = tension


@inline
def _reported(x, p, u, w, e, s, g, lanes, bends):
    """The tension behind the hole as the contact's law gives it at the speed and the tension that are reported."""
    for i in range(lanes):
        rubbed(x, p, w, e, s, g, i, x.load_velocity[i], x.drive_tension[i])
    for _ in range(REPORTED if bends else 1):
        wrapped(x, p, w, lanes, bends)
        for i in range(lanes):
            ratio(w, i)
        for i in range(lanes):
            behind(x, p, u, w, e, s, g, i)


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, stage by stage.

    Short loops, one for each stage: the processor then works on several columns at once, which the long chain of
    dependent operations of a whole step would prevent.
    """
    bends, builds = any_stiff(p, lanes), False
    if e is not None:  # what no column of a block has is left out for all of them
        builds = any_builds_up(e, lanes)
    for i in range(lanes):
        take_hole(p, w, i)
    for i in range(lanes):
        closed_loop(p, w, i, p.cable_stiffness[i], dt)
        x.slack_fraction[i] = 0.0
        x.peak_tension[i] = peak_at_start(x.drive_tension[i])
        x.out_of_range[i] = 0.0
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
            begin_friction(e, g, i)
            dry_friction(e, g, i, x.load_velocity[i], e.coulomb_friction_level[i], x.drive_tension[i])
            w.stiffness[i] = stiffness_now(x, p, e, i)
        else:
            w.stiffness[i] = p.cable_stiffness[i]
        w.damping[i], w.steepest[i] = p.cable_damping[i], steepest_ratio(p, i)
        w.bends[i], w.sags[i], w.steep[i] = 0.0, 0.0, select(steepness(x, p, i, dt) > STEEP, 1.0, 0.0)
    steep = any_of(w.steep, lanes)
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], x.drive_position[i], x.drive_velocity[i], e, s, i)
                closed_loop(p, w, i, stiffness_now(x, p, e, i), dt)
        for i in range(lanes):
            load_behind(x, p, u, w, e, s, i)
        for i in range(lanes):
            rubbed(x, p, w, e, s, g, i, x.load_velocity[i], x.drive_tension[i])
        wrapped(x, p, w, lanes, bends)
        for i in range(lanes):
            ratio(w, i)
        for i in range(lanes):
            _hauled(x, p, u, w, e, s, g, i, dt)
        for i in range(lanes):
            pulled_midway(x, p, u, w, e, s, g, i, 0.5 * dt * x.load_velocity[i])
        if steep:
            _against_steep_friction(x, p, u, w, e, s, g, lanes, bends, dt)
        if builds:
            for i in range(lanes):
                slipped(x, p, u, w, e, s, g, i, 0.5 * dt * x.load_velocity[i], dt, True)
        else:
            for i in range(lanes):
                slipped(x, p, u, w, e, s, g, i, 0.5 * dt * x.load_velocity[i], dt, False)
        if e is not None or bends:  # else the next step does not ask for it
            for i in range(lanes):
                behind(x, p, u, w, e, s, g, i)
                if e is not None:
                    advance_memory(
                        u.command[i], x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                        x.drive_tension[i], x.load_tension[i], e, s, i,
                    )  # fmt: skip
    _reported(x, p, u, w, e, s, g, lanes, bends)
    for i in range(lanes):
        x.slack_fraction[i] /= substeps
        if e is not None:
            end(e, s, g, i, x.load_position[i], substeps * dt)


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the load at ``position`` (m, [n]); equal tensions on both sides of the hole."""
    tension = np.maximum(p.load_weight + p.load_stiffness * position, 0.0)
    x.load_position[:] = position
    x.drive_tension[:] = x.load_tension[:] = x.peak_tension[:] = tension
    settle_drive(x, s, p, e, position, tension)


@cache
def cable_hole(holes: int = 1) -> Plant:
    """The plant with ``holes`` holes in series (1 to 50); several are those of `cable_envs.plants.hole.series`."""
    if not 1 <= holes <= MAX_HOLES:
        raise ConfigurationError(f"holes = {holes} is outside [1, {MAX_HOLES}]")
    if holes > 1:
        return holes_in_series(holes)
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
        resolves=resolves,
        ranges=RANGES,
    )


PLANT = cable_hole()
