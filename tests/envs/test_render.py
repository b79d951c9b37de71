"""Pictures: what a viewer is told must follow the numbers."""

import math

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from cable_envs.core.errors import ConfigurationError
from cable_envs.render import Renderer
from cable_envs.sim.rigs import load_rig

HANGING = {"load_mass": 5.0, "gravity": 9.81, "wrap_angle": math.pi / 3, "tension_limit": 100.0}
ANCHORED = {"load_mass": 1.0, "load_gravity": 0.0, "load_stiffness": 2600.0, "wrap_angle": 1.0}
HOLE = {"drive_position": 0.0008, "load_position": 0.0, "drive_tension": 60.0, "load_tension": 49.05, "sliding": 1.0}
CIRCUIT = {
    "drive_angle": 0.5, "output_angle": 0.6, "drive_torque": 0.1, "output_torque": 0.05,
    "tension_drive_top": 60.0, "tension_output_top": 55.0, "tension_drive_bottom": 40.0, "tension_output_bottom": 44.0,
    "phase": 3.0,
}  # fmt: skip


def hole(rig=HANGING, unit="m", **options):
    return Renderer("cable_hole", rig, "test", unit, **options)


def circuit(rig=None, unit="rad", plant="pulley_circuit", **options):
    return Renderer(plant, rig or {}, "test", unit, **options)


def picture(renderer, signals, time=0.0, reference=0.0, output=0.0, **changes):
    renderer.push({**signals, **changes}, time, reference, output)
    return renderer.frame()


def colour_count(frame, colour, tolerance=30):
    """Number of pixels within ``tolerance`` (summed over the channels) of an RGB colour."""
    return int((np.abs(frame.astype(int) - np.array(colour)).sum(axis=-1) <= tolerance).sum())


def cable_pixels(frame, box):
    """Coloured pixels (neither grey nor white) in box (left, top, right, bottom): only the cable has colour there."""
    left, top, right, bottom = box
    part = frame[top:bottom, left:right].reshape(-1, 3).astype(int)
    return part[part.max(axis=1) - part.min(axis=1) > 90]


SCENES = [
    (hole, HANGING, "m", HOLE),
    (hole, ANCHORED, "N", HOLE),
    (hole, {**HANGING, "wrap_angle_2": 0.8}, "m", HOLE),
    (hole, {**HANGING, "wrap_angle": 0.35, "wrap_angle_2": 0.35, "wrap_angle_3": 0.35}, "m", HOLE),
    (hole, {**HANGING, **{f"wrap_angle_{i}": 1.05 for i in (2, 3, 4)}}, "m", HOLE),
    (hole, {**HANGING, "wrap_angle": 0.0}, "m", HOLE),
    (hole, {**HANGING, "wrap_angle": 3.6}, "m", HOLE),
    (circuit, {}, "rad", CIRCUIT),
    (circuit, {"contact_stiffness": 2.0, "payload_mass": 0.1}, "N m", CIRCUIT),
    (circuit, {"wrap_top_2": 0.1, "wrap_bottom_4": 6.0}, "rad", CIRCUIT),
]


@pytest.mark.parametrize(("make", "rig", "unit", "signals"), SCENES)
def test_frame_is_a_uint8_picture_of_its_own(make, rig, unit, signals):
    renderer = make(rig, unit)
    first = renderer.frame()  # before anything was pushed: at rest
    assert first.shape == (640, 960, 3) and first.dtype == np.uint8
    before = first.copy()
    second = picture(renderer, signals)
    assert second.shape == first.shape
    np.testing.assert_array_equal(first, before)  # a later frame leaves an earlier one alone
    assert np.count_nonzero((second != first).any(axis=-1)) > 500


def test_scale_enlarges_the_whole_picture():
    small, large = picture(hole(), HOLE), picture(hole(scale=2.0), HOLE)
    assert large.shape == (1280, 1920, 3)
    mean = large.reshape(640, 2, 960, 2, 3).mean(axis=(1, 3))
    assert np.abs(mean - small).mean() < 2.0  # of 255: only edges differ


