"""Two motors that turn a sprung pulley through a belt: voltage to what the pulley's speed sensor reads.

    carriage (motors and belt)  m x'' = force_per_volt u - b - viscous x' - F_c sign(x')
    pulley                      m_p x_p'' = b + disturbance
    belt                        b = k (x - x_p) + c (x' - x_p'), a push as well as a pull
    reading                     z = |y|^power sign(y) + zero,  y = s - share min(s, 0),  s = speed_scale x_p'

symbol | meaning | unit
------ | ------- | ----
x, x_p | position of the belt at the motors and at the pulley | m
m, m_p | inertia of motors and belt, and of the pulley, at the belt | kg
u, z   | voltage of the motors; reading of the speed sensor | V

The rig is that of Wigren and Schoukens, Coupled electric drives data set, Uppsala University TR 2017-024. All dry
friction acts on the motors' side. Linearly implicit trapezoidal steps with the forces at the predicted middle of the
step, both inertias together: order 2. `replay` with drive "follow": the motors' side is moved as told.
"""

import numpy as np

from cable_envs.core.kernels import inline, maximum, minimum, power, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.effects.lanes import STEP
from cable_envs.effects.own import advance_memory, own_actuate, slopes_of_own_load
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.seams import actuate, begin, end, slide, sprung
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.plants.base import OUT_OF_RANGE, ActionMode, Plant, Signal, rows_of
from cable_envs.plants.coupled_drives.effects import ACTING

_TYPICAL = "chosen: the size of the published rig, of which only ratios are known"

PARAMETERS = ParameterTable(
    Parameter("mass", "kg", 10.0, 1e-6, 1e5, "inertia of motors and belt", _TYPICAL),
    Parameter("pulley_mass", "kg", 0.5, 1e-6, 1e5, "inertia of the pulley at the belt", _TYPICAL),
    Parameter("belt_stiffness", "N/m", 150.0, 1e-6, 1e9, "spring between motors and pulley", _TYPICAL),
    Parameter("belt_damping", "N s/m", 3.0, 0.0, 1e6, "damping of that spring", _TYPICAL),
    Parameter("viscous", "N s/m", 50.0, 0.0, 1e5, "viscous friction of the motors", _TYPICAL),
    Parameter("coulomb", "N", 0.0, 0.0, 1e4, "Coulomb friction of the motors", "null"),
    Parameter("force_per_volt", "N/V", 20.0, 1e-9, 1e6, "force of the motors for one volt", _TYPICAL),
    Parameter("voltage_limit", "V", 10.0, 1e-6, 1e6, "range of voltages that a command may ask for", _TYPICAL),
    Parameter("speed_scale", "V s/m", 10.0, 1e-9, 1e9, "reading of the speed sensor for 1 m/s", _TYPICAL),
    Parameter("reading_zero", "V", 0.0, -1e3, 1e3, "reading of the speed sensor at rest", "null"),
)

SIGNALS = (
    Signal("motor_position", "m", "position of the belt at the motors"),
    Signal("motor_velocity", "m/s", "its speed"),
    Signal("pulley_position", "m", "position of the belt at the pulley"),
    Signal("pulley_velocity", "m/s", "its speed"),
    Signal("belt_force", "N", "force of the belt on the pulley"),
    Signal("voltage", "V", "voltage of the motors"),
    Signal("speed_reading", "V", "what the speed sensor of the pulley reads"),
    OUT_OF_RANGE,
)

COEFFICIENTS = Lanes("Coefficients", PARAMETERS.names)
STEP_ROWS = Lanes("Step", [*STEP, "elastic"])
"""Besides what all plants have: what the belt is stretched by."""
LEAST_READING = 1e-12
"""V that are added to the size of a reading before it is raised to a power, which has no slope at zero else."""


@inline
def _resist(e, s, i, y, v, viscous):
    """(force that resists the motors besides dry friction, its stiffness, its damping)."""
    ripple, steep = wave(y, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i])
    at, k, c = slopes_of_own_load(y, v, e, s, i)
    spring = e.position_dependent_load_stiffness[i]
    resist = viscous * v + spring * (y - e.position_dependent_load_neutral[i]) - ripple + at
    return resist, spring + maximum(-steep, 0.0) + k, viscous + c


