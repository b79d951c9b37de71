"""The coupled wrist as the reference controllers know it: coupling, friction of the yaw cables, and their stretch."""

import math
from collections.abc import Mapping
from typing import ClassVar

from cable_envs.physics.contact import tension_ratio
from cable_envs.plants.view import Gains, Reference, View


class WristView(View):
    """The command is the angle of the yaw drive, the output that of the joint; the rig holds the pitch drive."""

    pid: ClassVar[Mapping[tuple[str, str], Gains]] = {
        ("position", "position"): {
            "kp": ("1", 0.1, 3.0), "ki": ("1/s", 5.0, 60.0), "kd": ("s", 0.0, 0.1), "filter_time": ("s", 0.02, 0.5),
        },
    }  # fmt: skip
    signal = "yaw_angle"

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        self.rig = rig

    def steady(self, ref: Reference, way: float) -> float:
        """See `View.steady`: what the joints wind up, and half the difference of the cables' stretches."""
        rig, (y, v, growth) = self.rig, ref
        r, k = rig["yaw_radius"], rig["yaw_cable_stiffness"]
        torque = rig["yaw_stiffness"] * y + rig["yaw_damping"] * v + rig["yaw_inertia"] * growth
        pull = (torque + way * rig["yaw_friction"]) / r  # T_a - T_b
        a, b = self._per_tension(1.0, way) / k, self._per_tension(-1.0, -way) / k
        long = 2.0 * rig["yaw_pretension"] / k
        low = (long - a * pull) / (a + b)  # T_b where both are taut
        if low < 0.0:
            apart = 2.0 * a * pull - long
        elif low + pull < 0.0:
            apart = long + 2.0 * b * pull
        else:
            apart = a * (low + pull) - b * low
        return y + rig["coupling_radius"] / r * self._pitch(pull) + 0.5 * apart / r

    def _pitch(self, pull: float) -> float:
        """Where the pitch joint stands beside its drive, while the yaw cables pull it by a difference of tensions."""
        rig = self.rig
        half = 0.5 * rig["coupling_radius"] * pull / rig["pitch_radius"]  # of the difference that its own cables hold
        stretch = max(abs(half), 2.0 * abs(half) - rig["pitch_pretension"])  # beyond the pretension one is slack
        return rig["pitch_angle"] + math.copysign(stretch, half) / (rig["pitch_cable_stiffness"] * rig["pitch_radius"])

    def _per_tension(self, cable: float, way: float) -> float:
        """Stretch of a cable over that of one without friction, for its tension at the joint."""
        rig = self.rig
        wrap = max(rig["yaw_wrap"] + cable * rig["wrap_growth"] * rig["pitch_angle"], 0.0)
        ratio = tension_ratio(rig["radius_ratio"], rig["friction_coefficient"], wrap)
        return rig["drive_share"] * ratio**way + 1.0 - rig["drive_share"]
