"""Drawing pieces shared by the scenes: the sheet, palette, ranges, paths of straight and wrapped cable, coloured cable.

Everything is placed in pixels of the frame at scale 1 (`SIZE`, origin bottom left). Imports matplotlib, which is
reached only through `cable_envs.render.Renderer`: its artists and its Agg canvas, but neither pyplot (global state) nor
Axes (building and drawing its ticks takes longer than all the rest of a frame).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.transforms import Affine2D

SIZE = (960, 640)
"""width and height of a frame in pixels at scale 1; multiples of 16, as video encoders want"""

INK, SOFT, FAINT, FILL = "#1f2933", "#7b8794", "#cbd2d9", "#e9edf1"
METAL, METAL_EDGE, BODY = "#dfe4ea", "#8491a0", "#b9c3ce"
REFERENCE, OUTPUT, FIRST, SECOND = "#3e4c59", "#0072b2", "#d55e00", "#009e73"  # Okabe, Ito
WARN, IDLE, GOOD, AMBER = "#c81e3a", "#7b8794", "#0b7a5b", "#b97300"
SLACK_COLOUR = "#9fb3c8"
TORQUE = "#5b2a86"

TENSION_MAP = ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.9, 256)), name="tension")
"""plasma without its palest end, which would vanish on white"""

TINY, SMALL, NORMAL, LARGE = 8.0, 8.0, 9.0, 12.5  # font sizes, points: the least has 11 pixels at scale 1


_A = TypeVar("_A", bound=Artist)


class Sheet:
    """A frame under construction: what stands still is drawn once and kept, what moves is drawn over it every time."""

    def __init__(self, scale: float):
        figure = Figure(figsize=(SIZE[0] / 100, SIZE[1] / 100), dpi=100 * scale, facecolor="white")
        self._canvas, self._figure = FigureCanvasAgg(figure), figure
        self.pixels = Affine2D().scale(scale)
        self._moving: list[Artist] = []
        self._ground = None

    def clear(self) -> None:
        """Take everything off."""
        self._figure.clear()
        self._moving.clear()

    def add(self, artist: _A, moving: bool = False) -> _A:
        """Put ``artist``, in pixels unless it has a transform of its own, on the sheet."""
        if not artist.is_transform_set():
            artist.set_transform(self.pixels)
        self._figure.add_artist(artist)
        if moving:
            artist.set_animated(True)
            self._moving.append(artist)
        return artist

    def stroke(self, points: np.ndarray, **style) -> Line2D:
        """A line through points [n, 2] that stands still."""
        return self.add(Line2D(*np.asarray(points).T, **style))

    def line(self, **style) -> Line2D:
        """A line, still without points, that moves."""
        return self.add(Line2D([], [], **style), moving=True)

    def shape(self, **style) -> Polygon:
        """A polygon, still without corners, that moves."""
        return self.add(Polygon(np.zeros((3, 2)), closed=True, joinstyle="round", **style), moving=True)

    def keep(self) -> None:
        """Draw what stands still."""
        self._moving.sort(key=lambda artist: artist.get_zorder())
        self._canvas.draw()
        self._ground = self._canvas.copy_from_bbox(self._figure.bbox)

    def picture(self) -> np.ndarray:
        """The frame with everything on it, uint8 [height, width, 3]."""
        self._canvas.restore_region(self._ground)
        renderer = self._canvas.get_renderer()
        for artist in self._moving:
            artist.draw(renderer)
        drawn = np.asarray(self._canvas.buffer_rgba())
        picture = np.empty((*drawn.shape[:2], 3), np.uint8)
        for k in range(3):  # ten times as fast as a copy of drawn[..., :3]
            picture[..., k] = drawn[..., k]
        return picture


def nice_range(low: float, high: float, least: float) -> tuple[float, float]:
    """The smallest range with ends on a 1-2-5 step that holds [low, high] and is at least ``least`` wide."""
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, least)
    low, high = min(low, middle - half), max(high, middle + half)
    rough = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * (1.0 - 1e-9))
    slip = 1e-6  # a value on a step stays there in spite of rounding
    return step * math.floor(low / step + slip), step * math.ceil(high / step - slip)


def ticks(low: float, high: float, most: int = 6) -> np.ndarray:
    """Round numbers within [low, high], at most ``most`` of them."""
    rough = (high - low) / (most - 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * (1.0 - 1e-9))
    return step * np.arange(math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6) + 1)


def unit_vector(angle: float) -> np.ndarray:
    """Direction of ``angle`` (rad, counter-clockwise from the right)."""
    return np.array([math.cos(angle), math.sin(angle)])


def left_of(direction: np.ndarray) -> np.ndarray:
    """``direction`` turned by 90 degrees counter-clockwise."""
    return np.array([-direction[1], direction[0]])


@dataclass(frozen=True)
class Piece:
    """A straight span or an arc of a cable's path: points [n, 2] in pixels; an arc has a centre and a signed turn."""

    points: np.ndarray
    centre: np.ndarray | None = None
    radius: float = 0.0
    turn: float = 0.0

    @property
    def around(self) -> np.ndarray:
        """The centre of an arc, [2]."""
        assert self.centre is not None, "a straight span has no centre"
        return self.centre


