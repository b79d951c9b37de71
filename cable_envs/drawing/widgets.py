"""What a picture is read by: labels, status words, the colour bar of tension, trace panels.

Text is drawn as outlines put together from cached glyphs: several times faster than matplotlib's `Text`, which lays
out and rasters every glyph anew.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.font_manager import FontProperties
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.textpath import TextPath, text_to_path
from matplotlib.transforms import Affine2D

from cable_envs.drawing.draw import (
    FILL,
    INK,
    NORMAL,
    REFERENCE,
    SMALL,
    SOFT,
    TENSION_MAP,
    TORQUE,
    Sheet,
    arc_points,
    left_of,
    nice_range,
    ticks,
    unit_vector,
)

_PIXELS = 100.0 / 72.0  # pixels per point at scale 1
_EMPTY = Path(np.empty((0, 2)))


@cache
def _glyph(text: str, size: float, weight: str) -> tuple[Path, float]:
    """Outline of a character (or of a whole mathtext) and the advance to the next one, pixels at scale 1."""
    font = FontProperties(family="DejaVu Sans", weight=weight, size=size * _PIXELS, math_fontfamily="dejavusans")
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath="$" in text)
    return (_EMPTY if text == " " else TextPath((0, 0), text, prop=font)), width


class Label:
    """A line of text that may change at every frame, anchored at (x, y) pixels.

    ``ha`` left, center or right; ``va`` baseline, center or top; ``turn`` rad, counter-clockwise.
    """

    def __init__(
        self,
        sheet: Sheet,
        x: float,
        y: float,
        text: str,
        size: float = SMALL,
        colour: str = INK,
        *,
        weight="normal",
        ha="left",
        va="baseline",
        turn: float = 0.0,
        moving: bool = False,
    ):
        self._size, self._weight, self._turn = size, weight, turn
        self._share = {"left": 0.0, "center": -0.5, "right": -1.0}[ha]
        self._drop = {"baseline": 0.0, "center": -0.36, "top": -0.76}[va] * size * _PIXELS  # heights of a digit
        self._place, self._text, self.width = Affine2D(), "", 0.0
        self.patch = PathPatch(_EMPTY, fc=colour, ec="none", zorder=9)
        self.patch.set_transform(self._place + sheet.pixels)
        sheet.add(self.patch, moving)
        self._at = x, y
        self.set(text)

    def set(self, text: str) -> None:
        """Show ``text`` (plain, or one mathtext)."""
        if text == self._text:
            return
        self._text = text
        x, parts = 0.0, []
        for piece in [text] if "$" in text else text:
            path, advance = _glyph(piece, self._size, self._weight)
            vertices = np.asarray(path.vertices)
            if len(vertices):
                parts.append((vertices + np.array([x, 0.0]), np.asarray(path.codes)))
            x += advance
        self.width = x
        outlines, codes = [part[0] for part in parts], [part[1] for part in parts]
        self.patch.set_path(Path(np.concatenate(outlines), np.concatenate(codes)) if parts else _EMPTY)
        self.move(*self._at)

    def move(self, x: float, y: float) -> None:
        """Put the anchor at (x, y)."""
        self._at = x, y
        self._place.clear().translate(self._share * self.width, self._drop).rotate(self._turn).translate(x, y)


def number(value: float, form: str = "g") -> str:
    """A number with a true minus sign, never a negative zero."""
    text = format(value, form)
    return text.replace("-", "\u2212") if any(c in "123456789" for c in text) else text.replace("-", "")


def rounded(x: float, y: float, width: float, height: float) -> np.ndarray:
    """Outline [n, 2] of a bar with round ends; (x, y) is the middle of its left end."""
    r = 0.5 * height
    return np.vstack(
        [
            arc_points((x + r, y), r, math.pi / 2, 1.5 * math.pi),
            arc_points((x + width - r, y), r, -math.pi / 2, math.pi / 2),
        ]
    )


class Pill:
    """A status word on a coloured ground, or nothing."""

    def __init__(self, sheet: Sheet, x: float, y: float):
        self.x, self.y = x, y
        self.ground = sheet.shape(ec="none", zorder=8.5)
        self.label = Label(sheet, x + 8.0, y, "", NORMAL, "white", weight="bold", va="center", moving=True)

    def set(self, word: str, colour: str) -> None:
        """Show ``word``; the empty word hides the pill."""
        self.ground.set_visible(bool(word))
        self.ground.set_facecolor(colour)
        self.label.set(word)
        self.ground.set_xy(rounded(self.x, self.y, 16.0 + self.label.width, 21.0))


class ColourBar:
    """The tension scale from (x, y) on, with a pointer for each named tension and a diamond for a tension reference."""

    def __init__(
        self,
        sheet: Sheet,
        x: float,
        y: float,
        length: float,
        limit: float,
        names: Sequence[str],
        *,
        upright: bool = False,
        title: str = "cable tension (N)",
    ):
        self.origin, self.length, self.limit, self.upright = (x, y), length, limit, upright
        edges = np.linspace(0.0, limit, 161)
        strips = [[self._at(a, 0), self._at(b, 0), self._at(b, 11), self._at(a, 11)] for a, b in pairwise(edges)]
        colours = TENSION_MAP(0.5 * (edges[1:] + edges[:-1]) / limit)
        sheet.add(PolyCollection(strips, facecolors=colours, edgecolors=colours, linewidths=0.3, zorder=2))
        corners = [self._at(0, 0), self._at(limit, 0), self._at(limit, 11), self._at(0, 11), self._at(0, 0)]
        sheet.stroke(np.array(corners), color=INK, lw=0.7, zorder=3)
        below: dict[str, Any] = {"ha": "right", "va": "center"} if upright else {"ha": "center", "va": "top"}
        for value in ticks(0.0, limit):
            sheet.stroke(np.array([self._at(value, -4), self._at(value, 0)]), color=INK, lw=0.7)
            Label(sheet, *self._at(value, -7), number(value), **below)
        place = (x - 30, y - 14) if upright else self._at(limit / 2, -22)
        Label(sheet, *place, title, ha="left" if upright else "center", va="top")
        beside: dict[str, Any] = {"ha": "left", "va": "center"} if upright else {"ha": "center"}
        marker = {"marker": "<" if upright else "v", "ms": 5.5, "color": INK, "zorder": 4}
        self.pointers = [(sheet.line(**marker), Label(sheet, 0.0, 0.0, n, moving=True, **beside)) for n in names]
        self.wanted = sheet.line(marker="D", ms=5, mfc="white", mec=REFERENCE, mew=1.3, zorder=4)

    def _at(self, tension: float, across: float) -> tuple[float, float]:
        along = self.length * min(max(tension / self.limit, 0.0), 1.0)
        x, y = self.origin
        return (x + across, y + along) if self.upright else (x + along, y + across)

    def set(self, tensions: Sequence[float], reference: float | None) -> None:
        """Pointers to ``tensions`` (N), one for each name; ``reference`` N, or None for no diamond."""
        places = [self._at(t, 15.0) for t in tensions]
        apart = _spread([y for _, y in places], 12.0) if self.upright else _levels([x for x, _ in places], 26.0)
        for (mark, label), (x, y), other in zip(self.pointers, places, apart, strict=True):
            mark.set_data([x], [y])
            label.move(*((x + 9.0, other) if self.upright else (x, y + 9.0 + 12.0 * other)))
        self.wanted.set_visible(reference is not None)
        if reference is not None:
            self.wanted.set_data(*np.array([self._at(reference, 5.5)]).T)


def _spread(places: Sequence[float], apart: float) -> list[float]:
    """``places`` moved as little as needed for neighbours to be ``apart``, in the same order."""
    order = sorted(range(len(places)), key=places.__getitem__)
    result = list(places)
    for before, after in pairwise(order):
        result[after] = max(result[after], result[before] + apart)
    shift = sum(r - p for r, p in zip(result, places, strict=True)) / len(places)
    return [r - shift for r in result]


def _levels(places: Sequence[float], apart: float) -> list[int]:
    """For each label the lowest line on which it overlaps no earlier one."""
    levels: list[int] = []
    for i, place in enumerate(places):
        taken = {levels[j] for j in range(i) if abs(places[j] - place) < apart}
        levels.append(next(level for level in range(len(places)) if level not in taken))
    return levels


@dataclass(frozen=True)
class Curve:
    """One line of a trace panel: name in the legend, colour, line style."""

    name: str
    colour: str
    style: str | tuple = "-"


class TracePanel:
    """The last seconds of some signals, against the time before now; its ordinate follows the data.

    ``box``: left, bottom, width, height of the plotting area; ``least``: smallest range of the ordinate.
    """

    def __init__(
        self,
        sheet: Sheet,
        box: tuple[float, float, float, float],
        curves: Sequence[Curve],
        label: str,
        window: float,
        least: float,
    ):
        self.box, self.window, self.least = box, window, least
        self.limits: tuple[float, float] | None = None
        x, y, width, height = box
        self.grid = sheet.line(color=FILL, lw=0.8, zorder=1)
        self.ends = sheet.line(color=SOFT, lw=0.8, zorder=2)
        self.scale = [Label(sheet, 0, 0, "", ha="right", va="center", moving=True) for _ in range(8)]
        for age in ticks(-window, 0.0, 7):
            at = x + width * (1.0 + age / window)
            sheet.stroke(np.array([[at, y], [at, y + height]]), color=FILL, lw=0.8, zorder=1)
            sheet.stroke(np.array([[at, y - 4], [at, y]]), color=SOFT, lw=0.8)
            Label(sheet, at, y - 8, number(age), ha="center", va="top")
        sheet.stroke(np.array([[x, y + height], [x, y], [x + width, y]]), color=SOFT, lw=0.8, zorder=3)
        Label(sheet, x + width / 2, y - 24, "time before now (s)", ha="center", va="top")
        Label(sheet, x, y + height + 25, label, NORMAL)
        at = x
        for curve in curves:
            sheet.stroke(np.array([[at, y + height + 12], [at + 22, y + height + 12]]), **_line_style(curve))
            at += 44.0 + Label(sheet, at + 28, y + height + 12, curve.name, va="center").width
        self.lines = [sheet.line(zorder=5, solid_joinstyle="round", **_line_style(curve)) for curve in curves]
        self.now = Label(sheet, x + width, y + height + 25, "", ha="right", moving=True)

    def set(self, age: np.ndarray, values: np.ndarray, readout: str) -> None:
        """``age`` [n] s (none positive), ``values`` [curves, n]."""
        x, y, width, height = self.box
        low, high = self._fit(values)
        across = x + width * (1.0 + age / self.window)
        for line, row in zip(self.lines, values, strict=True):
            line.set_data(across, y + height * (row - low) / (high - low))
        self.now.set(readout)

    def _fit(self, values: np.ndarray) -> tuple[float, float]:
        """Limits that hold ``values`` with a little air: the old ones while they fit and are not far too wide."""
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, self.least)
        wide = max(high - low, self.least)
        old = self.limits
        if old is None or not (old[0] <= low and high <= old[1]) or old[1] - old[0] > 4.0 * wide:
            floor = 0.0 if low >= 0.0 else low - 0.05 * wide
            self.limits = nice_range(max(low - 0.05 * wide, floor), high + 0.05 * wide, self.least)
            self._rule(*self.limits)
        return self.limits  # type: ignore[return-value]

    def _rule(self, low: float, high: float) -> None:
        """Grid lines and numbers of the ordinate."""
        x, y, width, height = self.box
        values = ticks(low, high)
        levels = y + height * (values - low) / (high - low)
        gap = np.full(len(levels), np.nan)
        ends = np.repeat([[x, x + width, np.nan]], len(levels), axis=0).ravel()
        self.grid.set_data(ends, np.stack([levels, levels, gap], axis=1).ravel())
        self.ends.set_data(np.where(ends == x + width, x - 4.0, ends), self.grid.get_ydata())
        for k, label in enumerate(self.scale):
            label.set(number(float(f"{values[k]:.6g}")) if k < len(values) else "")
            if k < len(values):
                label.move(x - 8.0, levels[k])


def _line_style(curve: Curve) -> dict:
    return {"color": curve.colour, "ls": curve.style, "lw": 1.5}


class TorqueArrow:
    """An arc around a pulley, as long as the torque is large, with a head in its direction."""

    def __init__(self, sheet: Sheet, centre: np.ndarray, radius: float, degrees: float):
        self.centre, self.radius, self.half = centre, radius, math.radians(degrees)
        self.line = sheet.line(color=TORQUE, lw=2.2, zorder=4)
        self.head = sheet.shape(fc=TORQUE, ec="none", zorder=4)

    def tip(self, share: float) -> np.ndarray:
        """Where the arrow of this share ends, pixels [2]."""
        return self.centre + self.radius * unit_vector(self.half * min(max(share, -1.0), 1.0))

    def set(self, share: float) -> None:
        """``share`` of the largest torque, signed (counter-clockwise positive)."""
        half = self.half * min(max(share, -1.0), 1.0)
        visible = abs(half) > 0.01
        self.line.set_visible(visible)
        self.head.set_visible(visible)
        if visible:
            self.line.set_data(*arc_points(self.centre, self.radius, -half, half).T)
            tip, out = self.tip(share), unit_vector(half)
            ahead = math.copysign(1.0, half) * left_of(out)
            self.head.set_xy(np.stack([tip + 9.0 * ahead, tip + 5.5 * out, tip - 5.5 * out]))