def test_equal_states_give_equal_pictures():
    one, two = hole(), hole()
    np.testing.assert_array_equal(picture(one, HOLE), picture(two, HOLE))


@pytest.mark.parametrize(
    ("make", "signals", "changes"),
    [
        (hole, HOLE, {"drive_position": 0.0018}),
        (hole, HOLE, {"load_position": 0.001}),
        (hole, HOLE, {"sliding": 0.0}),
        (hole, HOLE, {"sliding": -1.0}),
        (hole, HOLE, {"drive_tension": 30.0}),
        (hole, HOLE, {"peak_tension": 101.0}),
        (hole, HOLE, {"slack_fraction": 0.2}),
        (circuit, CIRCUIT, {"drive_angle": 0.7}),
        (circuit, CIRCUIT, {"output_angle": 0.7}),
        (circuit, CIRCUIT, {"output_torque": -0.05}),
        (circuit, CIRCUIT, {"tension_output_top": 47.0}),
        *((circuit, CIRCUIT, {"phase": phase}) for phase in (0.0, 1.0, 2.0)),
        (circuit, CIRCUIT, {"out_of_range": 1.0}),
    ],
)
def test_every_signal_is_visible(make, signals, changes):
    renderer = make()
    before = picture(renderer, signals)
    after = picture(renderer, signals, **changes)  # same time: the trace's newest sample is replaced
    mechanism = np.s_[50:520, :600] if make is hole else np.s_[50:390]
    assert np.count_nonzero((before[mechanism] != after[mechanism]).any(axis=-1)) > 40


def test_reference_is_visible():
    position, tension, angle, torque = hole(), hole(ANCHORED, "N"), circuit(), circuit(unit="N m")
    cases = (
        (position, HOLE, 0.0, 0.0015),
        (tension, HOLE, 30.0, 45.0),
        (angle, CIRCUIT, 0.5, 0.9),
        (torque, CIRCUIT, 0.02, 0.1),
    )
    for renderer, signals, one, other in cases:
        before, after = (picture(renderer, signals, reference=r) for r in (one, other))
        mechanism = np.s_[:, :600] if signals is HOLE else np.s_[:390]
        assert np.count_nonzero((before[mechanism] != after[mechanism]).any(axis=-1)) > 30


@pytest.mark.parametrize("tension", [10.0, 40.0, 70.0])
def test_cable_colour_is_the_colour_bar_at_its_tension(tension):
    from cable_envs.drawing.draw import TENSION_MAP

    renderer = hole()
    frame = picture(renderer, HOLE, drive_tension=tension, load_tension=tension, sliding=0.0)
    expected = 255 * np.array(TENSION_MAP(tension / 80.0)[:3])  # the scale of a 5 kg load ends at 80 N
    pixels = cable_pixels(frame, (130, 60, 560, 520))
    close = np.abs(pixels - expected).max(axis=1) <= 3  # rounding to bytes
    assert close.sum() > 300  # a cable of several hundred pixels' length


def test_cable_changes_colour_at_the_hole():
    from cable_envs.drawing.draw import TENSION_MAP

    frame = picture(hole(), HOLE, drive_tension=70.0, load_tension=20.0)
    for tension in (70.0, 20.0):
        assert colour_count(frame[60:520, 130:560], 255 * np.array(TENSION_MAP(tension / 80.0)[:3]), 6) > 60


def test_slack_cable_is_drawn_without_tension_colour():
    taut = picture(hole(), HOLE, sliding=0.0)
    slack = picture(hole(), HOLE, drive_tension=0.0, load_tension=0.0, drive_position=-0.001, sliding=0.0)
    box = (210, 90, 560, 520)  # right of and below the status words
    assert len(cable_pixels(taut, box)) > 500
    assert len(cable_pixels(slack, box)) < 200  # what is left is the blue mark of the output
    pale = (0x9F, 0xB3, 0xC8)
    assert colour_count(slack[60:520, 130:560], pale) > colour_count(taut[60:520, 130:560], pale) + 150


