"""``cablebench identify`` on recordings that the plant made."""

import json
import shutil

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.identification.samples import derivative, ratio_samples, together
from cablebench.cli import main
from cablebench.cli.physics.identify import identify_recording
from tests.support.recording_rig import write_recording

TRUTH = {"delta": 0.02, "mu": 0.43, "K": 6574.0, "omega": 2.03}
"""configs/rigs/gu-inferred.yaml"""


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """Three wraps, 0.1 N of noise on both tensions."""
    return write_recording(tmp_path_factory.mktemp("noisy"), np.random.default_rng(1))


def changed(path, folder, **changes):
    """A copy of the recording in ``folder`` with keys of its description replaced."""
    content = yaml.safe_load(path.read_text()) | changes
    for record in content["records"]:
        shutil.copy(path.parent / record["data"], folder)
    target = folder / "recording.yaml"
    target.write_text(yaml.safe_dump(content))
    return target


@pytest.mark.parametrize("method", ["lsq", "cma"])
def test_parameters_of_the_plant_are_recovered(noisy, method, capsys):
    with pytest.raises(SystemExit) as end:
        main(["identify", str(noisy), "--method", method, "--json"])
    assert not end.value.code
    result = json.loads(capsys.readouterr().out)
    for name, value in TRUTH.items():
        found = result["parameters"][name]
        assert abs(found["value"] - value) < 4 * found["std"], name  # 4 sigma: drawn once
    assert result["parameters"]["rho0"] == {"value": 1.5, "unit": "1", "status": "known"}
    assert 0.6 < result["chi2_per_degree_of_freedom"] < 1.6  # about 95 points: 0.15 at one sigma, and settling
    assert result["above_optimum"] < 1e-3 and result["heldout"]["rms"] < 2 * result["rms_fit"]
    assert any("K and omega" in note for note in result["notes"])
    assert any("rho0 (1 + delta)" in note for note in result["notes"])


def test_swarm_says_that_it_missed_the_optimum(noisy):
    result = identify_recording(load_recording(noisy), "pso")
    assert result["above_optimum"] > 0.1 and any("stopped above the optimum" in note for note in result["notes"])


def test_output_for_people(noisy, capsys):
    with pytest.raises(SystemExit):
        main(["identify", str(noisy)])
    out = capsys.readouterr().out
    assert "95 % interval" in out and "omega" in out and "identified" in out


def test_known_parameters_stay_fixed(noisy, tmp_path):
    known = {"radius_ratio": 1.5, "extrusion_delta": 0.02, "friction_coefficient": 0.43}
    result = identify_recording(load_recording(changed(noisy, tmp_path, known=known)), "lsq")
    assert result["parameters"]["delta"] == {"value": 0.02, "unit": "1", "status": "known"}
    assert result["parameters"]["K"]["std"] < 150  # without delta and mu free: was 170


def test_positions_and_a_known_weight_do_as_well(tmp_path):
    """Speed from drive positions, load tension from its mass; noise from the scatter."""
    path = write_recording(tmp_path, np.random.default_rng(2))
    for k in (1, 2, 3, 4):
        table = np.genfromtxt(tmp_path / f"run_{k}.csv", delimiter=",", names=True)
        position = np.concatenate([[0.0], np.cumsum(table["v_mm_s"][1:] * np.diff(table["t"]))])
        columns = np.column_stack([table["t"], position, table["F1"], table["wrap"]])
        np.savetxt(tmp_path / f"run_{k}.csv", columns, delimiter=",", header="t,x_mm,F1,wrap", comments="")
    content = yaml.safe_load(path.read_text())
    content["known"] = {
        "hole_radius": {"value": 1.5, "unit": "mm"},
        "cable_radius": {"value": 1, "unit": "mm"},
        "load_mass": 5.0,
    }
    content["channels"] = {
        "time": {"column": "t", "unit": "s"}, "drive_position": {"column": "x_mm", "unit": "mm"},
        "drive_tension": {"column": "F1", "unit": "N"}, "wrap_angle": {"column": "wrap", "unit": "deg"},
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content))
    result = identify_recording(load_recording(path), "lsq")
    assert result["radius_ratio_from"] == "hole_radius / cable_radius"
    for name in ("mu", "K", "omega"):
        assert result["parameters"][name]["value"] == pytest.approx(TRUTH[name], rel=0.15), name


