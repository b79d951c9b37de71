"""A rotary joint as a picture: a servo with its horn, an arm that turns as far as it does, and the mass at its end."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, Scene, Wheels

_AXIS, _RADIUS, _ARM, _BALL = (300.0, 350.0), 46.0, 150.0, 24.0


class RotaryJointScene(Scene):
    """Scene of the plant ``rotary_joint``. The arm's angle is true, zero hangs down; lengths are not to scale."""

    title = "Rotary joint"
    shows = "angle"
    pulls = "torque (N m)"
    least_tension = 0.2

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.mass, self.limit = rig.get("load_mass", 0.0), rig.get("duty_limit", 1.0)
        self.hangs, self.by_angle = rig.get("hanging_angle", 0.0), reference_unit == "rad"
        self.first_tension = max(rig.get("gravity", 0.0) * self.mass * rig.get("arm_length", 0.0), 0.1)
        self.curves = (w.Curve("of the motor", d.FIRST), w.Curve("of the load", d.SECOND))
        self.curve_signals = ("torque", "load_torque")

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the colours (N m); ``motion`` is not used."""
        case = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 0.8}
        sheet.add(d.block((_AXIS[0], _AXIS[1] + 44.0), FLAT, 128.0, 190.0, **case))
        w.Label(sheet, _AXIS[0], _AXIS[1] + 152.0, "servo", ha="center", va="center")
        self.wheels = Wheels(sheet, ((_AXIS, _RADIUS),))
        self.bar = self.pointer_bar(sheet, tension, ("motor", "load"))
        note = "The angle is true; the mass hangs down where the motor has no torque. Lengths are not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=3)
        self.arm = sheet.shape(fc="#52606d", ec=d.INK, lw=1.0, zorder=5)
        self.ball = sheet.shape(fc="#52606d", ec=d.INK, lw=1.0, zorder=6)
        style: dict[str, Any] = {"ha": "center", "va": "center", "moving": True}
        self.label = w.Label(sheet, 0.0, 0.0, f"{self.mass:g} kg", d.TINY, "white", **style)
        self.current = w.Label(sheet, _AXIS[0] + 150.0, _AXIS[1] + 90.0, "", d.NORMAL, d.TORQUE, **style)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 130, 572)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (rad)."""
        angle = signals["position"]
        self.wheels.turn((angle,))
        way = self._way(angle)
        axis = np.array(_AXIS)
        end = axis + _ARM * way
        self.arm.set_xy(d.block_points(axis + 0.5 * _ARM * way, way, _ARM, 18.0))
        self.ball.set_xy(d.arc_points(end, _BALL, 0.0, 2.0 * math.pi))
        self.label.move(*end)
        self.wanted.set_visible(self.by_angle)
        self.wanted.set_data(*(axis + np.outer([_RADIUS, _ARM + 40.0], self._way(reference))).T)
        self.bar.set((abs(signals["torque"]), abs(signals["load_torque"])), None)
        self.current.set(f"{w.number(signals['current'], '.2f')} A, duty {w.number(signals['duty'], '.2f')}")
        word, colour = (("stuck", d.IDLE), ("forward", d.GOOD), ("backward", d.AMBER))[int(np.sign(signals["sliding"]))]
        self.pills[0].set(word, colour)
        self.pills[1].set("duty at its limit" if abs(signals["duty"]) >= self.limit else "", d.AMBER)

    def _way(self, angle: float) -> np.ndarray:
        return d.unit_vector(angle - self.hangs - 0.5 * math.pi)