def test_one_slack_cable_of_the_circuit_leaves_the_other_coloured():
    both = picture(circuit(), CIRCUIT)
    one = picture(circuit(), CIRCUIT, tension_drive_bottom=0.0, tension_output_bottom=0.0)
    top, bottom = (180, 60, 600, 130), (260, 290, 680, 370)
    assert len(cable_pixels(one, bottom)) < 0.5 * len(cable_pixels(both, bottom))  # the cable's name keeps its colour
    assert len(cable_pixels(one, top)) == pytest.approx(len(cable_pixels(both, top)), rel=0.05)  # dots may move


def test_rulers_grow_with_the_motion_and_keep_the_load_in_the_picture():
    from cable_envs.plants.hole.scene import HoleScene

    renderer = hole()
    for metres in (0.001, 0.02, 0.3, -0.5):
        picture(renderer, HOLE, load_position=metres, drive_position=metres)
        scene = renderer._picture._scene
        assert isinstance(scene, HoleScene)
        assert scene.range[0] <= 1e3 * metres <= scene.range[1]
        corners = scene.load.get_xy()
        assert corners.min() > 0.0 and corners[:, 0].max() < 600.0 and corners[:, 1].max() < 600.0


@pytest.mark.parametrize("degrees", [20.0, 60.0, 90.0, 150.0, 200.0])
def test_wrap_angle_is_drawn_true(degrees):
    from cable_envs.plants.hole.scene import HoleScene

    scene = HoleScene({**HANGING, "wrap_angle": math.radians(degrees)}, "m")
    arc = scene.pieces[1]
    across = arc.points - arc.centre
    swept = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    assert math.degrees(abs(swept[-1] - swept[0])) == pytest.approx(degrees, abs=1e-9)  # rounding only
    np.testing.assert_allclose(scene.load_axis, [0.0, -1.0], atol=1e-12)  # the load hangs


def test_circuit_paths_are_closed_with_true_wraps_and_tangent_spans():
    from cable_envs.plants.circuit.parameters import CIRCUIT as TABLE
    from cable_envs.plants.circuit.parameters import SIDES
    from cable_envs.plants.circuit.scene import _DRIVE, _MM, _OUTPUT, CircuitScene

    scene = CircuitScene({}, "rad")
    for side in SIDES:
        pieces = scene.paths[side]
        ends = pieces[0].points[0] - _DRIVE, pieces[-1].points[-1] - _OUTPUT
        radii = [np.hypot(*end) / (_MM * 1e3) for end in ends]
        assert radii == pytest.approx([7e-3, 5e-3], rel=1e-9)  # rounding only
        for end, span in zip(ends, (pieces[0], pieces[-1]), strict=True):
            along = span.points[-1] - span.points[0]
            assert abs(end @ along) / np.hypot(*end) / np.hypot(*along) < 1e-9
        wraps = [abs(piece.turn) for piece in pieces if piece.centre is not None]
        assert wraps == [TABLE[f"wrap_{side}_{i}"].default for i in range(1, 5)]


def test_counter_clockwise_drive_moves_cable_t_towards_the_drive():
    """Dots of cable t on the top row (which runs away from the drive) move left, those of cable b (mirrored) right."""
    renderer = circuit()
    rows = {}
    for angle in (0.0, 0.1):
        picture(renderer, CIRCUIT, drive_angle=angle, output_angle=1.4 * angle)
        scene = renderer._picture._scene
        for side in ("top", "bottom"):
            dots = np.stack(scene.cables[side].dots.get_data(), axis=1)
            row = scene.paths[side][4].points
            inside = (dots[:, 0] > row[0, 0] + 30) & (dots[:, 0] < row[-1, 0] - 30)
            near = np.abs(dots[:, 1] - np.interp(dots[:, 0], row[:, 0], row[:, 1])) < 2.0
            rows[side, angle] = dots[inside & near, 0]
    for side, sign in (("top", -1.0), ("bottom", 1.0)):
        moved = rows[side, 0.1][:, None] - rows[side, 0.0][None]
        step = moved.flat[np.abs(moved).argmin()]
        assert step * sign == pytest.approx(4.1 * 7.0 * 0.1, abs=0.2)  # R0 times angle; rows lean by up to 7 degrees


