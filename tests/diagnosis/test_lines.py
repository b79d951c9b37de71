"""Exports that brought samples from another clock by straight lines: what tells that clock, and what is predicted."""

import numpy as np
import pytest

from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.clocks.beats import lines_of
from cable_envs.diagnosis.data.clocks.lines import Lines, near_jumps, without_lines_in_commands
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.search.known.lines import with_lines
from tests.support import drive_recording as drive

PERIOD, COUNT, NOISE = 0.01, 3000, 0.005
FIRST = (0.0, 0.0031)
"""Times of the first samples on the other clock, s, of two records."""
SHAPES = {
    "position": lambda t: np.sin(2 * np.pi * 0.3 * t),
    "force": lambda t: np.cos(2 * np.pi * 0.7 * t),
    "position_reference": lambda t: np.sin(2 * np.pi * 1.1 * t),
}


def brought(own, time, period, first):
    """Samples of a function of time at ``time``, by straight lines from another clock's, which have noise."""
    knots = first + period * np.arange(-2, int(time[-1] / period) + 3)
    return np.interp(time, knots, own(knots))


def recording(period, noise=NOISE, lost=()):
    """Two records of an export, their commands without noise; a period of 0: as the logger took them."""
    rng, records = np.random.default_rng(7), {}
    time = PERIOD * np.arange(COUNT)
    kept = np.setdiff1d(np.arange(COUNT), lost)
    for name, first in zip("ab", FIRST, strict=True):
        table = {"time": time[kept]}
        for channel, shape in SHAPES.items():
            size = 0.0 if channel.endswith("reference") else noise

            def noisy(t, shape=shape, size=size):
                return shape(t) + size * rng.standard_normal(len(t))

            table[channel] = (brought(noisy, time, period, first) if period else noisy(time))[kept]
        records[name] = table
    units = {"time": "s", "position": "m", "force": "N", "position_reference": "m"}
    return Recording.from_arrays("linear_drive", records, units=units)


@pytest.mark.parametrize("period", [0.0062, 0.0083, 0.0108, 0.0122, 0.0137, 0.021])
def test_noise_that_swells_and_fades_tells_the_other_clock_and_its_phase(period):
    lines = lines_of(recording(period))
    assert lines.odds > 20.0
    assert lines.period == pytest.approx(period, rel=5e-5)
    for name, first in zip("ab", FIRST, strict=True):
        begin, _ = lines.clocks[name]
        off = lines.phases[name] - (begin - first) / period
        assert abs((off + 0.5) % 1.0 - 0.5) < 0.06


def test_noise_that_is_as_large_everywhere_was_not_brought_by_straight_lines():
    as_taken = lines_of(recording(0.0))
    assert as_taken.odds < -20.0 and as_taken.ratio == 0.0
    assert as_taken.of("a", PERIOD * np.arange(COUNT)) is None
    assert lines_of(recording(0.0, noise=0.0)) == Lines(0.0)  # nothing tells


@pytest.mark.parametrize("period", [0.0083, 0.0137])
def test_predictions_have_the_corners_cut_off_as_the_samples_have(period):
    lines, time = lines_of(recording(period)), PERIOD * np.arange(COUNT)
    for name, first in zip("ab", FIRST, strict=True):
        for shape in SHAPES.values():
            cut = brought(shape, time, period, first) - shape(time)
            left = lines.of(name, time) @ shape(time) - shape(time) - cut
            assert np.std(left[20:-20]) < 0.1 * np.std(cut[20:-20])


def test_lines_are_only_known_between_even_samples():
    lines, time = lines_of(recording(0.0137)), PERIOD * np.arange(COUNT)
    later = lines.of("a", time[100:])
    assert (
        np.abs(later @ SHAPES["force"](time[100:]) - (lines.of("a", time) @ SHAPES["force"](time))[100:])[9:].max()
        < 1e-9
    )
    assert lines.of("a", np.delete(time, 50)) is None and lines.of("c", time) is None


@pytest.mark.parametrize("lost", [(), (500, 501, 1733)])
def test_commands_get_back_what_lines_took_off(lost):
    as_read = recording(0.0137, lost=lost)
    restored = without_lines_in_commands(as_read, lines_of(as_read))
    for read, record in zip(as_read.records, restored.records, strict=True):
        meant = SHAPES["position_reference"](record.time)
        off, was = (r.data["position_reference"] - meant for r in (record, read))
        assert np.std(off[20:-20]) < 0.15 * np.std(was[20:-20])
        assert all(np.array_equal(record.data[name], read.data[name]) for name in ("time", "position", "force"))


def test_a_command_that_is_held_is_not_changed_away_from_its_jumps():
    as_read = recording(0.0137)
    held = np.where(PERIOD * np.arange(COUNT) < 13.0, 0.2, 0.7)
    for record in as_read.records:
        record.data["position_reference"][:] = held
    for record in without_lines_in_commands(as_read, lines_of(as_read)).records:
        assert np.abs(record.data["position_reference"] - held)[np.abs(record.time - 13.0) > 0.15].max() < 1e-9


def test_what_is_near_a_jump_is_not_told():
    time = PERIOD * np.arange(COUNT)
    noise = NOISE * np.random.default_rng(2).standard_normal(COUNT)
    smooth = np.sin(2 * np.pi * 1.1 * time)
    assert near_jumps(smooth + noise).mean() < 0.02
    found = np.flatnonzero(near_jumps(smooth + noise + (time >= 13.0)))
    assert set(range(1297, 1303)) <= set(found) and np.sum(np.abs(found - 1300) < 20) < 14
    counts = 0.1 * np.round(10.0 * np.sin(2 * np.pi * 0.05 * time))
    assert not near_jumps(counts).any() and not near_jumps(np.zeros(COUNT)).any()


def exported(k, table):
    """Record k as an export brings it from a clock of 13 ms."""
    fine = drive._run(10 + k, _no_load, period=0.001, fine=1)[5 + k :: 13]
    return np.column_stack([table[:, 0], *(np.interp(table[:, 0], fine[:, 0], c) for c in fine.T[1:])])


def test_a_drive_whose_export_came_from_another_clock_lacks_nothing(tmp_path):
    """Where lines are not known, its controller is not found, and the answer is unknown."""
    drive.write(tmp_path, change=exported)
    found = diagnose(tmp_path)
    assert (found.verdict, found.effects) == ("no_detectable_mismatch", ())
    assert any("another clock, of a period of 13 ms" in note for note in found.notes)


def test_a_controller_may_have_an_integral_by_the_commands_as_they_are_and_none_without_lines(tmp_path):
    lines = lines_of(load_recording(drive.write(tmp_path / "lines", change=exported)))
    assert lines.ratio
    plain, restored = (
        ask(recording, request_of(recording))
        for recording in (load_recording(drive.write(tmp_path / str(ki), ki=ki)) for ki in (20000.0, 0.0))
    )
    assert "control.ki" in plain.nominals and "control.ki" not in restored.nominals
    assert with_lines(plain, restored, lines) is plain  # neither was brought by lines


def _no_load(y, v, t):
    return 0.0
