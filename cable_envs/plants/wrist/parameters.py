"""Declared parameters and signals of a wrist of two coupled joints."""

import math

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting
from cable_envs.physics.modes import COUPLED, longest_step
from cable_envs.plants.base import OUT_OF_RANGE, Signal

_TYPICAL = "chosen: an instrument of 8 mm"

PARAMETERS = ParameterTable(
    Parameter("yaw_inertia", "kg m^2", 2.5e-6, 1e-10, 1e3, "inertia about the yaw axis, with what is held", _TYPICAL),
    Parameter("yaw_damping", "N m s", 2e-4, 0.0, 1e3, "viscous damping of the yaw joint", _TYPICAL),
    Parameter("yaw_friction", "N m", 0.0, 0.0, 1e3, "Coulomb friction of the yaw joint", "null"),
    Parameter("yaw_stiffness", "N m/rad", 0.0, 0.0, 1e4, "spring that holds the yaw joint at 0, as tissue", "null"),
    Parameter("yaw_radius", "m", 2.7e-3, 1e-5, 1.0, "radius of the yaw joint's pulley, r_y", _TYPICAL),
    Parameter("coupling_radius", "m", 2.2e-3, 0.0, 1.0, "radius at which the yaw cables pass the pitch axis, r_c"),
    Parameter("pitch_inertia", "kg m^2", 1e-5, 1e-10, 1e3, "inertia about the pitch axis", _TYPICAL),
    Parameter("pitch_damping", "N m s", 6e-4, 0.0, 1e3, "viscous damping of the pitch joint", _TYPICAL),
    Parameter("pitch_friction", "N m", 0.0, 0.0, 1e3, "Coulomb friction of the pitch joint without tension", "null"),
    Parameter("bearing_arm", "m", 0.0, 0.0, 1.0, "friction of the pitch joint for the sum of all tensions", "null"),
    Parameter("pitch_radius", "m", 3.2e-3, 1e-5, 1.0, "radius of the pitch joint's pulley, r_p", _TYPICAL),
    Parameter("pitch_angle", "rad", 0.0, -6.3, 6.3, "where the pitch is held if nothing is commanded", "null"),
    Parameter("yaw_wrap", "rad", math.pi, 0.0, 50.0, "wrap of a yaw cable to the yaw joint at pitch 0", _TYPICAL),
    Parameter("wrap_growth", "1", 1.0, -10.0, 10.0, "wrap that yaw cable a gains, and b loses, for 1 rad of pitch"),
    Parameter("pitch_wrap", "rad", 1.5708, 0.0, 50.0, "wrap of a pitch cable to the pitch joint", _TYPICAL),
    Parameter("friction_coefficient", "1", 0.05, 0.0, 2.0, "friction coefficient mu of cable and pulleys", _TYPICAL),
    Parameter("radius_ratio", "1", 10.0, 0.1, 1e9, "radius of the pulleys over the cable's, rho", _TYPICAL),
    Parameter("drive_share", "1", 0.8, 0.05, 0.95, "share of a cable's compliance before its contact", _TYPICAL),
    Parameter("yaw_cable_stiffness", "N/m", 1e4, 1.0, 1e9, "stiffness of a yaw cable, k_y", _TYPICAL),
    Parameter("pitch_cable_stiffness", "N/m", 1e4, 1.0, 1e9, "stiffness of a pitch cable, k_p", _TYPICAL),
    Parameter("yaw_pretension", "N", 15.0, 0.0, 1e5, "pretension of the yaw cables", _TYPICAL),
    Parameter("pitch_pretension", "N", 15.0, 0.0, 1e5, "pretension of the pitch cables", _TYPICAL),
    Parameter("servo_frequency", "rad/s", 100.0, 0.1, 1e4, "natural frequency of the drives' servos", _TYPICAL),
    Parameter("servo_damping_ratio", "1", 1.0, 0.0, 5.0, "damping ratio of the drives' servos", _TYPICAL),
    Parameter("drive_speed_limit", "rad/s", 15.0, 1e-6, 1e4, "largest speed of a drive, at its joint", _TYPICAL),
    Parameter("drive_acceleration_limit", "rad/s^2", 2e3, 1e-6, 1e7, "largest acceleration of a servo", _TYPICAL),
    Parameter("drive_angle_limit", "rad", 2.6, 1e-6, 1e3, "range of the yaw drive that can be commanded", _TYPICAL),
    Parameter("pitch_limit", "rad", 1.4, 1e-6, 1e3, "range of the pitch that can be commanded", _TYPICAL),
    Parameter("tension_limit", "N", 80.0, 1e-3, 1e6, "tension at which a run counts as unsafe", _TYPICAL),
    Parameter("breaking_tension", "N", 250.0, 1e-3, 1e7, "a cable tears above this tension", _TYPICAL),
)  # fmt: skip

