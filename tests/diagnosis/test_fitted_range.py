"""A corrected rig knows the range that it was fitted in, and its simulation says when it is outside."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.report.fitted_range import MARGIN, fitted_range
from cable_envs.plants.base import OUT_OF_RANGE
from cable_envs.proof.cases import Case, make
from cable_envs.sim.rigs import load_rig

ROWS, PERIOD = 1200, 0.01


def _hole(**channels):
    t = PERIOD * np.arange(ROWS)
    place = 0.02 * np.sin(2.0 * t)
    table = {"time": t, "drive_position": place, "drive_tension": 60.0 + 8.0 * np.tanh(1e3 * np.cos(2.0 * t))}
    return Recording.from_arrays("cable_hole", table, channels=channels, known={"load_mass": 5.0})


def test_ranges_are_those_of_the_channels_and_of_their_speeds():
    found = fitted_range(_hole(), "cable_hole")
    assert set(found) == {"drive_position", "drive_velocity", "drive_tension"}
    for name, (low, high) in {"drive_position": (-0.02, 0.02), "drive_tension": (52.0, 68.0)}.items():
        more = MARGIN * (high - low)
        assert found[name]["low"] == pytest.approx(low - more, rel=1e-3)
        assert found[name]["high"] == pytest.approx(high + more, rel=1e-3)
    assert found["drive_velocity"]["high"] == pytest.approx(0.04 * (1.0 + 2.0 * MARGIN), rel=0.02)


def test_of_a_place_without_a_zero_only_the_speed_has_a_range():
    found = fitted_range(_hole(drive_position={"offset_free": "record"}), "cable_hole")
    assert set(found) == {"drive_velocity", "drive_tension"}


def test_what_follows_its_recording_counts_from_the_recordings_zero():
    t = PERIOD * np.arange(ROWS)
    table = {
        "time": t, "drive_angle": np.sin(t), "drive_torque": 0.1 * np.cos(t),
        "output_angle": 0.9 * np.sin(t), "output_torque": 0.08 * np.cos(t),
    }  # fmt: skip
    free = {name: {"offset_free": "record"} for name in ("drive_angle", "output_angle")}
    found = fitted_range(Recording.from_arrays("pulley_circuit", table, channels=free), "transmission")
    assert {"drive_angle", "drive_torque", "output_torque"} <= set(found) and "output_angle" not in found


def test_a_corrected_rig_says_when_it_is_outside(tmp_path):
    """Within the recorded motion an environment of the corrected rig is in range, and faster than that it is not."""
    make(Case("plain", 4711, "cable_hole", "nothing"), tmp_path)
    recording = load_recording(tmp_path)
    records = [replace(r, data={n: v[:400] for n, v in r.data.items()}) for r in recording.records[::2]]
    found = diagnose(replace(recording, records=tuple(records)), effects=["coulomb_friction"])
    rig = load_rig(found.rig)
    assert {"drive_velocity", "load_tension"} <= set(rig.valid)
    assert all(rig.sources[name] == "the fitted records" for name in rig.valid)
    low, high = rig.valid["drive_velocity"]
    only = load_rig({**rig.content(), "valid": {"drive_velocity": {"low": low, "high": high}}})
    env = gym.make("cable_envs/CableHole-Position-Sine-v1", rig=only, action_mode="speed")
    env.reset(seed=0)
    speeds = only.values["drive_speed_limit"] * np.linspace(0.0, 1.0, 100)
    assert low < 0.0 < high < speeds[-1]
    infos = [env.step(np.array([k / 99.0], np.float32))[4] for k in range(100)]
    beyond = [not low <= info["drive_velocity"] <= high for info in infos]
    assert [info["out_of_range"] > 0.0 for info in infos] == beyond and any(beyond) and not all(beyond)


@pytest.mark.parametrize("plant", ["linear_drive", "transmission", "band_brake", "coupled_drives"])
def test_rigs_of_benches_may_say_their_range(plant):
    signal = load_rig({"plant": plant}).simulated_by().signals[0]
    rig = load_rig({"plant": plant, "valid": {signal.name: {"low": -1.0, "high": 1.0, "unit": signal.unit}}})
    assert rig.valid == {signal.name: (-1.0, 1.0)}
    assert OUT_OF_RANGE.name in {s.name for s in rig.simulated_by().signals}
