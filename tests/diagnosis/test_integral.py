"""A drive whose controller has an integral is replayed with it, and what is missing is found beside it."""

import numpy as np
import pytest

from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.systems.drive.loop import controller
from tests.support import drive_recording as drive

KI = 20000.0
"""N/(m s), five times the proportional gain a second."""


def _dry(y, v, t):
    return 1.0 * np.tanh(v / 1e-3)


def _free(y, v, t):
    return 0.0


@pytest.mark.parametrize("ki", [0.0, KI])
def test_an_integral_is_seen_in_the_effort_where_there_is_one(tmp_path, ki):
    folder = drive.write(tmp_path, load=_free, ki=ki)
    gains, left = controller(load_recording(folder), 0.01)
    assert gains["control.ki"] == pytest.approx(ki, rel=0.1)
    assert gains["control.kp"] == pytest.approx(drive.KP, rel=0.05) and left < 2.0


def test_the_loop_is_replayed_with_its_integral(tmp_path):
    """It holds 2 N when the records begin, which move the carriage by 0.5 mm and are gone in 0.2 s."""
    recording = load_recording(drive.write(tmp_path, load=_free, ki=KI))
    question = ask(recording, request_of(recording))
    assert "control.ki" in question.nominals
    found = refit_and_learn(question.fit, [Start("", question.nominals, {})])
    assert found.fit.values["control.ki"] == pytest.approx(KI, rel=0.05)
    assert found.fit.values["mass"] == pytest.approx(drive.MASS, rel=0.02)
    for block, left in zip(question.fit.blocks, found.raw, strict=True):
        assert np.std(left[block.good]) < 1.1 * drive.NOISE[block.channel]


@pytest.mark.parametrize(("load", "names"), [(_free, []), (_dry, ["coulomb_friction"])])
def test_what_is_missing_is_found_beside_an_integral(tmp_path, load, names):
    found = diagnose(drive.write(tmp_path, load=load, ki=KI), without=["presliding_hysteresis", "stribeck_friction"])
    assert [one.name for one in found.effects] == names
    for one in found.effects:
        assert one.parameters["level"].value == pytest.approx(1.0, rel=0.05)
