"""A band brake as a picture: a drum that turns to and fro, and the band around it."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import FLAT, RulerScene, Wheels
from cable_envs.plants.band_brake.plant import PARAMETERS, grip

_DRUM, _RADIUS, _ANCHOR, _RULER = (300.0, 410.0), 104.0, 236.0, 190.0


class BandBrakeScene(RulerScene):
    """Scene of the plant ``band_brake``.

    The surface of the drum moves as far as the ruler says (mm); of the band's tensions only the difference is known.
    """

    title = "Band brake"
    shows = "drum position"
    pulls = "force (N)"

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.grip = float(grip({p.name: p.default for p in PARAMETERS} | dict(rig)))
        self.first_tension = max(1.2 * self.grip, 120.0)
        self.curves = (w.Curve("on the drum", d.FIRST), w.Curve("pull of the band", d.SECOND))
        self.curve_signals = ("force", "band_tension_difference")
        self.travel = 200.0

    def motion(self, signals: Mapping[str, float]) -> Sequence[float]:
        """Positions (mm) that the ruler must show."""
        return (1e3 * signals["position"],)

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for a range of the ruler (mm) and an end of the colours (N)."""
        self.ranged(motion, tension)
        self.drum = Wheels(sheet, ((_DRUM, _RADIUS),))
        foot = {"fc": d.METAL, "ec": d.METAL_EDGE, "lw": 0.9, "hatch": "////", "zorder": 1}
        over = d.arc_points(_DRUM, _RADIUS + 5.0, math.pi, 0.0)
        ends = np.array([[over[0, 0], _ANCHOR], [over[-1, 0], _ANCHOR]])
        self.path = np.vstack([ends[:1], over, ends[1:]])
        for (x, y), name in zip(ends, ("one end", "other end"), strict=True):
            sheet.add(d.block((x, y - 8.0), FLAT, 40.0, 16.0, **foot))
            w.Label(sheet, x, y + 40.0, name, ha="right" if x < _DRUM[0] else "left", va="center").move(
                x + (-12.0 if x < _DRUM[0] else 12.0), y + 40.0
            )
        self.ruler(sheet, _DRUM[0], _RULER)
        self.bar = self.pointer_bar(sheet, tension, ("drum", "band"))
        note = "The band is coloured by its pull, at the end that pulls; the drum's surface moves by the ruler."
        w.Label(sheet, 24, 14, note, d.TINY, d.SOFT)
        self.band = d.Cable(sheet, 5.0)
        self.level = sheet.line(color=d.OUTPUT, lw=1.6, marker="v", ms=6, zorder=3)
        self.pills = w.Pill(sheet, 24, 572), w.Pill(sheet, 130, 572)

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; the reference is the motion that is followed."""
        moved, pull = self.pixels(1e3 * signals["position"]), signals["band_tension_difference"]
        self.drum.turn((-moved / _RADIUS,))
        share = np.linspace(0.0, 1.0, len(self.path))
        share = share if pull < 0.0 else 1.0 - share  # the drum is held at the end that it moves away from
        stuck = self.pixels(1e3 * (signals["position"] - signals["slip"])) - self.pixels(0.0)
        least = 1e-3 * self.full
        self.band.set(self.path, least + abs(pull) * share, self.full, np.full(len(self.path), stuck))
        self.level.set_data([_DRUM[0] + moved], [_RULER + 8.0])
        self.bar.set((abs(signals["force"]), abs(pull)), None)
        speed = signals["velocity"]
        word, colour = (("still", d.IDLE), ("forward", d.GOOD), ("backward", d.AMBER))[int(np.sign(speed))]
        self.pills[0].set(word, colour)
        self.pills[1].set("slipping" if abs(pull) >= 0.999 * self.grip else "", d.WARN)