SIGNALS = (
    Signal("yaw_angle", "rad", "angle of the yaw joint, positive where cable a pulls"),
    Signal("yaw_velocity", "rad/s", "its speed"),
    Signal("pitch_angle", "rad", "angle of the pitch joint, positive where its cable a pulls"),
    Signal("pitch_velocity", "rad/s", "its speed"),
    Signal("drive_angle", "rad", "what the yaw drive has wound up, over r_y"),
    Signal("drive_velocity", "rad/s", "its speed"),
    Signal("pitch_drive_angle", "rad", "what the pitch drive has wound up, over r_p"),
    Signal("pitch_drive_velocity", "rad/s", "its speed"),
    Signal("pitch_command", "rad", "what the pitch drive is told: the posture too"),
    Signal("yaw_torque", "N m", "torque of the yaw cables on the yaw joint"),
    Signal("pitch_torque", "N m", "torque of the pitch cables on the pitch joint"),
    Signal("coupling_torque", "N m", "torque of the yaw cables on the pitch joint"),
    Signal("tension_drive_a", "N", "tension of yaw cable a at its drive"),
    Signal("tension_end_a", "N", "tension of yaw cable a at the yaw joint"),
    Signal("tension_drive_b", "N", "tension of yaw cable b at its drive"),
    Signal("tension_end_b", "N", "tension of yaw cable b at the yaw joint"),
    Signal("pitch_tension_drive_a", "N", "tension of pitch cable a at its drive"),
    Signal("pitch_tension_end_a", "N", "tension of pitch cable a at the pitch joint"),
    Signal("pitch_tension_drive_b", "N", "tension of pitch cable b at its drive"),
    Signal("pitch_tension_end_b", "N", "tension of pitch cable b at the pitch joint"),
    Signal("stretch_end_a", "m", "stretch of yaw cable a behind its contact"),
    Signal("stretch_end_b", "m", "stretch of yaw cable b behind its contact"),
    Signal("pitch_stretch_end_a", "m", "stretch of pitch cable a behind its contact"),
    Signal("pitch_stretch_end_b", "m", "stretch of pitch cable b behind its contact"),
    Signal("sliding", "1", "direction in which the yaw joint moves: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which a cable was slack"),
    Signal("peak_tension", "N", "largest tension within the last control step"),
    OUT_OF_RANGE,
)

ACTING = Acting(
    effects={
        "coulomb_friction": ("level", "contact"), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"), "cable_elongation": ("stiffness",),
        "friction_drift": ("change", "time", "travel"), "backlash": ("gap",), "slack": ("length",),
        "position_dependent_load": ("stiffness",), "actuator_lag": ("time",),
    },
    sensors={
        "yaw_angle": "rad", "yaw_velocity": "rad/s", "drive_angle": "rad", "drive_velocity": "rad/s",
        "pitch_drive_angle": "rad",
    },
    aliases={
        "coulomb_friction.level": "yaw_friction", "coulomb_friction.contact": "friction_coefficient",
        "viscous_friction.coefficient": "yaw_damping", "cable_elongation.stiffness": "yaw_cable_stiffness",
        "position_dependent_load.stiffness": "yaw_stiffness",
    },
    turning=True,
    seams=("actuate", "load"),
)  # fmt: skip
"""What of the library acts on it: on the yaw joint and its drive. A gap or slack of one radian is r_y."""

SAME = (
    "yaw_inertia", "yaw_damping", "yaw_friction", "yaw_stiffness", "yaw_radius", "coupling_radius", "pitch_inertia",
    "pitch_damping", "pitch_friction", "bearing_arm", "pitch_radius", "pitch_angle", "yaw_wrap", "wrap_growth",
    "pitch_wrap", "friction_coefficient", "radius_ratio", "drive_speed_limit", "drive_acceleration_limit",
)  # fmt: skip
"""Coefficients that are parameters as they stand."""
COEFFICIENTS = Lanes("Coefficients", [
    *SAME, "servo_stiffness", "servo_damping", "drive_stiffness", "end_stiffness", "pitch_drive_stiffness",
    "pitch_end_stiffness", "take_up", "pitch_take_up",
])  # fmt: skip
"""drive_stiffness, end_stiffness: of a cable before and behind its contact, N/m; take_up: stretch of a cable at its
pretension, m. The servos' are per inertia: 1/s^2 and 1/s."""


def derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`; raises ConfigurationError for what the bounds of single parameters cannot exclude."""
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any(np.abs(value["pitch_angle"]) > value["pitch_limit"]):
        raise ConfigurationError("pitch_angle must lie within pitch_limit")
    before, behind, frequency = value["drive_share"], 1.0 - value["drive_share"], value["servo_frequency"]
    return {
        **{name: value[name] for name in SAME},
        "servo_stiffness": frequency**2,
        "servo_damping": 2.0 * value["servo_damping_ratio"] * frequency,
        "drive_stiffness": value["yaw_cable_stiffness"] / before,
        "end_stiffness": value["yaw_cable_stiffness"] / behind,
        "pitch_drive_stiffness": value["pitch_cable_stiffness"] / before,
        "pitch_end_stiffness": value["pitch_cable_stiffness"] / behind,
        "take_up": value["yaw_pretension"] / value["yaw_cable_stiffness"],
        "pitch_take_up": value["pitch_pretension"] / value["pitch_cable_stiffness"],
    }


def resolves(p, e) -> np.ndarray:
    """Longest steps, s: `COUPLED` times those of both joints together while all contacts hold, and of a servo.

    The square of the fastest of two coupled modes is at most the sum of those of the joints alone.
    """
    yaw = 2.0 * p.yaw_radius**2 * p.end_stiffness + p.yaw_stiffness
    pitch = 2.0 * (p.pitch_radius**2 * p.pitch_end_stiffness + p.coupling_radius**2 * p.end_stiffness)
    both = yaw / p.yaw_inertia + pitch / p.pitch_inertia
    joints = longest_step(1.0, np.maximum(p.yaw_damping / p.yaw_inertia, p.pitch_damping / p.pitch_inertia), both)
    return COUPLED * np.minimum(joints, longest_step(1.0, p.servo_damping, p.servo_stiffness))


def pair(torque, radius, take_up, stiffness):
    """(T_a, T_b, stretches of a and b) of two cables on one drive that give a torque, at rest without friction."""
    half = 0.5 * torque / radius
    mean = stiffness * take_up
    a = np.where(half < -mean, 0.0, np.where(half > mean, 2.0 * half, mean + half))
    b = np.where(half > mean, 0.0, np.where(half < -mean, -2.0 * half, mean - half))
    own_a, own_b = a / stiffness, b / stiffness
    # where one is slack the other has the stretch of its tension, and the sum is still twice what is taken up
    none = np.maximum(a, b) <= 0.0
    long_a = np.where(none, take_up, np.where(a > 0.0, own_a, 2.0 * take_up - own_b))
    return a, b, long_a, np.where(none, take_up, np.where(b > 0.0, own_b, 2.0 * take_up - own_a))


def settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the yaw joint at ``position`` (rad, [n]) and the pitch drive where the rig holds it.

    Nothing of the friction is mobilised. The pitch cables hold what the yaw cables do to the pitch joint: where a
    spring pulls on the yaw joint, the pitch joint stands beside its drive by what its cables stretch for that.
    """
    k, kp = (1.0 / (1.0 / a + 1.0 / b) for a, b in (
        (p.drive_stiffness, p.end_stiffness), (p.pitch_drive_stiffness, p.pitch_end_stiffness)
    ))  # fmt: skip
    torque = p.yaw_stiffness * position
    coupling = p.coupling_radius / p.yaw_radius * torque
    taken = p.take_up - p.yaw_radius * e.slack_length
    a, b, long_a, long_b = pair(torque, p.yaw_radius, taken, k)
    pa, pb, pitch_a, pitch_b = pair(-coupling, p.pitch_radius, p.pitch_take_up, kp)
    x.pitch_drive_angle[:], x.pitch_command[:] = p.pitch_angle, p.pitch_angle
    x.yaw_angle[:], x.pitch_angle[:] = position, p.pitch_angle - 0.5 * (pitch_a - pitch_b) / p.pitch_radius
    passed = p.coupling_radius / p.yaw_radius * x.pitch_angle
    x.drive_angle[:] = position + passed + 0.5 * (long_a - long_b) / p.yaw_radius
    x.yaw_torque[:], x.pitch_torque[:], x.coupling_torque[:] = torque, -coupling, coupling
    x.tension_drive_a[:] = x.tension_end_a[:] = a
    x.tension_drive_b[:] = x.tension_end_b[:] = b
    x.pitch_tension_drive_a[:] = x.pitch_tension_end_a[:] = pa
    x.pitch_tension_drive_b[:] = x.pitch_tension_end_b[:] = pb
    x.stretch_end_a[:], x.stretch_end_b[:] = k / p.end_stiffness * long_a, k / p.end_stiffness * long_b
    x.pitch_stretch_end_a[:] = kp / p.pitch_end_stiffness * pitch_a
    x.pitch_stretch_end_b[:] = kp / p.pitch_end_stiffness * pitch_b
    x.peak_tension[:] = np.maximum(np.maximum(a, b), np.maximum(pa, pb))
    s.gap_position[:] = x.drive_angle
