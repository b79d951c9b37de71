"""The sample rig: three small logs that are what their script makes, and whose fault is found."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cable_envs.diagnosis import diagnose, load_recording
from cablebench.cli.app import app
from cablebench.skeletons import sample_rig

FOLDER = Path(__file__).parents[2] / "examples" / "sample_rig"
SPEC = importlib.util.spec_from_file_location("make_sample", FOLDER / "make.py")
MAKE = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(MAKE)


def numbers(text):
    return np.genfromtxt(text.splitlines(), delimiter=",", skip_header=1)


def test_the_logs_are_small_and_what_the_script_makes():
    assert sum(path.stat().st_size for path in FOLDER.glob("*.csv")) < 80_000
    assert (FOLDER / "recording.yaml").read_text(encoding="utf-8") == MAKE.recording()
    for name, text in MAKE.logs().items():
        off = np.abs(numbers(text) - numbers((FOLDER / name).read_text(encoding="utf-8")))
        assert off[:, :2].max() < 2e-5  # another processor rounds the last digit another way
        assert off[:, 2:].max() <= 1.0 and (off[:, 2:] > 0.0).mean() < 1e-3
    assert "lag" not in MAKE.recording() and [r.use for r in load_recording(FOLDER).records] == list(MAKE.USES)


def test_its_fault_is_named_and_the_corrected_rig_lacks_nothing():
    recording = load_recording(FOLDER)
    found = diagnose(recording)
    (effect,) = found.effects
    lag = effect.parameters["time"]
    assert (found.verdict, effect.name, effect.alternatives) == ("named", "actuator_lag", ())
    assert lag.low < MAKE.LAG < lag.high and lag.value == pytest.approx(MAKE.LAG, rel=0.02)
    held = found.fit["output_angle"]["heldout_rmse"]
    assert held["augmented"] < 1.1 * np.hypot(MAKE.NOISE["output_angle"], MAKE.COUNT / np.sqrt(12.0))
    assert held["augmented"] < 0.1 * held["refit"]
    assert diagnose(recording, rig=found.rig).verdict == "no_detectable_mismatch"


def test_a_command_copies_it(tmp_path):
    done = CliRunner().invoke(app, ["new", "sample", "joint", "--out", str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0 and "cablebench diagnose" in done.stdout
    assert {p.name: p.read_text(encoding="utf-8") for p in (tmp_path / "joint").iterdir()} == sample_rig()
    assert set(sample_rig()) == {"fit.csv", "heldout.csv", "rest.csv", "recording.yaml"}
