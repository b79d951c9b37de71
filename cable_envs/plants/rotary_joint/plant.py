"""A joint that a motor turns through a gear against a pendulum, a spring or nothing, under a controller of its own.

    (J + m l^2 + J_l) v' = T - viscous v - F_c sign(v) - m g l sin(q - q_0) - spring + disturbance
    torque   T = k_t i / (1 + drop |i|): `torque_saturation`
    current  i (R (1 + h) + R_s |u|) = u U - k_t v, within current_limit; 0 where the bridge is open (release above 1/2)
    duty     u = command, or position_gain (command - q) + rate_gain (command' - v), within duty_limit; or command / U
    else     i = command, within current_limit; k_t i = command, within torque_limit: an amplifier with a current loop,
             whose supply is never short

symbol | meaning | unit
------ | ------- | ----
q, v   | angle and speed of the joint | rad, rad/s
J, J_l | inertia of the motor's side, at the joint; of the load besides its point mass | kg m^2
m, l   | point mass and its distance from the axis; it hangs at q_0 | kg, m
i, u, U | current; duty of the bridge; voltage of the supply without load | A, 1, V
k_t    | torque constant, which is that of the back-EMF too, at the joint | N m/A
R, R_s, h | resistance of the winding when cold and of the supply's path; what heat adds | ohm, ohm, 1

The motor's side is what rubs; `gear_friction` is the gear between it and the load. All lengths are angles: it is the
linear drive with the motor's circuit and with gravity as a pendulum, and its dry friction is the same code
(`cable_envs.effects.seams.slid`). Linearly implicit trapezoidal steps with the forces at the predicted middle of the
step: order 2. One kernel: it has the effects always. `replay` with drive "follow": the joint is moved as told.
"""

import numpy as np

from cable_envs.core.inputs import FOLLOW
from cable_envs.core.kernels import clip, inline, maximum, select, sign, sine_cosine
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting, Layout
from cable_envs.effects.backlash import dead_zone
from cable_envs.effects.gear_friction import geared, shares
from cable_envs.effects.own import advance_memory, own_actuate, slopes_of_own_load
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.seams import actuate, begin, begin_friction, dry_friction, end, slid
from cable_envs.effects.torque_saturation import saturated, unsaturated
from cable_envs.effects.unilateral_contact import met_friction, met_push, push_at_rest
from cable_envs.effects.winding_heating import warmed
from cable_envs.physics.motor import driven_current, shown
from cable_envs.plants.base import OUT_OF_RANGE, ActionMode, Plant, SecondCommand, Signal, rows_of

_TYPICAL = "chosen: a small hobby servo"

PARAMETERS = ParameterTable(
    Parameter("inertia", "kg m^2", 2e-3, 1e-9, 1e4, "inertia of motor and gear, at the joint", _TYPICAL),
    Parameter("load_inertia", "kg m^2", 0.0, 0.0, 1e5, "inertia of the load besides its point mass", "null"),
    Parameter("load_mass", "kg", 0.5, 0.0, 1e5, "point mass of the load", _TYPICAL),
    Parameter("arm_length", "m", 0.1, 0.0, 100.0, "distance of the point mass from the axis", _TYPICAL),
    Parameter("hanging_angle", "rad", 0.0, -7.0, 7.0, "reading of the angle at which the mass hangs", "null"),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("viscous", "N m s", 5e-3, 0.0, 1e4, "viscous friction", _TYPICAL),
    Parameter("coulomb", "N m", 0.01, 0.0, 1e4, "Coulomb friction", _TYPICAL),
    Parameter("torque_constant", "N m/A", 0.4, 1e-9, 1e5, "torque for one ampere, at the joint", _TYPICAL),
    Parameter("resistance", "ohm", 3.0, 1e-6, 1e4, "resistance of the cold winding", _TYPICAL),
    Parameter("supply_voltage", "V", 7.4, 1e-6, 1e5, "voltage of the supply without load", _TYPICAL),
    Parameter("current_limit", "A", 1e3, 1e-6, 1e5, "largest current that the amplifier lets through", "null"),
    Parameter("torque_limit", "N m", 1.0, 1e-9, 1e6, "largest torque that a command may ask for", _TYPICAL),
    Parameter("duty_limit", "1", 1.0, 1e-6, 1.0, "largest duty", "null"),
    Parameter("position_gain", "1/rad", 1.0, 0.0, 1e5, "duty for a radian of position error", _TYPICAL),
    Parameter("rate_gain", "s/rad", 0.0, 0.0, 1e4, "duty for a radian per second of speed error", "null"),
    Parameter("position_limit", "rad", 3.0, 1e-6, 1e4, "range of positions that a command may ask for", _TYPICAL),
    Parameter("release_limit", "1", 1.0, 1e-6, 1.0, "largest release; above 1/2 the bridge is open", "null"),
)

