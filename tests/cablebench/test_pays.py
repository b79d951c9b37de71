"""Does the diagnosis pay: what is hidden stays hidden, the sums are right, and the whole study runs and goes on."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json
from cable_envs.sim.registered import setup_of
from cablebench.cli import main
from cablebench.pays import page as pays_page
from cablebench.pays.rigs import RIGS
from cablebench.pays.scores import SIMULATORS, Study, summary
from cablebench.protocol.actors import controller_actor

CONTROLLER, AGENT, ENV = "feedforward-pid", "residual-ppo", RIGS["circuit"].env
GAINS = {"kp": 0.0, "ki": 0.0, "kd": 0.0}
EFFECTS = {"circuit": ("backlash", "gap", 0.1, 0.09), "hole": ("coulomb_friction", "level", 4.0, 3.9)}
"""rig -> (effect, its parameter, as it is hidden, as a diagnosis found it)"""


@pytest.mark.parametrize("rig", sorted(RIGS))
def test_only_the_oracle_is_told_what_is_hidden(rig):
    effect, name, true, seen = EFFECTS[rig]
    study = Study(rig=rig, hidden={effect: {name: true}})
    hidden = setup_of(study.bench.env, study.hidden_options())
    found = {"schema": "cable-rig/1", "name": "augmented", "plant": hidden.rig.plant, "effects": {effect: {name: seen}}}

    def told(setup):
        return setup.rig.effects.get(f"{effect}.{name}")

    sizes = {s: told(setup_of(study.bench.env, study.simulator_options(s, found))) for s in SIMULATORS}
    assert sizes == {"nominal": None, "augmented": seen, "oracle": true}
    assert told(hidden) == true
    assert hidden.plant.name == {"circuit": "pulley_chain", "hole": "cable_hole"}[rig]


def test_every_rig_hides_effects_and_holds_a_motion_back():
    for rig in RIGS.values():
        study = Study(rig=next(name for name, r in RIGS.items() if r is rig))
        nominal, hidden = (
            setup_of(rig.env, options) for options in (study.simulator_options("nominal", {}), study.hidden_options())
        )
        assert nominal.rig.effects == {} and nominal.rig.name == rig.preset
        assert {**hidden.rig.values, **hidden.rig.effects} != {**nominal.rig.values, **nominal.rig.effects}
        assert len(rig.motions) >= 3 and nominal.reference not in [dict(m) for m in rig.motions]


def test_unknown_effects_and_empty_budgets_are_refused():
    with pytest.raises(ConfigurationError, match="backlash"):
        Study(hidden={"backlsh": {"gap": 0.1}})
    with pytest.raises(ConfigurationError, match="trials"):
        Study(trials=0)
    with pytest.raises(ConfigurationError, match="seeds"):
        Study(seeds=(1, 1))
    with pytest.raises(ConfigurationError, match="circuit"):
        Study(rig="circit")


def test_more_seeds_are_the_same_study_and_another_budget_is_not():
    study = Study(hidden={"backlash": {"gap": 0.1}}, seeds=(0,))
    assert replace(study, seeds=(0, 1)).hash() == study.hash()
    assert len({s.hash() for s in (study, replace(study, steps=7), replace(study, rig="hole"))}) == 3


def test_what_is_hidden_from_the_command_line_needs_one_rig():
    with pytest.raises(SystemExit) as ended:
        main(["pays", "--out", "nowhere", "--hide", "backlash.gap=0.1"])
    assert ended.value.code != 0


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
        actor = controller_actor(CONTROLLER, GAINS, setup_of(ENV, options), acting)
        y = dict.fromkeys(("drive_angle", "drive_velocity", "drive_torque"), 0.1)
        actor.controller.reset()
        commands.append([actor.controller.act(0.01 * k, y, (0.01 * k, 1.0, 0.0)) for k in range(50)][-1])
    assert commands[1] > commands[0] + 0.01


def test_page_command_and_figure_hold_the_numbers():
    table = {name: [[0.1, 0.12], [0.11, 0.1]] for name in SIMULATORS}
    study = Study(seeds=(3, 4), hidden={"backlash": {"gap": 0.1}, "coulomb_friction": {"level": 0.02}})
    named = {"name": "backlash", "confidence": 0.8, "parameters": {
        "backlash.gap": {"value": 0.0987, "unit": "rad", "ci95": [0.097, 0.1004]}}}  # fmt: skip
    result = {
        "command": pays_page.command([study], quick=False), "seeds": study.seeds, "episodes": 2,
        "budget": {"trials": 7, "steps": 11, "tuning_episodes": 2},
        "rigs": {"circuit": {"hidden": study.effects, "summary": summary({CONTROLLER: table}),
                             "diagnosis": {"verdict": "named", "effects": [named]}}},
    }  # fmt: skip
    text = pays_page.page(result)
    assert "--rig circuit" in text and "--seed 3 --seed 4" in text and "--hide backlash.gap=0.1" in text
    assert "| backlash.gap | 0.1 | 0.0987 rad | 0.097 to 0.1 | 0.80 |" in text
    assert "| coulomb_friction.level | 0.02 | - | - | - |" in text  # what was missed stands there too
    assert "7 trials" in text and "| `feedforward-pid` | 108 [" in text
    drawn = pays_page.figure(result)
    assert drawn.startswith("<svg") and "feedforward-pid" in drawn


def test_the_committed_page_is_that_of_its_numbers():
    docs = Path(__file__).parents[2] / "docs"
    result = read_json(docs / "pays.json.xz")
    assert (docs / "pays.md").read_text(encoding="utf-8") == pays_page.page(result)
    for name, found in result["rigs"].items():
        assert found["hidden"] == RIGS[name].effects
        again = summary(found["scores"])
        for learner, entry in found["summary"].items():
            assert again[learner]["augmented"]["value"] == pytest.approx(entry["augmented"]["value"])


@pytest.mark.slow
@pytest.mark.parametrize("rig", sorted(RIGS))
def test_the_recording_does_not_tell_what_is_hidden(rig, tmp_path):
    from cable_envs.diagnosis.data.recording import load_recording
    from cablebench.cli.physics.retrain_steps import recorded

    effect, name, _, _ = EFFECTS[rig]
    study = Study(rig=rig, hidden={effect: {name: 0.123}}, record_seconds=3.0)
    file = recorded(study, tmp_path / "r")
    text = file.read_text()
    assert "0.123" not in text and effect not in text and yaml.safe_load(text)["rig"] == study.bench.preset
    recording = load_recording(file)
    assert [r.use for r in recording.records] == ["fit", "fit", "heldout"] and recording.rig.effects == {}
    assert recording.channels["drive_angle" if rig == "circuit" else "load_position"].noise_std > 0.0
    assert not {"angle_reference", "position_reference"} & set(recording.channels)
    assert abs(len(recording.records[0].time) - 300) <= 1
    tables = {"recording.yaml", "motion_0.csv", "motion_1.csv", "motion_2.csv"}
    assert {p.name for p in (tmp_path / "r").iterdir()} == tables


@pytest.mark.slow
def test_the_recorded_hole_is_the_controlled_one(tmp_path):
    """Nothing hidden: the generator's tensions beside the paper's ratio with the preset's numbers, while it slides."""
    from cable_envs.baselines.hole_model import HoleModel
    from cable_envs.diagnosis.data.recording import load_recording
    from cablebench.cli.physics.retrain_steps import recorded

    study = Study(rig="hole", hidden={}, record_seconds=12.0)
    hole = HoleModel(setup_of(study.bench.env, study.hidden_options()).rig.values, "exact")
    data = load_recording(recorded(study, tmp_path / "r")).records[1].data  # ramps: no inertia
    speed = data["drive_velocity"]
    for way in (1.0, -1.0):
        slides = way * speed > 2e-3
        assert slides.sum() > 100
        ratio = np.array([hole.ratio(v, 50.0, 50.0) for v in speed[slides]])
        expected = data["load_tension"][slides] * ratio**way
        # noise of both tensions averages out; where the ramps turn the load is accelerated a little
        assert np.median(data["drive_tension"][slides] / expected) == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("rig", sorted(RIGS))
