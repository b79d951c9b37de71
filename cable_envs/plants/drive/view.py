"""The linear drive as the reference controllers know it: one mass, which its motor moves; a belt only stretches."""

from collections.abc import Mapping
from typing import ClassVar

from cable_envs.plants.view import ACCELERATION, POSITION, Gains, Reference, View


class DriveView(View):
    """The command is the motor's force, its voltage, or its position; the output the carriage's position."""

    pid: ClassVar[Mapping[tuple[str, str], Gains]] = {
        ("force", "position"): ACCELERATION,
        ("voltage", "position"): ACCELERATION,
        ("position", "position"): POSITION,
    }  # fmt: skip
    signal = "position"

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        self.rig, self.mode = rig, action_mode
        self.total = rig["mass"] + rig["motor_mass"]
        self.unit_command = {
            "force": self.total, "voltage": self.total / rig["force_per_volt"], "position": 1.0,
        }[action_mode]  # fmt: skip

    def steady(self, ref: Reference, way: float) -> float:
        """See `View.steady`: force of inertia, weight and friction, and what the belt stretches under it."""
        rig, (y, rate, growth) = self.rig, ref
        weight = rig["mass"] * rig["gravity"] * rig["gravity_share"]
        on_carriage = rig["mass"] * growth + weight + rig["viscous"] * rate + way * rig["coulomb"]
        force = on_carriage + rig["motor_mass"] * growth
        if self.mode == "position":
            stretch = on_carriage / rig["belt_stiffness"] if rig["belt_stiffness"] > 0.0 else 0.0
            # the servo takes the command's rate too, and finds no error of it
            return y + stretch + force / (self.total * rig["servo_frequency"] ** 2)
        return force / rig["force_per_volt"] if self.mode == "voltage" else force
