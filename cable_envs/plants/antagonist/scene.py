"""A joint with two tendons as a picture: two drives on the left, the bend of each tendon, the joint with its link."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, DriveName, Scene, Wheels

_JOINT, _RADIUS, _LINK = (390.0, 340.0), 58.0, 150.0
_DRIVES, _SPOOL = {"a": (86.0, 460.0), "b": (86.0, 220.0)}, 30.0
_GUIDE = 16.0


class JointScene(Scene):
    """Scene of the plant ``antagonistic_joint``. The joint and the spools turn as far as they do."""

    title = "Joint with two tendons"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.rig, self.by_torque = rig, reference_unit == "N m"
        self.arm, self.limit = rig.get("moment_arm", 0.01), rig.get("tension_limit", math.inf)
        self.first_tension = 2.0 * rig.get("co_contraction", 15.0)
        self.curves = (w.Curve("a at the joint", d.FIRST), w.Curve("b at the joint", d.SECOND))
        self.curve_signals = ("tension_joint_a", "tension_joint_b")

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the colours (N); ``motion`` is not used."""
        self.full = tension
        case = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 0.8}
        self.names = []
        for name, (x, y) in _DRIVES.items():
            sheet.add(d.block((x - 8.0, y), FLAT, 84.0, 84.0, **case))
            places = (x - 8.0, y - 58.0), (x - 8.0, y - 76.0)
            self.names.append(DriveName(sheet, self.rig, f"drive {name}", *places, f"motor_{name}_current"))
        self.guides = {"a": (250.0, _JOINT[1] + _RADIUS + _GUIDE), "b": (250.0, _JOINT[1] - _RADIUS - _GUIDE)}
        self.wheels = Wheels(sheet, ((_JOINT, _RADIUS), *((at, _SPOOL) for at in _DRIVES.values())))
        for at in self.guides.values():
            rim = d.arc_points(at, _GUIDE - 3.0, 0.0, 2.0 * math.pi)
            sheet.add(d.outline(rim, fc=d.METAL, ec=d.METAL_EDGE, lw=1.0, zorder=2))
        w.Label(sheet, 250.0, _JOINT[1], "bends", d.TINY, d.SOFT, ha="center", va="center")
        self.bar = self.pointer_bar(sheet, tension, ("$T_a$", "$T_b$"))
        note = "The joint's angle is true; spools turn as if they were as large as the joint's pulley. Not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.paths = {name: self._path(name) for name in "ab"}
        self.cables = {name: d.Cable(sheet, 3.6) for name in "ab"}
        body: dict[str, Any] = {"fc": "#52606d", "ec": d.INK, "lw": 1.0, "zorder": 4}
        self.link = sheet.shape(**body)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=5)
        style: dict[str, Any] = {"ha": "center", "va": "center", "moving": True}
        self.stiffness = w.Label(sheet, _JOINT[0] + 20.0, _JOINT[1] - 110.0, "", d.NORMAL, d.TORQUE, **style)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 110, 572)

    def _path(self, name: str) -> np.ndarray:
        """From the spool over the bend to the joint's pulley and half round it."""
        up = 1.0 if name == "a" else -1.0
        spool, guide = np.array(_DRIVES[name]), np.array(self.guides[name])
        reach = d.arc_points(guide, _GUIDE, -up * 2.0, -up * math.pi / 2)
        round_ = d.arc_points(_JOINT, _RADIUS + 2.0, up * math.pi / 2, 0.0)
        start = spool + np.array([0.0, -up * (_SPOOL + 2.0)])
        return np.vstack([start, reach, round_])

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (rad or N m)."""
        angle = signals["joint_angle"]
        drives = {name: signals[f"drive_{name}_position"] / self.arm for name in "ab"}
        self.wheels.turn((angle, drives["a"], -drives["b"]))
        way = d.unit_vector(angle)
        centre = np.array(_JOINT) + 0.5 * _LINK * way
        self.link.set_xy(d.block_points(centre, way, _LINK, 26.0))
        self.wanted.set_visible(not self.by_torque)
        if not self.by_torque:
            ends = np.array(_JOINT) + np.outer([_RADIUS, _LINK + 24.0], d.unit_vector(reference))
            self.wanted.set_data(*ends.T)
        ends_of = {name: (signals[f"tension_drive_{name}"], signals[f"tension_joint_{name}"]) for name in "ab"}
        for name, cable in self.cables.items():
            path = self.paths[name]
            drive, joint = ends_of[name]
            tension = np.where(np.arange(len(path)) < 3, drive, joint)
            cable.set(path, tension, self.full, np.full(len(path), -_RADIUS * drives[name]))
        for one in self.names:
            one.show(signals)
        self.bar.set((ends_of["a"][1], ends_of["b"][1]), None)
        self.stiffness.set(f"stiffness {w.number(signals['joint_stiffness'], '.2f')} N m/rad")
        slack = min(min(pair) for pair in ends_of.values()) <= 1e-6 or signals.get("slack_fraction", 0.0) > 0.0
        self.pills[0].set("slack" if slack else "", d.AMBER)
        peak = signals.get("peak_tension", max(max(pair) for pair in ends_of.values()))
        self.pills[1].set("overload" if peak > self.limit else "", d.WARN)