@inline
def _reading(p, e, i, velocity):
    """What the detector of the pulley's speed shows, V."""
    signal = p.speed_scale[i] * velocity
    seen = signal - e.sensor_rectification_share[i] * minimum(signal, 0.0)
    shape = e.detector_power_power[i]
    curved = sign(seen) * power(abs(seen) + LEAST_READING, shape)
    return select(shape == 1.0, seen, curved) + p.reading_zero[i]


@inline
def _step(x, p, u, e, s, g, i, dt):
    y, v, yp, vp = x.motor_position[i], x.motor_velocity[i], x.pulley_position[i], x.pulley_velocity[i]
    follows, half = g.follows[i] > 0.5, 0.5 * dt
    # both are solved together: the belt's force in the middle of the step is pull + grip (change of vp - of v)
    pull, belt_k, belt_c, g.elastic[i] = sprung(
        e, s, i, p.belt_stiffness[i], p.belt_damping[i], yp + half * vp - (y + half * v), vp - v
    )
    grip = 0.5 * (belt_c + half * belt_k)
    alone = dt * (u.disturbance[i] - pull) / (p.pulley_mass[i] + dt * grip)
    along = dt * grip / (p.pulley_mass[i] + dt * grip)
    resist, load_k, load_c = _resist(e, s, i, y + half * v, v, p.viscous[i])
    drive = pull + grip * alone + half * load_k * v  # the forces are those of the middle already
    damp = load_c + 2.0 * grip * (1.0 - along)
    force = p.force_per_volt[i] * u.command[i]
    v_new = slide(e, s, g, i, v, p.mass[i], p.coulomb[i], drive, resist - force, load_k, damp, dt)
    v_new = select(follows, g.target_rate[i], v_new)
    vp_new = vp + alone + along * (v_new - v)
    x.motor_position[i] = select(follows, g.target[i], y + half * (v + v_new))
    x.pulley_position[i] = yp + half * (vp + vp_new)
    x.motor_velocity[i], x.pulley_velocity[i] = v_new, vp_new
    creeps_on(s.creep_top, s.slow_creep_top, e, i, g.elastic[i], g.creep_left[i], g.slow_left[i])
    y, v = x.motor_position[i], x.motor_velocity[i]
    advance_memory(u.command[i], y, v, y, v, abs(pull), 0.0, e, s, i)


@inline
def _report(x, p, u, e, s, g, i):
    """What is seen of the state at the end of a control step."""
    stretch, rate = x.pulley_position[i] - x.motor_position[i], x.pulley_velocity[i] - x.motor_velocity[i]
    pull, _, _, _ = sprung(e, s, i, p.belt_stiffness[i], p.belt_damping[i], stretch, rate)
    x.belt_force[i], x.voltage[i] = -pull, select(g.follows[i] > 0.5, 0.0, u.command[i])
    x.speed_reading[i], x.out_of_range[i] = _reading(p, e, i, x.pulley_velocity[i]), 0.0


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        y, v = x.motor_position[i], x.motor_velocity[i]
        begin(e, s, g, u, i, y, v, y, v, substeps * dt, dt)
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            u.command[i] = own_actuate(u.command[i], x.motor_position[i], x.motor_velocity[i], e, s, i)
        for i in range(lanes):
            _step(x, p, u, e, s, g, i, dt)
            s.started[i] = 1.0
    for i in range(lanes):
        _report(x, p, u, e, s, g, i)
        end(e, s, g, i, x.motor_position[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`: the parameters themselves."""
    return {name: value[name] for name in COEFFICIENTS.names}


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest at ``position`` (m, [n]), held by the motors against a spring or a ripple; the belt is relaxed."""
    angle = 2.0 * np.pi * position / e.position_ripple_period + e.position_ripple_phase
    spring = e.position_dependent_load_stiffness * (position - e.position_dependent_load_neutral)
    held = spring - e.position_ripple_amplitude * np.sin(angle)
    x.motor_position[:], x.pulley_position[:] = position, position
    x.voltage[:], x.speed_reading[:] = held / p.force_per_volt, p.reading_zero


PLANT = Plant(
    name="coupled_drives",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=Lanes("Scratch", []),
    action_modes=(ActionMode("voltage", "V", "voltage_limit", rest_signal="voltage"),),
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("coupled_drives", PARAMETERS, ACTING),
    step_rows=STEP_ROWS,
    plain=False,
    replays=("follow",),
)