SIGNALS = (
    Signal("position", "rad", "angle of the joint"),
    Signal("velocity", "rad/s", "speed of the joint"),
    Signal("duty", "1", "duty of the bridge"),
    Signal("voltage", "V", "voltage that the bridge asks for: duty times supply_voltage"),
    Signal("current", "A", "current of the motor"),
    Signal("torque", "N m", "torque of the motor, at the joint"),
    Signal("load_torque", "N m", "what gravity, spring and disturbance ask of the motor at rest"),
    Signal("warming", "1", "share by which heat has raised the winding's resistance"),
    Signal("held_reference", "rad", "reference at which the controller would give this duty at rest"),
    Signal("release_command", "1", "above 1/2 the bridge is open"),
    Signal("sliding", "1", "direction in which the joint turns: -1, 0 (stuck), 1"),
    OUT_OF_RANGE,
)

ACTING = Acting(
    effects={
        "coulomb_friction": ("level",), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"),
        "gear_friction": ("driving", "backdriving", "rise", "velocity"), "friction_drift": ("change", "time", "travel"),
        "position_ripple": ("force", "period", "phase"), "position_dependent_load": ("stiffness", "neutral"),
        "unilateral_contact": ("stiffness", "damping", "friction", "place"),
        "actuator_lag": ("time",), "command_delay": ("time",), "dead_band": ("width",),
        "quantised_command": ("steps",), "supply_sag": ("resistance",), "torque_saturation": ("drop",),
        "winding_heating": ("growth", "time"),
    },
    sensors={"position": "rad", "velocity": "rad/s", "duty": "1", "current": "A"},
    aliases={"coulomb_friction.level": "coulomb", "viscous_friction.coefficient": "viscous"},
    turning=True,
    seams=("actuate", "load"),
)  # fmt: skip

COEFFICIENTS = Lanes("Coefficients", [
    "inertia", "load_inertia", "weight", "hanging_angle", "viscous", "coulomb", "torque_constant", "resistance",
    "supply_voltage", "current_limit", "torque_limit", "duty_limit", "position_gain", "rate_gain",
])  # fmt: skip
DUTY, POSITION, VOLTAGE, CURRENT, TORQUE = 0, 1, 2, 3, 4
"""Numbers of the action modes: their places in `PLANT`."""


@inline
def _of_current(u, i):
    """Whether the command is a current or a torque, which the amplifier has the motor make."""
    return (u.mode[i] > CURRENT - 0.5) & (u.mode[i] < TORQUE + 0.5)


@inline
def _heard(e, i, wanted, limit):
    """(what the amplifier takes from a command within its limit, that before its steps)."""
    asked = dead_zone(clip(wanted, -limit, limit), 2.0 * limit * e.dead_band_width[i])
    return shown(asked, e.quantised_command_steps[i] / limit), asked


@inline
def _duty(p, u, e, i, y, v):
    """(duty, 1 where it follows the controller's error and 0 elsewhere)."""
    mode, limit, command = u.mode[i], p.duty_limit[i], u.command[i]
    servo = (abs(mode - POSITION) < 0.5) | (mode > FOLLOW - 0.5)
    error, rate = command - y, u.command_rate[i] - v
    told = select(abs(mode - VOLTAGE) < 0.5, command / p.supply_voltage[i], command)
    wanted = select(servo, p.position_gain[i] * error + p.rate_gain[i] * rate, told)
    duty, asked = _heard(e, i, wanted, limit)
    free = servo & (abs(wanted) < limit) & (asked != 0.0)
    released = u.second[i] > 0.5
    return select(released, 0.0, duty), select(free & (not released), 1.0, 0.0)


