"""The next experiment: what a motion is worth, motions within limits, and a record that settles what was open."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.joined import joined
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.experiment.bench import Bench, Planned
from cable_envs.diagnosis.experiment.design import next_experiment
from cable_envs.diagnosis.experiment.motions import FAMILIES, REST, Limits, Motion
from cable_envs.diagnosis.experiment.rivals import names_of, rivals
from cable_envs.diagnosis.experiment.settings import checked
from cable_envs.diagnosis.experiment.worth import Told, divergence, divergences, narrowing
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.verdict import Diagnosis, EffectGain
from cable_envs.diagnosis.search.known.noise import told_at_rest
from cable_envs.diagnosis.systems import driven_by
from cable_envs.proof.cases import Case, make

ROOT = Path(__file__).parents[2]

LIMITS = {"low": -0.7, "high": 0.7, "speed": 3.0, "acceleration": 30.0}


def _told(rng, free, scale=1.0):
    root = rng.normal(size=(free, free))
    return Told(scale * rng.normal(size=25), rng.normal(size=(25, free)), 0.3 * root @ root.T)


def _dense(told):
    return np.eye(len(told.values)) + told.slopes @ told.covariance @ told.slopes.T


def test_expected_log_odds_are_the_divergence_of_two_normal_distributions():
    """Against the textbook's formula with full covariance matrices, and against drawn records."""
    rng = np.random.default_rng(3)
    one, other = _told(rng, 3), _told(rng, 4)
    s, t, apart = _dense(one), _dense(other), one.values - other.values
    inverse = np.linalg.inv(t)
    plain = 0.5 * (apart @ inverse @ apart + np.trace(inverse @ s) - 25)
    plain += 0.5 * (np.linalg.slogdet(t)[1] - np.linalg.slogdet(s)[1])
    assert divergence(one, other) == pytest.approx(plain, rel=1e-9)
    drawn = rng.multivariate_normal(one.values, s, size=20_000)

    def log(model, covariance):
        off = drawn - model.values
        return -0.5 * (np.einsum("ki,ij,kj->k", off, np.linalg.inv(covariance), off) + np.linalg.slogdet(covariance)[1])

    odds = log(one, s) - log(other, t)
    assert divergence(one, other) == pytest.approx(odds.mean(), abs=4.0 * odds.std() / np.sqrt(len(odds)))


