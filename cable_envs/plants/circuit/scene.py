"""The closed cable-pulley circuit as a picture: driving pulley, four idlers a side with their true wraps, jaw."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.patches import Circle

from cable_envs.drawing import draw as d
from cable_envs.drawing import widgets as w
from cable_envs.drawing.scene import DriveName, Scene
from cable_envs.plants.circuit.parameters import CIRCUIT, IDLERS, SIDES

_MM = 4.1  # pixels per millimetre of pulley radius
_DRIVE, _OUTPUT = np.array([232.0, 447.0]), np.array([752.0, 447.0])
_FIRST, _LAST = 46.0, 400.0  # drawn lengths of spans 0 and 4
_BACK = 0.5  # span 3 to span 4, as drawn
_JAW = 104.0
_PHASES = (("rest", d.IDLE), ("delay", d.WARN), ("transition", d.AMBER), ("working", d.GOOD))
_COLOURS = {"top": d.FIRST, "bottom": d.SECOND}


class CircuitScene(Scene):
    """Scene of the plants ``pulley_circuit`` and ``pulley_chain``.

    Pulley radii, wrap angles and all rotations are drawn true; the free spans are shortened. Cable b is drawn as the
    mirror image of how cable t runs. Counter-clockwise drive pulls cable t and turns the jaw counter-clockwise.
    """

    title = "Pulley circuit"
    trace_boxes = ((76, 54, 386, 158), (552, 54, 386, 158))
    least_motion, least_tension = 0.1, 10.0
    mechanism = (160, 50, 960, 370)

    def __init__(self, rig: Mapping[str, float], reference_unit: str):
        self.given, self.rig = rig, {p.name: rig.get(p.name, p.default) for p in CIRCUIT}
        self._full_torque = 0.5 * self.rig["drive_torque_limit"]
        self.by_angle = reference_unit == "rad"
        self.limit = self.rig["tension_limit"]
        self.first_tension = 1.6 * max(self.rig["pretension_top"], self.rig["pretension_bottom"])
        self.curves = (
            w.Curve("t drive", d.FIRST),
            w.Curve("t output", d.FIRST, (0, (3, 1.5))),
            w.Curve("b drive", d.SECOND),
            w.Curve("b output", d.SECOND, (0, (3, 1.5))),
        )
        ends = ("drive", "output")
        self.curve_signals = tuple(f"tension_{end}_{side}" for side in SIDES for end in ends)
        self.paths = {side: self._path(side) for side in SIDES}

    # -- geometry -----------------------------------------------------------------------------------------------

    def _path(self, side: str) -> list[d.Piece]:
        """Path of a cable from P0 to P5; with a rig that cannot be drawn so, Table 2's wraps."""
        pieces = self._closed_path(side, [self.rig[f"wrap_{side}_{i}"] for i in range(1, IDLERS + 1)])
        if pieces is None:
            pieces = self._closed_path(side, [CIRCUIT[f"wrap_{side}_{i}"].default for i in range(1, IDLERS + 1)])
        assert pieces is not None
        return pieces

    def _closed_path(self, side: str, wraps: Sequence[float]) -> list[d.Piece] | None:
        """Cable t turns left, right, right, left; spans 1 and 2 are as long as P0 and P5 ask for (two equations)."""
        radii = [_MM * 1e3 * self.rig[f"radius_{side}_{i}"] for i in range(1, IDLERS + 1)]
        turns = [wraps[0], -wraps[1], -wraps[2], wraps[3]]
        excess = wraps[3] - math.pi  # the rows before and after idler 4 meet where 2 R = length tan(excess)
        final = min(max(0.5 * excess, -0.1), 0.1)
        last = min(_LAST, 0.75 * 2.0 * radii[3] / math.tan(excess)) if 0.0 < excess < 1.5 else _LAST
        heading = (final - sum(turns) + math.pi) % (2 * math.pi) - math.pi
        start = _MM * 1e3 * self.rig["drive_radius"] * d.left_of(d.unit_vector(heading))
        end = _OUTPUT - _DRIVE + _MM * 1e3 * self.rig["output_radius"] * d.left_of(d.unit_vector(final))
        trial = self._walk(start, heading, radii, turns, (_FIRST, 0.0, 0.0, _BACK * last, last))
        unknown = np.stack([d.unit_vector(heading + turns[0]), d.unit_vector(heading + turns[0] + turns[1])], axis=1)
        if abs(np.linalg.det(unknown)) < 0.2:
            return None
        second, third = np.linalg.solve(unknown, end - trial[-1].points[-1])
        if min(second, third) < 8.0:
            return None
        pieces = self._walk(start, heading, radii, turns, (_FIRST, second, third, _BACK * last, last))
        flip = np.array([1.0, 1.0 if side == "top" else -1.0])
        return [
            d.Piece(
                _DRIVE + flip * p.points,
                None if p.centre is None else _DRIVE + flip * p.centre,
                p.radius,
                p.turn * flip[1],
            )
            for p in pieces
        ]

    @staticmethod
    def _walk(start, heading: float, radii, turns, lengths) -> list[d.Piece]:
        turtle = d.Turtle(start, heading)
        turtle.line(lengths[0])
        for radius, turn, length in zip(radii, turns, lengths[1:], strict=True):
            turtle.arc(radius, turn)
            turtle.line(length)
        return turtle.pieces

    # -- drawing ------------------------------------------------------------------------------------------------

    def build(self, sheet: d.Sheet, motion: tuple[float, float], tension: float) -> None:
        """Put everything on the sheet for an end of the tension scale (N); ``motion`` is not used."""
        self.full = tension
        self.wheels = [(_DRIVE, self.rig["drive_radius"]), (_OUTPUT, self.rig["output_radius"])]
        for side in SIDES:
            arcs = [p for p in self.paths[side] if p.centre is not None]
            self.wheels += [(p.around, p.radius / (_MM * 1e3)) for p in arcs]
            for i, arc in enumerate(arcs, 1):
                self._draw_idler(sheet, arc, i)
            ends = self.paths[side][4].points
            along = (ends[-1] - ends[0]) / np.hypot(*(ends[-1] - ends[0]))
            at = ends.mean(axis=0) + (15.0 if side == "top" else -15.0) * d.left_of(along)
            w.Label(
                sheet,
                *d.pair(at),
                f"cable {side[0]}",
                d.NORMAL,
                _COLOURS[side],
                weight="bold",
                ha="center",
                va="center",
                turn=math.atan2(along[1], along[0]),
            )
        self._draw_end_pulleys(sheet)
        names = ("t drive", "t output", "b drive", "b output")
        self.bar = w.ColourBar(sheet, 54, 318, 240, tension, names, upright=True)
        note = "Wraps, radii and rotations are true; free spans are shortened."
        w.Label(sheet, 934, 258, note, d.TINY, d.SOFT, ha="right")
        self._make_moving(sheet)

    @staticmethod
    def _draw_idler(sheet: d.Sheet, arc: d.Piece, number: int) -> None:
        sheet.add(Circle(d.pair(arc.around), arc.radius - 3.0, fc=d.METAL, ec=d.METAL_EDGE, lw=1.0, zorder=2))
        sheet.add(Circle(d.pair(arc.around), 6.5, fc="white", ec=d.METAL_EDGE, lw=0.8, zorder=4))
        w.Label(sheet, *d.pair(arc.around), str(number), d.TINY, ha="center", va="center")

    def _draw_end_pulleys(self, sheet: d.Sheet) -> None:
        for centre, radius in ((_DRIVE, self.rig["drive_radius"]), (_OUTPUT, self.rig["output_radius"])):
            sheet.add(Circle(d.pair(centre), _MM * 1e3 * radius - 3.0, fc=d.BODY, ec=d.INK, lw=1.1, zorder=2))
        w.Label(sheet, _DRIVE[0] + 66, _DRIVE[1] - 32, "driving pulley")
        w.Label(sheet, 934, 314, "driven pulley", ha="right")
        home = _OUTPUT + np.outer([34.0, _JAW + 34.0], [1.0, 0.0])
        sheet.stroke(home, color=d.SOFT, lw=0.8, ls=(0, (6, 2, 1, 2)), zorder=1)
        if self.rig["contact_stiffness"] > 0.0:
            far = self.rig["contact_angle"] + 0.42
            inner, outer = (_OUTPUT + r * d.unit_vector(far) for r in (30.0, _JAW + 14.0))
            middle, axis = 0.5 * (inner + outer), d.unit_vector(far)
            sheet.add(
                d.block(
                    middle + 16.0 * d.left_of(axis),
                    axis,
                    np.hypot(*(outer - inner)),
                    8.0,
                    fc=d.FILL,
                    ec=d.METAL_EDGE,
                    lw=0.8,
                    hatch="////",
                    zorder=1,
                )
            )

    def _make_moving(self, sheet: d.Sheet) -> None:
        self.cables = {side: d.Cable(sheet, 3.6) for side in SIDES}
        self.spokes = sheet.line(color=d.METAL_EDGE, lw=1.6, zorder=3)
        self.pointers = sheet.line(color=d.INK, lw=2.4, solid_capstyle="round", zorder=3)
        self.object = sheet.shape(fc="#f6c9a8", ec="#b5703a", lw=1.1, zorder=3)
        self.jaw = sheet.shape(fc="#52606d", ec=d.INK, lw=1.1, alpha=0.92, zorder=8)
        self.wanted = sheet.shape(fc="none", ec=d.REFERENCE, lw=1.3, ls=(0, (3, 2)), zorder=8)
        self.weight = sheet.line(marker="o", ms=15, mfc=d.SOFT, mec=d.INK, mew=1.0, zorder=8.2)
        self.torques = w.TorqueArrow(sheet, _DRIVE, 46.0, 75.0), w.TorqueArrow(sheet, _OUTPUT, _JAW + 32.0, 32.0)
        self.goal = sheet.line(marker="D", ms=5, mfc="white", mec=d.REFERENCE, mew=1.3, zorder=5)
        self.in_text = w.Label(sheet, _DRIVE[0] + 66, _DRIVE[1] - 50, "", d.NORMAL, d.TORQUE, moving=True)
        below = (_DRIVE[0] + 112, _DRIVE[1] - 64)
        self.drive_name = DriveName(sheet, self.given, "", below, below)
        self.out_text = w.Label(sheet, 934, 296, "", d.NORMAL, d.TORQUE, ha="right", moving=True)
        for centre, name in ((_DRIVE, "0"), (_OUTPUT, "5")):
            sheet.add(Circle(d.pair(centre), 7.5, fc="white", ec=d.INK, lw=1.0, zorder=8.5), moving=True)
            w.Label(sheet, *d.pair(centre), name, d.TINY, weight="bold", ha="center", va="center", moving=True)
        places = (660, 584), (762, 584), (826, 584), (762, 556)
        self.pills = [w.Pill(sheet, *place) for place in places]

    def update(self, signals: Mapping[str, float], reference: float) -> None:
        """Move everything to ``signals``; ``reference`` in SI (rad or N m)."""
        drive, output = signals["drive_angle"], signals["output_angle"]
        pulled = {"drive": drive * self.rig["drive_radius"], "output": output * self.rig["output_radius"]}
        self._set_spokes(drive, output, pulled)
        for side in SIDES:
            self._set_cable(side, signals, pulled)
        self._set_jaw(output, reference)
        moments = signals["drive_torque"], signals["output_torque"]
        for arrow, moment in zip(self.torques, moments, strict=True):
            arrow.set(moment / self._full_torque)
        self.goal.set_visible(not self.by_angle)
        if not self.by_angle:
            self.goal.set_data(*self.torques[1].tip(reference / self._full_torque)[:, None])
        self.in_text.set(f"drive torque {w.number(moments[0], '.3f')} N m")
        self.out_text.set(f"output torque {w.number(moments[1], '.3f')} N m")
        tensions = self.tensions(signals)
        self.bar.set(tensions, None)
        self.drive_name.show(signals)
        self.pills[0].set(*_PHASES[int(np.clip(signals.get("phase", 0.0), 0, 3))])
        slack = min(tensions) <= 1e-6 or signals.get("slack_fraction", 0.0) > 0.0
        self.pills[1].set("slack" if slack else "", d.AMBER)
        self.pills[2].set("overload" if signals.get("peak_tension", max(tensions)) > self.limit else "", d.WARN)
        self.pills[3].set("out of analytic range" if signals.get("out_of_range", 0.0) > 0.5 else "", d.IDLE)

    def _set_spokes(self, drive: float, output: float, pulled: Mapping[str, float]) -> None:
        """Idlers turn with the cable, from what the drive has pulled in to what the output has followed."""
        angles = [drive, output]
        for side in SIDES:
            sign = -1.0 if side == "top" else 1.0  # counter-clockwise drive moves cable t towards P0, cable b away
            arcs = [p for p in self.paths[side] if p.centre is not None]
            for i, arc in enumerate(arcs, 1):
                forward = sign * (pulled["drive"] + (pulled["output"] - pulled["drive"]) * i / (IDLERS + 1))
                angles.append(math.copysign(1.0, arc.turn) * forward * _MM * 1e3 / arc.radius)
        lines, gap = [], np.full((1, 2), np.nan)
        for (centre, radius), angle in zip(self.wheels, angles, strict=True):
            size = _MM * 1e3 * radius
            for k in range(3):
                e = d.unit_vector(angle + 2 * math.pi * k / 3)
                lines += [centre + np.outer([7.5, size - 5.0], e), gap]
        self.spokes.set_data(*np.vstack(lines).T)
        ends = [
            self.wheels[k][0] + np.outer([9.0, _MM * 1e3 * self.wheels[k][1] - 5.0], d.unit_vector(angles[k]))
            for k in range(2)
        ]
        self.pointers.set_data(*np.vstack([ends[0], gap, ends[1]]).T)

    def _set_cable(self, side: str, signals: Mapping[str, float], pulled: Mapping[str, float]) -> None:
        """Tension by interpolation between the measured ends: by equal ratios at the idlers, constant along spans."""
        first, last = signals[f"tension_drive_{side}"], signals[f"tension_output_{side}"]
        share = np.linspace(0.0, 1.0, IDLERS + 1)
        level = first * (last / first) ** share if min(first, last) > 0 else first + (last - first) * share
        points, tension = [self._on_drive(side, pulled["drive"] / self.rig["drive_radius"])], []
        tension.append(np.full(len(points[0]), level[0]))
        for k, piece in enumerate(self.paths[side]):
            span = k // 2
            if piece.centre is None:
                sag = 11.0 if level[span] <= 1e-6 else 0.0
                points.append(d.straight(piece.points[0], piece.points[-1], sag))
                tension.append(np.full(len(points[-1]), level[span]))
            else:
                points.append(piece.points)
                tension.append(np.linspace(level[span], level[span + 1], len(piece.points)))
        points.append(self._on_output(side))
        tension.append(np.full(len(points[-1]), level[-1]))
        path = np.concatenate(points)
        sign = -1.0 if side == "top" else 1.0
        on_drive = np.hypot(*np.diff(points[0], axis=0).T).sum()  # the path begins where the cable is fixed to P0
        shift = on_drive + sign * _MM * 1e3 * np.linspace(pulled["drive"], pulled["output"], len(path))
        self.cables[side].set(path, np.concatenate(tension), self.full, shift)

    def _on_drive(self, side: str, angle: float) -> np.ndarray:
        """The cable on P0, from where it is fixed (opposite to the spans at angle 0) to the tangent point."""
        away = self.paths[side][0].points[0] - _DRIVE
        tangent = math.atan2(away[1], away[0]) % (2 * math.pi)
        sense = 1.0 if side == "top" else -1.0
        fixed = 2 * math.pi + angle if side == "top" else angle
        fixed = max(fixed, tangent + 0.05) if side == "top" else min(fixed, tangent - 0.05)
        fixed = tangent + sense * min(sense * (fixed - tangent), 1.9 * math.pi)
        return d.arc_points(_DRIVE, np.hypot(*away), fixed, tangent)

    def _on_output(self, side: str) -> np.ndarray:
        """The cable on P5 as far as the jaw's side."""
        away = self.paths[side][-1].points[-1] - _OUTPUT
        return d.arc_points(_OUTPUT, np.hypot(*away), math.atan2(away[1], away[0]), 0.0)

    def _set_jaw(self, angle: float, reference: float) -> None:
        self.jaw.set_xy(_jaw_points(angle))
        self.wanted.set_visible(self.by_angle)
        if self.by_angle:
            self.wanted.set_xy(_jaw_points(reference))
        if self.rig["contact_stiffness"] > 0.0:
            touch, far = self.rig["contact_angle"], self.rig["contact_angle"] + 0.42
            near = min(max(touch, angle), far - 0.08)  # the object yields to the jaw
            lift = 9.0 * d.left_of(d.unit_vector(near))
            face = [_OUTPUT + r * d.unit_vector(near) + lift for r in (44.0, _JAW)]
            back = [_OUTPUT + r * d.unit_vector(far) + 12.0 * d.left_of(d.unit_vector(far)) for r in (_JAW + 6, 42.0)]
            self.object.set_xy(np.stack(face + back))
        if self.rig["payload_mass"] > 0.0:
            self.weight.set_data(*(_OUTPUT + (_JAW - 18.0) * d.unit_vector(angle))[:, None])


def _jaw_points(angle: float) -> np.ndarray:
    """Outline of the jaw at an output angle (rad)."""
    shape = np.array([[0, -11], [20, -11], [_JAW - 6, -4.5], [_JAW, 0], [_JAW - 6, 4.5], [20, 11], [0, 11]], float)
    e = d.unit_vector(angle)
    return _OUTPUT + shape[:, :1] * e + shape[:, 1:] * d.left_of(e)