@inline
def _motor(p, u, e, i, y, v, warming):
    """(torque, its stiffness, its damping, current, duty) of the motor at a position and speed.

    Where the command is a current or a torque, the duty is the share of the supply's voltage that it takes.
    """
    duty, free = _duty(p, u, e, i, y, v)
    winding, sag, k = p.resistance[i] * (1.0 + warming), e.supply_sag_resistance[i], p.torque_constant[i]
    current = driven_current(duty, k * v, winding, sag, p.supply_voltage[i], p.current_limit[i])
    told, limit = u.command[i], select(u.mode[i] > CURRENT + 0.5, p.torque_limit[i], p.current_limit[i])
    made, _ = _heard(e, i, told, limit)
    made = select(u.mode[i] > CURRENT + 0.5, made / k, made)
    looped = _of_current(u, i)
    current = select(looped, made, current)
    duty = select(looped, (winding * made + k * v) / p.supply_voltage[i], duty)
    released = u.second[i] > 0.5
    current, duty = select(released, 0.0, current), select(released, 0.0, duty)
    whole = winding + sag * abs(duty)
    gives = select(released | looped | (abs(current) >= p.current_limit[i]), 0.0, k / whole)
    push = free * gives * (p.supply_voltage[i] - sag * sign(duty) * current)
    magnetising, slope = saturated(current, e.torque_saturation_drop[i])
    push, gives = slope * push, slope * gives
    return k * magnetising, push * p.position_gain[i], push * p.rate_gain[i] + gives * k, current, duty


@inline
def _load(p, u, e, s, i, y, v, reach):
    """(torque that the load takes at rest, its stiffness, its damping); of what is met from y - reach to y + reach."""
    at, k, c = slopes_of_own_load(y, v, e, s, i)
    sine, cosine = sine_cosine(y - p.hanging_angle[i])
    spring = e.position_dependent_load_stiffness[i]
    back, rigid, wet = met_push(e, i, y, v, reach)
    torque = p.weight[i] * sine + spring * (y - e.position_dependent_load_neutral[i]) + at + back - u.disturbance[i]
    return torque, maximum(p.weight[i] * cosine, 0.0) + spring + k + rigid, c + wet


@inline
def _through(p, e, i, net, load, v):
    """(net torque, mass) of an upward motion with a net torque on the motor's side and what the load takes."""
    driven, drives = shares(
        e.gear_friction_driving[i],
        e.gear_friction_backdriving[i],
        e.gear_friction_rise[i],
        e.gear_friction_velocity[i],
        v,
    )
    return geared(net, load, p.inertia[i], p.load_inertia[i], driven, drives)


@inline
def _step(x, p, u, e, s, g, i, dt):
    y, v, half = x.position[i], x.velocity[i], 0.5 * dt
    middle = y + half * v
    torque, k, c, current, _ = _motor(p, u, e, i, middle, v, x.warming[i])
    ripple, steep = wave(
        middle, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i]
    )
    load, load_k, load_c = _load(p, u, e, s, i, middle, v, half * v)
    dry_friction(e, g, i, v, p.coulomb[i] + met_friction(e, i, middle, half * v), 0.0)
    net = torque + ripple - p.viscous[i] * v
    up, rising = _through(p, e, i, net - g.up[i], load, v)
    down, falling = _through(p, e, i, -net - g.down[i], -load, v)
    # the gear makes the mass another one by the direction: forces are taken over it, with one mass for both
    mass = p.inertia[i] + p.load_inertia[i]
    upward, downward = mass / rising, mass / falling
    now = select((v > 0.0) | ((v == 0.0) & (up > 0.0)), upward, downward)
    stiff = now * (k + maximum(-steep, 0.0) + load_k)
    damp = now * (c + p.viscous[i] + load_c)
    ahead = half * stiff * v  # these forces are those of the middle already
    v_new = slid(e, s, g, i, v, mass, upward * up + ahead, ahead - downward * down, stiff, damp, dt)
    loss = p.resistance[i] * (1.0 + x.warming[i]) * current * current
    x.warming[i] = warmed(x.warming[i], loss, e.winding_heating_growth[i], e.winding_heating_time[i], dt)
    follows = g.follows[i] > 0.5
    v_new = select(follows, g.target_rate[i], v_new)
    x.position[i], x.velocity[i] = select(follows, g.target[i], y + half * (v + v_new)), v_new


