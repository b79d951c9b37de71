"""A drive hauls an elastic cable through 2 to 50 holes in series; a load hangs behind the last one, or is on a spring.

The future work of Gu et al. 2024 (equations G). Drive, hole and load are those of `cable_envs.plants.hole.plant`:

    drive      accelerates within its limits towards a commanded speed, or towards the speed of the inner tension
               loop  v = kp (F - T_0) + kd (F' - T_0')                                                          G35
    span 0     T_0 = max(0, k (x - s_1) + c (x' - s_1')): between drive and first hole; slack carries nothing
    span j     T_j = max(0, k_s (s_j - s_{j+1})): between hole j and the next one; s_N is the load's position y
    hole h     T_{h-1} = n_h T_h sliding up, T_h = n_h T_{h-1} sliding down, in between at rest;
               n_h = lambda(rho_h (1 + delta), mu_h + K |s_h'|^omega, theta_h)                          G1, G9, G17
    load       m y'' = T_N - m g - k_l y - c_l y' + disturbance                                                 G28

The cable has no mass, so the slips s_h of the inner holes have no inertia: all holes, the load and the inner tension
loop, which is far quicker than a step, are solved together (`cable_envs.physics.series`).

Within a step of length dt a taut span acts at the share theta = 1/2 + SETTLING dt of it, so that what does not fit the
laws at its start dies out as ((1 - theta) / theta)^n; a slack span acts at its end. The inner loop asks the drive for
a speed, from the tension in the middle of the step, or as much later as it must be not to ring where the loop is
quicker than the step. A drive that is not as fast gets there at its limit of acceleration, and from then on, within the
step, does what it is asked for.
Tensions after the step follow from that of the first span by the law of every hole.

Signs: x > 0 hauls in, s > 0 and y > 0 lift. SI units throughout.
"""

from dataclasses import replace

import numpy as np

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import inline
from cable_envs.effects import Layout
from cable_envs.effects.own import advance_memory, own_actuate
from cable_envs.effects.seams import actuate, begin, begin_friction, end
from cable_envs.physics import series
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.plants.hole.parameters import (
    ACTING,
    RANGES,
    coefficient_rows,
    derive,
    series_parameters,
    series_signals,
    signal_rows,
)
from cable_envs.plants.hole.series_stages import (
    behind,
    drive_row,
    end_row,
    first_span,
    friction,
    inner_span,
    load_row,
    moved,
    pace,
    rub,
    scratch,
    slipped,
    spans,
    wrapped,
)
from cable_envs.plants.hole.spool import settle_drive
from cable_envs.plants.hole.stages import any_stiff
from cable_envs.plants.peaks import peak_at_start

solve_together = specialised(series.solve, law=friction, lead=end_row, pace=pace)

PICK_UP = 0.007
"""Longest step, as a share of the time in which a drive that accelerates from rest takes the whole weight up. Of 0.02,
5 of 172 random rigs differed from 20 times shorter steps by more than 1 %. The cause is known for one of them: the
drive alternates between its limits of acceleration, and each change is a corner."""


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, stage by stage."""
    bends, holes = any_stiff(p, lanes), p.wrap_angle.shape[0]
    for i in range(lanes):
        x.slack_fraction[i], x.out_of_range[i] = 0.0, 0.0
        x.peak_tension[i] = peak_at_start(x.drive_tension[i])
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
            begin_friction(e, g, i)
    for n in range(substeps):
        if (n == 0) | bends:
            wrapped(x, p, w, lanes, bends)
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], x.drive_position[i], x.drive_velocity[i], e, s, i)
            for h in range(holes):
                for i in range(lanes):
                    rub(x, p, w, e, s, g, h, i)
        for i in range(lanes):
            drive_row(x, p, u, w, e, s, g, i, dt)
            first_span(x, p, u, w, e, s, g, i, dt)
        for h in range(holes - 1):
            for i in range(lanes):
                inner_span(x, p, w, h, i, dt)
        for i in range(lanes):
            load_row(x, p, u, w, e, s, g, i, dt)
        if e is not None:
            solve_together(w, p, e, s, lanes, dt, True)
        else:
            solve_together(w, p, e, s, lanes, dt, (n == 0) | bends)
        for h in range(holes - 1):
            for i in range(lanes):
                slipped(x, w, h, i, dt)
        for i in range(lanes):
            moved(x, p, u, w, e, s, g, i, dt)
        for h in range(holes - 1):
            for i in range(lanes):
                spans(x, p, w, h, i)
        for i in range(lanes):
            behind(x, p, u, w, e, s, i)
            if e is not None:
                advance_memory(
                    u.command[i], x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                    x.drive_tension[i], x.load_tension[i], e, s, i,
                )  # fmt: skip
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
    settle_drive(x, s, p, e, slip, tension)


def _resolves(p, e) -> np.ndarray:
    """Longest steps, s: of the load on all spans one after the other, and of a drive that takes the load up.

    What is faster than that the step damps out.
    """
    softer = 1.0 / (1.0 + p.cable_stiffness * (p.wrap_angle.shape[0] - 1) / p.span_stiffness)
    harder = np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * p.load_weight)
    stiffness = softer * harder * p.cable_stiffness
    load = longest_step(p.load_mass, softer**2 * p.cable_damping + p.load_damping, stiffness + p.load_stiffness)
    weight = np.where(p.load_weight > 0.0, p.load_weight, np.inf)
    return np.minimum(load, PICK_UP * np.sqrt(2.0 * weight / (stiffness * p.acceleration_limit)))


_BRISTLES = ("lugre_friction", "elastoplastic_friction")
_ACTING = replace(
    ACTING, effects={name: p for name, p in ACTING.effects.items() if name not in _BRISTLES}, several=("contact",)
)
"""Of the library all that acts on one hole but the friction of bristles, whose state a hole has each for itself."""


def holes_in_series(holes: int) -> Plant:
    """The plant with ``holes`` >= 2 holes."""
    parameters = series_parameters(holes)
    return Plant(
        name="cable_hole",
        parameters=parameters,
        signals=series_signals(holes),
        signal_rows=signal_rows(holes),
        coefficient_rows=coefficient_rows(holes),
        scratch=scratch(holes),
        action_modes=(
            ActionMode("tension", "N", "tension_command_limit", one_sided=True, rest_signal="drive_tension"),
            ActionMode("speed", "m/s", "drive_speed_limit"),
        ),
        derive=derive,
        settle=_settle,
        solve=_solve,
        effects=Layout("cable_hole", parameters, _ACTING),
        resolves=_resolves,
        ranges=RANGES,
    )
