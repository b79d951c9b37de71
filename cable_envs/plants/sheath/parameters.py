"""Declared parameters and signals of a tendon in a sheath."""

import math

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting
from cable_envs.effects.slow_creep import lasting
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import OUT_OF_RANGE, Signal

_TYPICAL = "chosen: a 1 m sheath that moves a finger or a gripper"

PARAMETERS = ParameterTable(
    Parameter("load_mass", "kg", 0.5, 1e-4, 1e4, "inertia of the load at the tendon", _TYPICAL),
    Parameter("load_stiffness", "N/m", 1500.0, 0.0, 1e7, "return spring of the load", _TYPICAL),
    Parameter("load_preload", "N", 10.0, 0.0, 1e5, "force of that spring at y = 0; it keeps the tendon taut", _TYPICAL),
    Parameter("load_damping", "N s/m", 5.0, 0.0, 1e5, "viscous damping of the load", _TYPICAL),
    Parameter("load_friction", "N", 0.0, 0.0, 1e4, "Coulomb friction of the load itself", "null"),
    Parameter("bend_angle", "rad", math.pi, 0.0, 50.0, "total bend of the sheath, Theta", _TYPICAL),
    Parameter("friction_coefficient", "1", 0.1, 0.0, 2.0, "Coulomb coefficient mu of tendon and liner", _TYPICAL),
    Parameter("tendon_stiffness", "N/m", 14.4e3, 1.0, 1e9, "EA / L of the tendon", _TYPICAL),
    Parameter("sheath_stiffness", "N/m", 60e3, 1.0, 1e9, "axial stiffness of the sheath with its ends", _TYPICAL),
    Parameter("tendon_damping", "N s/m", 5.0, 0.0, 1e6, "viscous damping of tendon and sheath together", _TYPICAL),
    Parameter("drive_mass", "kg", 1.0, 1e-4, 1e4, "inertia of the drive at the tendon", _TYPICAL),
    Parameter("drive_damping", "N s/m", 20.0, 0.0, 1e5, "viscous friction of the drive", _TYPICAL),
    Parameter("drive_speed_limit", "m/s", 0.2, 1e-6, 10.0, "largest drive speed", _TYPICAL),
    Parameter("drive_acceleration_limit", "m/s^2", 10.0, 1e-6, 1e3, "largest acceleration of the servo", _TYPICAL),
    Parameter("drive_position_limit", "m", 0.05, 1e-6, 1e3, "range of positions that a command may ask for", _TYPICAL),
    Parameter("servo_frequency", "rad/s", 60.0, 0.1, 1e3, "natural frequency of the position servo", _TYPICAL),
    Parameter("servo_damping_ratio", "1", 1.0, 0.0, 5.0, "damping ratio of the position servo", _TYPICAL),
    Parameter("tension_command_limit", "N", 80.0, 1e-3, 1e5, "largest force that the drive can be told", _TYPICAL),
    Parameter("tension_limit", "N", 75.0, 1e-3, 1e6, "tension at which a run counts as unsafe", _TYPICAL),
    Parameter("breaking_tension", "N", 250.0, 1e-3, 1e7, "the tendon tears above this tension", _TYPICAL),
)

SIGNALS = (
    Signal("drive_position", "m", "position of the drive, positive pulls the tendon in"),
    Signal("drive_velocity", "m/s", "speed of the drive"),
    Signal("drive_tension", "N", "tension of the tendon at the drive, T1"),
    Signal("load_position", "m", "position of the load, positive towards the sheath"),
    Signal("load_velocity", "m/s", "speed of the load"),
    Signal("load_tension", "N", "tension of the tendon at the load, T2"),
    Signal("mobilised", "1", "mobilised friction ln(T1 / T2), within mu Theta either way"),
    Signal("sliding", "1", "direction in which the tendon slides at the load: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which the tendon was slack"),
    Signal("peak_tension", "N", "largest tension at the drive within the last control step"),
    OUT_OF_RANGE,
)

