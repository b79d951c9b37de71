"""The cable-hole as a picture: ball-screw drive, hole edges with their true wraps, load hanging or on a spring."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.patches import Polygon

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import DriveName, Scene

_BOX = (24.0, 130.0, 572.0, 584.0)  # left, bottom, right, top of the mechanism in the frame
_MOTOR = 58.0


class HoleScene(Scene):
    """Scene of the plant ``cable_hole``.

    Wrap angles are drawn true and turn to alternating sides where holes in series would otherwise close the path on
    itself. Positions are read on the rulers (mm); all other lengths are not to scale.
    """

    title = "Cable-hole"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.rig, self.by_tension = rig, reference_unit == "N"
        self.wraps = [rig.get("wrap_angle", math.pi / 3)]
        while f"wrap_angle_{len(self.wraps) + 1}" in rig:
            self.wraps.append(rig[f"wrap_angle_{len(self.wraps) + 1}"])
        self.mass = rig.get("load_mass", 0.0)
        self.sprung = rig.get("load_stiffness", 0.0) > 0.0
        self.hanging = rig.get("load_gravity", 1.0) > 0.5
        self.limit = rig.get("tension_limit", math.inf)
        weight = self.mass * rig.get("gravity", 9.81) * rig.get("load_gravity", 1.0)
        self.first_tension = 1.5 * weight or 20.0
        self.curves = (w.Curve("$T_1$ drive side", d.FIRST), w.Curve("$T_2$ load side", d.SECOND))
        self.curve_signals = ("drive_tension", "load_tension")
        single = len(self.wraps) == 1
        self.travel = 150.0 if single else 110.0  # pixels that the range of the rulers takes
        self.radius = 32.0 if single else 26.0  # centre of a hole's edge to the axis of the cable, pixels
        self._plan()

    def motion(self, signals: Mapping[str, float]) -> Sequence[float]:
        """Positions (mm) that the rulers must show."""
        return 1e3 * signals["drive_position"], 1e3 * signals["load_position"]

    # -- geometry -----------------------------------------------------------------------------------------------

    def _turns(self) -> tuple[float, list[float]]:
        """Heading of the drive span and the turns at the holes: backwards from a load that hangs down or lies right."""
        heading, turns = (-math.pi / 2 if self.hanging else 0.0), []
        for wrap in reversed(self.wraps):
            turn = -wrap if heading + wrap <= math.radians(100.0) or wrap > math.radians(150.0) else wrap
            turns.append(turn)
            heading -= turn
        return heading, turns[::-1]

    def _walk(self, stretch: float) -> None:
        heading, turns = self._turns()
        self.drive_axis = d.unit_vector(heading)
        turtle = d.Turtle((0.0, 0.0), heading)
        first, between, last = (150.0, 0.0, 70.0) if len(turns) == 1 else (70.0, 150.0, 45.0)
        turtle.line(stretch * first + self.travel / 2)
        for i, turn in enumerate(turns):
            turtle.arc(self.radius, turn)
            if i < len(turns) - 1:
                turtle.line(stretch * between)
        turtle.line(stretch * last + self.travel / 2)
        self.pieces, self.load_axis = turtle.pieces, d.unit_vector(turtle.heading)
        self.drive_home, self.load_home = np.zeros(2), turtle.position.copy()

    def _extent(self) -> np.ndarray:
        back = self.drive_home - (self.travel / 2 + 40.0 + _MOTOR) * self.drive_axis
        ahead = self.load_home + (self.travel / 2 + (165.0 if self.sprung else 60.0)) * self.load_axis
        side = 44.0 * d.left_of(self.load_axis)
        edges = [p.around + s * 30.0 for p in self._arcs() for s in (np.array([-1, -1]), np.array([1, 1]))]
        points = [back - 22.0, back + 22.0, ahead + side, ahead - 1.8 * side, *edges]
        return np.array([np.min(points, axis=0), np.max(points, axis=0)])

    def _arcs(self) -> list[d.Piece]:
        return [p for p in self.pieces if p.centre is not None]

    def _plan(self) -> None:
        """The longest spans that fit, centred."""
        left, bottom, right, top = _BOX
        for stretch in np.arange(1.6, 0.15, -0.05):
            self._walk(float(stretch))
            low, high = self._extent()
            if high[0] - low[0] <= right - left and high[1] - low[1] <= top - bottom:
                break
        shift = 0.5 * (np.array([left + right, bottom + top]) - low - high)
        self.drive_home, self.load_home = self.drive_home + shift, self.load_home + shift
        self.pieces = [
            d.Piece(p.points + shift, None if p.centre is None else p.centre + shift, p.radius, p.turn)
            for p in self.pieces
        ]

    # -- drawing ------------------------------------------------------------------------------------------------

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for a range of the rulers (mm) and an end of the tension scale (N)."""
        self.range, self.scale, self.full = motion, self.travel / (motion[1] - motion[0]), tension
        self._draw_rail(sheet)
        for arc, wrap in zip(self._arcs(), self.wraps, strict=True):
            self._draw_hole(sheet, arc, wrap)
        self._draw_load_side(sheet)
        self.bar = self.pointer_bar(sheet, tension, ("$T_1$", "$T_2$"))
        note = "Wrap angles are true, positions by the rulers; other lengths are not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self._make_moving(sheet)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 130, 572), w.Pill(sheet, 192, 572)

    def _draw_rail(self, sheet: d.Sheet) -> None:
        axis, normal = self.drive_axis, d.left_of(self.drive_axis)
        ahead, back = self.travel / 2 + 14.0, self.travel / 2 + 40.0
        front, rear = self.drive_home + (ahead - 40.0) * axis, self.drive_home - back * axis
        middle, length = 0.5 * (front + rear), ahead + back - 40.0
        sheet.add(d.block(middle - 15.0 * normal, axis, length + 14.0, 7.0, fc=d.METAL, ec=d.METAL_EDGE, lw=0.9))
        sheet.add(d.block(middle, axis, length, 7.0, fc=d.FILL, ec=d.METAL_EDGE, lw=0.8, zorder=2))
        for s in np.arange(-length / 2 + 4.0, length / 2 - 2.0, 5.0):  # thread of the ball screw
            at = middle + s * axis
            sheet.stroke(np.stack([at - 3.5 * normal - axis, at + 3.5 * normal + axis]), color=d.METAL_EDGE, lw=0.7)
        for end in (front, rear):
            sheet.add(d.block(end - 5.0 * normal, axis, 9.0, 27.0, fc=d.BODY, ec=d.METAL_EDGE, lw=0.9, zorder=3))
        motor = rear - (4.5 + _MOTOR / 2) * axis
        sheet.add(d.block(motor, axis, _MOTOR, 36.0, fc=d.BODY, ec=d.METAL_EDGE, lw=1.0, zorder=3))
        turned = math.atan2(axis[1], axis[0])
        turned += math.pi if abs(turned) > math.radians(91.0) else 0.0
        below = d.pair(motor - 32.0 * normal)
        self.drive_name = DriveName(sheet, self.rig, "drive", d.pair(motor), below, turn=turned)
        self._ruler(sheet, self.drive_home, -axis, 25.0 * normal, d.SOFT)

    def _draw_hole(self, sheet: d.Sheet, arc: d.Piece, wrap: float) -> None:
        """The edge that the cable bends over, its opposite edge pale, and the wrap angle between the contact ends."""
        inward = arc.around - arc.points[len(arc.points) // 2]
        inward = inward / max(np.hypot(*inward), 1e-9)
        style: dict[str, Any] = {"closed": True, "ec": d.METAL_EDGE, "lw": 1.0, "hatch": "///", "zorder": 1}
        sheet.add(Polygon(self._edge(arc.around, inward, 58.0 if len(self.wraps) < 3 else 44.0), fc=d.BODY, **style))
        if len(self.wraps) == 1 and wrap < 2.2:  # else the opposite edge has no room
            opposite = arc.around - (2.0 * self.radius + 10.0) * inward
            sheet.add(Polygon(self._edge(opposite, -inward, 26.0), fc=d.FILL, **style))
        ends = np.stack([arc.points[0], arc.around, arc.points[-1]])
        sheet.stroke(ends, color=d.INK, lw=0.8, ls=(0, (3, 2)), zorder=2)
        angle = np.arctan2(*(arc.points - arc.around).T[::-1])
        small = d.arc_points(arc.around, 0.45 * self.radius, angle[0], angle[0] + arc.turn)
        sheet.stroke(small, color=d.INK, lw=0.9, zorder=2)
        at = arc.around + (27.0 if len(self.wraps) < 3 else 24.0) * inward
        text = w.Label(sheet, *d.pair(at), f"\u03b8 = {math.degrees(wrap):.0f}\u00b0", ha="center", va="center")
        ground = w.rounded(at[0] - text.width / 2 - 3, at[1], text.width + 6, 14.0)
        sheet.add(Polygon(ground, closed=True, fc=d.BODY, ec="none", zorder=4))

    def _edge(self, tip: np.ndarray, back: np.ndarray, depth: float) -> np.ndarray:
        """Outline of a plate with a round end about ``tip`` that goes ``depth`` pixels ``back``."""
        radius, turn = self.radius - 3.5, math.atan2(-back[1], -back[0])
        root = tip + depth * back + np.outer([-radius, radius], d.left_of(back))
        return np.vstack([d.arc_points(tip, radius, turn - math.pi / 2, turn + math.pi / 2), root])

    def _ruler(self, sheet: d.Sheet, home: np.ndarray, axis: np.ndarray, offset: np.ndarray, colour: str) -> None:
        """A scale in mm: position grows along ``axis``; drawn beside ``home`` with labels on the outer side."""
        outward = offset / np.hypot(*offset)
        line = home + offset + np.outer([-self.travel / 2, self.travel / 2], axis)
        sheet.stroke(line, color=colour, lw=0.9)
        marks = d.ticks(*self.range, 6)
        ha = "center" if abs(outward[0]) < 0.4 else ("left" if outward[0] > 0 else "right")
        va = "center" if abs(outward[1]) < 0.4 else ("baseline" if outward[1] > 0 else "top")
        for value in marks:
            at = home + offset + axis * self._pixels(value)
            sheet.stroke(np.stack([at, at + 5.0 * outward]), color=colour, lw=0.9)
            text = w.number(float(f"{value:.6g}")) + (" mm" if value == marks[-1] else "")
            w.Label(sheet, *d.pair(at + 8.0 * outward), text, d.TINY, d.SOFT, ha=ha, va=va)

    def _draw_load_side(self, sheet: d.Sheet) -> None:
        self.beside = 46.0 * d.left_of(self.load_axis)
        self._ruler(sheet, self.load_home, -self.load_axis, self.beside, d.SOFT)
        if self.sprung:
            self.wall = self.load_home + (self.travel / 2 + 150.0) * self.load_axis
            hatch = {"fc": d.FILL, "ec": d.METAL_EDGE, "lw": 0.8, "hatch": "////"}
            sheet.add(d.block(self.wall + 5.0 * self.load_axis, self.load_axis, 10.0, 70.0, **hatch))
        if not self.hanging:
            floor = self.load_home + 26.0 * self.load_axis + 27.0 * np.array([0.0, -1.0])
            style = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9, "zorder": 0.5}
            sheet.add(d.block(floor - [0, 4], self.load_axis, self.travel + 66.0, 6.0, **style))

    def _make_moving(self, sheet: d.Sheet) -> None:
        body = {"fc": "#52606d", "ec": d.INK, "lw": 1.0, "zorder": 4}
        self.cable = d.Cable(sheet, 4.2)
        self.nut, self.load = sheet.shape(**body), sheet.shape(**body)
        self.nut_face = sheet.line(marker="o", ms=5, mfc="white", mec=d.INK, mew=1.0, zorder=8)
        self.wheels = sheet.line(ls="", marker="o", ms=8, mfc="white", mec=d.INK, mew=1.2, zorder=4)
        style: dict[str, Any] = {"weight": "bold", "ha": "center", "va": "center", "moving": True}
        self.label = w.Label(sheet, 0.0, 0.0, f"{self.mass:g} kg", d.NORMAL, "white", **style)
        self.spring = sheet.line(color=d.INK, lw=1.3, solid_joinstyle="round", zorder=3)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=3)
        self.level = sheet.line(color=d.OUTPUT, lw=1.6, zorder=3)
        self.drive_level = sheet.line(color=d.INK, lw=1.2, zorder=3)
        self.arrow = sheet.shape(ec="none", zorder=8)

    def _pixels(self, millimetres: float) -> float:
        return self.scale * (millimetres - 0.5 * (self.range[0] + self.range[1]))

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (m or N)."""
        x, y = 1e3 * signals["drive_position"], 1e3 * signals["load_position"]
        carriage = self.drive_home - self._pixels(x) * self.drive_axis
        hook = self.load_home - self._pixels(y) * self.load_axis
        t1, t2 = signals["drive_tension"], signals["load_tension"]
        between = [signals.get(f"span_tension_{h}", t2) for h in range(1, len(self.wraps))]
        self._set_cable(carriage, hook, x, y, [t1, *between, t2])
        self._set_bodies(carriage, hook, reference)
        self._set_sliding(signals["sliding"])
        self.bar.set((t1, t2), reference if self.by_tension else None)
        self.drive_name.show(signals)
        slack = t1 <= 1e-6 or signals.get("slack_fraction", 0.0) > 0.0
        self.pills[1].set("slack" if slack else "", d.AMBER)
        self.pills[2].set("overload" if signals.get("peak_tension", t1) > self.limit else "", d.WARN)

    def _set_cable(self, carriage, hook, x: float, y: float, levels: Sequence[float]) -> None:
        """``levels``: tension of each span; in between it changes exponentially. The slack length sags, magnified."""
        span = np.hypot(*(self.pieces[0].points[-1] - carriage))
        missing = self.scale * max(0.0, y - x)
        sag = min(max(9.0, math.sqrt(0.375 * span * missing)), 45.0) if levels[0] <= 1e-6 else 0.0
        points = [d.straight(carriage, self.pieces[0].points[-1], sag)]
        tension = [np.full(len(points[0]), levels[0])]
        for piece, before, after in zip(self.pieces[1::2], levels[:-1], levels[1:], strict=True):
            share = np.linspace(0.0, 1.0, len(piece.points))
            ratio = min(before, after) > 0.0
            tension.append(before * (after / before) ** share if ratio else before + (after - before) * share)
            points.append(piece.points)
        path = np.concatenate([*points, hook[None]])
        shift = np.full(len(path), self._pixels(x) - self._pixels(y))  # the path begins at the moving carriage
        shift[: len(points[0])] = np.linspace(0.0, shift[-1], len(points[0]))
        self.cable.set(path, np.append(np.concatenate(tension), levels[-1]), self.full, shift)

    def _set_bodies(self, carriage, hook, reference: float) -> None:
        axis = self.load_axis
        self.nut.set_xy(d.block_points(carriage - 11.0 * self.drive_axis, self.drive_axis, 30.0, 30.0))
        self.nut_face.set_data(*carriage[:, None])
        normal = d.left_of(self.drive_axis)
        self.drive_level.set_data(*np.stack([carriage + 16.0 * normal, carriage + 25.0 * normal]).T)
        length, width = (46.0, 56.0) if self.hanging else (52.0, 32.0)
        centre = hook + 0.5 * length * axis
        self.load.set_xy(d.block_points(centre, axis, length, width))
        self.label.move(*centre)
        if not self.hanging:
            self.wheels.set_data(*(centre + np.outer([-15.0, 15.0], axis) + np.array([0.0, -21.5])).T)
        if self.sprung:
            self.spring.set_data(*d.spring_points(hook + length * axis, self.wall).T)
        toward = self.beside / np.hypot(*self.beside)
        self.level.set_data(*np.stack([hook, hook + self.beside]).T)
        self.wanted.set_visible(not self.by_tension)
        if not self.by_tension:
            at = self.load_home - np.clip(self._pixels(1e3 * reference), -self.travel, self.travel) * axis
            self.wanted.set_data(*np.stack([at - 34.0 * toward, at + self.beside]).T)

    def _set_sliding(self, sliding: float) -> None:
        word, colour = (("stuck", d.IDLE), ("hauling in", d.GOOD), ("paying out", d.AMBER))[int(np.sign(sliding))]
        self.pills[0].set(word, colour)
        self.arrow.set_visible(sliding != 0)
        if sliding != 0:
            along = -sliding * self.load_axis
            across = d.left_of(along)
            beside = 0.4 * self.beside
            tail = self.pieces[-1].points[0] + 26.0 * self.load_axis + beside - 14.0 * along
            shape = np.array([[0, -2], [16, -2], [16, -6], [28, 0], [16, 6], [16, 2], [0, 2]], float)
            self.arrow.set_xy(tail + shape[:, :1] * along + shape[:, 1:] * across)
            self.arrow.set_facecolor(colour)
