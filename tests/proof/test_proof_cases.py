"""Cases of the blind proof: reproducible, of the wanted size, told in the recording format, sealed end to end."""

import json

import numpy as np
import pytest

from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.proof.baselines import BASELINES
from cable_envs.proof.cases import AT_REST, BANDS, PERIOD, Case, make, plan
from cable_envs.proof.effects import LIBRARY, STRANGE, SYSTEMS, find
from cable_envs.proof.excitation import reference
from cable_envs.proof.refit import Refit
from cable_envs.proof.rigs import CLOCK, random_rig
from cable_envs.proof.run import make_one, prove
from cable_envs.proof.sensors import stamps
from cable_envs.proof.writing import digest

ONE = {
    "linear_drive": Case("case-0001", 11, "linear_drive", "single", ("stribeck_friction",), "3-10"),
    "cable_hole": Case("case-0002", 12, "cable_hole", "single", ("lateral_extrusion",), ">10", "ar1"),
    "pulley_circuit": Case("case-0003", 13, "pulley_circuit", "single", ("backlash",), ">10"),
}


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_case_is_reproducible_sized_and_readable(system, tmp_path):
    case = ONE[system]
    found = make(case, tmp_path / "a")
    low, high = BANDS[case.band]
    assert low * 0.8 < found["added"] < high * 1.2
    assert sum(share for _, share in found["mismatch"]) == pytest.approx(1.0)
    assert found["effects"][0]["name"] == case.effects[0] and 0.0 <= found["absorbed"] <= 1.0
    recording = load_recording(tmp_path / "a")
    assert [r.use for r in recording.records][:3] == ["fit", "fit", "heldout"]
    assert 60 < sum(np.ptp(r.time) for r in recording.records[:3]) < 120
    for told, true in found["true_nominal"].items():  # off, but within three standard deviations of what it says
        stated = recording.nominal[told]
        assert 0.0 < abs(stated.value - true) < 3 * stated.std
    text = (tmp_path / "a" / "recording.yaml").read_text()
    assert case.effects[0] not in text and "seed" not in text
    if system == "linear_drive":
        assert json.loads(json.dumps(make(case, tmp_path / "b"))) == json.loads(json.dumps(found))
        assert digest(tmp_path / "a") == digest(tmp_path / "b")


def test_nothing_wrong_and_decoys_have_no_effect(tmp_path):
    for kind in ("nothing", "decoy"):
        found = make(Case("case-1", 5, "linear_drive", kind), tmp_path / kind)
        assert (found["effects"], found["added"], found["concealment"], found["mismatch"]) == ([], 0.0, [], [])
    off = [
        abs(load_recording(tmp_path / kind).nominal["mass"].value / found["true_nominal"]["mass"] - 1)
        for kind in ("nothing", "decoy")
    ]
    assert off[0] <= 0.06 < off[1] <= 0.13


def test_plan_covers_everything_and_tells_nothing():
    cases = plan(per_effect=3, nothing=6)
    assert cases == plan(per_effect=3, nothing=6) and cases != plan(per_effect=3, nothing=6, seed=6)
    assert len({c.name for c in cases}) == len({c.seed for c in cases}) == len(cases)
    for system in SYSTEMS:
        own = [c for c in cases if c.system == system]
        for effect in LIBRARY[system]:
            bands = [c.band for c in own if c.kind == "single" and c.effects == (effect.name,)]
            assert sorted(bands) == sorted(BANDS)
        assert {c.effects[0] for c in own if c.kind == "strange"} == {e.name for e in STRANGE[system]}
        assert sum(c.kind == "pair" for c in own) == 3
        assert len(STRANGE[system]) >= 6
    assert sum(c.kind == "nothing" and c.noise == "white" for c in cases) == 6
    assert sum(c.kind == "nothing" and c.noise != "white" for c in cases) == 6
    kinds = [c.kind for c in cases]
    assert kinds[:20] != sorted(kinds[:20])


def test_strange_effects_are_in_no_library():
    known = {e.name for effects in LIBRARY.values() for e in effects}
    assert not known & {e.name for effects in STRANGE.values() for e in effects}