@inline
def _report(x, p, u, e, s, i):
    """What is seen of the state at the end of a control step."""
    y, v = x.position[i], x.velocity[i]
    x.torque[i], _, _, x.current[i], x.duty[i] = _motor(p, u, e, i, y, v, x.warming[i])
    x.voltage[i] = x.duty[i] * p.supply_voltage[i]
    x.load_torque[i], _, _ = _load(p, u, e, s, i, y, v, 0.0)
    gain = p.position_gain[i]
    x.held_reference[i] = y + select(gain > 0.0, x.duty[i] / select(gain > 0.0, gain, 1.0), 0.0)
    x.sliding[i], x.release_command[i], x.out_of_range[i] = sign(v), u.second[i], 0.0


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        y, v = x.position[i], x.velocity[i]
        begin(e, s, g, u, i, y, v, y, v, substeps * dt, dt)
        begin_friction(e, g, i)
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            u.command[i] = own_actuate(u.command[i], x.position[i], x.velocity[i], e, s, i)
        for i in range(lanes):
            _step(x, p, u, e, s, g, i, dt)
            y, v = x.position[i], x.velocity[i]
            advance_memory(u.command[i], y, v, y, v, 0.0, 0.0, e, s, i)
            s.started[i] = 1.0
    for i in range(lanes):
        _report(x, p, u, e, s, i)
        end(e, s, g, i, x.position[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`."""
    point = value["load_mass"] * value["arm_length"]
    same = (name for name in COEFFICIENTS.names if name not in ("load_inertia", "weight"))
    return {name: value[name] for name in same} | {
        "load_inertia": value["load_inertia"] + point * value["arm_length"], "weight": point * value["gravity"],
    }  # fmt: skip


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest at ``position`` (rad, [n]), held by the motor alone; the winding is cold."""
    angle = 2.0 * np.pi * position / e.position_ripple_period + e.position_ripple_phase
    spring = e.position_dependent_load_stiffness * (position - e.position_dependent_load_neutral)
    load = p.weight * np.sin(position - p.hanging_angle) + spring + push_at_rest(e, position)
    held = load - e.position_ripple_amplitude * np.sin(angle)
    current = unsaturated(held / p.torque_constant, e.torque_saturation_drop)
    current = np.clip(current, -p.current_limit, p.current_limit)
    most = np.maximum(p.supply_voltage - e.supply_sag_resistance * np.abs(current), 1e-300)
    duty = np.clip(current * p.resistance / most, -p.duty_limit, p.duty_limit)
    x.position[:], x.load_torque[:], x.duty[:], x.voltage[:] = position, load, duty, duty * p.supply_voltage
    x.current[:], x.torque[:] = current, held
    x.held_reference[:] = position + np.where(p.position_gain > 0.0, duty / np.maximum(p.position_gain, 1e-300), 0.0)


RELEASE = SecondCommand("release", "1", "release_limit", one_sided=True)
"""The bridge is open where it is above 1/2: the motor turns freely."""

PLANT = Plant(
    name="rotary_joint",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=Lanes("Scratch", []),
    action_modes=(
        ActionMode("duty", "1", "duty_limit", rest_signal="duty", second=RELEASE),
        ActionMode("position", "rad", "position_limit", rest_signal="held_reference", second=RELEASE),
        ActionMode("voltage", "V", "supply_voltage", rest_signal="voltage", second=RELEASE),
        ActionMode("current", "A", "current_limit", rest_signal="current", second=RELEASE),
        ActionMode("torque", "N m", "torque_limit", rest_signal="torque", second=RELEASE),
    ),
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("rotary_joint", PARAMETERS, ACTING),
    plain=False,
    replays=("follow",),
)
