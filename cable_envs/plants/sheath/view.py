"""The tendon in a sheath as the reference controllers know it: capstan law, compliance and the load's balance."""

import math
from collections.abc import Mapping
from typing import ClassVar

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.sheath.capstan import leaving
from cable_envs.plants.view import Gains, Reference, View


class SheathLoad:
    """The load of G28: mass, balance of forces, and the capstan ratio e^(mu Theta) in place of the hole's."""

    def __init__(self, rig: Mapping[str, float]):
        self.mass, self.stiffness, self.damping = rig["load_mass"], rig["load_stiffness"], rig["load_damping"]
        self.preload, self.friction = rig["load_preload"], rig["load_friction"]
        self.cable_stiffness = 1.0 / (1.0 / rig["tendon_stiffness"] + 1.0 / rig["sheath_stiffness"])
        self.exponent = rig["friction_coefficient"] * rig["bend_angle"]

    def ratio(self, speed: float, drive_tension: float, load_tension: float) -> float:
        """e^(mu Theta), at any speed and tension."""
        return math.exp(self.exponent)

    def resistance(self, position: float, velocity: float) -> float:
        """Return spring and viscous friction, N."""
        return self.preload + self.stiffness * position + self.damping * velocity

    def require_spring(self, task: str) -> None:
        """A tension can only be set against a spring; ConfigurationError where there is none."""
        if task == "tension" and self.stiffness <= 0.0:
            raise ConfigurationError(
                "load_stiffness = 0 N/m: a tension task needs a return spring (load_stiffness > 0)"
            )


class SheathView(View):
    """The command is the drive's position, or its force; the output the load's position, or the tension there."""

    hauls = ("tension",)
    pid: ClassVar[Mapping[tuple[str, str], Gains]] = {
        ("position", "position"): {
            "kp": ("1", 0.1, 3.0), "ki": ("1/s", 5.0, 60.0), "kd": ("s", 0.0, 0.1), "filter_time": ("s", 0.02, 0.5),
        },
        ("position", "tension"): {
            "kp": ("m/N", 1e-4, 1e-2), "ki": ("m/(N s)", 3e-3, 0.1), "kd": ("m s/N", 0.0, 1e-3),
            "filter_time": ("s", 0.02, 0.5),
        },
        ("tension", "position"): {
            "kp": ("N/m", 2000.0, 3e4), "ki": ("N/(m s)", 8e3, 2e5), "kd": ("N s/m", 20.0, 500.0),
            "filter_time": ("s", 0.02, 0.5),
        },
        ("tension", "tension"): {
            "kp": ("1", 0.5, 3.0), "ki": ("1/s", 15.0, 60.0), "kd": ("s", 0.0, 0.1), "filter_time": ("s", 0.02, 0.5),
        },
    }  # fmt: skip

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        self.load, self.by_position, self.of_tension = SheathLoad(rig), action_mode == "position", task == "tension"
        self.drive_mass, self.drive_damping = rig["drive_mass"], rig["drive_damping"]
        self.signal = "load_tension" if self.of_tension else "load_position"
        self.load.require_spring(task)

    def steady(self, ref: Reference, way: float) -> float:
        """See `View.steady`: x = y + Tm / k, or T1 and what the drive's own motion takes."""
        load, r = self.load, way * self.load.exponent
        if self.of_tension:
            tension, y, rate, growth = ref[0], (ref[0] - load.preload) / load.stiffness, ref[1] / load.stiffness, 0.0
        else:
            y, rate, growth = ref
            tension = load.resistance(y, rate) + load.mass * growth + way * load.friction
        tension = max(tension, 0.0)
        if self.by_position:
            return y + tension / leaving(r) / load.cable_stiffness
        return tension * math.exp(r) + self.drive_mass * growth + self.drive_damping * rate

    def hauling(self) -> SheathLoad:
        """The load, for a drive that is told its force."""
        return self.load
