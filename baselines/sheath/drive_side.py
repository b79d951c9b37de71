"""Feedforward and PI for a load at the end of a sheath of which only the drive is measured.

A tendon whose tension falls from T1 at the drive to T2 at the load by friction carries the mean (T1 - T2) / ln(T1 / T2)
(capstan law), whatever the friction and the bend are. So the load stands at

    y = x_drive - C (T1 - T2) / ln(T1 / T2),        T2 = preload + k_load y

T1 is measured, and T2 follows from y itself: two steps of iteration find both. The drive was homed, and an episode
begins at rest on the reference with one tension all along, so that the first sample tells C and the preload; after that
nothing nominal but the return spring is left. The command is the drive's position for the reference with the mean that
the friction of the way gives, measured while it slides, and a PI on the estimated error.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import Controller, Levels, Reference
from cable_envs.baselines.parts import Smoother, follow_direction
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.plants.sheath.view import SheathLoad

SHEATH = "tendon_sheath"


def mean_tension(drive: float, load: float) -> float:
    """Mean along a tendon whose tension falls by the capstan law from ``drive`` to ``load``, N."""
    drive, load = max(drive, 1e-3), max(load, 1e-3)
    ratio = drive / load
    return 0.5 * (drive + load) if abs(ratio - 1.0) < 1e-3 else (drive - load) / math.log(ratio)


class SheathDriveSide(Controller):
    """PI on the load's place as the drive tells it, with the friction of the way as feedforward."""

    name = "sheath-drive-side"
    information = "nominal"
    plants = (SHEATH,)
    tasks = ("position",)
    modes: ClassVar = ("position",)
    levels: ClassVar[Mapping[str, str]] = Levels({SHEATH: "drive"})
    gain_tables: ClassVar = {
        (SHEATH, "position", "position"): ParameterTable(
            Parameter("kp", "1", 0.2, 1e-4, 100.0, "proportional gain of the estimated error"),
            Parameter("ki", "1/s", 4.0, 1e-4, 1e4, "integral gain of the estimated error"),
            Parameter("homed", "1", 1.0, 0.0, 2.0, "share of the first sample's compliance that is believed"),
            Parameter("lead", "s", 0.02, -0.5, 0.5, "how far ahead the reference is taken"),
            Parameter("turn_time", "s", 0.1, 1e-4, 10.0, "time constant of changes of direction"),
            Parameter("learns", "1/s", 2.0, 1e-4, 1e3, "rate at which the friction follows the measured tension"),
            Parameter("slides", "m/s", 1e-3, 1e-6, 1.0, "speed of the reference from which the tendon slides"),
        )
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        self._load = SheathLoad(self.rig)
        self._side = Smoother(self.dt, self.gains["turn_time"])

    def reset(self) -> None:
        self._side.reset()
        self._direction, self._integral = 0.0, 0.0
        self._last: float | None = None
        self.compliance = 0.0
        """C, m/N; 0 before the first sample"""
        self.exponent = self._load.exponent
        """ln(T1 / T2) of the way that pulls"""

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        g, drive, tension = self.gains, y["drive_position"], y["drive_tension"]
        if self.compliance == 0.0:
            self._begin(ref[0], drive, tension)
        self.place = self._placed(drive, tension)
        self._direction = follow_direction(self._direction, self._last, ref)
        self._last = ref[0]
        way = self._side.update(self._direction)
        pulls = self._pulls(ref[0])
        if abs(ref[1]) > g["slides"] and abs(way) > 0.95:
            seen = abs(math.log(max(tension, 1e-3) / max(self._pulls(self.place), 1e-3)))
            self.exponent += min(g["learns"] * self.dt, 1.0) * (seen - self.exponent)
        wanted = ref[0] + g["lead"] * ref[1]
        stretch = self.compliance * mean_tension(pulls * math.exp(way * self.exponent), pulls)
        error = ref[0] - self.place
        self._integral += g["ki"] * error * self.dt
        return self.limit(wanted + stretch + g["kp"] * error + self._integral)

    def _begin(self, place: float, drive: float, tension: float) -> None:
        """Compliance and preload, as the first sample shows them."""
        nominal = 1.0 / self._load.cable_stiffness
        seen = min(max((drive - place) / max(tension, 1e-3), nominal / 5.0), nominal * 5.0)
        self.compliance = nominal + self.gains["homed"] * (seen - nominal)
        self.place = place
        self._preload = tension - self._load.stiffness * place

    def _pulls(self, place: float) -> float:
        """T2 with the load at ``place``, N."""
        return max(self._preload + self._load.stiffness * place, 0.0)

    def _placed(self, drive: float, tension: float) -> float:
        """y from what the drive shows."""
        place = self.place
        for _ in range(2):
            place = drive - self.compliance * mean_tension(tension, self._pulls(place))
        return place
