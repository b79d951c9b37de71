"""Recordings of a hole and of a circuit as models, against generators that share no integrator with their kernels."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.common import (
    augmented_rig,
    free_parameters,
    motion_coordinates,
    plant_values,
    resample,
    time_since_reversal,
)
from cable_envs.diagnosis.systems.question import Request
from cable_envs.diagnosis.systems.replayed import delayed
from cable_envs.plants import plant_for
from cable_envs.proof.cases import Case, make
from cable_envs.proof.logs.cases import make as make_log
from cable_envs.sim.rigs import load_rig

QUANTISED = float(np.sqrt(1.0 + 0.5**2 / 12.0))
"""RMS of the generators' white noise once it is on a grid of half its standard deviation."""


def _record(time, **data):
    return Record("run", "fit", {"time": np.asarray(time, dtype=float), **{k: np.asarray(v) for k, v in data.items()}})


def test_the_period_of_a_jittery_clock_does_not_drift():
    rng = np.random.default_rng(3)
    time = 5.0 + 0.01 * np.arange(6000) + rng.uniform(-1e-4, 1e-4, 6000)
    assert sample_period([_record(time)]) == pytest.approx(0.01, abs=3e-9)  # 0.02 ms after a minute


def test_gaps_and_unusable_samples_are_not_good():
    time = np.r_[0.01 * np.arange(100), 2.0 + 0.01 * np.arange(100)]
    values = 3.0 * time
    values[20] = np.nan
    at, seen = resample(_record(time, force=values), 0.01, ["force"])
    got = seen["force"]
    assert at[-1] == pytest.approx(time[-1]) and len(at) == 300
    assert not got.good[20] and not got.good[105:199].any()
    assert got.good[[0, 19, 21, 98, 201, 299]].all()
    assert got.values[got.good] == pytest.approx(3.0 * at[got.good], abs=1e-9)


def test_stamps_that_scatter_take_nothing_of_a_vibration():
    """Straight lines between samples take 4 % of 15 Hz where stamps scatter by a fifth of a period."""
    rng, turn = np.random.default_rng(2), 2.0 * np.pi * 15.0
    time = np.sort(0.01 * (np.arange(2000) + rng.uniform(-0.2, 0.2, 2000)))
    at, seen = resample(_record(time, force=np.sin(turn * time)), 0.01, ["force"])
    good = seen["force"].good
    waves = np.column_stack([np.sin(turn * at), np.cos(turn * at)])[good]
    size = np.linalg.lstsq(waves, seen["force"].values[good], rcond=None)[0]
    assert np.hypot(*size) == pytest.approx(1.0, abs=5e-3)


def test_coordinates_of_a_motion():
    time = 0.01 * np.arange(1000)
    position = 0.02 * np.sin(2 * np.pi * 0.2 * time)
    along = {c.name: c for c in motion_coordinates(time, position, "m")}
    speed = 0.02 * 2 * np.pi * 0.2 * np.cos(2 * np.pi * 0.2 * time)
    assert np.abs(along["speed"].values - speed)[20:-20].max() < 0.01 * speed.max()
    assert along["speed"].unit == "m/s"
    turned = along["time since reversal"].values
    assert turned[600] == pytest.approx(6.0 - 3.75, abs=0.1)  # it turned at 1.25 s and at 3.75 s


def test_a_rest_is_no_reversal():
    direction = np.array([0, 1, 1, 0, 0, 1, -1, 0, -1, 1])
    assert time_since_reversal(np.arange(10.0), direction).tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2, 0]


def test_late_by_a_part_of_a_sample():
    time = 0.01 * np.arange(300)
    late = delayed(np.sin(2 * np.pi * 2 * time)[:, None].repeat(2, 1), np.array([0.16, 2.5]))
    for k, seconds in enumerate((0.0016, 0.025)):
        assert np.abs(late[:, k] - np.sin(2 * np.pi * 2 * (time - seconds)))[5:-5].max() < 1e-5


def test_late_samples_are_those_of_the_cubic_through_four_samples():
    """Each by itself by Lagrange's formula; before the record the first sample stands."""
    rng, steps = np.random.default_rng(5), np.array([0.0, 0.4, 1.0, 2.0, 2.5, 7.25, 30.0])
    series = np.cumsum(rng.standard_normal((20, len(steps))), axis=0)
    found = delayed(series, steps)
    for now, (k, late) in itertools.product(range(len(series)), enumerate(steps)):
        at = max(now - late, 0.0)
        second = min(int(at), max(now - 2, 0))
        samples = [second + j for j in (-1, 0, 1, 2)]
        value = sum(
            np.prod([(at - other) / (one - other) for other in samples if other != one])
            * series[min(max(one, 0), len(series) - 1), k]
            for one in samples
        )
        assert found[now, k] == pytest.approx(value, abs=1e-9)


