"""A linear drive as a picture: a motor that pulls a carriage along a rail by a belt."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, RulerScene, Wheels

_TOP, _RADIUS = 400.0, 34.0  # height of the belt's upper run; then places of motor, of the other pulley, of the middle
_MOTOR, _OTHER, _MIDDLE = 84.0, 536.0, 310.0


class DriveScene(RulerScene):
    """Scene of the plant ``linear_drive``. Positions are read on the ruler (mm); all else is not to scale."""

    title = "Linear drive"
    shows = "carriage position"
    pulls = "force (N)"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.mass, self.limit = rig.get("mass", 0.0), rig.get("tension_limit", math.inf)
        self.rigid = rig.get("belt_stiffness", 0.0) <= 0.0
        self.first_tension = 20.0
        self.curves = (w.Curve("belt", d.FIRST), w.Curve("motor", d.SECOND))
        self.curve_signals = ("belt_force", "force")
        self.travel = 300.0

    def motion(self, signals: Mapping[str, float]) -> Sequence[float]:
        """Positions (mm) that the ruler must show."""
        return 1e3 * signals["motor_position"], 1e3 * signals["position"]

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for a range of the ruler (mm) and an end of the colours (N)."""
        self.ranged(motion, tension)
        centre = _TOP - _RADIUS
        motor = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 1}
        sheet.add(d.block((_MOTOR - 10.0, centre), FLAT, 84.0, 96.0, **motor))
        w.Label(sheet, _MOTOR - 10.0, centre - 66.0, "motor", ha="center", va="center")
        rail = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9, "zorder": 1}
        sheet.add(d.block((_MIDDLE, centre + 8.0), FLAT, self.travel + 78.0, 9.0, **rail))
        foot = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9, "hatch": "////", "zorder": 0.5}
        for end in (_MIDDLE - self.travel / 2 - 30.0, _MIDDLE + self.travel / 2 + 30.0):
            sheet.add(d.block((end, centre - 22.0), FLAT, 12.0, 50.0, **foot))
        self.wheels = Wheels(sheet, (((_MOTOR, centre), _RADIUS - 3.0), ((_OTHER, centre), _RADIUS - 3.0)))
        self.ruler(sheet, _MIDDLE, _TOP - 130.0)
        self.bar = self.pointer_bar(sheet, tension, ("belt", "motor"))
        note = "The belt is rigid here." if self.rigid else "Both runs of the belt are pretensioned."
        w.Label(sheet, 24, 14, f"{note} Positions by the ruler; other lengths are not to scale.", d.TINY, d.SOFT)
        self._make_moving(sheet)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 130, 572)

    def _make_moving(self, sheet: d.Sheet) -> None:
        self.ahead, self.behind = d.Cable(sheet, 3.6), d.Cable(sheet, 3.6)
        self.carriage = sheet.shape(fc="#52606d", ec=d.INK, lw=1.0, zorder=7)
        style: dict[str, Any] = {"weight": "bold", "ha": "center", "va": "center", "moving": True}
        self.label = w.Label(sheet, 0.0, 0.0, f"{self.mass:g} kg", d.NORMAL, "white", **style)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=3)
        self.level = sheet.line(color=d.OUTPUT, lw=1.6, zorder=3)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (m)."""
        x, pull = _MIDDLE + self.pixels(1e3 * signals["position"]), signals["belt_force"]
        turned = self.pixels(1e3 * signals["motor_position"])
        self._set_belt(x, pull, turned)
        self.wheels.turn((-turned / _RADIUS, -turned / _RADIUS))
        self.carriage.set_xy(d.block_points((x, _TOP + 8.0), FLAT, 66.0, 44.0))
        self.label.move(x, _TOP + 8.0)
        self.level.set_data([x, x], [_TOP - 130.0, _TOP - 14.0])
        at = _MIDDLE + self.within(1e3 * reference)
        self.wanted.set_data([at, at], [_TOP - 130.0, _TOP + 44.0])
        self.bar.set((abs(pull), abs(signals["force"])), None)
        word, colour = (("stuck", d.IDLE), ("forward", d.GOOD), ("backward", d.AMBER))[int(np.sign(signals["sliding"]))]
        self.pills[0].set(word, colour)
        self.pills[1].set("overload" if signals.get("peak_tension", abs(pull)) > self.limit else "", d.WARN)

    def _set_belt(self, x: float, pull: float, turned: float) -> None:
        """The run ahead of the carriage pulls it forward, that behind it backward."""
        half = math.pi / 2.0
        right = d.arc_points((_OTHER, _TOP - _RADIUS), _RADIUS, half, -half)
        left = d.arc_points((_MOTOR, _TOP - _RADIUS), _RADIUS, half, 3.0 * half)
        ahead = np.vstack([[x + 33.0, _TOP], right, left[::-1][:1]])
        behind = np.vstack([[x - 33.0, _TOP], left])
        for cable, path, force, way in ((self.ahead, ahead, pull, 1.0), (self.behind, behind, -pull, -1.0)):
            moved = way * (turned - (x - _MIDDLE)) * np.ones(len(path))
            cable.set(path, np.full(len(path), max(force, 1e-3 * self.full)), self.full, moved)
