"""References: values, derivatives against finite differences, kinks, random ones by key, and errors that help."""

import math

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.references import FIELDS, KINDS, evaluate, pack_signal

SPECS = {
    "constant": {"kind": "constant", "offset": 0.3},
    "step": {"kind": "step", "offset": 0.1, "amplitude": 0.2, "start": 1.0},
    "pulse": {"kind": "pulse", "offset": 0.1, "amplitude": 0.2, "start": 1.0, "hold": 0.5},
    "sine": {"kind": "sine", "offset": 0.1, "amplitude": 0.2, "frequency": 0.7, "start": 1.0, "phase": 0.4},
    "ramp": {"kind": "ramp", "offset": 0.1, "amplitude": 0.2, "start": 1.0, "hold": 2.0},
    "triangle": {"kind": "triangle", "offset": 0.1, "amplitude": 0.2, "frequency": 0.7, "start": 1.0},
    "multisine": {"kind": "multisine", "offset": 0.1, "amplitude": 0.2, "frequency": 0.3, "start": 1.0},
    "random_steps": {"kind": "random_steps", "offset": 0.1, "amplitude": 0.2, "start": 1.0, "hold": 0.25},
    "trapezoids": {
        "kind": "trapezoids", "offset": 0.1, "amplitude": 0.2, "start": 1.0, "ramp": 0.3, "hold": 0.7, "micro": 0.001,
        "frequency": 3.1,
    },
}  # fmt: skip


def column(spec, key=12345):
    q = pack_signal("reference", spec)
    q[FIELDS.row("key")] = key
    return np.ascontiguousarray(q[:, None])


def values(spec, times, key=12345):
    q = column(spec, key)
    return np.array([evaluate(q, t)[:, 0] for t in times])


def test_every_kind_is_tested():
    assert set(SPECS) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_before_the_start_it_is_the_offset_at_rest(kind):
    spec = SPECS[kind]
    assert np.array_equal(values(spec, [0.0, 0.5, 0.999])[:, 0], [spec["offset"]] * 3)
    assert not values(spec, [0.0, 0.5, 0.999])[:, 1:].any()


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_equal_finite_differences(kind):
    h, times = 1e-4, np.linspace(1.013, 4.987, 311)  # off the kinks and jumps, which are multiples of 1/7 and 1/4
    r, rate, acceleration = values(SPECS[kind], times).T
    after, before = values(SPECS[kind], times + h)[:, 0], values(SPECS[kind], times - h)[:, 0]
    jumps = np.abs(after - before) > 0.01  # within h of a jump: nothing to compare
    kinks = np.abs(times - 3.0) < h if kind == "ramp" else np.zeros_like(jumps)
    if kind == "triangle":
        kinks = np.abs((0.7 * (times - 1.0) + 0.25) * 2 % 1.0 - 0.5) > 0.5 - 2e-4
    if kind == "trapezoids":
        since = (times - 1.0) % 1.0
        turns = np.abs(((since - 0.3) * 3.1 + 0.25) * 2 % 1.0 - 0.5) > 0.5 - 1e-3
        kinks = turns | (np.abs(since - 0.3) < 2 * h) | (since < 2 * h) | (since > 1.0 - 2 * h)
    smooth = ~(jumps | kinks)
    assert smooth.sum() > 290
    # central differences: h^2 r'''/6, below 1e-8 * 0.2 (2 pi 1.8)^3 / 6; second differences: rounding 1e-16 / h^2
    assert rate[smooth] == pytest.approx(((after - before) / (2 * h))[smooth], abs=1e-6)
    assert acceleration[smooth] == pytest.approx(((after - 2 * r + before) / h**2)[smooth], abs=1e-5)


def test_levels_and_shapes():
    assert values(SPECS["step"], [1.0, 5.0])[:, 0] == pytest.approx(0.3)
    assert values(SPECS["pulse"], [1.2, 1.6])[:, 0] == pytest.approx([0.3, 0.1])
    assert values(SPECS["ramp"], [2.0, 3.0, 9.0])[:, 0] == pytest.approx([0.2, 0.3, 0.3])
    quarter = 0.25 / 0.7
    assert values(SPECS["triangle"], 1.0 + quarter * np.arange(5))[:, 0] == pytest.approx([0.1, 0.3, 0.1, -0.1, 0.1])
    assert values(SPECS["sine"], [1.0])[0, 0] == pytest.approx(0.1 + 0.2 * math.sin(0.4))


