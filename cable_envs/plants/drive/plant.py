"""A one-axis drive: a motor pushes a carriage, rigidly or through a belt; the rig of drive benchmarks.

    rigid    (m + m_m) x'' = F - viscous x' - F_c sign(x') - m g share + disturbance
    belt     m_m x_m'' = F - b,  m x'' = b - viscous x' - F_c sign(x') - m g share + disturbance,
             b = k (x_m - x) + c (x_m' - x'),  a push as well as a pull; with a gap only what is left beyond it
    force    F = command, or force_per_volt times a voltage; within force_limit
    servo    F = (m + m_m) (w^2 (command - x_m) + 2 z w (command_rate - x_m')), within force_limit

symbol | meaning | unit
------ | ------- | ----
x, x_m | position of the carriage and of the motor, at the carriage's scale | m
m, m_m | mass of the carriage; inertia of the motor, at the carriage's scale | kg
F, b   | force of the motor; force of the belt on the carriage | N

Linearly implicit trapezoidal steps with the forces at the predicted middle of the step, carriage and motor together:
order 2. Where the belt is rigid the motor is the carriage. One kernel: it has the effects always.
"""

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import FOLLOW, OBSERVED
from cable_envs.core.kernels import clip, inline, maximum, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting, Layout
from cable_envs.effects.actuator_lag import lagged
from cable_envs.effects.backlash import dead_zone
from cable_envs.effects.lanes import STEP
from cable_envs.effects.own import advance_memory, own_actuate, slopes_of_own_load
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import actuate, begin, begin_friction, end, reported, slide, sprung
from cable_envs.effects.slow_creep import creeps_on, lasting
from cable_envs.effects.unilateral_contact import met_friction, met_push, push_at_rest
from cable_envs.physics.motor import shown
from cable_envs.plants.base import OUT_OF_RANGE, ActionMode, Plant, Signal, rows_of

_TYPICAL = "chosen: a small belt axis"

PARAMETERS = ParameterTable(
    Parameter("mass", "kg", 10.0, 1e-6, 1e5, "mass of the carriage with what it carries", _TYPICAL),
    Parameter("motor_mass", "kg", 1.0, 0.0, 1e5, "inertia of the motor at the carriage's scale", _TYPICAL),
    Parameter("belt_stiffness", "N/m", 0.0, 0.0, 1e9, "spring between motor and carriage; 0: rigid", "null"),
    Parameter("belt_damping", "N s/m", 50.0, 0.0, 1e6, "damping of that spring", _TYPICAL),
    Parameter("viscous", "N s/m", 20.0, 0.0, 1e5, "viscous friction of the carriage", _TYPICAL),
    Parameter("coulomb", "N", 5.0, 0.0, 1e4, "Coulomb friction of the carriage", _TYPICAL),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("gravity_share", "1", 0.0, -1.0, 1.0, "share of gravity along the axis: 1 upright, 0 level", "null"),
    Parameter("force_limit", "N", 200.0, 1e-6, 1e6, "largest force of the motor", _TYPICAL),
    Parameter("force_per_volt", "N/V", 20.0, 1e-9, 1e6, "force of the motor for one volt", _TYPICAL),
    Parameter("voltage_limit", "V", 10.0, 1e-6, 1e6, "range of voltages that a command may ask for", _TYPICAL),
    Parameter("position_limit", "m", 1.0, 1e-6, 1e3, "range of positions that a command may ask for", _TYPICAL),
    Parameter("servo_frequency", "rad/s", 40.0, 0.1, 1e3, "natural frequency of the position servo", _TYPICAL),
    Parameter("servo_damping_ratio", "1", 0.8, 0.0, 5.0, "damping ratio of the position servo", _TYPICAL),
    Parameter("tension_limit", "N", 500.0, 1e-3, 1e7, "force of the belt at which a run counts as unsafe", _TYPICAL),
    Parameter("breaking_tension", "N", 2000.0, 1e-3, 1e8, "force at which the belt tears", _TYPICAL),
)

