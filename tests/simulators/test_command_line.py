"""``cablebench diagnose RECORDING --simulator FILE.py:NAME``: the three files of an answer."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cable_envs.diagnosis.simulators.base import load_simulator
from cablebench.cli.app import app
from tests.simulators.rigs import cart_records

RIGS = Path(__file__).parent / "rigs.py"


@pytest.mark.slow
def test_the_command_line_diagnoses_a_simulator_in_a_file(tmp_path):
    recording = cart_records(seed=1, seconds=2.5, noise=5e-4, coulomb=1.5).write(tmp_path / "rig")
    place, out = f"{RIGS}:cart", tmp_path / "answer"
    asked = ["diagnose", str(recording), "--simulator", place, "--out", str(out), "--effects", "coulomb_friction"]
    done = CliRunner().invoke(app, [*asked, "--trust"])
    assert done.exit_code == 0, done.output
    answer = json.loads((out / "diagnosis.json").read_text())
    assert answer["verdict"] == "named" and answer["about"]["simulator"] == "cart"
    page = (out / "report.html").read_text()
    assert "coulomb friction" in page and all(one in page for one in answer["about"]["assumed"])
    better = load_simulator(place).corrected(out / "augmented.yaml")
    assert abs(better.terms["coulomb_friction.slide.level"] - 1.5) < 0.02
