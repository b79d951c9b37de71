"""Long recordings are averaged to fewer samples, and answered as if they were not."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording, diagnose
from cable_envs.diagnosis.data import thinning
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.entries import Doubt
from cable_envs.diagnosis.intake import gate
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.common import mean_over_samples
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from cablebench.pages.diagnosis import render
from cablebench.pages.diagnosis_words import lines

MASS, VISCOUS, STIFFNESS = 2.5, 12.0, 60.0
KP, KV, KD = 4000.0, 150.0, 150.0
NOISE = {"position": 1e-5, "velocity": 1e-3, "force": 0.05}


def drive(seed, seconds=20.0, period=1e-3, noise=True):
    """A run of a drive with a spring under a PD controller, linear and therefore solved exactly between samples."""
    rng = np.random.default_rng(seed)
    t = period * np.arange(round(seconds / period))
    w, a, p = 2 * np.pi * rng.uniform(0.3, 1.4, 3), rng.uniform(0.005, 0.015, 3), rng.uniform(0, 6, 3)
    path = (a * np.sin(np.outer(t, w) + p)).sum(axis=1) - float(np.sum(a * np.sin(p)))
    rate = (a * w * np.cos(np.outer(t, w) + p)).sum(axis=1)
    matrix = [[0.0, 1.0], [-(KP + STIFFNESS) / MASS, -(KD + VISCOUS) / MASS]]
    system = StateSpace(matrix, [[0.0, 0.0], [KP / MASS, KV / MASS]], np.eye(2), np.zeros((2, 2)))
    _, state, _ = lsim(system, np.column_stack([path, rate]), t, X0=[0.0, rate[0]])
    x, v = state.T
    clean = {"position": x, "velocity": v, "force": KP * (path - x) + KV * rate - KD * v}
    seen = {n: s + (rng.normal(0.0, NOISE[n], len(t)) if noise else 0.0) for n, s in clean.items()}
    return {"time": t, "position_reference": path, **seen}


def drives(**options):
    return Recording.from_arrays(
        "linear_drive", {f"run_{k}": drive(10 + k, **options) for k in range(3)}, noise=NOISE, heldout="run_2",
        known={"coulomb": 0.0, "mass": MASS}, nominal={"viscous": {"value": 10.0, "std": 4.0}},
    )  # fmt: skip


@pytest.fixture(scope="module")
def long():
    return drives()


def recording(data, **channels):
    return Recording.from_arrays("cable_hole", [data], channels=channels)


def holes(seconds=60.0, held=10, every=1e-3):
    """A sine of a hole at 1 kHz whose speed command is held for ``held`` rows; tension with noise of 0.1 N."""
    t = every * np.arange(round(seconds / every))
    speed = np.repeat(0.01 * np.cos(2 * np.pi * 0.5 * t[::held]), held)[: len(t)]
    tension = 50.0 + np.sin(2 * np.pi * 0.5 * t) + np.random.default_rng(1).normal(0.0, 0.1, len(t))
    return {
        "time": t,
        "drive_velocity_command": speed,
        "drive_position": np.cumsum(speed) * every,
        "drive_tension": tension,
    }


def how(of):
    return thinning.thinning(of, gate.POSITIONS)


def test_short_and_slow_recordings_stay_as_they_are():
    short = drives(seconds=3.0)
    assert how(short).every == 1 and thinning.thinned(short, how(short)) is short
    slow = recording(holes(seconds=400.0, held=1, every=0.01))
    assert len(slow.records[0].time) > thinning.ENOUGH and how(slow).every == 1


def test_the_new_period_keeps_what_the_motion_has(long):
    found = how(long)
    assert found.every == 5 and 1.0 < found.fastest < 2.0
    data = holes()
    data["drive_position"] = data["drive_position"] + 0.002 * np.sin(2 * np.pi * 30.0 * data["time"])
    fast = how(recording(data))
    assert 30.0 <= fast.fastest < 33.0 and fast.every == 1  # a wave of 30 Hz has 20 samples at 1.7 ms
    rest = {"time": data["time"][:5000], **{n: v[:5000] * 0.0 + v[0] for n, v in data.items() if n != "time"}}
    still = Recording.from_arrays("cable_hole", {"run": holes(), "still": rest}, rest="still")
    assert how(still).every == 2  # of 5000 samples at rest 2000 must stay


def test_a_mean_has_less_noise_and_the_statement_says_so(long):
    found = how(long)
    fewer = thinning.thinned(long, found)
    clean = thinning.thinned(drives(noise=False), found)
    for name, std in NOISE.items():
        assert fewer.noise[name] == pytest.approx(std / np.sqrt(5.0))
        off = fewer.records[0].data[name] - clean.records[0].data[name]
        assert np.std(off) == pytest.approx(fewer.noise[name], rel=0.05)
        assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 0.04  # white noise stays white
    assert thinning.noise_left(4) == pytest.approx(np.sqrt(3.5) / 4.0)
    assert sample_period(fewer.records) == pytest.approx(0.005)
    text = thinning.statement(long, fewer, found)
    assert text.startswith("60000 rows, one every 1 ms, were averaged to 12000 samples, one every 5 ms")


def test_counts_of_an_encoder_are_resolved_by_the_mean():
    data = holes()
    count = 1e-4
    data["drive_position"] = count * np.round(
        (data["drive_position"] + np.random.default_rng(2).normal(0.0, count, 60_000)) / count
    )
    of = recording(data)
    fewer = thinning.thinned(of, how(of)).records[0]
    true = np.interp(fewer.time, data["time"], holes()["drive_position"])
    alone = np.std(data["drive_position"] - holes()["drive_position"])
    assert np.std(fewer.data["drive_position"] - true) < 1.1 * alone / np.sqrt(5.0)


@pytest.mark.parametrize("lost", [0, 3])
def test_held_commands_stay_what_acted(lost):
    """Whatever the first row is: new rows fall on the command's steps, and hold what was held."""
    data = {name: values[lost:] for name, values in holes(held=10).items()}
    of = recording(data, drive_velocity_command={"hold": "step"})
    found = how(of)
    assert (found.every, found.steps) == (5, 10)
    fewer = thinning.thinned(of, found).records[0]
    acted = data["drive_velocity_command"][np.round((fewer.time - data["time"][0]) / 1e-3).astype(int)]
    assert np.array_equal(fewer.data["drive_velocity_command"], acted)
    other = thinning.thinned(of, thinning.Thinning(3, 1e-3, 1.0)).records[0]  # steps that no sample of 3 ms meets
    moved = np.cumsum(other.data["drive_velocity_command"]) * 3e-3
    true = np.interp(other.time + 3e-3, data["time"] + 1e-3, np.cumsum(data["drive_velocity_command"]) * 1e-3)
    assert np.ptp(moved - true) < 1e-12  # the way is that of the command all the same