SIGNALS = (
    Signal("position", "m", "position of the carriage"),
    Signal("velocity", "m/s", "speed of the carriage"),
    Signal("force", "N", "force of the motor"),
    Signal("voltage", "V", "force of the motor over force_per_volt"),
    Signal("motor_position", "m", "position of the motor, at the carriage's scale"),
    Signal("motor_velocity", "m/s", "speed of the motor"),
    Signal("belt_force", "N", "force of the belt on the carriage; where it is rigid, what it would be"),
    Signal("sliding", "1", "direction in which the carriage moves: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "0: a belt pushes and pulls"),
    Signal("peak_tension", "N", "largest size of the belt's force within the last control step"),
    OUT_OF_RANGE,
)

ACTING = Acting(
    effects={
        "coulomb_friction": ("level",), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"), "cable_elongation": ("belt_stiffness",),
        "stiffness_hardening": ("coefficient",), "viscoelastic_creep": ("share", "time"),
        "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"), "backlash": ("gap",),
        "position_ripple": ("force", "period", "phase"), "position_dependent_load": ("stiffness", "neutral"),
        "unilateral_contact": ("stiffness", "damping", "friction", "place"),
        "actuator_lag": ("time",), "dead_band": ("width",), "quantised_command": ("steps",),
    },
    sensors={"position": "m", "velocity": "m/s", "force": "N", "motor_position": "m"},
    aliases={
        "coulomb_friction.level": "coulomb", "viscous_friction.coefficient": "viscous",
        "cable_elongation.belt_stiffness": "belt_stiffness",
    },
)  # fmt: skip

COEFFICIENTS = Lanes("Coefficients", [
    "mass", "motor_mass", "belt_stiffness", "belt_damping", "viscous", "coulomb", "weight", "force_limit",
    "force_per_volt", "servo_stiffness", "servo_damping",
])  # fmt: skip
STEP_ROWS = Lanes("Step", [*STEP, "motor_speed_before", "elastic", "force_left", "force_late"])
"""Besides what all plants have: the motor's speed before a step, what the belt is stretched by, and for an observed
drive what its amplifier's lag keeps over a step and the mean share of the old force."""
# An observed drive keeps the force behind its lag, the speed of a step before, and the integral of its servo, in rows
# that a drive does not use; the gain of that integral is its input second.
FORCE, POSITION, VOLTAGE = 0, 1, 2
"""Numbers of the action modes: their places in `PLANT`."""


@inline
def _motor_force(p, u, e, i, x, v):
    """(force, stiffness, damping) of the motor at a position and speed; none of the latter two at its limit."""
    mode, command = u.mode[i], u.command[i]
    servo, observed = (abs(mode - POSITION) < 0.5) | (mode > FOLLOW - 0.5), mode > OBSERVED - 0.5
    told = select(abs(mode - VOLTAGE) < 0.5, p.force_per_volt[i] * command, command)
    wanted = p.servo_stiffness[i] * (command - x) + p.servo_damping[i] * (u.command_rate[i] - v)
    wanted = select(observed, wanted + u.disturbance[i], wanted)
    force, limit = clip(select(servo, wanted, told), -p.force_limit[i], p.force_limit[i]), p.force_limit[i]
    asked = dead_zone(force, 2.0 * limit * e.dead_band_width[i])
    made = shown(asked, e.quantised_command_steps[i] / limit)
    free = servo & (abs(wanted) < limit) & ((e.dead_band_width[i] <= 0.0) | (asked != 0.0))
    return select(observed, force, made), select(free, p.servo_stiffness[i], 0.0), select(free, p.servo_damping[i], 0.0)


@inline
def _observed_force(p, u, e, s, g, i, y, v, half):
    """Force of an observed drive in the middle of a step, behind the amplifier's lag; moves lag and integral on.

    The speed there goes on as it did in the step before: the servo is soft enough for that.
    """
    going = s.started[i] > 0.5
    ahead = select(going, 0.5 * (v - s.pulley_angle[i]), 0.0)
    s.pulley_angle[i] = v
    wanted, _, _ = _motor_force(p, u, e, i, y + half * (v + 0.5 * ahead), v + ahead)
    grown = half * u.second[i] * (u.command[i] - y - half * v)
    wanted += s.second[i] + grown
    s.second[i] += 2.0 * grown
    late = select(going, s.gap_position[i], wanted)
    s.gap_position[i] = lagged(late, wanted, g.force_left[i])
    return select(g.force_left[i] > 0.0, wanted + (late - wanted) * g.force_late[i], wanted)


@inline
def _belt(p, e, s, g, i, stretch, rate):
    """(force, stiffness, damping) of the belt."""
    force, k, c, g.elastic[i] = sprung(e, s, i, p.belt_stiffness[i], p.belt_damping[i], stretch, rate)
    return force, k, c


@inline
def _load(p, u, e, s, i, y, v, reach):
    """(force that resists besides dry friction, its stiffness, its damping); what is met: from y - reach to + reach."""
    ripple, steep = wave(y, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i])
    at, k, c = slopes_of_own_load(y, v, e, s, i)
    push = select(u.mode[i] > OBSERVED - 0.5, 0.0, u.disturbance[i])
    back, rigid, wet = met_push(e, i, y, v, reach)
    resist = (
        p.weight[i]
        + p.viscous[i] * v
        + e.position_dependent_load_stiffness[i] * (y - e.position_dependent_load_neutral[i])
        - ripple
        + at
        + back
        - push
    )
    return (
        resist,
        e.position_dependent_load_stiffness[i] + maximum(-steep, 0.0) + k + rigid,
        p.viscous[i] + c + wet,
    )


