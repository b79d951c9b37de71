"""A wrist of two joints as a picture: both drives, the shaft, and the joints seen along the pitch and the yaw axis."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, DriveName, Scene, Wheels

_DRIVES = {"": (80.0, 430.0), "pitch_": (80.0, 210.0)}
_SPOOL, _WHEEL, _LINK = 32.0, 42.0, 96.0
_PITCH, _YAW, _PITCH_ALONE = (300.0, 430.0), (470.0, 430.0), (300.0, 210.0)


class WristScene(Scene):
    """Scene of the plant ``wrist``. Angles are true; the yaw cables are above, the pitch cables below."""

    title = "Coupled wrist"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.rig, self.ratio = rig, rig.get("coupling_radius", 2.2e-3) / rig.get("yaw_radius", 2.7e-3)
        self.limit = rig.get("tension_limit", math.inf)
        self.first_tension = 2.0 * rig.get("yaw_pretension", 15.0)
        self.curves = (w.Curve("yaw cable a", d.FIRST), w.Curve("yaw cable b", d.SECOND))
        self.curve_signals = ("tension_end_a", "tension_end_b")

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the colours (N); ``motion`` is not used."""
        self.full = tension
        case = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 0.8}
        self.names = []
        for name, (x, y) in _DRIVES.items():
            sheet.add(d.block((x - 6.0, y), FLAT, 88.0, 88.0, **case))
            places = (x - 6.0, y - 60.0), (x - 6.0, y - 78.0)
            called = "pitch drive" if name else "yaw drive"
            self.names.append(DriveName(sheet, self.rig, called, *places, f"{name}motor_current"))
        for (x, y), text in ((_PITCH, "pulleys on the pitch axis"), (_YAW, "yaw"), (_PITCH_ALONE, "pitch")):
            w.Label(sheet, x, y - _WHEEL - 26.0, text, ha="center", va="center")
        at = ((_DRIVES[""], _SPOOL), (_DRIVES["pitch_"], _SPOOL))
        self.wheels = Wheels(sheet, (*at, (_PITCH, _WHEEL), (_YAW, _WHEEL), (_PITCH_ALONE, _WHEEL)))
        self.bar = self.pointer_bar(sheet, tension, ("$T_a$", "$T_b$"))
        note = f"Angles are true; 1 rad of pitch takes up what {self.ratio:.3f} rad of yaw does. Not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.paths = {key: self._path(*key) for key in (("", "a"), ("", "b"), ("pitch_", "a"), ("pitch_", "b"))}
        self.cables = {key: d.Cable(sheet, 3.4) for key in self.paths}
        body: dict[str, Any] = {"fc": "#52606d", "ec": d.INK, "lw": 1.0, "zorder": 7.5}
        self.jaw, self.clevis = sheet.shape(**body), sheet.shape(**body)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=8)
        style: dict[str, Any] = {"ha": "center", "va": "center", "moving": True}
        self.text = w.Label(sheet, 470.0, 210.0, "", d.NORMAL, d.TORQUE, **style)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 110, 572)

    @staticmethod
    def _path(which: str, side: str) -> np.ndarray:
        """From the spool to the joint's pulley; a yaw cable passes the pulley on the pitch axis."""
        up = 1.0 if side == "a" else -1.0
        x, y = _DRIVES[which]
        end = np.array(_PITCH_ALONE if which else _YAW)
        start = np.array([[x, y + up * (_SPOOL + 2.0)]])
        passed = d.arc_points(_PITCH, _WHEEL + 2.0, up * 2.0, up * 1.1)
        arc = d.arc_points(end, _WHEEL + 2.0, up * math.pi / 2, 0.0)
        return np.vstack([start, arc] if which else [start, passed, arc])

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in rad."""
        yaw, pitch, wound = signals["yaw_angle"], signals["pitch_angle"], signals["drive_angle"]
        self.wheels.turn((wound, signals["pitch_drive_angle"], pitch, yaw, pitch))
        for shape, at, angle in ((self.jaw, _YAW, yaw), (self.clevis, _PITCH_ALONE, pitch)):
            way = d.unit_vector(angle)
            shape.set_xy(d.block_points(np.array(at) + 0.5 * _LINK * way, way, _LINK, 20.0))
        ends = np.array(_YAW) + np.outer([_WHEEL, _LINK + 18.0], d.unit_vector(reference))
        self.wanted.set_data(*ends.T)
        for (which, side), cable in self.cables.items():
            path = self.paths[which, side]
            before, behind = (signals.get(f"{which}tension_{end}_{side}", 0.0) for end in ("drive", "end"))
            moved = (signals["pitch_drive_angle"] if which else wound) * (1.0 if side == "a" else -1.0)
            tension = np.where(np.arange(len(path)) < 6, before, behind)
            cable.set(path, tension, self.full, np.full(len(path), -_WHEEL * moved))
        for one in self.names:
            one.show(signals)
        self.bar.set((signals["tension_end_a"], signals["tension_end_b"]), None)
        self.text.set(f"pitch {w.number(math.degrees(pitch), '.0f')}°, yaw {w.number(math.degrees(yaw), '.0f')}°")
        self.pills[0].set("slack" if signals.get("slack_fraction", 0.0) > 0.0 else "", d.AMBER)
        self.pills[1].set("overload" if signals.get("peak_tension", 0.0) > self.limit else "", d.WARN)