def test_what_is_late_never_looks_ahead():
    series = np.zeros((40, 3))
    series[21:] = 1.0
    assert not delayed(series, np.array([0.1, 0.9, 1.5]))[:21].any()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders and keys of recordings with nothing wrong, white noise."""
    found = {}
    for system, seed in (("cable_hole", 4711), ("pulley_circuit", 4712)):
        folder = tmp_path_factory.mktemp(system)
        found[system] = folder, make(Case("plain", seed, system, "nothing"), folder)
    return found


def _over_noise(model, key, changes=None, without=()):
    """channel -> RMS of the residual at the true parameters, over that of the noise."""
    true = {**key["true_nominal"], **(changes or {})}
    predicted = model.predict(np.array([[true.get(p.name, p.start)] for p in model.parameters]))
    left = {}
    for block, p in zip(model.blocks, predicted, strict=True):
        left.setdefault(block.channel, []).append((block.measured - p[:, 0])[block.good])
    return {c: np.sqrt(np.mean(np.concatenate(r) ** 2)) / key["noise_std"][c] / QUANTISED for c, r in left.items()}


@pytest.mark.parametrize("system", ["cable_hole", "pulley_circuit"])
def test_with_nothing_wrong_only_noise_is_left(made, system):
    """The chain, too, reaches the noise; what is above one standard error (1.5 %) would be numerics."""
    folder, key = made[system]
    question = prepare(load_recording(folder))
    for model in (question.fit, question.heldout):
        for channel, ratio in _over_noise(model, key).items():
            assert ratio == pytest.approx(1.0, abs=0.05), channel
    assert [p.name for p in question.fit.parameters] == [p.name for p in question.heldout.parameters]
    assert set(question.nominals) <= {p.name for p in question.fit.parameters}


def test_a_batch_gives_what_its_columns_give(made):
    model = prepare(load_recording(made["cable_hole"][0])).fit
    columns = np.array([[p.start, p.start * 1.02 + 1e-3 * p.scale] for p in model.parameters])
    names = [p.name for p in model.parameters]
    columns[names.index("sensor_delay.drive_tension"), 1] = 0.003
    both, single = model.predict(columns), [model.predict(columns[:, [k]]) for k in range(2)]
    for k in range(2):
        for together, alone in zip(both, single[k], strict=True):
            assert together[:, k] == pytest.approx(alone[:, 0], rel=1e-9, abs=1e-12)  # sums over other widths


def test_where_the_load_hung_at_first_is_no_mismatch(made):
    """A shift of both counters of a record by the same length changes no residual, but for the spring."""
    recording = load_recording(made["cable_hole"][0])
    before = prepare(recording).heldout
    for record in recording.records:
        for channel in ("drive_position", "load_position"):
            record.data[channel][:] += 1e-5
    after = prepare(recording).heldout
    column = np.array([[p.start] for p in before.parameters])
    for block, a, b in zip(after.blocks, before.predict(column), after.predict(column), strict=True):
        moved = 1e-5 if block.channel.endswith("position") else 0.0
        noise = made["cable_hole"][1]["noise_std"][block.channel]
        assert np.abs(b - a - moved)[block.good].max() < 0.2 * noise, block.channel


def test_a_record_may_begin_in_motion(tmp_path):
    """Its first samples tell the start to millimetres; a spring of 780 N/m would make a newton of each."""
    key = make_log(Case("cut", 550709888, "cable_hole", "nothing", noise="starts in motion"), tmp_path)
    model = prepare(load_recording(tmp_path)).fit
    true = key["true_nominal"]
    predicted = model.predict(np.array([[true.get(p.name, p.start)] for p in model.parameters]))
    for block, p in zip(model.blocks, predicted, strict=True):
        if block.channel == "drive_tension":
            left = (block.measured - p[:, 0])[block.good]
            assert abs(left.mean()) < 0.1 * key["noise_std"]["drive_tension"]  # four and a half standard errors


def test_what_friction_held_before_a_record_is_forgotten_where_it_counts(tmp_path):
    """One record begins in a hold: how far the cable is stretched there, and how it lets go, no record tells.

    Counted from where it has left its place by 3 % it left three times the noise; what friction holds in the next hold
    depends on it a little.
    """
    key = make_log(Case("hold", 1642184952, "cable_hole", "nothing", noise="starts in motion"), tmp_path)
    question = prepare(load_recording(tmp_path))
    assert max(_over_noise(question.fit, key).values()) < 1.03
    assert max(_over_noise(question.heldout, key).values()) < 1.3


@pytest.mark.slow
def test_an_effect_at_its_true_size_leaves_only_noise(tmp_path):
    """Friction that grows with tension: the generator's exponent is the kernel's."""
    key = make(Case("loaded", 4713, "cable_hole", "single", ("load_dependent_friction",), ">10"), tmp_path)
    question = prepare(load_recording(tmp_path))
    exponent = key["effects"][0]["parameters"]["exponent"]["value"]
    with_it = _over_noise(question.fit, key, {"load_dependent_friction.exponent": exponent})
    assert max(with_it.values()) < 1.05
    assert max(_over_noise(question.fit, key).values()) > 1.2
    assert "load_dependent_friction" in {h.name for h in question.hypotheses}


def test_an_effect_in_several_places_is_asked_in_each_of_them_alone(made):
    """Friction of a hole may be in its contact or at its load; other effects have one place."""
    question = prepare(load_recording(made["cable_hole"][0]))
    parts = {h.name: h.parts for h in question.hypotheses if h.parts}
    assert set(parts) == {"asymmetric_friction", "stribeck_friction"}
    difference, contact = parts["asymmetric_friction"]
    assert difference.names == ("asymmetric_friction.difference",) and contact.names == ("asymmetric_friction.contact",)
    assert {n for p in contact.probes for d in p for n in d} == set(contact.names)
    excess, dip = parts["stribeck_friction"]
    assert excess.names == ("stribeck_friction.excess", "stribeck_friction.velocity")
    assert dip.names == ("stribeck_friction.contact", "stribeck_friction.velocity") and dip.parts == ()


@pytest.mark.slow
def test_a_contact_whose_friction_depends_on_the_direction_is_like_a_tension_that_is_read_off(tmp_path):
    """Tensions T exp(+-mu a) with two mu are those with one, times a scale: the right one is at least in the class."""
    key = make(Case("skew", 1318, "cable_hole", "single", ("asymmetric_friction",), ">10"), tmp_path)
    found = diagnose(tmp_path).as_json()
    (effect,) = found["effects"]
    assert "asymmetric_friction" in (effect["name"], *effect["alternatives"])
    if effect["name"] == "asymmetric_friction":
        true = key["effects"][0]["changes"]["asymmetric_friction.difference"]
        assert effect["parameters"]["contact"]["value"] == pytest.approx(true, rel=0.3)


def _edited(folder: Path, target: Path, change) -> Path:
    content = yaml.safe_load((folder / "recording.yaml").read_text(encoding="utf-8"))
    change(content)
    for file in folder.glob("*.csv"):
        (target / file.name).write_bytes(file.read_bytes())
    (target / "recording.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return target


def test_a_claimed_stiffness_may_be_wrong(made, tmp_path):
    def claim(content):
        content["nominal"].pop("cable_stiffness", None)
        content["known"]["cable_stiffness"] = {"value": 2e5, "unit": "N/m"}

    plain = {h.name for h in prepare(load_recording(made["cable_hole"][0])).hypotheses}
    assert "cable_elongation" not in plain  # refitted
    question = prepare(load_recording(_edited(made["cable_hole"][0], tmp_path, claim)))
    found = next(h for h in question.hypotheses if h.name == "cable_elongation")
    assert found.nulls == {"cable_stiffness": 2e5}
    assert all(direction["cable_stiffness"] < 2e5 for probe in found.probes for direction in probe)


@pytest.mark.parametrize(
    ("system", "gone", "named"),
    [
        ("cable_hole", ("drive_velocity_command", "drive_position"), "drive_position"),
        ("cable_hole", ("drive_tension", "load_position", "load_tension"), "drive_tension"),
        ("pulley_circuit", ("drive_angle_command", "drive_angle"), "drive_angle"),
    ],
)
def test_what_is_missing_is_named(made, tmp_path, system, gone, named):
    folder = _edited(made[system][0], tmp_path, lambda c: [c["channels"].pop(name, None) for name in gone])
    with pytest.raises(ConfigurationError, match=named):
        prepare(load_recording(folder))


@pytest.mark.parametrize("system", ["cable_hole", "pulley_circuit"])
def test_without_a_command_the_drive_follows_what_was_recorded(made, tmp_path, system):
    """The noise of the recorded drive is then in all channels: they come within a few times their own."""
    gone = ("drive_velocity_command", "drive_angle_command")
    folder = _edited(made[system][0], tmp_path, lambda c: [c["channels"].pop(name, None) for name in gone])
    question = prepare(load_recording(folder))
    left = _over_noise(question.fit, made[system][1])
    assert "drive_position" not in left and "drive_angle" not in left
    assert max(left.values()) < 15.0


def test_parameters_and_the_rig_found(made):
    recording = load_recording(made["pulley_circuit"][0])
    plant = plant_for("pulley_circuit", "chain")
    values = plant_values(recording, plant)
    free = {p.name: p for p in free_parameters(recording, plant, values, ("cable_damping",))}
    assert set(recording.nominal) < set(free) and "cable_damping" in free
    assert free["shaft_friction"].std == recording.nominal["shaft_friction"].std
    assert not set(free) & set(recording.known)
    found = {**values, "shaft_friction": 0.2, "backlash.gap": 1e-3, "sensor_bias.drive_torque": 0.01}
    rig = load_rig(augmented_rig(plant, found, ["backlash", "sensor_bias.drive_torque"]))
    assert rig.values["shaft_friction"] == 0.2
    assert rig.effects["backlash.gap"] == 1e-3 and rig.effects["sensor_bias.drive_torque"] == 0.01
    again = plant_values(recording, plant, {**rig.values, **rig.effects})
    assert again["backlash.gap"] == 1e-3
    question = prepare(recording, Request(rig={**rig.values, **rig.effects}))
    assert "backlash" not in {h.name for h in question.hypotheses}


def _curved(stiffness, pretension, curvature):
    """Tool's coefficient of T = pre + EA e + EA curvature e^2 about the pretension, e the strain beyond it.

    With T = L (1 + c L / 2), L = L0 + k e:  k = EA / (1 + c L0),  c k^2 / 2 = EA curvature,  pre = L0 (1 + c L0 / 2).
    """

    def beyond(c):
        at_rest = 2.0 * pretension / (1.0 + np.sqrt(1.0 + 2.0 * c * pretension))
        return 0.5 * c * (stiffness / (1.0 + c * at_rest)) ** 2 - stiffness * curvature

    return brentq(beyond, 1e-9, 1.0)


def test_a_cable_that_hardens_has_its_stiffness_about_its_pretension(tmp_path):
    key = make(Case("hard", 4714, "pulley_circuit", "single", ("stiffness_hardening",), ">10"), tmp_path)
    recording = load_recording(tmp_path)
    question = prepare(recording)
    true = {
        name: key["true_nominal"].get(name, recording.value(name)) for name in ("tensile_stiffness", "pretension_top")
    }
    (curvature,) = key["effects"][0]["changes"].values()
    coefficient = _curved(true["tensile_stiffness"], true["pretension_top"], curvature)
    name = "stiffness_hardening.coefficient"
    assert max(_over_noise(question.fit, key, {name: coefficient}).values()) < 1.1
    assert max(_over_noise(question.fit, key).values()) > 1.15

    values = {p.name: p.start for p in question.fit.parameters} | key["true_nominal"] | {name: coefficient}
    rig = load_rig(question.rig(values, ["stiffness_hardening"]))
    assert rig.values["tensile_stiffness"] < 0.9 * true["tensile_stiffness"]  # the plant's is that without tension
    again = prepare(recording, Request(rig={**rig.values, **rig.effects}))
    first = question.fit.predict(np.array([[values[p.name]] for p in question.fit.parameters]))
    second = again.fit.predict(np.array([[p.start] for p in again.fit.parameters]))
    plain = {**values, name: 0.0}
    both = question.fit.predict(np.array([[plain[p.name], values[p.name]] for p in question.fit.parameters]))
    for block, a, b, c in zip(question.fit.blocks, first, second, both, strict=True):
        near = {"rtol": 0.0, "atol": 1e-6 * np.ptp(block.measured)}
        np.testing.assert_allclose(b, a, **near)
        np.testing.assert_allclose(c[:, [1]], a, **near)  # in a batch behind a column that does not harden
