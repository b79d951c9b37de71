"""What the scenes of plants share: where the traces stand and what they show, rulers in mm, belts round pulleys."""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w

FLAT = np.array([1.0, 0.0])


class Scene:
    """A mechanism as a picture; the folder of a plant has its own.

    Attributes
    ----------
    title : str
        Name of the mechanism, in the caption.
    trace_boxes : tuple
        Left, bottom, width and height of the two traces, pixels.
    least_motion, least_tension : float
        Smallest range of the rulers (mm or rad) and of the colours (N or N m): no closer look than this.
    shows : str
        What the upper trace shows; empty: what the unit of the reference stands for.
    pulls : str
        What the lower trace and the colours show, with its unit.
    curves, curve_signals : tuple
        Lines of the lower trace, and the signals that they show.
    first_tension : float
        Where the colours end before anything larger was seen.
    mechanism : tuple of four int
        Left, upper, right and lower edge of the frame's part without traces and scale, pixels from the upper left.
    """

    title: ClassVar[str]
    trace_boxes: ClassVar[tuple[tuple[float, float, float, float], ...]] = (
        (644, 372, 296, 178), (644, 88, 296, 178)
    )  # fmt: skip
    mechanism: ClassVar[tuple[int, int, int, int]] = (0, 56, 592, 500)
    least_motion: ClassVar[float] = 4.0
    least_tension: ClassVar[float] = 10.0
    shows: ClassVar[str] = ""
    pulls: ClassVar[str] = "cable tension (N)"
    curves: tuple[w.Curve, ...]
    curve_signals: tuple[str, ...]
    first_tension: float

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        raise NotImplementedError

    def motion(self, signals: Mapping[str, float]) -> Sequence[float]:
        """Positions (mm) that the rulers must show; none where rotations are drawn true."""
        return ()

    def tensions(self, signals: Mapping[str, float]) -> Sequence[float]:
        """What the colours must show: the size of every pull (N or N m)."""
        return [abs(signals[name]) for name in self.curve_signals]

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for a range of the rulers (mm) and an end of the colours."""
        raise NotImplementedError

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI."""
        raise NotImplementedError

    def pointer_bar(self, sheet: d.Sheet, tension: float, names: Sequence[str]) -> w.ColourBar:
        """The scale of the colours at the bottom of the mechanism, with a pointer for each name."""
        return w.ColourBar(sheet, 56, 62, 470, tension, names, title=self.pulls)


class RulerScene(Scene):
    """A scene with positions in mm on flat rulers: a pixel of the picture stands for the same length on all of them.

    Attributes
    ----------
    travel : float
        Pixels that the range of the rulers takes.
    way : float
        1 where a position grows to the right, -1 where it grows to the left.
    """

    travel: float = 110.0
    way: ClassVar[float] = 1.0

    def ranged(self, motion: tuple[float, float], tension: float) -> None:
        """Take the range of the rulers (mm) and the end of the colours."""
        self.range, self.scale, self.full = motion, self.travel / (motion[1] - motion[0]), tension

    def pixels(self, millimetres: float) -> float:
        """Distance on the picture from the middle of a ruler, to the right."""
        return self.way * self.scale * (millimetres - 0.5 * (self.range[0] + self.range[1]))

    def within(self, millimetres: float) -> float:
        """`pixels`, at most a ruler's length away from its middle."""
        return float(np.clip(self.pixels(millimetres), -self.travel, self.travel))

    def ruler(self, sheet: d.Sheet, middle: float, y: float) -> None:
        """A scale in mm at the height ``y``."""
        sheet.stroke(np.array([[middle - self.travel / 2, y], [middle + self.travel / 2, y]]), color=d.SOFT, lw=0.9)
        marks = d.ticks(*self.range, 4)
        for value in marks:
            x = middle + self.pixels(value)
            sheet.stroke(np.array([[x, y], [x, y - 5.0]]), color=d.SOFT, lw=0.9)
            text = w.number(float(f"{value:.6g}")) + (" mm" if value == marks[-1] else "")
            w.Label(sheet, x, y - 8.0, text, d.TINY, d.SOFT, ha="center", va="top")


