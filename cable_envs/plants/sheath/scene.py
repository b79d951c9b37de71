"""A tendon in a sheath as a picture: drive, bent sheath with the tendon in it, load on its return spring."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import DriveName, RulerScene

_LEVEL = 300.0  # height of both ends of the sheath in the frame; then places along it, of rulers by their middles
_DRIVE, _MOUTH, _EXIT, _LOAD, _WALL = 132.0, 205.0, 385.0, 452.0, 566.0
_MOST_TURN = 1.4
"""rad, of the steepest piece of the drawn sheath: bends beyond four times that are drawn as several humps"""
_TALLEST = 190.0


class SheathScene(RulerScene):
    """Scene of the plant ``tendon_sheath``.

    The sheath is drawn as humps whose turns add up to the true bend. Positions are read on the rulers (mm); all other
    lengths are not to scale.
    """

    title = "Tendon in a sheath"
    way = -1.0  # what is pulled in goes to the left, on either side of the sheath

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.by_tension = reference_unit == "N"
        self.rig, self.bend = rig, rig.get("bend_angle", math.pi)
        self.coefficient = rig.get("friction_coefficient", 0.1)
        self.limit = rig.get("tension_limit", math.inf)
        self.first_tension = 2.0 * rig.get("load_preload", 10.0) + 10.0
        self.curves = (w.Curve("$T_1$ drive side", d.FIRST), w.Curve("$T_2$ load side", d.SECOND))
        self.curve_signals = ("drive_tension", "load_tension")
        self.path = _humps(self.bend)

    def motion(self, signals: Mapping[str, float]) -> Sequence[float]:
        """Positions (mm) that the rulers must show."""
        return 1e3 * signals["drive_position"], 1e3 * signals["load_position"]

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for a range of the rulers (mm) and an end of the tension scale (N)."""
        self.ranged(motion, tension)
        self._draw_sheath(sheet)
        self._draw_ends(sheet)
        for middle in (_DRIVE, _LOAD):
            self.ruler(sheet, middle, _LEVEL - 62.0)
        self.bar = self.pointer_bar(sheet, tension, ("$T_1$", "$T_2$"))
        note = "The bends add up to the true angle, positions by the rulers; other lengths are not to scale."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self._draw_gauge(sheet)
        self._make_moving(sheet)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 130, 572), w.Pill(sheet, 192, 572)

    # -- what stands still --------------------------------------------------------------------------------------

    def _draw_sheath(self, sheet: d.Sheet) -> None:
        sheet.stroke(self.path, color=d.METAL_EDGE, lw=11.5, solid_capstyle="butt", zorder=1)
        sheet.stroke(self.path, color=d.FILL, lw=10.0, solid_capstyle="butt", zorder=2)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.path, axis=0).T))])
        for at in np.arange(4.0, length[-1] - 2.0, 6.0):  # the coil
            ends = [np.array([np.interp(at + s, length, self.path[:, k]) for k in (0, 1)]) for s in (-1.0, 1.0)]
            middle, across = 0.5 * (ends[0] + ends[1]), d.left_of((ends[1] - ends[0]) / 2.0)
            sheet.stroke(middle + np.outer([-6.5, 6.5], across), color=d.BODY, lw=1.0, zorder=2.5)
        for end in (_MOUTH, _EXIT):
            cap = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 3}
            sheet.add(d.block((end, _LEVEL), np.array([1.0, 0.0]), 12.0, 26.0, **cap))
            foot = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9, "hatch": "////", "zorder": 1}
            sheet.add(d.block((end, _LEVEL - 24.0), np.array([1.0, 0.0]), 18.0, 22.0, **foot))
        text = f"Θ = {math.degrees(self.bend):.0f}°, μΘ = {self.bend * self.coefficient:.2f}"
        w.Label(sheet, 0.5 * (_MOUTH + _EXIT), self.path[:, 1].max() + 24.0, text, ha="center")

    def _draw_ends(self, sheet: d.Sheet) -> None:
        flat = np.array([1.0, 0.0])
        motor = {"fc": d.BODY, "ec": d.METAL_EDGE, "lw": 1.0, "zorder": 3}
        sheet.add(d.block((44.0, _LEVEL), flat, 44.0, 40.0, **motor))
        self.drive_name = DriveName(sheet, self.rig, "drive", (44.0, _LEVEL), (44.0, _LEVEL - 32.0))
        rail = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9}
        for middle, length in ((_DRIVE - 12.0, self.travel + 50.0), (_LOAD + 20.0, self.travel + 74.0)):
            sheet.add(d.block((middle, _LEVEL - 19.0), flat, length, 6.0, **rail))
        wall = {"fc": d.FILL, "ec": d.METAL_EDGE, "lw": 0.8, "hatch": "////"}
        sheet.add(d.block((_WALL + 5.0, _LEVEL), flat, 10.0, 70.0, **wall))

    def _draw_gauge(self, sheet: d.Sheet) -> None:
        """How much of the friction is mobilised, and which way."""
        left, right, y = 190.0, 400.0, 176.0
        sheet.stroke(np.array([[left, y], [right, y]]), color=d.METAL_EDGE, lw=4.0, zorder=1)
        for at, text in ((left, "paying out"), (0.5 * (left + right), "friction mobilised"), (right, "pulling in")):
            sheet.stroke(np.array([[at, y - 5.0], [at, y + 5.0]]), color=d.METAL_EDGE, lw=0.9)
            w.Label(sheet, at, y - 10.0, text, d.TINY, d.SOFT, ha="center", va="top")
        self.gauge = (0.5 * (left + right), 0.5 * (right - left), y)

    # -- what moves ---------------------------------------------------------------------------------------------

    def _make_moving(self, sheet: d.Sheet) -> None:
        body = {"fc": "#52606d", "ec": d.INK, "lw": 1.0, "zorder": 4}
        self.cable = d.Cable(sheet, 3.6)
        self.carriage, self.load = sheet.shape(**body), sheet.shape(**body)
        self.spring = sheet.line(color=d.INK, lw=1.3, solid_joinstyle="round", zorder=3)
        self.wanted = sheet.line(color=d.REFERENCE, lw=1.4, ls=(0, (4, 2)), zorder=3)
        self.level = sheet.line(color=d.OUTPUT, lw=1.6, zorder=3)
        self.drive_level = sheet.line(color=d.INK, lw=1.2, zorder=3)
        self.needle = sheet.line(marker="o", ms=7, color=d.FIRST, mec=d.INK, zorder=5)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (m or N)."""
        x, y = 1e3 * signals["drive_position"], 1e3 * signals["load_position"]
        carriage, hook = _DRIVE + self.pixels(x), _LOAD + self.pixels(y)
        t1, t2 = signals["drive_tension"], signals["load_tension"]
        self._set_tendon(carriage, hook, _profile(signals))
        flat = np.array([1.0, 0.0])
        self.carriage.set_xy(d.block_points((carriage - 12.0, _LEVEL), flat, 24.0, 30.0))
        self.load.set_xy(d.block_points((hook + 14.0, _LEVEL), flat, 28.0, 30.0))
        self.spring.set_data(*d.spring_points(np.array([hook + 28.0, _LEVEL]), np.array([_WALL, _LEVEL])).T)
        self.drive_level.set_data([carriage, carriage], [_LEVEL - 62.0, _LEVEL - 22.0])
        self.level.set_data([hook, hook], [_LEVEL - 62.0, _LEVEL - 22.0])
        self.wanted.set_visible(not self.by_tension)
        if not self.by_tension:
            at = _LOAD + self.within(1e3 * reference)
            self.wanted.set_data([at, at], [_LEVEL - 62.0, _LEVEL + 40.0])
        self.bar.set((t1, t2), reference if self.by_tension else None)
        self.drive_name.show(signals)
        middle, half, height = self.gauge
        friction = self.coefficient * signals.get("bend", self.bend)
        share = math.log(t1 / t2) / friction if min(t1, t2, friction) > 1e-9 else 0.0
        self.needle.set_data([middle + half * min(max(share, -1.0), 1.0)], [height])
        word, colour = (("stuck", d.IDLE), ("pulling in", d.GOOD), ("paying out", d.AMBER))[
            int(np.sign(signals["sliding"]))
        ]
        self.pills[0].set(word, colour)
        slack = t1 <= 1e-6 or signals.get("slack_fraction", 0.0) > 0.0
        self.pills[1].set("slack" if slack else "", d.AMBER)
        self.pills[2].set("overload" if signals.get("peak_tension", t1) > self.limit else "", d.WARN)

    def _set_tendon(self, carriage: float, hook: float, tensions: np.ndarray) -> None:
        """Along the sheath the tension changes with the angle turned, exponentially between two of ``tensions``."""
        path = np.vstack([[carriage, _LEVEL], self.path, [hook, _LEVEL]])
        steps = np.diff(self.path, axis=0)
        turned = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
        along = np.concatenate([[0.0], np.cumsum(turned), [turned.sum()]]) / max(turned.sum(), 1e-9)
        t1, t2, places = tensions[0], tensions[-1], np.linspace(0.0, 1.0, len(tensions))
        taut = tensions.min() > 0.0
        within = np.exp(np.interp(along, places, np.log(tensions))) if taut else np.interp(along, places, tensions)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))]) / 1e3
        moved = -(carriage - _DRIVE) + length / length[-1] * ((carriage - _DRIVE) - (hook - _LOAD))
        self.cable.set(path, np.concatenate([[t1], within, [t2]]), self.full, moved - moved[0])


def _profile(signals: Mapping[str, float]) -> np.ndarray:
    """Tensions from the drive to the load, at equal angles: of all spans where there are some, else of both ends."""
    name = "span_tension_{}"
    inner: list[float] = []
    while name.format(len(inner) + 1) in signals:
        inner.append(signals[name.format(len(inner) + 1)])
    return np.array([signals["drive_tension"], *inner, signals["load_tension"]])


def _humps(bend: float) -> np.ndarray:
    """The sheath's axis [n, 2] in pixels: humps of arcs, a quarter of each bend up, half over, a quarter down."""
    width = _EXIT - _MOUTH
    if bend < 0.05:
        return np.array([[_MOUTH, _LEVEL], [0.5 * (_MOUTH + _EXIT), _LEVEL], [_EXIT, _LEVEL]])
    count = math.ceil(bend / (4.0 * _MOST_TURN))
    quarter = bend / (4.0 * count)
    radius = min(width / (4.0 * count * math.sin(quarter)), _TALLEST / (2.0 * (1.0 - math.cos(quarter))))
    turtle = d.Turtle((_MOUTH, _LEVEL), 0.0)
    spare = width - 4.0 * count * radius * math.sin(quarter)
    turtle.line(max(0.5 * spare, 1e-3))
    for _ in range(count):
        for turn in (quarter, -2.0 * quarter, quarter):
            turtle.arc(radius, turn)
    turtle.line(max(0.5 * spare, 1e-3))
    points = np.concatenate([piece.points for piece in turtle.pieces])
    return points[np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-6])]