def test_marks_gaps_and_jitter_are_kept():
    data = holes()
    rng = np.random.default_rng(4)
    data["time"] = data["time"] + rng.uniform(-2e-4, 2e-4, 60_000)
    clean = {name: values.copy() for name, values in data.items()}
    data["drive_tension"][20_000:20_040] = np.nan
    data["drive_tension"][30_001:60_000:50] = np.nan
    keep = np.r_[0:40_000, 40_004:60_000]
    of = recording({name: values[keep] for name, values in data.items()})
    record = of.records[0]
    marked = Recording(**{**of.__dict__, "records": (type(record)(**{**record.__dict__, "quality": (
        Doubt("stuck", "", "drive_position", 5.0, 6.0),)}),)})  # fmt: skip
    found = how(marked)
    fewer = thinning.thinned(marked, found).records[0]
    assert np.isnan(fewer.data["drive_tension"]).sum() == pytest.approx(8, abs=2)
    inside = (fewer.time > 5.01) & (fewer.time < 5.99)
    assert not fewer.usable("drive_position")[inside].any() and fewer.usable("drive_position")[~inside].mean() > 0.99
    at = np.interp(fewer.time, clean["time"], holes()["drive_position"])
    good = fewer.usable("drive_position")
    true = np.interp(fewer.time, holes()["time"], holes()["drive_position"])
    assert np.abs(fewer.data["drive_position"] - at)[good].max() < np.abs(at - true).max() + 3e-6
    assert np.allclose(np.diff(fewer.time), 0.005, atol=1e-6)


@pytest.mark.parametrize("fine", [1, 4, 5, 10])
def test_means_of_a_prediction(fine):
    at = (np.arange(fine * 400) + 1.0) / fine - 1.0  # the last of each is of the sample's moment
    wave = 2 * np.pi * 0.04
    found = mean_over_samples(np.cos(wave * at)[:, None], fine)
    true = np.cos(wave * np.arange(400)) * np.sinc(0.04)
    assert np.abs(found[2:-2, 0] - true[2:-2]).max() < (2e-4 if fine in (1, 10) else 4e-4)
    assert np.abs(found[-1, 0] - true[-1]) < 0.01


