"""Declared parameters and signals of a joint with two tendons."""

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting
from cable_envs.effects.slow_creep import lasting
from cable_envs.physics.modes import COUPLED, longest_step
from cable_envs.plants.base import OUT_OF_RANGE, Signal

_TYPICAL = "chosen: the base joint of a tendon-driven finger"

PARAMETERS = ParameterTable(
    Parameter("joint_inertia", "kg m^2", 1.5e-4, 1e-9, 1e3, "inertia of joint and link", _TYPICAL),
    Parameter("joint_damping", "N m s", 3e-3, 0.0, 1e3, "viscous damping of the joint", _TYPICAL),
    Parameter("joint_friction", "N m", 0.0, 0.0, 1e3, "Coulomb friction of the joint", "null"),
    Parameter("spring_stiffness", "N m/rad", 0.0, 0.0, 1e4, "spring that holds the joint at 0, or what it grasps"),
    Parameter("weight_torque", "N m", 0.0, -1e3, 1e3, "torque of the link's weight at 90 degrees"),
    Parameter("moment_arm", "m", 0.01, 1e-5, 10.0, "distance of both tendons from the axis at 0, r", _TYPICAL),
    Parameter("moment_arm_growth", "m/rad", 0.0, -1.0, 1.0, "growth of a's arm, and loss of b's, with the angle"),
    Parameter("wrap_angle", "rad", 1.5708, 0.0, 50.0, "bend of a tendon's way to the joint, phi", _TYPICAL),
    Parameter("friction_coefficient", "1", 0.1, 0.0, 2.0, "friction coefficient mu of tendon and guide", _TYPICAL),
    Parameter("radius_ratio", "1", 30.0, 0.1, 1e9, "radius of the bend over the tendon's, rho", _TYPICAL),
    Parameter("drive_share", "1", 0.5, 0.05, 0.95, "share of a tendon's compliance before the bend", _TYPICAL),
    Parameter("tendon_stiffness", "N/m", 2e4, 1.0, 1e9, "stiffness of a tendon without tension, k", _TYPICAL),
    Parameter("tendon_hardening", "1/N", 0.0, 0.0, 1.0, "growth of that stiffness with the tension, over it", "null"),
    Parameter("co_contraction", "N", 15.0, 0.0, 1e5, "mean tension where it is not commanded", _TYPICAL),
    Parameter("co_contraction_limit", "N", 50.0, 1e-3, 1e5, "largest mean tension that can be commanded", _TYPICAL),
    Parameter("drive_mass", "kg", 0.3, 1e-4, 1e4, "inertia of a drive at its tendon", _TYPICAL),
    Parameter("drive_damping", "N s/m", 60.0, 0.0, 1e5, "viscous friction of a drive", _TYPICAL),
    Parameter("drive_speed_limit", "m/s", 0.2, 1e-6, 10.0, "largest speed of a drive", _TYPICAL),
    Parameter("drive_acceleration_limit", "m/s^2", 20.0, 1e-6, 1e3, "largest acceleration of a servo", _TYPICAL),
    Parameter("drive_angle_limit", "rad", 1.5, 1e-6, 1e3, "range of angles that a command may ask for", _TYPICAL),
    Parameter("servo_frequency", "rad/s", 80.0, 0.1, 1e3, "natural frequency of a drive's servo", _TYPICAL),
    Parameter("servo_damping_ratio", "1", 1.0, 0.0, 5.0, "damping ratio of a drive's servo", _TYPICAL),
    Parameter("torque_command_limit", "N m", 0.5, 1e-6, 1e4, "largest torque that the drives can be told", _TYPICAL),
    Parameter("drive_force_limit", "N", 100.0, 1e-3, 1e5, "largest force of a drive", _TYPICAL),
    Parameter("tension_limit", "N", 90.0, 1e-3, 1e6, "tension at which a run counts as unsafe", _TYPICAL),
    Parameter("breaking_tension", "N", 300.0, 1e-3, 1e7, "a tendon tears above this tension", _TYPICAL),
)  # fmt: skip