class Turtle:
    """Walks along a cable: `line` straight on, `arc` around a pulley or hole edge (positive turn: to the left)."""

    def __init__(self, position: Sequence[float], heading: float):
        self.position, self.heading = np.array(position, float), heading
        self.pieces: list[Piece] = []

    def line(self, length: float) -> None:
        """Go ``length`` straight on."""
        end = self.position + length * unit_vector(self.heading)
        self.pieces.append(Piece(np.stack([self.position, end])))
        self.position = end

    def arc(self, radius: float, turn: float) -> None:
        """Go round an edge of ``radius`` by the angle ``turn``, rad."""
        side = math.copysign(1.0, turn)
        centre = self.position + side * radius * left_of(unit_vector(self.heading))
        count = max(5, math.ceil(abs(turn) / 0.18))
        angles = self.heading - side * math.pi / 2 + np.linspace(0.0, turn, count)
        points = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self.pieces.append(Piece(points, centre, radius, turn))
        self.position, self.heading = points[-1], self.heading + turn


def straight(start: np.ndarray, end: np.ndarray, sag: float = 0.0) -> np.ndarray:
    """Points [n, 2] from start to end; slack cable bows by ``sag`` pixels to the lower side."""
    if sag == 0.0:
        return np.stack([start, end])
    s = np.linspace(0.0, 1.0, 15)[:, None]
    across = left_of((end - start) / max(np.hypot(*(end - start)), 1e-9))
    return start + s * (end - start) + 4.0 * sag * s * (1.0 - s) * (across if across[1] < 0 else -across)


def pair(point: np.ndarray) -> tuple[float, float]:
    """(x, y) of a point [2]."""
    return float(point[0]), float(point[1])


def arc_points(centre: Sequence[float] | np.ndarray, radius: float, start: float, end: float) -> np.ndarray:
    """Points [n, 2] on a circle between two angles (rad)."""
    angles = np.linspace(start, end, max(9, math.ceil(abs(end - start) / 0.18)))
    return np.asarray(centre) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def spring_points(start: np.ndarray, end: np.ndarray, coils: int = 8, width: float = 11.0) -> np.ndarray:
    """A zigzag from start to end, straight at both ends."""
    s = np.concatenate([[0.0], np.linspace(0.12, 0.88, 2 * coils + 1), [1.0]])
    offset = width * np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], coils)[: 2 * coils - 1], [0.0, 0.0]])
    axis = end - start
    return start + s[:, None] * axis + offset[:, None] * left_of(axis / max(np.hypot(*axis), 1e-9))


def block(centre, axis: np.ndarray, length: float, width: float, **style) -> Polygon:
    """A rectangle around ``centre``, its length along ``axis``."""
    return outline(block_points(centre, axis, length, width), **style)


def outline(points: np.ndarray, **style) -> Polygon:
    """A closed shape through points [n, 2]."""
    return Polygon(points, closed=True, joinstyle="round", **style)


def block_points(centre, axis: np.ndarray, length: float, width: float) -> np.ndarray:
    """Corners [4, 2] of `block`."""
    a, n = 0.5 * length * axis, 0.5 * width * left_of(axis)
    return np.asarray(centre) + np.stack([-a - n, a - n, a + n, -a + n])


class Cable:
    """A cable through given points, coloured by tension; where it carries none it is dashed and pale.

    ``points`` [n, 2]; ``tension`` [n] N at the points; ``limit`` N at the end of the colours; ``shift`` [n] pixels by
    which the cable has moved along the path, seen from the path's first point: white dots move with it.
    """

    def __init__(self, sheet: Sheet, width: float = 4.0):
        self.outline = sheet.line(color=INK, lw=width + 1.6, solid_capstyle="round", zorder=5)
        self.body = sheet.add(LineCollection([], linewidths=width, capstyle="round", zorder=6), moving=True)
        dashed = {"lw": 0.6 * width, "ls": (0, (2.2, 1.4)), "dash_capstyle": "butt", "zorder": 5}
        self.slack = sheet.line(color=SLACK_COLOUR, **dashed)
        self.dots = sheet.line(ls="", marker="o", ms=2.4, mfc="white", mec="none", zorder=7)

    def set(self, points: np.ndarray, tension: np.ndarray, limit: float, shift: np.ndarray) -> None:
        """Lay the cable along ``points`` [n, 2], coloured by its tension [n] over ``limit``."""
        middle = 0.5 * (tension[:-1] + tension[1:])
        taut = middle > 1e-6
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        self.body.set_segments(pairs[taut])
        self.body.set_color(TENSION_MAP(middle[taut] / limit))
        self.outline.set_data(*_with_gaps(points, taut))
        self.slack.set_data(*_with_gaps(points, ~taut))
        self.dots.set_data(*_travelling_dots(points, shift, np.append(taut, taut[-1])))


def _with_gaps(points: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Coordinates [2, ...] of a line that shows only the segments in ``keep``."""
    if keep.all():
        return points.T
    gap = np.full_like(points[:-1], np.nan)
    pieces = np.stack([points[:-1], points[1:], gap], axis=1)
    joined = np.append(keep[1:] & keep[:-1], False)  # no gap between neighbours: keeps joins and dashes continuous
    pieces[joined, 2] = pieces[joined, 1]
    return pieces[keep].reshape(-1, 2).T if keep.any() else np.empty((2, 0))


def _travelling_dots(points: np.ndarray, shift: np.ndarray, taut: np.ndarray, spacing: float = 27.0) -> np.ndarray:
    """Coordinates [2, m] of dots on the taut cable, every ``spacing`` pixels of a cable that has moved by ``shift``."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    material = s - shift  # rises along the path as long as the cable stretches by less than its length
    first, last = math.ceil(material[0] / spacing), math.floor(material[-1] / spacing)
    at = np.interp(spacing * np.arange(first, last + 1), material, s)
    at = at[taut[np.searchsorted(s, at, side="right") - 1]]
    return np.stack([np.interp(at, s, points[:, 0]), np.interp(at, s, points[:, 1])])
