"""Does the diagnosis pay: what is hidden stays hidden, the sums are right, and the whole study runs and goes on."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from cable_envs.errors import ConfigurationError
from cablebench import pays
from cablebench.cli import main
from cablebench.entrants import controller_entrant
from cablebench.evaluate import setup_of
from cablebench.pays import AGENT, CONTROLLER, ENV, SIMULATORS, Study, page, summary

GAINS = {"kp": 0.0, "ki": 0.0, "kd": 0.0}


def test_only_the_oracle_is_told_what_is_hidden():
    study = Study(hidden={"backlash": {"gap": 0.1}})
    rig = {
        "schema": "cable-rig/1",
        "name": "augmented",
        "plant": "pulley_circuit",
        "effects": {"backlash": {"gap": 0.09}},
    }
    gaps = {
        name: setup_of(ENV, study.simulator_options(name, rig)).rig.effects.get("backlash.gap") for name in SIMULATORS
    }
    assert gaps == {"nominal": None, "augmented": 0.09, "oracle": 0.1}
    hidden = setup_of(ENV, study.hidden_options())
    assert hidden.plant.name == "pulley_chain" and hidden.rig.effects["backlash.gap"] == 0.1


def test_unknown_effects_and_empty_budgets_are_refused():
    with pytest.raises(ConfigurationError, match="backlash"):
        Study(hidden={"backlsh": {"gap": 0.1}})
    with pytest.raises(ConfigurationError, match="trials"):
        Study(trials=0)
    with pytest.raises(ConfigurationError, match="seeds"):
        Study(seeds=(1, 1))


def test_summary_pairs_episodes_and_resamples_seeds():
    nominal = np.array([[0.10, 0.12], [0.14, 0.16], [0.12, 0.14]])
    table = {"nominal": nominal, "augmented": nominal - 0.03, "oracle": nominal - 0.04}
    found = summary({AGENT: table})[AGENT]
    assert found["nominal"]["value"] == pytest.approx(0.13)
    assert found["nominal"]["low"] < 0.13 < found["nominal"]["high"]
    assert found["nominal"]["over"] == "training seeds" and found["nominal"]["runs"] == 3
    # the seeds differ by more than the saving, yet the same saving in every pair has no spread
    assert found["saved"]["low"] == pytest.approx(0.03) and found["saved"]["high"] == pytest.approx(0.03)
    assert found["closed"] == pytest.approx(0.75)
    assert summary({AGENT: {**table, "oracle": nominal + 0.01}})[AGENT]["closed"] is None


def test_a_model_based_controller_believes_the_rig_of_its_simulator():
    """With the pretension of another rig it expects other torques, so it answers otherwise to the same measurements."""
    study = Study(hidden={"coulomb_friction": {"level": 0.02}}, duration=3.0)
    soft = {**study.simulator_options("nominal", {}), "rig": {"tensile_stiffness": 6000.0}}
    acting = setup_of(ENV, study.hidden_options())
    commands = []
    for options in (study.simulator_options("nominal", {}), soft):
        actor = pays.controller_actor(GAINS, setup_of(ENV, options), acting)
        y = {name: 0.1 for name in ("drive_angle", "drive_velocity", "drive_torque")}
        actor.controller.reset()
        commands.append([actor.controller.act(0.01 * k, y, (0.01 * k, 1.0, 0.0)) for k in range(50)][-1])
    assert commands[1] > commands[0] + 0.01


def test_page_and_command_hold_the_numbers():
    table = {name: [[0.1, 0.12], [0.11, 0.1]] for name in SIMULATORS}
    study = Study(seeds=(3, 4), hidden={"backlash": {"gap": 0.1}})
    text = page({
        "hidden": study.hidden, "command": pays.command(study, quick=False), "seeds": study.seeds, "episodes": 2,
        "diagnosis": {"verdict": "named", "effects": [{"name": "backlash", "parameters": {
            "backlash.gap": {"value": 0.0987, "unit": "rad"}}}]},
        "budget": {"trials": 7, "steps": 11}, "summary": summary({CONTROLLER: table}),
    })  # fmt: skip
    assert "--seed 3 --seed 4" in text and "--hide backlash.gap=0.1" in text
    assert "backlash.gap = 0.0987 rad" in text and "7 trials" in text
    assert "| `feedforward-pid` | 107.5 [" in text


@pytest.mark.slow
def test_the_recording_does_not_tell_what_is_hidden(tmp_path):
    from cablebench.export.concealed import write_concealed
    from diagnosis.recording import load_recording

    study = Study(hidden={"backlash": {"gap": 0.123}}, duration=3.0)
    motions = [
        {"kind": "sine", "amplitude": 1.0, "frequency": 0.5},
        {"kind": "sine", "amplitude": 0.8, "frequency": 0.7},
    ]
    entrant = controller_entrant(CONTROLLER, GAINS)
    file = write_concealed(ENV, study.hidden_options(), motions, entrant, "zou-table2", tmp_path / "r", seed=5)
    text = file.read_text()
    assert "0.123" not in text and "backlash" not in text and yaml.safe_load(text)["rig"] == "zou-table2"
    recording = load_recording(file)
    assert [r.use for r in recording.records] == ["fit", "heldout"] and recording.rig.effects == {}
    assert recording.channels["drive_angle"].noise_std == 5e-4
    assert len(recording.records[0].time) == 301
    assert {p.name for p in (tmp_path / "r").iterdir()} == {"recording.yaml", "motion_0.csv", "motion_1.csv"}


@pytest.mark.slow
def test_a_small_study_runs_keeps_its_parts_and_refuses_another(tmp_path, monkeypatch, capsys):
    """With a diagnosis from elsewhere in its place, which takes most of the time and has tests of its own."""
    out = tmp_path / "study"
    study = Study(hidden={"backlash": {"gap": 0.2}}, seeds=(0,), steps=8192, trials=2, tuning_episodes=1, episodes=1,
                  duration=2.0, record_seconds=2.0)  # fmt: skip
    found = out / "diagnosis"
    (out / "recording").mkdir(parents=True)
    found.mkdir()
    (out / "recording" / "recording.yaml").write_text("schema: cable-recording/1\n")
    rig = {"schema": "cable-rig/1", "name": "augmented", "plant": "pulley_circuit",
           "effects": {"backlash": {"gap": 0.19}}}  # fmt: skip
    (found / "augmented.yaml").write_text(yaml.safe_dump(rig))
    (found / "diagnosis.json").write_text(json.dumps({"verdict": "named", "effects": []}))
    words = ["pays", "--out", str(out), "--seed", "0", "--steps", "8192", "--trials", "2", "--tuning-episodes", "1"]
    words += ["--episodes", "1", "--duration", "2", "--record-seconds", "2", "--hide", "backlash.gap=0.2", "--json"]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    result = json.loads(capsys.readouterr().out)
    assert result["scores"].keys() == {CONTROLLER, AGENT}
    assert all(np.isfinite(result["scores"][learner][s]).all() for learner in result["scores"] for s in SIMULATORS)
    assert (out / "pays.md").read_text().startswith("# Does it pay?")
    from cablebench.commands import pays_steps

    again = json.loads((out / "scores" / f"{CONTROLLER}-oracle-0.json").read_text())
    monkeypatch.setattr(pays_steps, "tuned_gains", None)  # nothing is made twice
    monkeypatch.setattr(pays_steps, "trained", None)
    repeated = pays_steps.run(study, out, False, lambda text: None, lambda *now: None)
    assert repeated["scores"][CONTROLLER]["oracle"] == [again]
    with pytest.raises(ConfigurationError, match="other settings"):
        pays_steps.run(replace(study, trials=3), out, False, lambda text: None, lambda *now: None)