@inline
def _step(x, p, u, e, s, g, i, dt):
    y, v, xm, vm = x.position[i], x.velocity[i], x.motor_position[i], x.motor_velocity[i]
    rigid = p.belt_stiffness[i] <= 0.0
    follows, half = g.follows[i] > 0.5, 0.5 * dt
    # behind a belt both are solved together: its force in the middle of the step is pull + grip (change of vm - of v)
    observed = u.mode[i] > OBSERVED - 0.5
    pushed = _observed_force(p, u, e, s, g, i, y, v, half)
    force, k, c = _motor_force(p, u, e, i, xm + half * vm, vm)
    force, k, c = select(observed, pushed, force), select(observed, 0.0, k), select(observed, 0.0, c)
    pull, belt_k, belt_c = _belt(p, e, s, g, i, xm + half * vm - (y + half * v), vm - v)
    grip = 0.5 * (belt_c + half * belt_k)
    inertia = maximum(p.motor_mass[i], 1e-9) + dt * grip + half * (c + half * k)
    alone = select(follows, g.target_rate[i] - vm, dt * (force - pull) / inertia)
    along = select(follows, 0.0, dt * grip / inertia)
    # one body, or the carriage
    direct, k, c = _motor_force(p, u, e, i, y + half * v, v)
    direct, k, c = select(observed, pushed, direct), select(observed, 0.0, k), select(observed, 0.0, c)
    resist, load_k, load_c = _load(p, u, e, s, i, y + half * v, v, half * v)
    elastic = g.elastic[i]
    drive = select(rigid, direct, pull + grip * alone)
    stiff = load_k + select(rigid, k, 0.0)
    damp = load_c + select(rigid, c, 2.0 * grip * (1.0 - along))
    mass = select(rigid, p.mass[i] + p.motor_mass[i], p.mass[i])
    ahead = half * stiff * v  # these forces are those of the middle already
    level = p.coulomb[i] + met_friction(e, i, y + half * v, half * v)
    v_new = slide(e, s, g, i, v, mass, level, drive + ahead, resist, stiff, damp, dt)
    v_new = select(rigid & follows, g.target_rate[i], v_new)
    vm_new = vm + alone + along * (v_new - v)
    xm_new = select(follows, g.target[i], xm + half * (vm + vm_new))
    y_new = select(rigid & follows, g.target[i], y + half * (v + v_new))
    creeps_on(s.creep_top, s.slow_creep_top, e, i, elastic, g.creep_left[i], g.slow_left[i])
    x.position[i], x.velocity[i], x.sliding[i] = y_new, v_new, sign(v_new)
    x.motor_position[i], x.motor_velocity[i] = select(rigid, y_new, xm_new), select(rigid, v_new, vm_new)
    _report(x, p, u, e, s, g, i, v, v_new, dt)


