"""Servo pendulum: the reader, the model with the controller in the loop, and the ladder on simulated and real runs."""

import json
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.readers.base import Request as Asked
from cable_envs.diagnosis.readers.sets import servo_pendulum as reader
from cable_envs.diagnosis.real import servo_pendulum as study
from cable_envs.diagnosis.real.sets import FOLDERS, imported
from cable_envs.diagnosis.systems import prepare
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay

SHARED = Path(__file__).parents[3] / "shared" / "recordings"
SET = SHARED / FOLDERS["servo-pendulum"]
needs = pytest.mark.skipif(not SET.is_dir(), reason=f"the published set servo_pendulum is not at {SET}")
TRUE = {
    "gear_friction.driving": 0.3, "gear_friction.backdriving": 0.35, "torque_saturation.drop": 0.3, "coulomb": 0.004,
    "viscous": 0.009, "torque_constant": 0.35, "resistance": 2.9, "inertia": 1.7e-3, "hanging_angle": -0.015,
    "supply_voltage": 7.4,
}  # fmt: skip


def simulated(gain, trajectory, released=False):
    """A run of 6 s at 200 Hz of the plant with `TRUE` as a record of 1 mrad of noise."""
    plant = plant_for("rotary_joint")
    time = np.arange(0.0, 6.0, 0.005)
    goal = 1.5 * np.sin(2.0 * np.pi * 0.2 * time) * (1.0 if trajectory == "sine" else np.cos(np.pi * 0.7 * time))
    off = (time > 3.0) * float(released)
    values = plant.table.pack({**TRUE, "position_gain": gain, "load_mass": 0.49, "arm_length": 0.1})[:, None]
    angle = replay(
        plant, values, goal, 0.005, drive="position", hold="ramp", signals=["position"], second=off, substeps=20
    )[:, 0, 0]
    noise = 1e-3 * np.random.default_rng(3).normal(size=len(time))
    return {"time": time, "position": angle + noise, "position_reference": goal, "release_reference": off}


@pytest.fixture(scope="module")
def recording():
    """Two gains and two trajectories; the lower gain is held out."""
    runs = {
        f"{kp}_{name}": simulated(kp / 350.0, name, name == "mixed") for kp in (100, 400) for name in ("sine", "mixed")
    }
    about = {
        name: {"conditions": {"kp": float(name[:3]), "trajectory": name[4:], "position_gain": float(name[:3]) / 350.0}}
        for name in runs
    }
    return Recording.from_arrays(
        "rotary_joint", runs, about=about, heldout=[n for n in runs if n.startswith("100")],
        known={"load_mass": 0.49, "arm_length": 0.1, "supply_voltage": 7.4},
        nominal={"torque_constant": 0.35, "resistance": 3.4},
    )  # fmt: skip


def test_the_ladder_finds_gear_and_saturation_and_predicts_the_gain_left_out(recording):
    """Noise of 1 mrad has a mean size of 0.8 mrad; the simulator without both is off by many times that.

    A loss of the driven gear and a smaller torque constant are much the same, so neither is asked for.
    """
    naive, gear, most = study.ladder(recording, study.LADDER[:2])
    held = [float(np.mean(list(rung.heldout.values()))) for rung in (naive, gear, most)]
    assert held[0] > 0.01 and held[2] < 0.2 * held[0] and held[2] < held[1]
    assert most.values["torque_saturation.drop"] == pytest.approx(0.3, rel=0.3)
    assert most.as_json()["heldout"] == round(held[2], study.DECIMALS)


def test_splits_hold_out_one_gain_or_one_trajectory_and_once_nothing(recording):
    splits = study.splits(recording)
    assert list(splits) == [
        "without kp=100",
        "without kp=400",
        "without trajectory=sine",
        "without trajectory=mixed",
        "all",
    ]
    for name, split in splits.items():
        out = {r.name for r in split.used_for("heldout")}
        assert all(name.split("=")[-1] in run for run in out) and bool(out) == (name != "all")


def test_a_gain_must_be_said():
    runs = {"one": simulated(1.0, "sine"), "two": simulated(1.0, "sine")}
    with pytest.raises(ConfigurationError, match="position_gain"):
        prepare(Recording.from_arrays("rotary_joint", runs, heldout=["two"]))


def entry(time, angle, **changes):
    return {
        "timestamp": time, "position": angle, "speed": 0.0, "goal_position": 0.5, "load": 0, "input_volts": 7.3,
        "temp": 30, "torque_enable": time < 0.5, **changes,
    }  # fmt: skip


def written(folder, **changes):
    rows = [entry(0.0053 * k, 0.1 * np.sin(0.0053 * k)) for k in range(300)]
    content = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "trajectory": "x", "entries": rows, **changes}
    (folder / "kp100_x.json").write_text(json.dumps(content))
    return folder


def test_the_reader_lays_rows_on_an_even_clock_in_steps_of_the_encoder(tmp_path):
    data = reader.open_dataset(written(tmp_path), Asked())
    (chunk,) = data.records[0].chunks(None)
    time, angle = chunk.columns["time"], chunk.columns["position"]
    np.testing.assert_allclose(np.diff(time), 0.005, atol=1e-12)
    np.testing.assert_allclose(angle, 0.1 * np.sin(time), atol=np.pi / 4096 + 1e-5)  # half a step
    assert np.all(chunk.columns["release_reference"] == (time > 0.5))
    assert data.records[0].conditions["position_gain"] == pytest.approx(100 * 651.9 / (256 * 885), rel=1e-4)


@pytest.mark.parametrize(("changes", "said"), [
    ({"kp": None}, "'kp' is None"),
    ({"entries": []}, "expected an object with rows"),
    ({"entries": [entry(0.0, 0.0), {"timestamp": 1.0}]}, "entry 2: 'position' is missing"),
])  # fmt: skip
def test_damage_is_refused_by_place(tmp_path, changes, said):
    with pytest.raises(ConfigurationError, match=said):
        reader.open_dataset(written(tmp_path, **changes), Asked())


@needs
def test_the_real_set_asks_for_gear_friction_and_a_torque_that_saturates(tmp_path):
    """Fitted on gain 100 alone, errors on gain 400: 0.080 rad naive, 0.049 with the gear, 0.026 with saturation."""
    recording = study.splits(imported("servo-pendulum", SHARED, tmp_path))["without kp=400"]
    held = [float(np.mean(list(rung.heldout.values()))) for rung in study.ladder(recording, study.LADDER[:2])]
    assert held[0] > 0.07 and held[1] < 0.06 and held[2] < 0.03
