"""The coupled electric drives as a picture: two motors, a belt, and a sprung pulley whose speed is sensed."""

import math
from collections.abc import Mapping

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import Scene, Wheels, belt

_PULLEY, _LEFT, _RIGHT = (300.0, 440.0), (170.0, 250.0), (430.0, 250.0)
_RADII = {_PULLEY: 44.0, _LEFT: 36.0, _RIGHT: 36.0}
_CEILING = 566.0
_TURNS = 20.0
"""rad of a motor for one metre of the belt: pulleys of 50 mm, as drawn."""


class CoupledDrivesScene(Scene):
    """Scene of the plant ``coupled_drives``. All pulleys turn as if the motors' had a radius of 50 mm."""

    title = "Coupled electric drives"
    shows = "belt position at the pulley"
    pulls = "force of the belt (N)"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.limit = rig.get("voltage_limit", math.inf)
        self.first_tension = 20.0
        self.curves = (w.Curve("on the pulley", d.FIRST),)
        self.curve_signals = ("belt_force",)

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the colours (N); ``motion`` is not used."""
        self.full = tension
        wall = {"fc": d.FILL, "ec": d.METAL_EDGE, "lw": 0.8, "hatch": "////", "zorder": 0.5}
        sheet.add(d.block((_PULLEY[0], _CEILING + 5.0), np.array([1.0, 0.0]), 120.0, 10.0, **wall))
        spring = d.spring_points(np.array([_PULLEY[0], _CEILING]), np.array(_PULLEY), 6, 9.0)
        sheet.stroke(spring, color=d.INK, lw=1.2, solid_joinstyle="round", zorder=1)
        case = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 0.8}
        for at, side in ((_LEFT, -1.0), (_RIGHT, 1.0)):
            sheet.add(d.block((at[0] + 10.0 * side, at[1] - 6.0), np.array([1.0, 0.0]), 104.0, 104.0, **case))
            w.Label(sheet, at[0] + 10.0 * side, at[1] - 76.0, "motor", ha="center", va="center")
        w.Label(sheet, _PULLEY[0] + 62.0, _PULLEY[1] + 26.0, "pulley with speed sensor")
        wheels = tuple((at, radius) for at, radius in _RADII.items())
        self.wheels = Wheels(sheet, wheels)
        on_pulley, down, on_left, between, on_right, up = belt(wheels)
        half = len(on_pulley) // 2
        self.paths = (  # what turns the pulley on (counter-clockwise), what turns it back, and between the motors
            np.vstack([on_pulley[half:], down, on_left]), np.vstack([on_pulley[: half + 1][::-1], up[::-1]]),
            np.vstack([between, on_right]),
        )  # fmt: skip
        self.bar = self.pointer_bar(sheet, tension, ("belt",))
        note = "The belt turns the wheels as if the motors' had a radius of 50 mm; lengths are not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.cables = [d.Cable(sheet, 3.6) for _ in self.paths]
        self.voltage = w.Label(sheet, _PULLEY[0], _LEFT[1] - 10.0, "", d.NORMAL, ha="center", moving=True)
        self.reading = w.Label(sheet, _PULLEY[0] + 62.0, _PULLEY[1] + 8.0, "", d.NORMAL, moving=True)
        self.pill = w.Pill(sheet, 24, 572)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; a reference is not shown."""
        motor, pulley = (_TURNS * signals[name] for name in ("motor_position", "pulley_position"))
        drive, ratio = _RADII[_LEFT], _RADII[_LEFT] / _RADII[_PULLEY]
        self.wheels.turn((ratio * pulley, motor, motor))
        pull = signals["belt_force"]
        moved = (drive * pulley, -drive * pulley, drive * motor)
        for cable, path, force, shift in zip(self.cables, self.paths, (-pull, pull, 0.0), moved, strict=True):
            cable.set(path, np.full(len(path), max(force, 1e-3 * self.full)), self.full, np.full(len(path), shift))
        self.bar.set((abs(pull),), None)
        self.voltage.set(f"{w.number(signals['voltage'], '.2f')} V")
        self.reading.set(f"reads {w.number(signals['speed_reading'], '.2f')} V")
        self.pill.set("voltage at its limit" if abs(signals["voltage"]) >= self.limit else "", d.AMBER)