@inline
def _report(x, p, u, e, s, g, i, v, v_new, dt):
    """Forces of the new state. A path that is followed: the force that it takes."""
    rigid = p.belt_stiffness[i] <= 0.0
    observed = u.mode[i] > OBSERVED - 0.5
    force, _, _ = _motor_force(
        p,
        u,
        e,
        i,
        select(observed, x.position[i], x.motor_position[i]),
        select(observed, x.velocity[i], x.motor_velocity[i]),
    )
    force = select(observed, force + s.second[i], force)
    pull, _, _ = _belt(p, e, s, g, i, x.motor_position[i] - x.position[i], x.motor_velocity[i] - x.velocity[i])
    resist, _, _ = _load(p, u, e, s, i, x.position[i], x.velocity[i], 0.0)
    friction = select(v_new > 0.0, g.up[i], select(v_new < 0.0, -g.down[i], 0.0))
    turned = share(s.presliding, i)
    band = g.up[i] + g.down[i]
    friction = reported(e, g, i, friction, turned * band - g.down[i])
    faster = (v_new - v) / dt
    needed = resist + friction + p.mass[i] * faster
    pull = select(rigid, select(g.follows[i] > 0.5, needed, force - p.motor_mass[i] * faster), pull)
    behind = select(
        rigid,
        needed + p.motor_mass[i] * faster,
        pull + p.motor_mass[i] * (x.motor_velocity[i] - g.motor_speed_before[i]) / dt,
    )
    force = select(g.follows[i] > 0.5, behind, force)
    x.force[i], x.voltage[i], x.belt_force[i] = force, force / p.force_per_volt[i], pull
    x.peak_tension[i] = maximum(x.peak_tension[i], abs(pull))


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        begin(e, s, g, u, i, x.motor_position[i], x.motor_velocity[i], x.position[i], x.velocity[i], substeps * dt, dt)
        begin_friction(e, g, i)
        u.mode[i] = select(g.imposes[i] > 0.5, 0.0, u.mode[i])
        observed = u.mode[i] > OBSERVED - 0.5  # the amplifier is behind its servo, not before it
        g.force_left[i] = g.lag_left[i]
        g.force_late[i] = (1.0 - g.lag_left[i]) * e.actuator_lag_time[i] / dt  # mean share of the old force over a step
        g.lag_left[i] = select(observed, 0.0, g.lag_left[i])
        x.slack_fraction[i], x.peak_tension[i], x.out_of_range[i] = 0.0, 0.0, 0.0
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            u.command[i] = own_actuate(u.command[i], x.motor_position[i], x.motor_velocity[i], e, s, i)
        for i in range(lanes):
            g.motor_speed_before[i] = x.motor_velocity[i]  # the motor's speed before the step
            _step(x, p, u, e, s, g, i, dt)
            advance_memory(
                u.command[i], x.motor_position[i], x.motor_velocity[i], x.position[i], x.velocity[i],
                abs(x.belt_force[i]), 0.0, e, s, i,
            )  # fmt: skip
            s.started[i] = 1.0
    for i in range(lanes):
        end(e, s, g, i, x.position[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`; raises ConfigurationError for what the bounds of single parameters cannot exclude."""
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any((value["belt_stiffness"] > 0.0) & (value["motor_mass"] <= 0.0)):
        raise ConfigurationError("a belt (belt_stiffness above 0) needs a motor with inertia: motor_mass above 0")
    for name, size in (
        ("backlash.gap", e.backlash_gap), ("viscoelastic_creep.share", e.viscoelastic_creep_share),
        ("slow_creep.share", e.slow_creep_share),
        ("stiffness_hardening.coefficient", e.stiffness_hardening_coefficient),
    ):  # fmt: skip
        if np.any((size > 0.0) & (value["belt_stiffness"] <= 0.0)):
            raise ConfigurationError(f"{name} needs a belt: belt_stiffness above 0")
    total, frequency = value["mass"] + value["motor_mass"], value["servo_frequency"]
    same = (
        "mass",
        "motor_mass",
        "belt_stiffness",
        "belt_damping",
        "viscous",
        "coulomb",
        "force_limit",
        "force_per_volt",
    )
    return {
        **{name: value[name] for name in same},
        "weight": value["mass"] * value["gravity"] * value["gravity_share"],
        "servo_stiffness": total * frequency**2,
        "servo_damping": 2.0 * total * value["servo_damping_ratio"] * frequency,
    }


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the carriage at ``position`` (m, [n]), its weight held."""
    angle = 2.0 * np.pi * position / e.position_ripple_period + e.position_ripple_phase
    ripple = e.position_ripple_amplitude * np.sin(angle)
    spring = e.position_dependent_load_stiffness * (position - e.position_dependent_load_neutral)
    force = p.weight + spring + push_at_rest(e, position) - ripple
    hard = e.stiffness_hardening_coefficient
    size = 2.0 * np.abs(force) / (1.0 + np.sqrt(1.0 + 2.0 * hard * np.abs(force)))
    belt = p.belt_stiffness > 0.0
    stretch = np.where(belt, np.sign(force) * size / np.where(belt, p.belt_stiffness, 1.0), 0.0)
    x.position[:], x.force[:], x.voltage[:] = position, force, force / p.force_per_volt
    x.belt_force[:], x.peak_tension[:] = force, np.abs(force)
    s.creep_top[:], s.slow_creep_top[:] = lasting(e) * stretch, e.slow_creep_share * stretch
    lost = np.where(belt, 0.5 * e.backlash_gap * np.sign(force), 0.0)
    x.motor_position[:] = position + stretch * (1.0 + lasting(e)) + lost


PLANT = Plant(
    name="linear_drive",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=Lanes("Scratch", []),
    action_modes=(
        ActionMode("force", "N", "force_limit", rest_signal="force"),
        ActionMode("position", "m", "position_limit", rest_signal="motor_position"),
        ActionMode("voltage", "V", "voltage_limit", rest_signal="voltage"),
    ),
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("linear_drive", PARAMETERS, ACTING),
    step_rows=STEP_ROWS,
    plain=False,
)
