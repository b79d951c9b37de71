"""Logs of imperfect loggers, generator A: what each kind does to the tables, and that a recording can be read."""

import numpy as np
import pytest

from cable_envs.diagnosis import load_recording
from cable_envs.proof.cases import PERIOD, Case
from cable_envs.proof.effects import SYSTEMS
from cable_envs.proof.logs.cases import make, plan
from cable_envs.proof.logs.loggers import KINDS


def _tables(kind, folder, system="linear_drive", seed=4):
    key = make(Case("case", seed, system, "nothing", noise=kind), folder)
    return key, load_recording(folder)


@pytest.mark.parametrize("system", SYSTEMS)
def test_everything_at_once_can_be_read_and_states_nothing(tmp_path, system):
    key, recording = _tables("everything", tmp_path / "log", system)
    assert recording.system == system
    assert not recording.noise
    assert [r.use for r in recording.records] == ["fit", "fit", "heldout"]
    assert key["log"]["hum"]
    assert key["log"]["counts"]


def test_rows_are_lost_and_a_clock_is_wrong(tmp_path):
    _, whole = _tables("white, unstated", tmp_path / "whole")
    key, lost = _tables("lost rows", tmp_path / "lost")
    assert np.max(np.diff(lost.records[0].time)) > 1.5 * PERIOD
    assert np.max(np.diff(whole.records[0].time)) < 1.5 * PERIOD
    key, fast = _tables("wrong clock", tmp_path / "fast")
    periods = np.median(np.diff(fast.records[0].time)) / PERIOD - 1.0
    assert periods == pytest.approx(key["log"]["fast"], abs=1e-4)


def test_encoders_count(tmp_path):
    key, recording = _tables("counts", tmp_path / "log")
    step = key["log"]["counts"]["position"]
    values = recording.records[0].data["position"] / step
    assert np.max(np.abs(values - np.round(values))) < 1e-3


def test_the_plan_has_every_kind_on_every_system():
    cases = plan(nothing=1, single=1, strange=1)
    assert {(c.noise, c.system, c.kind) for c in cases} == {
        (kind, system, what) for kind in KINDS for system in SYSTEMS for what in ("nothing", "single", "strange")
    }
    assert len({c.seed for c in cases}) == len(cases)