def test_trace_keeps_the_window_and_starts_anew_with_an_episode():
    renderer = hole(window=2.0)
    for k in range(1000):
        renderer.push({**HOLE, "load_position": 1e-6 * k}, 0.01 * k, 0.0, 1e-6 * k)
    times = renderer._history.visible()[0]
    assert times[0] == pytest.approx(9.99 - 2.0, abs=0.011) and times[-1] == pytest.approx(9.99)
    assert np.all(np.diff(times) > 0)
    assert np.diff(times).max() < 0.0101  # no step is missing
    renderer.push(HOLE, 0.0, 0.0, 0.0)
    assert renderer._history.visible().shape[1] == 1


def test_trace_of_many_short_steps_spans_the_window():
    renderer = hole(window=2.0)
    for k in range(50_000):
        renderer.push(HOLE, 1e-4 * k, 0.0, 0.0)
    times = renderer._history.visible()[0]
    assert times[0] == pytest.approx(5.0 - 2.0, abs=0.005)
    assert len(times) <= 1500


def test_values_that_are_not_finite_still_give_a_picture():
    renderer = hole()
    picture(renderer, HOLE)
    frame = picture(renderer, HOLE, time=0.01, output=math.nan, drive_tension=math.inf, load_position=math.nan)
    assert frame.shape == (640, 960, 3)
    everything = circuit()
    assert picture(everything, dict.fromkeys(CIRCUIT, math.nan), reference=math.nan).shape == (640, 960, 3)


def test_reset_and_close_may_be_repeated():
    renderer = hole()
    picture(renderer, HOLE)
    renderer.reset()
    renderer.reset()
    assert renderer._history.visible().shape[1] == 0
    renderer.close()
    renderer.close()
    assert renderer.frame().shape == (640, 960, 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plant": "cable_hol"}, "did you mean 'cable_hole'"),
        ({"reference_unit": "Nm"}, "did you mean 'N m'"),
        ({"mode": "rgb"}, "did you mean 'rgb_array'"),
        ({"window": 0.0}, r"window = 0 is outside \[0.1, 3600\]"),
        ({"scale": math.nan}, "scale = nan"),
        ({"fps": 1e9}, "fps"),
    ],
)
def test_bad_options_are_named(changes, words):
    with pytest.raises(ConfigurationError, match=words):
        Renderer(**{"plant": "cable_hole", "rig": {}, **changes})


def test_window_needs_mode_human():
    with pytest.raises(ConfigurationError, match="human"):
        hole().show()


def test_users_matplotlib_style_changes_nothing():
    import matplotlib

    plain = picture(hole(), HOLE)
    with matplotlib.rc_context({"lines.linewidth": 9.0, "hatch.color": "red", "patch.facecolor": "red"}):
        styled = picture(hole(), HOLE)
        assert matplotlib.rcParams["lines.linewidth"] == 9.0
    np.testing.assert_array_equal(plain, styled)


@pytest.mark.parametrize(("plant", "ideal", "currents"), [
    ("cable_hole", "gu-steel-1mm", ("motor_current",)), ("tendon_sheath", "bowden-1m-20", ("motor_current",)),
    ("pulley_circuit", "zou-table2", ("motor_current",)),
    ("wrist", "wrist-8mm", ("motor_current", "pitch_motor_current")),
    ("antagonistic_joint", "finger-joint", ("motor_a_current", "motor_b_current")),
])  # fmt: skip
def test_a_motor_is_shown_with_its_current_and_an_ideal_drive_is_not(plant, ideal, currents):
    for rig in (load_rig(ideal), load_rig(f"{ideal}-motor")):
        simulated = rig.simulated_by()
        rest = simulated.rest(simulated.prepare(rig.column(simulated)), np.zeros(1))[:, 0]
        signals = dict(zip([s.name for s in simulated.signals], rest, strict=False))
        renderer = Renderer(plant, rig.values, "test", "m" if plant in ("cable_hole", "tendon_sheath") else "rad")
        first = picture(renderer, signals)
        for current in currents:
            other = picture(renderer, signals, **{current: 1.25})
            shows = np.count_nonzero((other != first).any(axis=2)) > 20
            assert shows == (current in signals), (rig.name, current)
