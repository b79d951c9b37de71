"""A user's own effect with a memory is concealed in records; the diagnosis, told of its file, names and fits it."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import JIT_DISABLED
from cable_envs.diagnosis import Recording, diagnose
from cable_envs.plants import plant_for
from cable_envs.plants.own_effects import load_effect, with_own_effects
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig

EXAMPLES = Path(__file__).parents[2] / "examples" / "effects"
PERIOD, SECONDS = 0.01, 12.0
NOISE = {
    "drive_position": 5e-6, "drive_velocity": 1e-4, "drive_tension": 0.1, "load_position": 1e-5, "load_tension": 0.1,
}  # fmt: skip
RIG = load_rig("gu-inferred")
KNOWN = ("load_mass", "gravity", "load_gravity", "wrap_angle", "radius_ratio", "cable_radius")
NOMINAL = ("friction_coefficient", "extrusion_delta", "extrusion_gain", "extrusion_exponent", "cable_stiffness",
           "cable_damping")  # fmt: skip


def records(file, **changes):
    """Three runs of a cable through a hole by the speed of its drive, with the effect; they do not tell of it."""
    effect = load_effect(file)
    plant = with_own_effects(plant_for("cable_hole"), (effect,))
    values = plant.table.pack({**RIG.values, **{f"{effect.name}.{name}": v for name, v in changes.items()}})[:, None]
    rng, runs = np.random.default_rng(1), {}
    time = np.arange(round(SECONDS / PERIOD) + 1) * PERIOD
    for name, pace in (("slow", 0.15), ("middle", 0.2), ("fast", 0.25)):
        speed = 0.006 * np.sin(2 * np.pi * pace * time) + 0.003 * np.sin(2 * np.pi * 2.7 * pace * time)
        state = plant.rest(plant.prepare(values), np.zeros(1))
        rest = state[[plant.row(signal) for signal in NOISE], 0]
        seen = replay(
            plant, values, speed[:-1], PERIOD, drive="speed", hold="step", signals=list(NOISE), state=state,
            rate=np.zeros(len(time) - 1), substeps=10,
        )[:, :, 0]  # fmt: skip
        seen = np.vstack([rest, seen]) + rng.normal(size=(len(time), len(NOISE))) * list(NOISE.values())
        runs[name] = {"time": time, "drive_velocity_command": np.r_[speed[:-1], speed[-2]]}
        runs[name] |= dict(zip(NOISE, seen.T, strict=True))
    return Recording.from_arrays(
        "cable_hole", runs, noise=NOISE, known={n: RIG.values[n] for n in KNOWN}, heldout="fast", rig="gu-inferred",
        nominal={n: {"value": RIG.values[n]} for n in NOMINAL}, channels={"drive_velocity_command": {"hold": "step"}},
    )  # fmt: skip


CASES = {
    "wear": {"growth": 0.5},
    "temperature": {"slope": -0.04, "constant": 5.0},  # slope and resistance act as one number
    "lugre": {"level": 4.0, "displacement": 5e-5},
    "elasto_plastic": {"level": 4.0, "displacement": 5e-5},
}


def left(recording, rig):
    """RMS of what a rig leaves of the held-out record, over the noise, by channel."""
    plant = rig.simulated_by()
    record = recording.used_for("heldout")[0]
    speed = record.data["drive_velocity_command"][:-1]
    values = plant.table.pack({**rig.values, **rig.effects})[:, None]
    out = replay(
        plant, values, speed, PERIOD, drive="speed", hold="step", signals=list(NOISE), rate=np.zeros(len(speed)),
        substeps=10,
    )[:, :, 0]  # fmt: skip
    return [
        np.sqrt(np.mean((record.data[name][1:] - path) ** 2)) / NOISE[name]
        for name, path in zip(NOISE, out.T, strict=True)
    ]


@pytest.mark.slow  # a minute each
@pytest.mark.skipif(JIT_DISABLED, reason="takes hours")
@pytest.mark.parametrize("name", CASES)
def test_an_effect_of_ones_own_is_named_fitted_and_simulated(name, tmp_path):
    file, hidden = EXAMPLES / f"{name}.py", CASES[name]
    effect, recording = load_effect(file), records(file, **hidden)
    found = diagnose(recording, effect_file=file)
    assert found.verdict == "named" and [one.name for one in found.effects] == [name]
    true = {p.name: p.null for p in effect.parameters} | hidden
    for parameter, estimate in found.effects[0].parameters.items():
        width = estimate.high - estimate.low  # four standard errors
        assert abs(estimate.value - true[parameter]) < width < 0.5 * abs(true[parameter]), parameter

    found.write(tmp_path)
    with pytest.raises(ConfigurationError, match=f"unknown effect '{name}'"):
        load_rig(tmp_path / "augmented.yaml")
    corrected = load_rig(tmp_path / "augmented.yaml", (effect,))
    assert max(left(recording, RIG)) > 1.3
    assert max(left(recording, corrected)) < 1.18  # as much as a named effect may leave (docs/diagnosis.md)


@pytest.mark.slow  # compiles the kernel of an environment, and diagnoses twice
@pytest.mark.skipif(JIT_DISABLED, reason="takes hours")
def test_the_corrected_rig_lacks_nothing_more_and_runs_as_an_environment(tmp_path):
    file, recording = EXAMPLES / "wear.py", records(EXAMPLES / "wear.py", growth=0.5)
    few = ["wear", "friction_drift", "coulomb_friction"]
    diagnose(recording, effects=few, effect_file=file).write(tmp_path)
    again = diagnose(recording, effects=few, effect_file=file, rig=tmp_path / "augmented.yaml")
    assert again.verdict == "no_detectable_mismatch"
    options = {"rig": tmp_path / "augmented.yaml", "effect_file": file, "duration": 4.0}
    ends = []
    for growth in ({}, {"effects": {"wear": {"growth": 0.0}}}):
        worn = gym.make("cable_envs/CableHole-Position-Sine-v1", **options, **growth)
        worn.reset(seed=0)
        for k in range(200):
            *_, info = worn.step(np.array([0.3 * np.sin(0.1 * k)], np.float32))
        ends.append(info["load_position"])
    assert abs(ends[0] - ends[1]) > 1e-5
