"""Scheduled PI-D behind holes of which only the drive is measured.

The load hangs at the end of the cable, so it stands where the drive stands less the stretch of the cable:

    y = x_drive - C T_drive,        y' = x_drive'

The drive was homed: it reads what the load would have without stretch. An episode begins with the load on its
reference, so that the first sample tells C. It stays within a factor of `FACTOR` of the nominal one.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from cable_envs.baselines.base import HOLE, Levels, Reference
from cable_envs.baselines.hole.scheduled import ScheduledPid
from cable_envs.core.params import Parameter, ParameterTable

FACTOR = 5.0

_SLOWER = {"kp": 8000.0, "ki": 4e4, "ki_rest": 4e4, "kd": 200.0, "width": 5e-4}
"""Gains for a speed that is a filtered difference of the drive's position."""


class DriveSide(ScheduledPid):
    """PI-D on the load's place as the drive's position and tension tell it."""

    name = "drive-side"
    tasks = ("position",)
    levels: ClassVar[Mapping[str, str]] = Levels({HOLE: "drive"})
    gain_tables: ClassVar = {
        case: ParameterTable(
            *(replace(p, default=_SLOWER.get(p.name, p.default)) for p in table),
            Parameter("homed", "1", 1.0, 0.0, 2.0, "share of the first sample's compliance that is believed"),
        )
        for case, table in ScheduledPid.gain_tables.items()
        if case[2] == "position"
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        spans = sum(name.startswith("wrap_angle_") for name in self.rig)
        self._nominal = 1.0 / self.rig["cable_stiffness"] + (spans / self.rig["span_stiffness"] if spans else 0.0)

    def reset(self) -> None:
        super().reset()
        self.compliance = 0.0
        """C, m/N; 0 before the first sample"""

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if self.compliance == 0.0:
            seen = (y["drive_position"] - ref[0]) / max(y["drive_tension"], 1.0)
            seen = min(max(seen, self._nominal / FACTOR), self._nominal * FACTOR)
            self.compliance = self._nominal + self.gains["homed"] * (seen - self._nominal)
        place = y["drive_position"] - self.compliance * y["drive_tension"]
        return super().act(t, {**y, "load_position": place, "load_velocity": y["drive_velocity"]}, ref)