def test_sticking_after_a_reversal_is_left_out():
    """The drive moves, the tension climbs, the cable sticks: no friction is seen."""
    time = np.arange(0.0, 1.0, 0.01)
    samples = ratio_samples(time, np.full(100, 5e-3), np.full(100, 1.0), 49.0 + 20.0 * time, np.full(100, 49.0))
    assert len(samples) == 0 and samples.left_out["tension not steady"] >= 3
    with pytest.raises(ConfigurationError, match=r"no block of steady sliding .*tension not steady"):
        together([samples])


def test_ratio_is_drive_over_load_while_hauling_in_and_inverse_while_paying_out():
    time, ones = np.arange(0.0, 1.0, 0.01), np.ones(100)
    up = ratio_samples(time, 5e-3 * ones, ones, 60.0 * ones, 40.0 * ones, drive_std=0.1, load_std=0.2)
    down = ratio_samples(time, -5e-3 * ones, ones, 40.0 * ones, 60.0 * ones, drive_std=0.2, load_std=0.1)
    for samples in (up, down):
        assert samples.ratio == pytest.approx(1.5) and len(samples) == 4  # of 5 blocks, the first may still settle
        expected = 1.5 * np.hypot(0.1 / 60, 0.2 / 40) / np.sqrt(20)
        assert samples.noise_std == pytest.approx(expected)
    with pytest.raises(ConfigurationError, match="Check the sign of drive_velocity"):
        together([ratio_samples(time, -5e-3 * ones, ones, 60.0 * ones, 40.0 * ones, drive_std=0.1, load_std=0.2)])


def test_derivative_of_a_noisy_ramp():
    time = np.arange(0.0, 2.0, 0.01)
    position = 3e-3 * time + 1e-6 * np.random.default_rng(0).standard_normal(200)
    # slope of a line through 21 points: sqrt(12 / 21^3) * noise / step = 3.6e-6 m/s at one sigma
    assert derivative(time, position, 0.2) == pytest.approx(np.full(200, 3e-3), abs=2e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"system": "pulley_circuit", "known": {}, "channels": {"time": {"column": "t", "unit": "s"}}},
            "works on cable_hole recordings",
        ),
        ({"known": {}}, "the ratio of hole to cable radius is needed"),
        (
            {"channels": {"time": {"column": "t", "unit": "s"}}},
            "needs the channel drive_tension; the recording has time",
        ),
    ],
)
def test_recordings_that_cannot_answer_are_refused(noisy, tmp_path, changes, message):
    with pytest.raises(ConfigurationError, match=message):
        identify_recording(load_recording(changed(noisy, tmp_path, **changes)), "lsq")


def test_missing_load_tension_and_wrap_are_named(noisy, tmp_path):
    channels = yaml.safe_load(noisy.read_text())["channels"]
    for gone, message in (
        ("load_tension", "load_tension, or load_mass under 'known'"),
        ("wrap_angle", "channel wrap_angle, or"),
        ("drive_velocity", "drive_velocity"),
    ):
        rest = {k: v for k, v in channels.items() if k != gone}
        with pytest.raises(ConfigurationError, match=message):
            identify_recording(load_recording(changed(noisy, tmp_path, channels=rest)), "lsq")


@pytest.mark.parametrize("arguments", [("no-such-file.yaml",), (".", "--method", "annealing"), (".", "--bound", "K=3")])
def test_bad_arguments_end_with_code_2(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["identify", *arguments])
    assert end.value.code == 2 and capsys.readouterr().err