def test_effects_and_their_parameters_are_those_of_the_tool():
    from cable_envs.plants import plant_for

    for system, effects in LIBRARY.items():
        for effect in effects:
            theirs = plant_for(system).effects.effects[effect.name]
            assert theirs.parameters, (system, effect.name)
            if not theirs.each_sensor:
                assert set(effect.compare) <= {p.name for p in theirs.parameters}, (system, effect.name)


def test_baselines_give_verdicts(tmp_path):
    make(Case("case-1", 21, "linear_drive", "single", ("stribeck_friction",), ">10"), tmp_path)
    recording = load_recording(tmp_path)
    for name, method in BASELINES.items():
        if name == "sparse regression":
            pytest.importorskip("pysindy")
        if name == "black box":
            pytest.importorskip("sklearn")
        assert method(recording)["schema"] == "cable-diagnosis/1", name


def test_coloured_noise_comes_with_a_record_at_rest_white_noise_with_a_number(tmp_path):
    white, coloured = (Case("case-0001", 7, "pulley_circuit", "nothing", noise=noise) for noise in ("white", "flicker"))
    make(white, tmp_path / "white")
    key = make(coloured, tmp_path / "coloured")
    stated, at_rest = (load_recording(tmp_path / name) for name in ("white", "coloured"))
    assert stated.noise and not stated.used_for("rest") and not at_rest.noise
    (rest,) = at_rest.used_for("rest")
    assert rest.time[-1] - rest.time[0] == pytest.approx(AT_REST, abs=0.1)
    for channel, std in key["noise_std"].items():
        first = at_rest.records[0].data[channel][:40].mean()
        assert rest.data[channel].std() == pytest.approx(std, rel=0.5)
        assert abs(rest.data[channel].mean() - first) < 5 * std
    for channel in set(rest.data) - set(key["noise_std"]) - {"time"}:
        assert np.ptp(rest.data[channel]) == 0.0


def test_prove_with_a_callable(tmp_path):
    """A tool that always says nothing is right where nothing is wrong; finished cases are kept, sealed ones guarded."""
    cases = [ONE["linear_drive"], Case("case-0009", 3, "linear_drive", "nothing")]
    quiet = {"schema": "cable-diagnosis/1", "verdict": "no_detectable_mismatch", "effects": []}
    seen = []

    def tool(folder):
        seen.append(sorted(p.name for p in folder.iterdir()))
        return quiet

    results = prove(tool, cases, tmp_path, {"plan": "test"})
    assert [(r.kind, r.outcome) for r in results] == [("single", "none"), ("nothing", "none")]
    assert seen == [["recording.yaml", "run_1.csv", "run_2.csv", "run_3.csv"]] * 2
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    again = make_one(None, cases[0], str(tmp_path))
    assert again == manifest["cases"][cases[0].name]


def _refit(seed, effect):
    """(a rig of the hole, its refit over two records)"""
    rng = np.random.default_rng([seed, 7])
    rig = random_rig("cable_hole", rng, (find("cable_hole", effect),))
    at = [stamps(rng, 0.0, 24.0, PERIOD, 0.02) for _ in range(2)]
    motions = [rig.centre + reference(kind, rng, 24.0, rig.amplitude, CLOCK) for kind in ("sine", "multisine")]
    return rig, Refit(rig, motions, at)


def test_what_friction_holds_before_the_first_motion_does_not_count():
    """On this rig an asymmetry is another friction and another mass, but for the tension that records begin with."""
    rig, refit = _refit(1203998115, "asymmetric_friction")
    place = refit.see({})[:, rig.scored.index("load_position")]
    first = np.abs(place - place[0]) < 0.01 * np.ptp(place)
    standing = np.logical_and.accumulate(first)
    assert standing[5]  # the load hangs still while the drive stretches the cable
    found = refit.excess({"asymmetric_friction.difference": 0.05})
    assert np.abs(found.left[standing]).max() < 1e-9 < np.abs(found.left).max()
    assert found.absorbed > 0.99 and found.added < 0.01


def test_a_refit_of_the_proof_goes_on_until_no_more_is_absorbed(monkeypatch):
    _, refit = _refit(205116082, "bending_stiffness")
    left = []
    for steps in (1, 6, 12):
        monkeypatch.setattr("cable_envs.proof.refit.STEPS", steps)
        left.append(refit.excess({"bending_stiffness.rigidity": 2e-6}).added)
    assert left[1] < 0.95 * left[0] and left[2] == pytest.approx(left[1], rel=0.02)
