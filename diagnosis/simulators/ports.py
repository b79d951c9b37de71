"""The forces of all laws at a port, over one step: the library's friction on an inertia that the simulator shows.

A simulator says how fast the place at a port moves, not what moves there. Over a step of length dt a force F changes
the velocity by F dt / m; m is found by trying (`cable_envs.diagnosis.simulators.motion`). All that acts at the place
besides the port is then one net force, and the port's own follow from the velocity v' that the laws of
`cable_envs.effects` give an inertia m under that net force within dt:

    F = m (v' - v) / dt - net

Dry friction so holds what it can hold, stops within a step, and is elastic before it slides, as on every plant.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from cable_envs.core.kernels import LANES, jit, load, maximum, select, store
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import ParameterTable
from cable_envs.diagnosis.simulators.effects import CONSTANT_LOAD, FORMS, QUADRATIC, drag
from cable_envs.effects.base import Acting, Effect
from cable_envs.effects.friction_drift import drifted
from cable_envs.effects.lanes import STATES, STEP
from cable_envs.effects.layout import Layout
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.seams import begin_friction, slide
from cable_envs.effects.unilateral_contact import met_friction, met_push

ACTING = {
    "coulomb_friction": ("level",), "viscous_friction": ("coefficient",), "stribeck_friction": ("excess", "velocity"),
    "asymmetric_friction": ("difference",), "presliding_hysteresis": ("displacement",),
    "friction_drift": ("change", "time", "travel"), "position_dependent_load": ("stiffness", "neutral"),
    "position_ripple": ("force", "period", "phase"),
    "unilateral_contact": ("stiffness", "damping", "friction", "place"),
}  # fmt: skip
"""Effects of the library at a port -> their parameters there."""
OF_PLACE = ("presliding_hysteresis", "position_dependent_load", "position_ripple", "unilateral_contact")
"""Those that ask for the position."""
_TURNING = {QUADRATIC.name: "N m s^2/rad^2", CONSTANT_LOAD.name: "N m"}


@cache
def layout(turning: bool) -> Layout:
    """The effects at a port whose motion is straight, or an angle."""
    forms = tuple(_turned(form) for form in FORMS) if turning else FORMS
    return Layout("port", ParameterTable(), Acting(ACTING, {}, turning=turning, forms=forms))


def _turned(form: Effect) -> Effect:
    return replace(form, parameters=tuple(replace(p, unit=_TURNING[form.name]) for p in form.parameters))


_SCRATCH = Lanes("PortStep", STEP)
_e_tile, _s_tile, _g_tile = layout(False).lanes.tile, STATES.tile, _SCRATCH.tile


@jit
def _push(coefficients, states, x, v, mass, net, dt, forces):
    e, s, g = _e_tile(), _s_tile(), _g_tile()
    for first in range(0, len(v), LANES):
        lanes = min(LANES, len(v) - first)
        load(e.rows, coefficients, first, lanes)
        load(s.rows, states, first, lanes)
        for i in range(lanes):
            y, speed, m, rest = x[first + i], v[first + i], mass[first + i], net[first + i]
            change, time, travel = e.friction_drift_change[i], e.friction_drift_time[i], e.friction_drift_travel[i]
            g.factor[i] = 1.0 + change * drifted(s.drift[i], change, time, travel, 0.5 * dt, 0.5 * dt * abs(speed))
            g.up[i], g.down[i], g.steep[i], g.excess[i], g.part[i] = 0.0, 0.0, 0.0, 0.0, 1.0
            begin_friction(e, g, i)
            resist, damping = drag(e.quadratic_drag_coefficient[i], speed)
            viscous, k = e.viscous_friction_coefficient[i], e.position_dependent_load_stiffness[i]
            push, rise = wave(
                y, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i]
            )
            back, rigid, wet = met_push(e, i, y, speed, 0.0)
            resist += viscous * speed + k * (y - e.position_dependent_load_neutral[i]) + e.constant_load_force[i] + back
            stiffness = maximum(k - rise, 0.0) + rigid
            level = e.coulomb_friction_level[i] + met_friction(e, i, y, 0.0)
            new = slide(e, s, g, i, speed, m, level, rest + push, resist, stiffness, damping + viscous + wet, dt)
            s.drift[i] = drifted(s.drift[i], change, time, travel, dt, 0.5 * dt * abs(speed + new))
            s.started[i] = 1.0
            forces[first + i] = select(e.on[i] > 0.0, m * (new - speed) / dt - rest, 0.0)
        store(s.rows, states, first, lanes)


class Rubbing(NamedTuple):
    """The laws at a port in n columns: coefficients and states."""

    coefficients: np.ndarray
    states: np.ndarray

    def forces(
        self, place: np.ndarray, velocity: np.ndarray, mass: np.ndarray, net: np.ndarray, period: float
    ) -> np.ndarray:
        """Mean forces [n] of the laws over a step; the states move on.

        Parameters
        ----------
        place, velocity : ndarray
            [n] at the start of the step.
        mass, net : ndarray
            [n]: what a force has to move, and the force of everything else, at the middle of the step.
        period : float
            Length of the step, s.
        """
        found = np.empty(len(velocity))
        _push(self.coefficients, self.states, place, velocity, mass, net, period, found)
        return found


def rubbing(turning: bool, values: np.ndarray) -> Rubbing:
    """The laws with these values [rows of the layout's table, n], at the start of a run."""
    of = layout(turning)
    return Rubbing(of.coefficients(values), np.zeros((STATES.count, values.shape[1])))