def test_a_small_study_runs_keeps_its_parts_and_refuses_another(rig, tmp_path, monkeypatch, capsys):
    """With a diagnosis from elsewhere in its place, which takes most of the time and has tests of its own."""
    out, (effect, name, true, seen) = tmp_path / "study", EFFECTS[rig]
    study = Study(rig=rig, hidden={effect: {name: true}}, seeds=(0,), steps=8192, trials=2, tuning_episodes=1,
                  episodes=1, duration=2.0, record_seconds=2.0)  # fmt: skip
    controller, agent = study.learners
    found, recording = out / rig / "diagnosis", out / rig / "recording"
    found.mkdir(parents=True)
    recording.mkdir()
    (recording / "recording.yaml").write_text("schema: cable-recording/1\n")
    system = setup_of(study.bench.env, study.hidden_options()).rig.plant
    content = {"schema": "cable-rig/1", "name": "augmented", "plant": system, "effects": {effect: {name: seen}}}
    (found / "augmented.yaml").write_text(yaml.safe_dump(content))
    (found / "diagnosis.json").write_text(json.dumps({"verdict": "named", "effects": []}))
    words = ["pays", "--out", str(out), "--rig", rig, "--seed", "0", "--steps", "8192", "--trials", "2"]
    words += ["--tuning-episodes", "1", "--episodes", "1", "--duration", "2", "--record-seconds", "2"]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--hide", f"{effect}.{name}={true}", "--json"])
    assert ended.value.code == 0
    scores = json.loads(capsys.readouterr().out)["rigs"][rig]["scores"]
    assert scores.keys() == {controller, agent}
    assert all(np.isfinite(scores[learner][s]).all() for learner in scores for s in SIMULATORS)
    assert (out / "pays.md").read_text().startswith("# Does it pay?")
    assert (out / pays_page.FIGURE).read_text().startswith("<svg")
    from cablebench.cli.physics import retrain_steps

    again = json.loads((out / rig / "scores" / f"{controller}-oracle-0.json").read_text())
    monkeypatch.setattr(retrain_steps, "tuned_gains", None)  # nothing is made twice
    monkeypatch.setattr(retrain_steps, "trained", None)
    repeated = retrain_steps.run([study], out, False, lambda text: None, lambda *now: None)
    assert repeated["rigs"][rig]["scores"][controller]["oracle"] == [again]
    with pytest.raises(ConfigurationError, match="other settings"):
        retrain_steps.run([replace(study, trials=3)], out, False, lambda text: None, lambda *now: None)


@pytest.mark.slow
def test_a_trained_agent_keeps_the_rig_that_its_controller_believed(tmp_path):
    """A loaded policy would take the task's own: another controller than the one it learnt to correct."""
    from cablebench.cli.physics import retrain_steps

    study = Study(rig="hole", hidden={"coulomb_friction": {"level": 1.0}}, seeds=(0,), steps=8192, duration=2.0)
    rig = {"schema": "cable-rig/1", "name": "augmented", "plant": "cable_hole",
           "parameters": {"load_mass": {"value": 3.0, "unit": "kg"}}}  # fmt: skip
    policy = retrain_steps.trained(study, tmp_path, "augmented", rig, 0, lambda *now: None)
    assert policy.setup.rig.values["load_mass"] == 3.0