def test_a_record_narrows_parameters_as_bayes_says():
    one = _told(np.random.default_rng(4), 3)
    after = np.linalg.inv(np.linalg.inv(one.covariance) + one.slopes.T @ one.slopes)
    np.testing.assert_allclose(narrowing(one) ** 2, np.diag(after) / np.diag(one.covariance), rtol=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_motions_keep_to_the_limits_and_begin_and_end_at_rest(family):
    rng, limits, period = np.random.default_rng(7), Limits(-0.2, 0.5, 0.4, 3.0), 0.01
    travels = []
    for _ in range(40):
        start = rng.uniform(limits.low, limits.high)
        place = Motion(family, rng.uniform(size=4)).samples(limits, start, period, 1201)
        still = round(REST / period)
        assert np.ptp(place[:still]) == 0.0 and place[0] == pytest.approx(start) and np.ptp(place[-still + 1 :]) < 1e-12
        assert limits.low - 1e-9 <= place.min() and place.max() <= limits.high + 1e-9
        assert np.max(np.abs(np.diff(place))) / period <= limits.speed * (1 + 1e-9)
        assert np.max(np.abs(np.diff(place, 2))) / period**2 <= limits.acceleration * (1 + 1e-9)
        travels.append(np.ptp(place))
    assert max(travels) > 0.3 * limits.span and min(travels) < 0.1 * limits.span


@pytest.mark.parametrize("family", FAMILIES)
def test_no_wave_is_faster_than_the_samples_resolve(family):
    """Of a small and quick motion within wide limits; the next is 40 times as quick where no frequency is stated."""
    slow, quick = (Limits(-1.0, 1.0, 1e3, 1e5, frequency) for frequency in (5.0, np.inf))
    motion = Motion(family, np.array([0.0, 1.0, 1.0, 1.0]))
    waves = [
        np.sum(np.diff(np.signbit(motion.samples(limits, 0.0, 1e-3, 12_000))) != 0) / 2.0 for limits in (slow, quick)
    ]
    assert waves[0] <= 5.0 * 12.0 + 1.0 and waves[1] > 3.0 * waves[0]


def test_limits_that_nothing_can_keep_to_are_refused():
    with pytest.raises(ConfigurationError, match="low < high"):
        Limits(1.0, 0.0, 1.0, 1.0)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The sample rig, and how it answers a motion: by the simulator that made it, which shares none with the tool."""
    spec = importlib.util.spec_from_file_location("sample_rig", ROOT / "examples" / "sample_rig" / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    folder = tmp_path_factory.mktemp("rig")

    def recorded(name, path, use, seed):
        """A recording with one record of a path, rad at every ms, and one at rest."""
        at = np.arange(0.0, len(path) * 1e-3 - 1e-9, make.PERIOD)
        content = yaml.safe_load(make.recording())
        content["records"] = [{"data": f"{name}.csv", "use": use}, {"data": "rest.csv", "use": "rest"}]
        (folder / name).mkdir()
        (folder / name / "recording.yaml").write_text(yaml.safe_dump(content))
        log = make.table(make.sensed(make.signals(path), at, np.random.default_rng(seed)))
        (folder / name / f"{name}.csv").write_text(log)
        (folder / name / "rest.csv").write_text((ROOT / "examples" / "sample_rig" / "rest.csv").read_text())
        return load_recording(folder / name)

    time = np.arange(5000) * 1e-3
    first = recorded("first", 0.1 * np.sin(2.0 * np.pi * 0.3 * time) * np.minimum(2.0 * time, 1.0), "fit", 5)
    return first, recorded


def test_no_motion_settles_what_the_data_are_at_fault_for():
    clock = EffectGain(Hypothesis("logger.clock", (), (), "t -> (1 + c) t", "time a minute by a good clock"))
    alone = [{"name": "logger.clock", "log_odds": 34.2}, {"name": "sensor_scale.velocity", "log_odds": 33.2}]
    found = Diagnosis("data_fault", (), (), {}, {}, {}, faults=(clock,), hypotheses=tuple(alone))
    with pytest.raises(ConfigurationError, match="the answer is a fault of the data; time a minute by a good clock"):
        names_of(found)
    assert names_of(replace(found, verdict="unknown")) == [("sensor_scale.velocity",)]


def test_the_rival_is_in_the_sensor_that_could_not_be_told_apart():
    """An answer's alternatives are names alone; a bias of the other sensors was told apart, and is no rival."""
    friction = EffectGain(
        Hypothesis("asymmetric_friction", (), (), "", ""), alternatives=("sensor_bias",),
        rivals={"sensor_bias.position": 90.0, "sensor_bias.tension": 2.9, "load_dependent_friction": 59.0},
    )  # fmt: skip
    found = Diagnosis("equivalence_class", (friction,), (), {}, {}, {})
    assert names_of(found) == [("asymmetric_friction",), ("sensor_bias.tension",)]
    learnt = replace(friction, rivals={"sensor_bias.position": 90.0, "sensor_bias.tension": 6.0})  # 8 are asked there
    assert names_of(replace(found, effects=(learnt,)))[1:] == [("sensor_bias.tension",)]
    scale = EffectGain(Hypothesis("sensor_scale.speed", (), (), "", ""), rivals={"sensor_scale.position": -0.3})
    assert names_of(replace(found, effects=(scale,))) == [("sensor_scale.speed",), ("sensor_scale.position",)]
    clock = replace(scale, alternatives=("logger.clock",), rivals={**scale.rivals, "logger.clock": 0.1})
    assert names_of(replace(found, effects=(clock,)))[1:] == [("sensor_scale.position",)]  # no motion tells a clock
    unsaid = replace(friction, rivals={})
    assert names_of(replace(found, effects=(unsaid,))) == [("asymmetric_friction",), ("sensor_bias",)]


def test_the_interval_narrows_as_was_expected(bench):
    first, recorded = bench
    found = diagnose(first)
    (effect,) = found.effects
    assert effect.name == "actuator_lag" and names_of(found) == [("actuator_lag",)]
    plan = next_experiment(first, found, limits=LIMITS)
    assert plan.purpose == "narrow" and plan.channel.name == "drive_angle_command" and plan.tried > 50
    path = np.interp(np.arange(round(plan.time[-1] * 1e3)) * 1e-3, plan.time, plan.values)
    both = joined(first, [recorded("next", path, "fit", 6)])
    assert [r.use for r in both.records] == ["fit", "rest", "fit"]
    (after,) = diagnose(both).effects
    before, expected = plan.narrowed["actuator_lag.time"]
    widths = [np.ptp((e.parameters["time"].low, e.parameters["time"].high)) for e in (effect, after)]
    # the interval is of the discrepancy, too, and of batches of few records: a factor of two
    assert 0.5 < (widths[1] / widths[0]) / (expected / before) < 2.0
    assert after.parameters["time"].low < 0.015 < after.parameters["time"].high


@pytest.mark.slow
def test_odds_of_rivals_come_out_as_was_expected(bench):
    """A delay of the angle's sensor is all but the lag of the drive in slow motion, and no more in the next record."""
    first, recorded = bench
    between = ["actuator_lag", "sensor_delay.output_angle"]
    gentle = {"low": -0.1, "high": 0.1, "speed": 0.2, "acceleration": 3.0}
    found = diagnose(first, effects=["actuator_lag"])
    plan = next_experiment(first, found, between=between, limits=gentle, seconds=4.0)
    assert plan.rivals[0] == "actuator_lag" and plan.behind[0] == 0.0 < plan.behind[1]
    assert plan.least == plan.expected[0, 1]  # the other one is ruled out already
    path = np.interp(np.arange(4000) * 1e-3, plan.time, plan.values)
    both = joined(first, [recorded("odds", path, "fit", 8)])
    question = told_at_rest(both, ask(both, request_of(both)))
    lead, other = rivals(question, [(n,) for n in between], {})
    assert lead.name == "actuator_lag"
    assert other.behind == pytest.approx(plan.expected[0, 1], rel=0.5)
    if not plan.expected[0, 1] > 2.0 * plan.repeated[0, 1]:
        pytest.xfail("log odds of 1826, and 1097 by a repeated record, since a discrepancy counts as far as it is told")


def test_a_rival_that_may_be_in_several_places_is_compared_in_the_best_of_them(tmp_path):
    """As the search compares it: a place in which nothing is missing costs it no parameter."""
    make(Case("skew", 1318, "cable_hole", "single", ("asymmetric_friction",), ">10"), tmp_path)
    recording = load_recording(tmp_path)
    question = told_at_rest(recording, ask(recording, request_of(recording)))
    found = rivals(question, [("asymmetric_friction",), ("sensor_scale.drive_tension",)], {})
    assert {rival.name for rival in found} == {"asymmetric_friction", "sensor_scale.drive_tension"}
    (own,) = (r.candidate.effects[0] for r in found if r.name == "asymmetric_friction")
    assert own.names == ("asymmetric_friction.contact",)
    # an answer names its alternatives without their sensors: each that it may be of is a rival
    asked = {h.name for h in question.hypotheses if h.canonical == "sensor_scale"}
    every = rivals(question, [("asymmetric_friction",), ("sensor_scale",)], {})
    assert {rival.name for rival in every} == {"asymmetric_friction", *asked}


def test_another_pretension_tells_friction_of_the_cable_from_that_of_the_joint(tmp_path):
    """In a circuit the pretension holds the tension: no motion tells them apart, another pretension does."""
    make(Case("slack", 2024, "pulley_circuit", "single", ("load_dependent_friction",), ">10"), tmp_path)
    recording = load_recording(tmp_path)
    request = request_of(recording)
    question = told_at_rest(recording, ask(recording, request))
    models = [("coulomb_friction",), ("load_dependent_friction",)]
    planning = Bench(recording, request, question, rivals(question, models, {}))
    first = planning.run[0]
    (setting,) = checked(recording, request, [{"pretension_top": 120.0, "pretension_bottom": 120.0}])
    planned = [Planned(f"next {k}", planning.place(first), first, own) for k, own in enumerate(({}, setting))]
    assert planned[1].conditions == {**first.conditions, **setting}
    as_it_is, tighter = (divergences(told) for told in planning.told(planned))
    apart = ~np.eye(2, dtype=bool)
    assert tighter[apart].min() > 20.0 > 4.0 * as_it_is[apart].min()


def test_settings_that_a_rig_cannot_have_are_refused(bench):
    first, _ = bench
    request = request_of(first)
    for wrong, why in (
        ({"pretensoin_top": 9.0}, "pretension_top"),
        ({"pretension_top": -1.0}, "pretension_top"),
        ({}, "a parameter"),
    ):
        with pytest.raises(ConfigurationError, match=why):
            checked(first, request, [wrong])


def test_sensors_that_read_exactly_nothing_at_first_are_planned_with(tmp_path):
    """Readings that a planned record does not have fit no constant, whatever the first of them are."""
    make(Case("plain", 4711, "cable_hole", "nothing"), tmp_path)
    recording = load_recording(tmp_path)
    shown = []
    for begins in (None, 0.0):
        records = list(recording.records)
        if begins is not None:
            data = {n: v.copy() for n, v in records[0].data.items()}
            data["drive_velocity"][:20] = begins
            records[0] = replace(records[0], data=data)
        given = replace(recording, records=tuple(records))
        request = request_of(given)
        question = ask(given, request)
        planning = Bench(given, request, question, rivals(question, [("coulomb_friction",)], {}))
        first = planning.run[0]
        (told,) = planning.told([Planned("next", planning.place(first), first)])
        assert told is not None
        shown.append(told[0].values)
    # predictions in standard deviations of noise: where the record began does not make them others
    np.testing.assert_allclose(shown[0], shown[1], atol=0.5)


def test_a_plan_is_written_in_the_unit_of_the_recording_and_says_what_to_expect(bench, tmp_path):
    first, _ = bench
    plan = next_experiment(first, diagnose(first, effects=["actuator_lag"]), limits=LIMITS, seconds=3.0)
    plan.write(tmp_path)
    table = np.genfromtxt(tmp_path / "reference.csv", delimiter=",", skip_header=2)
    np.testing.assert_allclose(table[:, 1], plan.in_unit(), rtol=1e-8, atol=1e-9)
    assert np.diff(table[:, 0]).max() < 1.001e-3  # a drive goes straight from row to row
    straight = [np.abs(np.interp(plan.time, plan.time[::n], plan.values[::n]) - plan.values).max() for n in (2, 10)]
    assert 0.0 < straight[0] < 0.06 * straight[1]  # the square of (2 / 10): the motion is smooth between samples
    said = json.loads((tmp_path / "experiment.json").read_text())
    assert said["schema"] == "cable-experiment/1" and said["seconds"] == pytest.approx(3.0, abs=0.02)
    assert any("standard deviation falls to" in line for line in plan.lines())
    tighter = replace(plan, settings={"pretension_top": (120.0, "N")})
    assert tighter.as_json()["settings"] == {"pretension_top": {"value": 120.0, "unit": "N"}}
    assert any(line.startswith("Set pretension_top to 120 N for it") for line in tighter.lines())


def test_wrong_requests_are_refused(bench):
    first, _ = bench
    found = diagnose(first, effects=["actuator_lag"])
    with pytest.raises(ConfigurationError, match=r"limit 'sped'.*speed"):
        next_experiment(first, found, limits={"sped": 1.0})
    with pytest.raises(ConfigurationError, match="actuator_lag"):
        next_experiment(first, found, between=["actuator_lgg", "backlash"])
    with pytest.raises(ConfigurationError, match="above 0 s"):
        next_experiment(first, found, seconds=0.0)
    time = np.linspace(0.0, 2.0, 401)
    observed = Recording.from_arrays("linear_drive", {"position": np.sin(time), "force": np.cos(time)}, time=time)
    with pytest.raises(ConfigurationError, match="record position_reference"):
        driven_by(observed)
    with pytest.raises(ConfigurationError, match="one rig can be joined"):
        joined(first, [observed])