class Wheels:
    """Pulleys whose spokes turn: centres and radii in pixels."""

    def __init__(self, sheet: d.Sheet, wheels: Sequence[tuple[tuple[float, float], float]]):
        self.wheels = wheels
        for centre, radius in wheels:
            rim = d.arc_points(centre, radius, 0.0, 2.0 * math.pi)
            sheet.add(d.outline(rim, fc=d.METAL, ec=d.METAL_EDGE, lw=1.0, zorder=2))
            hub = d.arc_points(centre, 5.5, 0.0, 2.0 * math.pi)
            sheet.add(d.outline(hub, fc="white", ec=d.METAL_EDGE, lw=0.8, zorder=4))
        self.spokes = sheet.line(color=d.METAL_EDGE, lw=1.6, zorder=3)
        self.pointers = sheet.line(color=d.INK, lw=2.4, solid_capstyle="round", zorder=3)

    def turn(self, angles: Sequence[float]) -> None:
        """Turn each to its angle (rad, counter-clockwise); one spoke of three is dark."""
        gap = np.full((1, 2), np.nan)
        spokes: list[np.ndarray] = []
        pointers: list[np.ndarray] = []
        for (centre, radius), angle in zip(self.wheels, angles, strict=True):
            for k in range(3):
                reach = np.outer([5.5, radius - 2.0], d.unit_vector(angle + 2.0 * math.pi * k / 3.0))
                (spokes if k else pointers).extend([np.asarray(centre) + reach, gap])
        self.spokes.set_data(*np.vstack(spokes).T)
        self.pointers.set_data(*np.vstack(pointers).T)


class DriveName:
    """What a drive is called; one with a motor is a motor, and says what current it has.

    Parameters
    ----------
    sheet : Sheet
        Where it stands.
    rig : mapping of str to float
        Parameters of the rig by name.
    name : str
        Name of the ideal drive; empty: nothing but the current is written.
    at, reading : tuple of float
        Middle of the name and of the current, pixels.
    current : str
        Signal of the motor's current.
    turn : float
        Direction of the name, rad.
    """

    def __init__(
        self,
        sheet: d.Sheet,
        rig: Mapping[str, float],
        name: str,
        at: tuple[float, float],
        reading: tuple[float, float],
        current: str = "motor_current",
        turn: float = 0.0,
    ):
        self.current = current if "motor_constant" in rig else ""
        self.word = "" if name else "motor "
        if name:
            text = name.replace("drive", "motor") if self.current else name
            w.Label(sheet, *at, text, ha="center", va="center", turn=turn)
        self.reading = w.Label(sheet, *reading, "", d.SMALL, d.TORQUE, ha="center", va="center", moving=True)

    def show(self, signals: Mapping[str, float]) -> None:
        """The present current, where there is a motor."""
        if self.current:
            self.reading.set(f"{self.word}{w.number(signals[self.current], '.2f')} A")


def belt(wheels: Sequence[tuple[tuple[float, float], float]], gap: float = 2.0) -> list[np.ndarray]:
    """A closed belt round wheels that are given counter-clockwise: arc, straight run, arc and so on, each [n, 2]."""
    centres = [np.asarray(centre, float) for centre, _ in wheels]
    radii = [radius + gap for _, radius in wheels]
    normals = []
    for k in range(len(wheels)):
        step = centres[(k + 1) % len(wheels)] - centres[k]
        lean = math.asin((radii[k] - radii[(k + 1) % len(wheels)]) / np.hypot(*step))
        normals.append(math.atan2(step[1], step[0]) - math.pi / 2.0 + lean)
    pieces = []
    for k, (centre, radius) in enumerate(zip(centres, radii, strict=True)):
        start = normals[k - 1]
        arc = d.arc_points(centre, radius, start, start + (normals[k] - start) % (2.0 * math.pi))
        after = (k + 1) % len(wheels)
        pieces += [arc, np.stack([arc[-1], centres[after] + radii[after] * d.unit_vector(normals[k])])]
    return pieces
