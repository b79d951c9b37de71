"""A cable transmission between two torque sensors, quasi-static: the output, given angle and torque of the drive.

Geometry, tensions and idlers are not known, so the circuit is lumped into friction contacts and springs, in the drive's
units. Without effects it is rigid and frictionless:

    angle = ratio x        M_out = M / ratio        M = torque_constant reading - torque_zero

symbol   | meaning | unit
-------- | ------- | ----
x, v     | angle of the drive, and its speed: what is followed (`replay`'s drive "follow") | rad, rad/s
M        | torque of the drive: ``disturbance`` as its sensor reads it, in A where that is a current | N m
w_1, w   | torque behind the contact at the drive, and behind the second one | N m
angle    | of the output, M_out its torque | rad, N m

contact     opening (v > 0, against a pull w < 0):  M = w e^-l + c        closing:  M = w e^l - c
            l is the capstan's or the bearings' exponent over the whole path (Zou 2022 Eq. 12-13: tension ratio of a
            wrap; both signs), c the part without load: dry friction, or l times a pretension (cannot be told apart)
sticking    set-valued: w stays as it is while M is between the two, else it is at the nearer one (play operator of the
            torque: it knows no motion, so a pull that falls while the output still goes the same way leaves w where it
            was). By the sign of the motion instead: the one or the other, whatever the torque's history

The laws of the springs, the gap, creep, drift, Stribeck's friction and the sensors are those of `cable_envs.effects`;
which parameters they have here is in `effects`. The state has no inertia: a control step may be of any length, and more
substeps refine only the path between two samples. A recording's direction of motion is the sign of ``command_rate``;
where that is zero the direction stays.
"""

import numpy as np

from cable_envs.core.kernels import exp, inline, maximum, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.effects.backlash import play
from cable_envs.effects.load_dependent_friction import friction_band
from cable_envs.effects.position_ripple import half_turn
from cable_envs.effects.presliding_hysteresis import torque_play
from cable_envs.effects.seams import actuate, begin, end
from cable_envs.effects.stiffness_hardening import linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.plants.base import OUT_OF_RANGE, Plant, Signal, rows_of
from cable_envs.plants.transmission.effects import ACTING

PARAMETERS = ParameterTable(
    Parameter("ratio", "1", 1.0, 0.01, 100.0, "angle of the output over that of the drive"),
    Parameter("torque_zero", "N m", 0.0, -10.0, 10.0, "what the drive's torque sensor reads without a torque"),
    Parameter("torque_constant", "N m/A", 1.0, 0.0, 1e3, "torque for one unit of the drive's reading; 1: a torque"),
)

SIGNALS = (
    Signal("output_angle", "rad", "angle of the output"),
    Signal("output_torque", "N m", "torque of the transmission on the output"),
    Signal("drive_angle", "rad", "angle of the drive"),
    Signal("drive_velocity", "rad/s", "speed of the drive"),
    Signal("drive_torque", "N m", "torque of the drive, less its sensor's zero"),
    Signal("direction", "1", "direction of the drive's motion: -1 closing, 1 opening"),
    Signal("play_drive", "N m", "where the play of the torque is at the contact at the drive"),
    Signal("play_output", "N m", "where the play of the torque is at the second contact"),
    OUT_OF_RANGE,
)

COEFFICIENTS = Lanes("Coefficients", ["ratio", "torque_zero", "torque_constant"])
FREE = 1e9
"""N m: a play that has not been taken anywhere yet is beyond every torque, against the motion."""


@inline
def _spring(torque, compliance, hardening):
    """Angle by which a stiffening spring gives way under a torque of either sign."""
    return compliance * sign(torque) * linear(abs(torque), hardening)


@inline
def _contact(torque, exponent, level, share, way, held):
    """(torque behind a contact, where its play is)."""
    low, high = friction_band(torque, exp(exponent), level)
    return torque_play(held, low, high, way, share)


@inline
def _step(x, p, u, e, s, g, i):
    fresh = s.started[i] < 0.5
    angle, v = g.target[i], g.target_rate[i]
    way = select(v > 0.0, 1.0, select(v < 0.0, -1.0, x.direction[i]))
    torque = p.torque_constant[i] * u.disturbance[i] - p.torque_zero[i]
    # friction: a contact at the drive, and one behind the spring of partial slip
    extra, _ = excess_at(e.stribeck_friction_excess[i], e.stribeck_friction_velocity[i], v)
    level = maximum(g.factor[i] * (e.coulomb_friction_level[i] + extra), 0.0)
    exponent, first = g.factor[i] * e.load_dependent_friction_exponent[i], e.partial_slip_share[i]
    share = e.presliding_hysteresis_share[i]
    given = torque - e.position_dependent_load_drive_side[i] * angle - e.viscous_friction_coefficient[i] * v
    held = select(fresh, -way * FREE, x.play_drive[i])
    middle, x.play_drive[i] = _contact(given, exponent * first, level * first, share, way, held)
    held = select(fresh, -way * FREE, x.play_output[i])
    last, x.play_output[i] = _contact(middle, exponent * (1.0 - first), level * (1.0 - first), share, way, held)
    out = last / p.ratio[i] - e.position_dependent_load_output_side[i] * angle
    # springs, creep and gap between the drive's path and the output
    elastic = (
        _spring(torque, e.cable_elongation_drive_side[i], e.stiffness_hardening_drive_side[i])
        + _spring(out, e.cable_elongation_output_side[i], e.stiffness_hardening_output_side[i])
        + _spring(middle, e.partial_slip_compliance[i], e.stiffness_hardening_output_side[i])
    )
    settled = e.viscoelastic_creep_share[i] * elastic
    creep = crept(s.creep_top[i], e.viscoelastic_creep_share[i], elastic, g.creep_left[i])
    s.creep_top[i] = select(fresh, settled, creep)
    ripple = half_turn(angle, e.position_ripple_sine[i], e.position_ripple_cosine[i])
    path = p.ratio[i] * angle + ripple - (elastic + s.creep_top[i])
    s.gap_position[i] = select(fresh, path, play(s.gap_position[i], path, e.backlash_gap[i]))
    x.output_angle[i], x.output_torque[i], x.out_of_range[i] = s.gap_position[i], out, 0.0
    x.drive_angle[i], x.drive_velocity[i], x.drive_torque[i], x.direction[i] = angle, v, torque, way
    s.started[i] = 1.0


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        at = select(s.started[i] < 0.5, u.command[i], x.drive_angle[i])  # before the first step nothing has moved
        begin(e, s, g, u, i, at, x.drive_velocity[i], at, x.drive_velocity[i], substeps * dt, dt)
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
        for i in range(lanes):
            _step(x, p, u, e, s, g, i)
    for i in range(lanes):
        end(e, s, g, i, x.drive_angle[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`."""
    return {name: value[name] for name in COEFFICIENTS.names}


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """The output at ``position`` (rad, [n]) without a torque; friction takes its side by the first step's motion."""
    x.output_angle[:], x.drive_angle[:], x.direction[:] = position, position / p.ratio, 1.0
    s.gap_position[:] = position


PLANT = Plant(
    name="transmission",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=Lanes("Scratch", []),
    action_modes=(),
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("transmission", PARAMETERS, ACTING),
    plain=False,
)
