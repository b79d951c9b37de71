"""A cable transmission of unknown geometry as a picture: two ends with torque sensors, and what lies between lumped."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, Scene, Wheels

_DRIVE, _OUTPUT, _RADIUS = (118.0, 400.0), (482.0, 400.0), 62.0
_BOX = (300.0, 150.0)  # middle and length of what is not known


class TransmissionScene(Scene):
    """Scene of the plant ``transmission``. The ends turn as far as they do; the cable is coloured by the torques."""

    title = "Cable transmission"
    least_tension = 0.01
    pulls = "torque (N m)"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.ratio = rig.get("ratio", 1.0)
        self.first_tension = 0.05
        self.curves = (w.Curve("drive", d.FIRST), w.Curve("output", d.SECOND))
        self.curve_signals = ("drive_torque", "output_torque")

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the colours (N m); ``motion`` is not used."""
        self.full = tension
        self.wheels = Wheels(sheet, ((_DRIVE, _RADIUS), (_OUTPUT, _RADIUS)))
        for (x, y), name in ((_DRIVE, "drive"), (_OUTPUT, "output")):
            w.Label(sheet, x, y - 104.0, name, ha="center", va="center")
        middle, length = _BOX
        hidden = {"fc": d.FILL, "ec": d.METAL_EDGE, "lw": 1.0, "hatch": "////", "zorder": 7.5}
        sheet.add(d.block((middle, _DRIVE[1]), FLAT, length, 2.0 * _RADIUS + 44.0, **hidden), moving=True)
        plain = {"fc": "white", "ec": d.METAL_EDGE, "lw": 0.8, "zorder": 7.6}
        sheet.add(d.block((middle, _DRIVE[1]), FLAT, 124.0, 54.0, **plain), moving=True)
        style: dict[str, Any] = {"ha": "center", "va": "center", "moving": True}
        w.Label(sheet, middle, _DRIVE[1] + 10.0, "contacts and", **style)
        w.Label(sheet, middle, _DRIVE[1] - 8.0, "springs, lumped", **style)
        self.bar = self.pointer_bar(sheet, tension, ("drive", "output"))
        note = (
            f"Angles are true, with {w.number(self.ratio, '.3g')} of the output for 1 of the drive if nothing gave way."
        )
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.cables = [d.Cable(sheet, 3.6) for _ in range(4)]
        self.torques = (
            w.TorqueArrow(sheet, np.array(_DRIVE), 82.0, 75.0),
            w.TorqueArrow(sheet, np.array(_OUTPUT), 82.0, 75.0),
        )
        self.texts = [
            w.Label(sheet, x, y - 124.0, "", d.NORMAL, d.TORQUE, ha="center", va="center", moving=True)
            for x, y in (_DRIVE, _OUTPUT)
        ]
        self.pill = w.Pill(sheet, 24, 572)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; the reference is not shown."""
        angles = signals["drive_angle"], signals["output_angle"]
        moments = signals["drive_torque"], signals["output_torque"]
        self.wheels.turn(angles)
        for cable, (path, moment, shift) in zip(self.cables, self._runs(angles, moments), strict=True):
            cable.set(path, np.full(len(path), max(moment, 1e-3 * self.full)), self.full, np.full(len(path), shift))
        for arrow, text, moment in zip(self.torques, self.texts, moments, strict=True):
            arrow.set(moment / self.full)
            text.set(f"{w.number(moment, '.3f')} N m")
        self.bar.set([abs(m) for m in moments], None)
        way = int(np.sign(signals["direction"]))
        self.pill.set(*(("", d.IDLE), ("opening", d.GOOD), ("closing", d.AMBER))[way])

    @staticmethod
    def _runs(angles: tuple[float, float], moments: tuple[float, float]) -> list[tuple[np.ndarray, float, float]]:
        """Points, torque that it carries and shift of the upper and lower run at both ends, into the middle."""
        quarter, runs = 0.5 * np.pi, []
        for (centre, away), angle, moment in zip(((_DRIVE, 1.0), (_OUTPUT, -1.0)), angles, moments, strict=True):
            for side in (1.0, -1.0):  # the upper run, and the lower one
                begin = quarter + away * quarter
                arc = d.arc_points(centre, _RADIUS + 4.0, begin, begin - side * away * quarter)
                path = np.vstack([arc, [_BOX[0], centre[1] + side * (_RADIUS + 4.0)]])
                runs.append((path, side * moment, -side * away * _RADIUS * angle))
        return runs