ACTING = Acting(
    effects={
        "coulomb_friction": ("level", "contact"), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "contact", "velocity"), "asymmetric_friction": ("difference", "contact"),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"), "cable_elongation": ("stiffness",),
        "stiffness_hardening": ("coefficient",), "viscoelastic_creep": ("share", "time"),
        "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"), "backlash": ("gap",), "slack": ("length",),
        "position_dependent_load": ("stiffness",), "actuator_lag": ("time",),
    },
    sensors={
        "drive_position": "m", "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m",
        "load_velocity": "m/s", "load_tension": "N",
    },
    aliases={
        "coulomb_friction.level": "load_friction", "coulomb_friction.contact": "friction_coefficient",
        "viscous_friction.coefficient": "load_damping", "cable_elongation.stiffness": "tendon_stiffness",
        "position_dependent_load.stiffness": "load_stiffness",
    },
    seams=("actuate", "cable", "contact", "load"),
)  # fmt: skip
"""What of the library acts on it: not what asks for an edge (extrusion), pulleys, or a spool that is not round."""

SAME = (
    "load_mass", "load_stiffness", "load_preload", "load_damping", "load_friction", "bend_angle",
    "friction_coefficient", "tendon_damping", "drive_mass", "drive_damping", "drive_speed_limit",
    "drive_acceleration_limit",
)  # fmt: skip
"""Coefficients that are parameters as they stand."""
COEFFICIENTS = Lanes("Coefficients", [*SAME, "stiffness", "servo_stiffness", "servo_damping"])
"""stiffness: of tendon and sheath in series, N/m. The servo's are per mass of the drive: 1/s^2 and 1/s."""


def derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`; raises ConfigurationError for what the bounds of single parameters cannot exclude."""
    if np.any((value["load_stiffness"] == 0.0) & (value["load_preload"] == 0.0)):
        raise ConfigurationError("nothing pulls the tendon back: give it load_stiffness > 0 or load_preload > 0")
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    frequency = value["servo_frequency"]
    return {
        **{name: value[name] for name in SAME},
        "stiffness": 1.0 / (1.0 / value["tendon_stiffness"] + 1.0 / value["sheath_stiffness"]),
        "servo_stiffness": frequency**2,
        "servo_damping": 2.0 * value["servo_damping_ratio"] * frequency,
    }


def resolves(p, e) -> np.ndarray:
    """Longest steps, s: of servo, load that pays the tendon out against all friction, and drive that pulls it in.

    Either end then feels Tm r / (1 - e^-r) with r = mu Theta (`sheath.capstan.leaving` at -r).
    """
    r = (p.friction_coefficient + np.maximum(e.stribeck_friction_contact, 0.0)) * p.bend_angle
    share = np.where(r > 1e-6, r / -np.expm1(-np.maximum(r, 1e-6)), 1.0)
    k = share * p.stiffness * np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * p.load_preload)
    c = share * p.tendon_damping
    load = longest_step(p.load_mass, c + p.load_damping, k + p.load_stiffness)
    servo = longest_step(1.0, p.servo_damping, p.servo_stiffness)
    return np.minimum(np.minimum(load, servo), longest_step(p.drive_mass, c + p.drive_damping, k))


def settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the load at ``position`` (m, [n]): equal tensions at both ends, the drive amid its gap."""
    tension = np.maximum(p.load_preload + p.load_stiffness * position, 0.0)
    hard = e.stiffness_hardening_coefficient
    stretch = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * hard * tension)) / p.stiffness
    x.load_position[:] = position
    x.drive_tension[:] = x.load_tension[:] = x.peak_tension[:] = tension
    x.drive_position[:] = position + stretch * (1.0 + lasting(e)) + e.slack_length
    s.creep_top[:], s.slow_creep_top[:] = lasting(e) * stretch, e.slow_creep_share * stretch
    s.gap_position[:] = x.drive_position