SIGNALS = (
    Signal("joint_angle", "rad", "angle of the joint, positive where tendon a pulls"),
    Signal("joint_velocity", "rad/s", "its speed"),
    Signal("joint_torque", "N m", "torque of both tendons on the joint"),
    Signal("joint_stiffness", "N m/rad", "stiffness of the joint with the drives held, without friction"),
    Signal("drive_angle", "rad", "difference of the drives' positions over two moment arms"),
    Signal("drive_torque", "N m", "torque of the tensions at the drives, with the moment arm at 0"),
    Signal("pretension", "N", "mean tension that the drives' mean position gives at 0"),
    Signal("co_contraction", "N", "mean of the tensions at the drives"),
    Signal("co_contraction_command", "N", "mean tension that the drives are told"),
    Signal("drive_a_position", "m", "position of drive a, positive pulls its tendon in"),
    Signal("drive_a_velocity", "m/s", "its speed"),
    Signal("drive_b_position", "m", "position of drive b, positive pulls its tendon in"),
    Signal("drive_b_velocity", "m/s", "its speed"),
    Signal("tension_drive_a", "N", "tension of tendon a at its drive"),
    Signal("tension_joint_a", "N", "tension of tendon a at the joint"),
    Signal("tension_drive_b", "N", "tension of tendon b at its drive"),
    Signal("tension_joint_b", "N", "tension of tendon b at the joint"),
    Signal("stretch_joint_a", "m", "stretch of tendon a between its bend and the joint"),
    Signal("stretch_joint_b", "m", "stretch of tendon b between its bend and the joint"),
    Signal("sliding", "1", "direction in which the joint moves: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which a tendon was slack"),
    Signal("peak_tension", "N", "largest tension within the last control step"),
    OUT_OF_RANGE,
)  # fmt: skip

ACTING = Acting(
    effects={
        "coulomb_friction": ("level", "contact"), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"), "cable_elongation": ("stiffness",),
        "stiffness_hardening": ("coefficient",), "viscoelastic_creep": ("share", "time"),
        "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"), "backlash": ("gap",), "slack": ("length",),
        "position_dependent_load": ("stiffness",), "actuator_lag": ("time",),
    },
    sensors={
        "joint_angle": "rad", "joint_velocity": "rad/s", "joint_torque": "N m", "drive_angle": "rad",
        "drive_torque": "N m", "co_contraction": "N",
    },
    aliases={
        "coulomb_friction.level": "joint_friction", "coulomb_friction.contact": "friction_coefficient",
        "viscous_friction.coefficient": "joint_damping", "cable_elongation.stiffness": "tendon_stiffness",
        "position_dependent_load.stiffness": "spring_stiffness",
        "stiffness_hardening.coefficient": "tendon_hardening",
    },
    turning=True,
    seams=("actuate", "load"),
)  # fmt: skip
"""What of the library acts on it. Lengths of effects are angles: a gap or a slack of one radian is one moment arm."""

SAME = (
    "joint_inertia", "joint_damping", "joint_friction", "spring_stiffness", "weight_torque", "moment_arm",
    "moment_arm_growth", "wrap_angle", "friction_coefficient", "radius_ratio", "tendon_stiffness", "tendon_hardening",
    "co_contraction", "drive_mass", "drive_damping", "drive_speed_limit", "drive_acceleration_limit",
    "drive_force_limit",
)  # fmt: skip
"""Coefficients that are parameters as they stand."""
COEFFICIENTS = Lanes("Coefficients", [*SAME, "drive_stiffness", "end_stiffness", "servo_stiffness", "servo_damping",
                                      "tension_limit", "angle_limit"])  # fmt: skip
"""drive_stiffness, end_stiffness: of a tendon before and behind its bend, N/m. The servo's are per mass: 1/s^2, 1/s."""


def derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`; raises ConfigurationError for what the bounds of single parameters cannot exclude."""
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any(value["co_contraction"] > value["co_contraction_limit"]):
        raise ConfigurationError("co_contraction must not be above co_contraction_limit")
    if np.any(np.abs(value["moment_arm_growth"]) * value["drive_angle_limit"] > 0.9 * value["moment_arm"]):
        raise ConfigurationError(
            "moment_arm_growth over the range drive_angle_limit must stay below nine tenths of moment_arm: a tendon "
            "cannot pass the axis"
        )
    frequency = value["servo_frequency"]
    return {
        **{name: value[name] for name in SAME},
        "drive_stiffness": value["tendon_stiffness"] / value["drive_share"],
        "end_stiffness": value["tendon_stiffness"] / (1.0 - value["drive_share"]),
        "servo_stiffness": frequency**2,
        "servo_damping": 2.0 * value["servo_damping_ratio"] * frequency,
        "tension_limit": value["tension_limit"],
        "angle_limit": value["drive_angle_limit"],
    }


def resolves(p, e) -> np.ndarray:
    """Longest steps, s: `COUPLED` times those of joint and drive at the tension limit, while both contacts hold."""
    hard = np.sqrt(1.0 + 2.0 * p.tendon_hardening * p.tension_limit)
    arm = p.moment_arm + np.abs(p.moment_arm_growth) * p.angle_limit
    turning = 2.0 * arm**2 * p.end_stiffness * hard + p.spring_stiffness + np.abs(p.weight_torque)
    turning = turning + 2.0 * np.abs(p.moment_arm_growth) * p.tension_limit
    joint = longest_step(p.joint_inertia, p.joint_damping, turning)
    drive = longest_step(p.drive_mass, p.drive_damping, p.drive_stiffness * hard)
    return COUPLED * np.minimum(np.minimum(joint, drive), longest_step(1.0, p.servo_damping, p.servo_stiffness))


def needed_torque(p, position):
    """Torque of the tendons that holds the joint at a position, N m."""
    return p.spring_stiffness * position + p.weight_torque * np.sin(position)


def angle_of_torque(value, wanted):
    """Angle at which spring and weight need a torque of the tendons, rad: Newton's method from the spring alone."""
    spring, weight = value["spring_stiffness"], value["weight_torque"]
    angle = wanted / spring
    for _ in range(20):
        slope = spring + weight * np.cos(angle)
        angle = angle - (spring * angle + weight * np.sin(angle) - wanted) / np.where(slope > 0.0, slope, spring)
    return angle


def _stretch(tension, stiffness, hard):
    """Stretch of a tendon at a tension, m."""
    return 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * hard * tension)) / stiffness


def settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest at ``position`` (rad, [n]), both drives held where the co-contraction of the rig has them.

    Nothing of the friction is mobilised. The tensions balance the joint, and their stretches add up to what the drives
    take up: one unknown, found by halving an interval.
    """
    hard, k = p.tendon_hardening, p.tendon_stiffness
    creep, slack = 1.0 + lasting(e), p.moment_arm * e.slack_length
    arm_a, arm_b = (p.moment_arm + way * p.moment_arm_growth * position for way in (1.0, -1.0))
    torque = needed_torque(p, position)
    take_up = _stretch(p.co_contraction, k, hard)
    length = 2.0 * (take_up - slack) - p.moment_arm_growth * position**2

    low = np.maximum(0.0, -torque / arm_b)
    high = low + 2.0 * k * np.maximum(length, 0.0) * (1.0 + hard * k * np.maximum(length, 0.0)) + 1e-9
    for _ in range(200):
        middle = 0.5 * (low + high)
        long = creep * (_stretch((torque + arm_b * middle) / arm_a, k, hard) + _stretch(middle, k, hard)) < length
        low, high = np.where(long, middle, low), np.where(long, high, middle)
    b = np.where(low > 0.0, 0.5 * (low + high), 0.0)
    b = np.where(b <= np.maximum(0.0, -torque / arm_b) + 1e-12, np.maximum(0.0, -torque / arm_b), b)
    a = np.maximum((torque + arm_b * b) / arm_a, 0.0)
    own_a, own_b = _stretch(a, k, hard), _stretch(b, k, hard)
    rest_a, rest_b = creep * own_a, creep * own_b
    missing = np.minimum(length - rest_a - rest_b, 0.0)  # what a slack tendon is too long by
    rest_b = rest_b + np.where(b <= 0.0, missing, 0.0)
    rest_a = rest_a + np.where((b > 0.0) & (a <= 0.0), missing, 0.0)
    x.joint_angle[:], x.joint_torque[:] = position, arm_a * a - arm_b * b
    half = 0.5 * p.moment_arm_growth * position**2
    x.drive_a_position[:] = p.moment_arm * position + half + slack + rest_a
    x.drive_b_position[:] = -p.moment_arm * position + half + slack + rest_b
    x.tension_drive_a[:] = x.tension_joint_a[:] = a
    x.tension_drive_b[:] = x.tension_joint_b[:] = b
    share = p.tendon_stiffness / p.end_stiffness
    x.stretch_joint_a[:] = share * (rest_a - (creep - 1.0) * own_a)
    x.stretch_joint_b[:] = share * (rest_b - (creep - 1.0) * own_b)
    x.drive_angle[:] = 0.5 * (x.drive_a_position - x.drive_b_position) / p.moment_arm
    x.drive_torque[:] = p.moment_arm * (a - b)
    x.pretension[:], x.co_contraction[:], x.co_contraction_command[:] = (
        p.co_contraction,
        0.5 * (a + b),
        p.co_contraction,
    )
    x.peak_tension[:] = np.maximum(a, b)
    own = (arm**2 * k * np.sqrt(1.0 + 2.0 * hard * t) * (t > 0.0) for arm, t in ((arm_a, a), (arm_b, b)))
    x.joint_stiffness[:] = (
        sum(own) - p.moment_arm_growth * (a + b)
        + p.spring_stiffness + p.weight_torque * np.cos(position)
    )  # fmt: skip
    s.creep_top[:], s.creep_bottom[:] = (creep - 1.0) * own_a, (creep - 1.0) * own_b
    s.slow_creep_top[:], s.slow_creep_bottom[:] = e.slow_creep_share * own_a, e.slow_creep_share * own_b
    s.gap_position[:], s.gap_opposed[:] = x.drive_a_position, x.drive_b_position
