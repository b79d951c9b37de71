"""The joint with two tendons as the reference controllers know it: balance of the joint, contacts, and stretch."""

import math
from collections.abc import Mapping
from typing import ClassVar

from scipy.optimize import brentq

from cable_envs.effects.stiffness_hardening import linear
from cable_envs.physics.contact import tension_ratio
from cable_envs.plants.antagonist.parameters import angle_of_torque
from cable_envs.plants.view import Gains, Reference, View

_SMOOTH = {"filter_time": ("s", 0.02, 0.5)}


class JointView(View):
    """The command is the drives' angle, or their torque; the output the joint's angle, or the torque there."""

    pid: ClassVar[Mapping[tuple[str, str], Gains]] = {
        ("position", "position"): {"kp": ("1", 0.1, 3.0), "ki": ("1/s", 5.0, 60.0), "kd": ("s", 0.0, 0.1)} | _SMOOTH,
        ("position", "torque"): {
            "kp": ("rad/(N m)", 0.1, 10.0), "ki": ("rad/(N m s)", 4.0, 100.0), "kd": ("rad s/(N m)", 0.0, 1.0),
        } | _SMOOTH,
        ("torque", "position"): {
            "kp": ("N m/rad", 0.5, 10.0), "ki": ("N m/(rad s)", 2.0, 100.0), "kd": ("N m s/rad", 0.02, 1.0),
        } | _SMOOTH,
        ("torque", "torque"): {"kp": ("1", 0.3, 3.0), "ki": ("1/s", 10.0, 60.0), "kd": ("s", 0.0, 0.1)} | _SMOOTH,
    }  # fmt: skip

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        self.rig, self.by_position, self.of_torque = rig, action_mode == "position", task == "torque"
        self.signal = "joint_torque" if self.of_torque else "joint_angle"
        self.ratio = tension_ratio(rig["radius_ratio"], rig["friction_coefficient"], rig["wrap_angle"])

    def steady(self, ref: Reference, way: float) -> float:
        """See `View.steady`: both tensions at the joint and, through the contacts, what the drives must do for them."""
        rig, r, g = self.rig, self.rig["moment_arm"], self.rig["moment_arm_growth"]
        torque, q, v = self._wanted(ref, way)
        arm_a, arm_b = r + g * q, r - g * q
        up = self.ratio**way  # tendon a is pulled in, b is paid out
        need = 2.0 * self._stretch(rig["co_contraction"], rig["co_contraction"]) - g * q * q

        def of(b: float) -> tuple[float, float]:
            return max((torque + arm_b * b) / arm_a, 0.0), b

        def longer(b: float) -> float:
            a = of(b)[0]
            if self.by_position:
                return self._stretch(a * up, a) + self._stretch(b / up, b) - need
            return a * up + b / up - 2.0 * rig["co_contraction"]

        least = max(0.0, -torque / arm_b)
        most = least + 4.0 * (rig["co_contraction"] + abs(torque) / min(arm_a, arm_b)) + 1.0
        b = least if longer(least) >= 0.0 else brentq(longer, least, most, xtol=1e-13, rtol=1e-14)
        a = of(b)[0]
        if self.by_position:
            own = self._stretch(b / up, b) if b > 0.0 else need - self._stretch(a * up, a)
            return q + 0.5 * (self._stretch(a * up, a) - own) / r
        return r * (a * up - b / up) + 2.0 * rig["drive_damping"] * r * r * v

    def _wanted(self, ref: Reference, way: float) -> tuple[float, float, float]:
        """Torque of the tendons at the joint, its angle and its speed."""
        rig = self.rig
        if self.of_torque:
            torque, spring = ref[0], rig["spring_stiffness"]
            return torque, float(angle_of_torque(rig, torque)), ref[1] / spring
        q, v, growth = ref
        held = rig["spring_stiffness"] * q + rig["weight_torque"] * math.sin(q)
        return held + rig["joint_damping"] * v + rig["joint_inertia"] * growth + way * rig["joint_friction"], q, v

    def _stretch(self, at_drive: float, at_joint: float) -> float:
        """Stretch of a tendon at its tensions before and behind the bend, m."""
        rig, hard = self.rig, self.rig["tendon_hardening"]
        share = rig["drive_share"]
        return (share * linear(at_drive, hard) + (1.0 - share) * linear(at_joint, hard)) / rig["tendon_stiffness"]
