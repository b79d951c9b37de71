"""A tendon that rubs in its sheath at N contacts, with the tendon's and the sheath's compliance spread between them.

The sheath of `cable_envs.plants.sheath.plant` cut into N equal pieces: the friction of a piece acts in its middle, and
the compliance 1/k of tendon and sheath lies in N + 1 spans between drive, contacts and load, those at the ends half as
long. The bend changes with the posture.

    spans    T_j = max(0, k_j (s_j - s_{j+1} - its share of slack and creep) + c_j (s_j' - s_{j+1}'))
             k_j = N k, twice that at the ends; c_j / k_j = c / k;   s_0 = x, s_{N+1} = y
    contact  T_{h-1} = up T_h slipping to the drive,  T_h = down T_{h-1} slipping to the load,  in between at rest
             up = down = exp(mu Theta / N),   Theta = bend_angle + posture, at least 0
    load     m y'' = T_N - preload - k_l y - c_l y' - F_c sign(y') + disturbance
    position x'' = w^2 (command - x) + 2 z w (command_rate - x'),     within acceleration and speed limits
    tension  m_d x'' = command - T_0 - c_d x',                        within the speed limit

A reversal of the drive does not reach the load at once: the contacts turn one after the other, from the drive on, and
the drive runs through the stretch that goes with it. So backlash and hysteresis come out, with the path of T_0 between
its ends, and nothing of them is put in (Kaneko et al., IEEE Transactions on Robotics and Automation 8 (1992) 1;
Agrawal, Peine and Yao, IEEE Transactions on Robotics 26 (2010) 920, whose chain of elements this is, here without
mass). With N towards infinity this is the distributed capstan; sliding throughout, T_0 / T_N is e^(mu Theta) for any N.

A step solves all contacts and both ends together, exactly (`cable_envs.physics.sweeps`): T_j are those that stand c / k
before its end, at most in its middle. The forces on load and drive are the means of a straight line through them (order
2), and more of the end where a step cannot resolve how an end shakes on its own span. What is shown at the end of a
control step is solved for there.

Signs: x > 0 pulls in, s > 0 slips to the drive, y > 0 goes towards the sheath. SI units throughout.

Valid for slow motion (no waves, no mass of the tendon), a tendon without bending stiffness in the middle of the sheath:
its path keeps its length as the bend changes, and only its friction does. Curvature and pressure do not change mu.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import inline, sign
from cable_envs.core.lanes import Lanes
from cable_envs.effects import Layout
from cable_envs.effects.own import advance_memory, own_actuate
from cable_envs.effects.seams import actuate, begin, end
from cable_envs.physics import sweeps
from cable_envs.physics.modes import COUPLED
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.peaks import peak_at_start
from cable_envs.plants.sheath.contact_stages import (
    at_speeds,
    drive_end,
    drive_row,
    first_span,
    inner_span,
    last_span,
    limits,
    load_end,
    load_row,
    load_stays,
    moved,
    report,
    scratch,
    shown_tensions,
    spans_of,
)
from cable_envs.plants.sheath.parameters import ACTING, COEFFICIENTS, PARAMETERS, SIGNALS, derive, resolves
from cable_envs.plants.sheath.plant import PLANT

MOST = 50
"""Most contacts."""

SHAKES = 0.5
"""Most that the vibration of an end on its own span may turn in a step, rad."""

SHORT = 1e-6
"""Length, over that of a step, of one in which nothing moves: it shows the tensions at the end of a control step."""

solve_together = specialised(
    sweeps.solve, first_span=first_span, inner_span=inner_span, last_span=last_span, drive_end=drive_end,
    load_end=load_end, load_stays=load_stays,
)  # fmt: skip


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, stage by stage."""
    contacts = x.slip_position.shape[0]
    for i in range(lanes):
        x.slack_fraction[i], x.out_of_range[i] = 0.0, 0.0
        x.peak_tension[i] = peak_at_start(x.drive_tension[i])
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
        limits(x, p, u, w, e, s, g, i)
        spans_of(x, p, w, e, s, i, dt)
    for h in range(contacts):
        for i in range(lanes):
            w.way[h, i] = sign(x.slip_velocity[h, i])
    for n in range(substeps):
        for i in range(lanes):
            if e is not None:
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], x.drive_position[i], x.drive_velocity[i], e, s, i)
                limits(x, p, u, w, e, s, g, i)
            drive_row(x, p, u, w, e, s, g, i, dt)
            load_row(x, p, u, w, e, s, g, i, dt)
            if e is not None:
                spans_of(x, p, w, e, s, i, dt)
        solve_together(w, x, e, s, lanes)
        for h in range(contacts):
            for i in range(lanes):
                x.slip_position[h, i] += w.slip[h + 1, i]
        for i in range(lanes):
            moved(x, p, u, w, e, s, g, i, dt)
            if e is not None:
                advance_memory(
                    u.command[i], x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                    x.drive_pull[i], x.load_pull[i], e, s, i,
                )  # fmt: skip
                s.started[i] = 1.0
    for h in range(contacts):
        for i in range(lanes):
            x.slip_velocity[h, i] = w.slip[h + 1, i] / dt
    short = SHORT * dt
    for i in range(lanes):
        spans_of(x, p, w, e, s, i, short)
        at_speeds(x, w, i, short)
    solve_together(w, x, e, s, lanes)
    for i in range(lanes):
        shown_tensions(x, w, i)
    for h in range(contacts - 1):
        for i in range(lanes):
            x.span_tension[h, i] = w.tension[h + 1, i]
    for i in range(lanes):
        report(x, w, i, substeps)
        if e is not None:
            end(e, s, g, i, x.load_position[i], substeps * dt)


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the load at ``position`` (m, [n]): one tension all along, the drive amid its gap."""
    PLANT.settle(x, s, p, e, position)
    contacts = len(x.slip_position)
    for h in range(contacts):
        x.slip_position[h] = position + (x.drive_position - position) * (1.0 - (h + 0.5) / contacts)
    x.span_tension[:], x.bend[:] = x.drive_tension, p.bend_angle
    x.drive_pull[:], x.load_pull[:] = x.drive_tension, x.load_tension


_BUILDING_UP = ("presliding_hysteresis", "lugre_friction", "elastoplastic_friction")
_ACTING = replace(ACTING, effects={name: p for name, p in ACTING.effects.items() if name not in _BUILDING_UP})
"""Of the library all that acts on the sheath as one contact, but friction that is made to build up: here it does."""


def _resolves(contacts: int) -> Callable:
    """Longest steps, s: a share of those of the sheath without contacts, whose vibrations are in time to order 4.

    Here all tensions are solved together, so that they are in time to order 2. Where the contact next to it rests, an
    end shakes on its own short span.
    """

    def resolved(p, e) -> np.ndarray:
        span = 2.0 * contacts * p.stiffness * np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * p.load_preload)
        return np.minimum(COUPLED * resolves(p, e), SHAKES / np.sqrt(span / np.minimum(p.load_mass, p.drive_mass)))

    return resolved


@cache
def sheath_with_contacts(contacts: int) -> Plant:
    """The plant with so many contacts, 1 to `MOST`; ConfigurationError beyond."""
    if not 1 <= contacts <= MOST:
        raise ConfigurationError(f"contacts: expected 1 to {MOST}, got {contacts}")
    rows = (
        *((f"slip_position_{h}", "m", f"place of the tendon at contact {h}") for h in range(1, contacts + 1)),
        *((f"slip_velocity_{h}", "m/s", f"speed of the tendon at contact {h}") for h in range(1, contacts + 1)),
        *((f"span_tension_{j}", "N", f"tension behind contact {j}") for j in range(1, contacts)),
    )
    ends = (
        Signal("drive_pull", "N", "tension at the drive with which the last integration step was solved"),
        Signal("load_pull", "N", "tension at the load with which the last integration step was solved"),
    )
    signals = (*SIGNALS, Signal("bend", "rad", "present bend of the sheath"), *(Signal(*row) for row in rows), *ends)
    ends_of_spans = ("slip_position", contacts), ("slip_velocity", contacts), ("span_tension", contacts - 1)
    return replace(
        PLANT,
        signals=signals,
        signal_rows=Lanes("Signals", [*(s.name for s in SIGNALS), "bend", *ends_of_spans, "drive_pull", "load_pull"]),
        coefficient_rows=COEFFICIENTS,
        scratch=scratch(contacts),
        derive=derive,
        settle=_settle,
        solve=_solve,
        effects=Layout("tendon_sheath", PARAMETERS, _ACTING),
        resolves=_resolves(contacts),
        plain=True,
        contacts=contacts,
        posture="bend",
    )
