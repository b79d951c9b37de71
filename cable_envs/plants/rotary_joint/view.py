"""The rotary joint as the reference controllers know it: one inertia on a pendulum, and the motor's circuit."""

import math
from collections.abc import Mapping
from typing import ClassVar

from cable_envs.plants.view import ACCELERATION, POSITION, Gains, Reference, View


class RotaryJointView(View):
    """The command is the motor's torque, current, voltage or duty, or a position; the output the joint's angle."""

    pid: ClassVar[Mapping[tuple[str, str], Gains]] = {
        **dict.fromkeys(((mode, "position") for mode in ("torque", "current", "voltage", "duty")), ACCELERATION),
        ("position", "position"): POSITION,
    }  # fmt: skip
    signal = "position"

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        self.rig, self.mode = rig, action_mode
        self.inertia = rig["inertia"] + rig["load_inertia"] + rig["load_mass"] * rig["arm_length"] ** 2
        current = self.inertia / rig["torque_constant"]
        voltage = current * rig["resistance"]
        self.unit_command = {
            "torque": self.inertia, "current": current, "voltage": voltage, "duty": voltage / rig["supply_voltage"],
            "position": 1.0,
        }[action_mode]  # fmt: skip

    def steady(self, ref: Reference, way: float) -> float:
        """See `View.steady`: torque of inertia, pendulum and friction, and through the circuit what it takes."""
        rig, (y, rate, growth) = self.rig, ref
        weight = rig["load_mass"] * rig["gravity"] * rig["arm_length"] * math.sin(y - rig["hanging_angle"])
        torque = self.inertia * growth + weight + rig["viscous"] * rate + way * rig["coulomb"]
        if self.mode == "torque":
            return torque
        current = torque / rig["torque_constant"]
        if self.mode == "current":
            return current
        voltage = rig["resistance"] * current + rig["torque_constant"] * rate
        if self.mode == "voltage":
            return voltage
        duty = voltage / rig["supply_voltage"]
        if self.mode == "duty":
            return duty
        return y + duty / rig["position_gain"] if rig["position_gain"] > 0.0 else y