def test_multisine_stays_within_its_amplitude_and_depends_on_the_key():
    times = np.linspace(1.0, 60.0, 4000)
    a, b, again = (values(SPECS["multisine"], times, key)[:, 0] for key in (1, 2, 1))
    assert np.array_equal(a, again) and not np.array_equal(a, b)
    assert np.abs(a - 0.1).max() <= 0.2 and np.ptp(a) > 0.2


def test_random_steps_hold_their_level_and_fill_their_range():
    times = 1.0 + 0.25 * np.arange(2000)
    starts, ends = (values(SPECS["random_steps"], times + d)[:, 0] for d in (0.01, 0.24))
    assert np.array_equal(starts, ends)
    levels = (starts - 0.1) / 0.2
    assert -1.0 <= levels.min() < -0.98 and 0.98 < levels.max() < 1.0
    # 2000 uniform numbers: standard deviations of mean and of mean square are 0.013 and 0.0067
    assert abs(levels.mean()) < 0.05 and np.mean(levels**2) == pytest.approx(1 / 3, abs=0.027)
    assert abs(np.corrcoef(levels[1:], levels[:-1])[0, 1]) < 0.09  # four standard deviations


def test_trapezoids_go_from_level_to_level_and_reverse_by_microns_while_they_hold():
    spec = SPECS["trapezoids"]
    plain = {**spec, "micro": 0.0}
    starts = 1.0 + np.arange(1000)
    levels = values(plain, starts + 0.65)[:, 0]
    assert np.array_equal(levels, values(plain, starts + 0.301)[:, 0])  # held for 0.7 s
    before = np.concatenate([[0.1], levels[:-1]])
    assert values(plain, starts + 0.15)[:, 0] == pytest.approx(0.5 * (before + levels), rel=1e-9)
    assert np.abs(levels - 0.1).max() <= 0.2 and np.ptp(levels) > 0.39
    held = 1.3 + np.linspace(0.0, 0.699, 1000)
    small = values(spec, held)[:, 0] - values(plain, held)[:, 0]
    assert np.abs(small).max() == pytest.approx(0.001, rel=0.01)
    whole = held - 1.3 < 2.0 / 3.1  # two whole cycles fit into 0.7 s
    assert not small[~whole].any() and np.sum(np.diff(np.sign(np.diff(small[whole]))) != 0) == 4


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"kind": "sin"}, "did you mean 'sine'"),
        ({}, "unknown reference kind None"),
        ({"kind": "step"}, "needs amplitude"),
        ({"kind": "step", "amplitude": 1.0, "begin": 2.0}, "unknown key in reference 'begin'"),
        ({"kind": "step", "amplitude": "1"}, "reference.amplitude: expected a finite number"),
        ({"kind": "step", "amplitude": True}, "reference.amplitude: expected a finite number"),
        ({"kind": "sine", "amplitude": 1.0, "frequency": -1.0}, "reference.frequency must be above 0"),
        ({"kind": "sine", "amplitude": 1.0, "frequency": 1.0, "key": 3}, "unknown key in reference 'key'"),
        ({"kind": "trapezoids", "amplitude": 1.0, "hold": 1.0, "ramp": 0.0}, "reference.ramp must be above 0"),
        ({"kind": "trapezoids", "amplitude": 1, "hold": 1, "ramp": 1, "micro": 1}, "reference.frequency must be above"),
        ("sine", "expected a mapping"),
    ],
)
def test_bad_references_say_what_would_be_right(spec, message):
    with pytest.raises(ConfigurationError, match=message):
        pack_signal("reference", spec)


def test_numpy_numbers_are_numbers():
    spec = {"kind": "step", "amplitude": np.float32(0.5), "start": np.int64(2)}
    assert pack_signal("reference", spec)[FIELDS.row("amplitude")] == 0.5
