"""Rigs of every plant that has equations in continuous time, with what moves them."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cable_envs import load_rig, model
from cable_envs.continuous.ways import asked


@dataclass(frozen=True)
class Case:
    """``size``: amplitude of the command around rest, ``second`` of the second; ``position``: of the output at rest.

    ``arm``: metres that a drive moves for one unit of the output. ``within``: share of the range of every state to
    which the kernel with substeps of 10 us agrees.
    """

    rig: Any
    mode: str | None
    size: float
    position: float = 0.0
    changes: dict = field(default_factory=dict)
    second: float = 0.0
    arm: float = 1.0
    variant: str = "analytic"
    within: float = 3e-4

    @cached_property
    def made(self):
        """The model, made once for all tests: none changes it."""
        return model(load_rig(self.rig).replace(self.changes), self.mode, self.variant)

    @cached_property
    def smooth(self):
        """Its CasADi functions with the usual smoothing."""
        return self.made.casadi()


FAST = {"drive_acceleration_limit": 1e3}  # the equations of the hole leave this limit out
DRIVE, COUPLED, JOINT = {"plant": "linear_drive"}, {"plant": "coupled_drives"}, {"plant": "rotary_joint"}
IDEAL = {
    "hole-tension": Case("gu-inferred", "tension", 20.0, 0.0, FAST),
    "hole-speed": Case("gu-inferred", "speed", 0.02, 0.0, FAST),
    "hole-stiff-cable": Case(
        "gu-inferred", "tension", 20.0, 0.0, {**FAST, "bending_rigidity": 1e-5, "load_stiffness": 500.0}
    ),
    "series-tension": Case("gu-three-holes", "tension", 25.0, 0.0, FAST),
    "series-speed": Case("gu-three-holes", "speed", 0.02, 0.0, FAST),
    "series-stiff-cable": Case(
        "gu-three-holes", "tension", 15.0, 0.0, {**FAST, "bending_rigidity": 1e-6}
    ),
    "circuit-position": Case("zou-table2", "position", 0.3),
    "circuit-torque": Case("zou-grasp", "torque", 0.25, 0.05, {"brake_torque": 0.01, "payload_mass": 0.1}),
    "chain-position": Case("zou-table2", "position", 0.3, 0.0, {"brake_torque": 0.02}, variant="chain"),
    "chain-torque": Case(
        "zou-grasp", "torque", 0.25, 0.05, {"brake_torque": 0.01, "payload_mass": 0.1}, variant="chain"
    ),
    "sheath-position": Case("bowden-1m", "position", 0.01, 0.005),
    "sheath-tension": Case(
        "bowden-1m", "tension", 25.0, 0.0,
        {"load_friction": 1.0, "stribeck_friction.contact": 0.05, "stribeck_friction.velocity": 0.02,
         "stiffness_hardening.coefficient": 0.01, "slack.length": 1e-3},
    ),
    "contacts-position": Case({"extends": "bowden-1m", "contacts": 3}, "position", 0.01, 0.005, {"load_friction": 1.0}),
    "contacts-tension": Case(
        {"extends": "bowden-1m", "contacts": 3}, "tension", 25.0, 0.0,
        {"load_friction": 1.0, "stribeck_friction.contact": 0.05, "stribeck_friction.velocity": 0.02,
         "stiffness_hardening.coefficient": 0.01, "slack.length": 1e-3},
    ),
    "drive-force": Case(DRIVE, "force", 20.0),
    "drive-belt": Case(DRIVE, "position", 0.05, 0.0, {"belt_stiffness": 1e5, "gravity_share": 0.2}),
    "drive-effects": Case(
        DRIVE, "force", 25.0, 0.0,
        {"asymmetric_friction.difference": 2.0, "position_dependent_load.stiffness": 50.0,
         "position_ripple.force": 3.0, "position_ripple.period": 0.05},
    ),
    "drive-met": Case(
        DRIVE, "force", 25.0, 0.02,
        {"unilateral_contact.stiffness": 400.0, "unilateral_contact.friction": -60.0, "unilateral_contact.place": 0.01,
         "unilateral_contact.damping": 200.0},
    ),
    "rotary-met": Case(
        JOINT, "duty", 0.3, 0.2, {"unilateral_contact.stiffness": -0.4, "unilateral_contact.friction": 0.05,
         "unilateral_contact.place": 0.1},
    ),
    "rotary-duty": Case(
        JOINT, "duty", 0.3, 0.2, {"gear_friction.driving": 0.4, "gear_friction.backdriving": 0.3,
         "supply_sag.resistance": 1.0, "torque_saturation.drop": 0.3, "position_dependent_load.stiffness": 0.05},
    ),
    "rotary-position": Case(JOINT, "position", 0.4, 0.0, {"gear_friction.driving": 0.3, "rate_gain": 0.02}),
    "coupled": Case(COUPLED, "voltage", 2.0, 0.0, {"coulomb": 5.0, "stiffness_hardening.coefficient": 0.05}),
    "joint-position": Case("finger-joint", "position", 0.3, 0.1, {"joint_friction": 0.004}, 3.0, 0.01),
    "joint-torque": Case(
        "finger-joint", "torque", 0.1, 0.0, {"joint_friction": 0.004, "moment_arm_growth": 5e-4, "slack.length": 0.01},
        3.0, 0.01,
    ),
    "wrist": Case(
        "wrist-8mm", "position", 0.5, 0.2, {"yaw_friction": 1e-3, "pitch_friction": 2e-3, "pitch_angle": 0.3}, 0.3,
    ),
}  # fmt: skip
"""Plants with an ideal drive that is commanded."""

QUICK = {"encoder_period": 1e-5, "encoder_counts": 0.0}  # the servo in continuous time neither waits nor rounds
HELD = {"joint_friction": 0.004}
SERIES = {"extends": "gu-three-holes", "drive": "motor"}
SCREW = {
    "spool_radius": 1.6e-3, "spool_inertia": 1.8e-5, "gear_efficiency": 0.9, "drive_friction": 6.0,
    "servo_kp": 1.2e5, "servo_ki": 1.2e6, "servo_kd": 1500.0,
}  # fmt: skip
"""A motor with the ball screw of gu-steel-1mm-motor, for holes in series."""
MOTORS = {
    "hole-motor-force": Case("gu-steel-1mm-motor", "tension", 30.0),
    "hole-motor-speed": Case("gu-steel-1mm-motor", "speed", 0.02, 0.0, {**QUICK, **FAST}, within=5e-4),
    "series-motor-force": Case(SERIES, "tension", 30.0, 0.0, SCREW),
    "series-motor-speed": Case(SERIES, "speed", 0.02, 0.0, {**SCREW, **QUICK, **FAST}, within=5e-4),
    "series-motor-no-extrusion": Case(
        SERIES, "tension", 30.0, 0.0, {**SCREW, "extrusion_gain": 0.0, "wrap_angle_2": 0.0}
    ),
    "circuit-motor-torque": Case("zou-table2-motor", "torque", 0.25, 0.0, {"cogging_torque": 1e-4}),
    "circuit-motor-position": Case("zou-table2-motor", "position", 0.3, 0.0, QUICK, within=6e-4),
    "chain-motor-position": Case(
        "zou-table2-motor", "position", 0.3, 0.0, {**QUICK, "brake_torque": 0.02}, variant="chain", within=6e-4
    ),
    "sheath-motor-force": Case("bowden-1m-motor", "tension", 25.0),
    "sheath-motor-position": Case("bowden-1m-motor", "position", 0.01, 0.005, QUICK, within=5e-4),
    "contacts-motor-force": Case(
        {"extends": "bowden-1m-motor", "contacts": 3}, "tension", 25.0, 0.0, {"load_friction": 1.0}
    ),
    "contacts-motor-position": Case(
        {"extends": "bowden-1m-motor", "contacts": 3}, "position", 0.01, 0.005, {**QUICK, "load_friction": 1.0},
        within=5e-4,
    ),
    "joint-motor-torque": Case("finger-joint-motor", "torque", 0.2, 0.0, HELD, 3.0, 0.01),
    "joint-motor-position": Case("finger-joint-motor", "position", 0.3, 0.1, {**QUICK, **HELD}, 3.0, 0.01, within=5e-4),
    "wrist-motor": Case(
        "wrist-8mm-motor", "position", 0.5, 0.2,
        {**QUICK, "yaw_friction": 1e-3, "pitch_friction": 2e-3, "pitch_angle": 0.3}, 0.3, 0.003, within=5e-4,
    ),
}  # fmt: skip
"""Plants with a motor, told its torque, or with its servo read every 10 us."""
DRIVEN = {**IDEAL, **MOTORS}

TRANSMISSION = Case(
    {"plant": "transmission"}, None, 0.0, 0.0,
    {"coulomb_friction.level": 0.1, "load_dependent_friction.exponent": 0.2, "partial_slip.share": 0.3,
     "partial_slip.compliance": 0.2, "cable_elongation.drive_side": 0.1, "cable_elongation.output_side": 0.05,
     "stiffness_hardening.drive_side": 5.0, "viscous_friction.coefficient": 0.02, "position_ripple.sine": 0.01},
)  # fmt: skip
BRAKE = Case(
    {"plant": "band_brake"}, None, 0.0, 0.0,
    {"cable_elongation.compliance": 1e-6, "stiffness_hardening.coefficient": 1e-4,
     "asymmetric_friction.difference": 500.0,
     "load_dependent_friction.coefficient": 1.5, "viscous_friction.coefficient": 1e3,
     "position_dependent_load.stiffness": 1e4},
)  # fmt: skip
EVERY = {**DRIVEN, "transmission": TRANSMISSION, "band-brake": BRAKE}


def point(m, case, way, rng, share=0.05):
    """A state and an input near the verge of sliding, with speeds in which the plant slides ``way``."""
    if m.equations.stiff:  # where a slip starts the friction is straight over less than any step of a difference
        x, u = m.rest(case.position)
        u[0] += way * case.size
        return m.simulate([0.0, rng.uniform(0.04, 0.06)], u, x).x[-1], u
    x, u = m.rest(case.position, way)
    for k, s in enumerate(m.states):
        if s.unit in ("m/s", "rad/s"):
            x[k] += share * (case.arm if s.unit == "m/s" else 1.0) * m.equations.speed * rng.normal()
    for place, slides in zip(m.places, asked(m.equations, way)):
        if place >= 0:
            x[place] = slides * m.equations.speed * rng.uniform(5.0, 10.0)
    if m.held < 0 and m.equations.slides:
        u[0] = way * rng.uniform(0.1, 0.5)
        u[1] = rng.normal()
    return followed(m, x, u, asked(m.equations, way)), u


def followed(m, x, u, ways):
    """The state with contacts at their limits; where the limit grows with the speed of a slip, the speed follows."""
    return x if m.equations.stiff else np.array(m.slid(x.tolist(), u.tolist(), ways))


def tangents(m, x, u, ways):
    """Directions in (x, u) that keep contacts without a mass at their limits, one a column; without: unit vectors."""
    n, columns = len(x), []
    for k, value in enumerate((*x, *u)):
        ends = []
        for s in (1.0, -1.0):
            z = np.concatenate([x, u])
            z[k] += s * 1e-6 * max(1e-3, abs(value))
            z[:n] = followed(m, z[:n], z[n:], ways)
            ends.append(z)
        columns.append((ends[0] - ends[1]) / (2e-6 * max(1e-3, abs(value))))
    return np.array(columns).T


def sampled(size, steps, period, frequency=1.5):
    """A sine in steps that begins gently [steps]."""
    k = np.arange(1, steps + 1)
    return size * np.sin(2.0 * np.pi * frequency * k * period) * np.minimum(1.0, k / 20.0)


def moved(m, case, u0, steps, period):
    """Inputs that move a plant to and fro around rest, [steps, inputs], and the same for `cable_envs.replay`."""
    ways = {i.row: k for k, i in enumerate(m.equations.inputs)}
    found = {"command": u0[0] + sampled(case.size, steps, period)}
    if "second" in ways:
        found["second"] = u0[ways["second"]] + sampled(case.second, steps, period, 1.1)
    for name in list(found):
        found[f"{name}_rate"] = np.concatenate([[0.0], np.diff(found[name]) / period])
    if m.inputs[list(ways).index("disturbance")].unit == m.inputs[0].unit:
        found["disturbance"] = sampled(0.05 * case.size, steps, period, 3.0)
    if "posture" in ways:
        found["posture"] = sampled(0.5, steps, period, 0.8)
    u = np.column_stack([found.get(row, np.zeros(steps)) for row in ways])
    given = {name.replace("command_rate", "rate"): value for name, value in found.items()}
    return u, given