def test_a_model_averages_what_it_predicts(long):
    """The true drive predicts the means of its own noiseless rows far below their noise."""
    from cable_envs.diagnosis.asked import request_of

    clean = drives(noise=False)
    fewer = thinning.thinned(clean, how(clean))
    asked = prepare(fewer, request_of(fewer, effects=["position_dependent_load"]))
    values = {p.name: p.start for p in asked.fit.parameters}
    values |= {"viscous": VISCOUS, "load_stiffness": STIFFNESS, "control.hold": 1e-6, "control.read": 0.0}
    values |= {"control.kp": KP, "control.kv": KV, "control.kd": KD}
    assert "load_stiffness" in values or "position_dependent_load.stiffness" in values
    values |= {n: STIFFNESS for n in values if n.endswith("load.stiffness") or n == "load_stiffness"}
    column = np.array([[values[p.name]] for p in asked.fit.parameters])
    for block, found in zip(asked.fit.blocks, asked.fit.predict(column), strict=True):
        off = (block.measured - found[:, 0])[block.good]
        assert np.sqrt(np.mean(off**2)) < 0.1 * fewer.noise[block.channel], block.channel


def test_a_hole_under_held_commands_is_predicted_as_it_was_averaged():
    from cable_envs.diagnosis.asked import request_of

    plant = plant_for("cable_hole")
    values = {p.name: p.default for p in plant.table} | {"extrusion_gain": 0.0}  # absent, as nobody states it
    data = holes(held=10)
    column = plant.table.pack(values)[:, None]
    command = np.r_[0.0, data["drive_velocity_command"][:-1]]  # what acted over the step that ends there
    names = ("drive_position", "drive_velocity", "drive_tension")
    out = replay(plant, column, command, 1e-3, drive="speed", hold="step", signals=names, substeps=4)
    data |= {name: out[:, k, 0] for k, name in enumerate(names)}
    of = recording(data, drive_velocity_command={"hold": "step"})
    fewer = thinning.thinned(of, how(of))
    asked = prepare(fewer, request_of(fewer, effects=["backlash"]))
    start = np.array([[p.start] for p in asked.fit.parameters])
    sizes = {"drive_position": 1e-6, "drive_velocity": 1e-4, "drive_tension": 0.05}
    for block, found in zip(asked.fit.blocks, asked.fit.predict(start), strict=True):
        off = (block.measured - found[:, 0])[block.good]
        assert np.sqrt(np.mean(off**2)) < 0.1 * sizes[block.channel], block.channel


def test_only_what_is_predicted_as_a_mean_is_averaged(long):
    from cable_envs.diagnosis.systems import looked_at

    assert looked_at(long).averages and looked_at(recording(holes(seconds=1.0))).averages
    t = 1e-3 * np.arange(20_000)
    data = {"time": t, "voltage": np.sin(t), "speed_reading": np.abs(np.sin(t))}
    coupled = Recording.from_arrays("linear_drive", [data])
    assert not looked_at(coupled).averages  # a model of its own, of samples of a moment


@pytest.mark.parametrize(
    ("seconds", "enough"), [(3.0, 1800), pytest.param(20.0, thinning.ENOUGH, marks=pytest.mark.slow)]
)
def test_so_many_rows_are_answered_and_the_answer_says_how(monkeypatch, seconds, enough):
    monkeypatch.setattr(thinning, "ENOUGH", enough)
    rows, said = round(3000 * seconds), []
    recording = drives(seconds=seconds)
    found = diagnose(recording, effects=["position_dependent_load", "actuator_lag"], tell=said.append)
    assert found.verdict == "named"
    (effect,) = found.effects
    assert effect.name == "position_dependent_load"
    assert effect.parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=0.02 if seconds == 20.0 else 0.06)
    averaged = found.about["averaged"]
    assert (averaged["rows"], averaged["samples"], averaged["every"]) == (rows, rows // 5, 5)
    assert found.notes[0] == averaged["why"] and f"{rows} rows" in averaged["why"]
    assert f"averaging {rows} rows to {rows // 5} samples" in said
    record = found.as_json()
    assert any(f"{rows} rows" in line for line in lines(record)) and f"{rows} rows" in render(record)


def test_rows_that_are_too_many_even_so_are_refused_with_what_would_help(monkeypatch):
    monkeypatch.setattr(gate, "MOST", 9000)
    of = drives(seconds=16.0)
    with pytest.raises(ConfigurationError, match=r"48000 rows make 12000 samples .* at most 9000"):
        diagnose(of)
