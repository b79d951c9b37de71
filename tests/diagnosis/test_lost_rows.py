"""Rows that a log has lost: the command went on, what was measured does not count there, and then all is as before."""

import numpy as np
import pytest

from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.common import command_rows, held_command, moving_command

PERIOD = 0.01
TIME = PERIOD * np.arange(800)
LOST = np.r_[300:309, 500:504, 620]
SPEED = 0.05 * np.sin(4.0 * TIME) + 0.02 * np.sin(9.0 * TIME)
PATH = 0.05 / 4.0 * (1.0 - np.cos(4.0 * TIME)) + 0.02 / 9.0 * (1.0 - np.cos(9.0 * TIME))
GAINS = (6000.0, 250.0)


def recording(system, table, hold="", **given):
    channels = {hold: {"hold": "step"}} if hold else None
    return Recording.from_arrays(system, {"one": table, "two": table}, heldout="two", channels=channels, **given)


def hole(hold=""):
    table = {"time": TIME, "drive_velocity_command": SPEED, "drive_position": PATH, "load_position": PATH}
    table["drive_tension"] = 19.62 * np.exp(0.3 * np.tanh(SPEED / 1e-3))
    return "cable_hole", table, {"hold": hold and "drive_velocity_command", "nominal": {"load_mass": 2.0}}


def circuit():
    turned = 10.0 * PATH
    table = {"time": TIME, "drive_angle_command": turned, "drive_angle": turned, "output_angle": turned}
    return "pulley_circuit", table, {"nominal": {"pretension_top": 60.0, "pretension_bottom": 60.0}}


def loop():
    """A rigid drive under the documented controller, by its own small steps."""
    mass, step, s, rows = 4.0, 1e-4, np.zeros(2), []
    for k in range(round(TIME[-1] / step) + 2):
        t = k * step
        told = 0.05 / 4.0 * (1.0 - np.cos(4.0 * t)) + 0.02 / 9.0 * (1.0 - np.cos(9.0 * t))
        force = GAINS[0] * (told - s[0]) + GAINS[1] * (0.05 * np.sin(4.0 * t) + 0.02 * np.sin(9.0 * t) - s[1])
        if k % round(PERIOD / step) == 0:
            rows.append((*s, force))
        s = s + step * np.array([s[1] + 0.5 * step * force / mass, force / mass])
    position, velocity, force = np.array(rows[: len(TIME)]).T
    table = {"time": TIME, "position_reference": PATH, "position": position, "velocity": velocity, "force": force}
    return "linear_drive", table, {"nominal": {"mass": mass}}


@pytest.mark.parametrize("made", [hole, lambda: hole("step"), circuit, loop], ids=["hole", "held", "circuit", "loop"])
def test_after_lost_rows_the_predictions_are_as_without(made):
    system, table, given = made()
    whole = prepare(recording(system, table, **given)).fit
    kept = np.delete(np.arange(len(TIME)), LOST)
    holed = prepare(recording(system, {name: values[kept] for name, values in table.items()}, **given)).fit
    column = np.array([[p.start] for p in whole.parameters])
    near = np.isin(np.arange(len(TIME)), LOST[:, None] + np.arange(12))  # the loop forgets with 31 1/s
    assert [p.name for p in holed.parameters] == [p.name for p in whole.parameters]
    for block, right, found in zip(whole.blocks, whole.predict(column), holed.predict(column), strict=True):
        other = next(b for b in holed.blocks if b.channel == block.channel and b.record == block.record)
        assert not other.good[LOST].any() and other.good[kept[kept > 200]].all()
        assert len(right) == len(found)
        off = np.abs(found - right)[:, 0] / np.ptp(right)
        assert np.max(off[LOST]) < 1e-3  # where the command is interpolated
        assert np.max(off[~near]) < 1e-4


def record_of(values, lost, hold=""):
    kept = np.delete(np.arange(len(TIME)), lost)
    _, table, given = hole(hold)
    table = {**table, "drive_velocity_command": values}
    one = recording("cable_hole", {name: v[kept] for name, v in table.items()}, **given)
    return one.records[0]


def test_a_command_that_moves_is_a_cubic_over_lost_rows():
    record = record_of(SPEED, LOST)
    stamps, values = command_rows(record, "drive_velocity_command", PERIOD)
    np.testing.assert_allclose(stamps, TIME, atol=1e-12)
    width = 10 * PERIOD
    fourth = 0.05 * 4.0**4 + 0.02 * 9.0**4
    assert np.max(np.abs(values - SPEED)) < 5.0 / 384.0 * 4.0 * fourth * width**4  # of a spline: Hall and Meyer, 1976
    found = moving_command(record, "drive_velocity_command", TIME, PERIOD)
    np.testing.assert_allclose(found, values, atol=1e-12)
    straight = np.interp(TIME, record.time, record.data["drive_velocity_command"])
    assert np.max(np.abs(found - SPEED)) < 0.05 * np.max(np.abs(straight - SPEED))


def test_a_command_that_repeats_itself_is_held_over_lost_rows():
    steps = 0.05 * np.sign(np.sin(2.0 * TIME + 0.1))
    edge = int(np.flatnonzero(np.diff(steps))[1])  # the row before a step
    lost = np.arange(edge - 3, edge + 1)
    record = record_of(steps, lost, "step")
    found = held_command(record, "drive_velocity_command", TIME, PERIOD, 0.0)
    np.testing.assert_array_equal(found[1:], steps[:-1])
    later = record_of(steps, lost + 2, "step")  # the step itself is lost: what acted before it goes on
    found = held_command(later, "drive_velocity_command", TIME, PERIOD, 0.0)
    assert set(found[edge : edge + 4]) == {steps[edge]} and found[edge + 5] == steps[edge + 4]


def test_a_ramp_between_rests_is_a_straight_line_over_lost_rows():
    ramp = np.clip(2.0 * (TIME - 3.0), 0.0, 1.0) * 0.05
    lost = np.arange(310, 322)
    found = moving_command(record_of(ramp, lost), "drive_velocity_command", TIME, PERIOD)
    np.testing.assert_allclose(found, ramp, atol=1e-12)


def test_without_lost_rows_a_command_is_what_was_recorded():
    record = record_of(SPEED, [])
    stamps, values = command_rows(record, "drive_velocity_command", PERIOD)
    np.testing.assert_array_equal(stamps, record.time)
    np.testing.assert_array_equal(values, SPEED)
