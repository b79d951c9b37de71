"""Band brake, coupled drives, EMPS: their models against independent solutions, and slices of the real files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cable_envs.diagnosis.data.description import Quantity
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.weights import reweighted_refit, rmse, with_sandwich_covariance
from cable_envs.diagnosis.model.verdict import SURE_WHERE_LEARNT
from cable_envs.diagnosis.real import band_brake, emps
from cable_envs.diagnosis.real.sets import FOLDERS, imported
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.band_brake import Track, driven
from cable_envs.diagnosis.systems.coupled_drives import RECTIFIED
from cable_envs.diagnosis.systems.question import Request
from cable_envs.plants.band_brake.effects import RIGID
from cable_envs.plants.band_brake.plant import PLANT as BRAKE
from cable_envs.plants.drive.plant import PLANT
from cable_envs.sim.replay import replay

SHARED = Path(__file__).parents[3] / "shared" / "recordings"
needs = {
    form: pytest.mark.skipif(not (SHARED / folder).is_dir(), reason=f"the set {folder} is not at {SHARED / folder}")
    for form, folder in FOLDERS.items()
}
T = np.arange(0.0, 4.0, 1.0 / 64.0)
X, V = 0.02 * np.sin(np.pi * T), 0.02 * np.pi * np.cos(np.pi * T)


def pulls(**values):
    """Pull of a band [T] along X with a grip of 5 kN, other effects absent unless given."""
    column = BRAKE.table.pack({"band_grip": 5e3, **values})[:, None]
    return driven(Track(X, V, np.zeros_like(X), 1.0 / 64.0), column)[:, 1, 0]


def test_a_rigid_band_pulls_with_its_grip_against_the_motion():
    bare = pulls()
    moving = (np.abs(V) > 0.2 * V.max()) & (T > 0.0)
    np.testing.assert_allclose(bare[moving], 5e3 * np.sign(V[moving]), rtol=1e-12)


def test_backlash_and_a_spring_are_those_of_the_linear_drive():
    """The kernel integrates a light carriage behind a belt; the play operator needs no mass. 1 % of the grip apart."""
    stiffness, gap, hardening = 2e6, 3e-3, 2e-4
    mine = pulls(**{
        "cable_elongation.compliance": 1.0 / stiffness, "backlash.gap": gap,
        "stiffness_hardening.coefficient": hardening,
    })  # fmt: skip
    named = {
        "mass": 1.0, "motor_mass": 1e-3, "belt_stiffness": stiffness, "belt_damping": 2e3, "viscous": 0.0,
        "coulomb": 5e3, "backlash.gap": gap, "stiffness_hardening.coefficient": hardening, "force_limit": 1e6,
        "tension_limit": 1e6, "breaking_tension": 1e7,
    }  # fmt: skip
    values = PLANT.table.pack({**{p.name: p.default for p in PLANT.table}, **named})[:, None]
    kernel = replay(
        PLANT, values, X, 1.0 / 64.0, drive="follow", signals=["belt_force"], rate=V, substeps=200
    )[:, 0, 0]  # fmt: skip
    later = T > 1.6  # the kernel's carriage starts at rest, the band's past is forgotten after the first full stroke
    assert np.sqrt(np.mean((mine - kernel)[later] ** 2)) < 0.01 * 5e3
    assert np.mean(np.abs(mine[later]) < 10.0) > 0.05  # in the gap nothing pulls


def test_presliding_turns_over_its_distance_and_takes_the_gap_in_series():
    soft = pulls(**{"presliding_hysteresis.displacement": 6e-3})
    turn = int(np.argmax(X))
    back = X[turn] - X[turn : turn + 64]
    # half of the first element's, third of ... : slope -2 grip mean(4 / (k d)) at the reversal, all way over d
    slope = 2 * 5e3 * np.mean([4.0 / (k * 6e-3) for k in (1, 2, 3, 4)])
    small = (back > 0.0) & (back < 1.4e-3)
    np.testing.assert_allclose(soft[turn : turn + 64][small], 5e3 - slope * back[small], atol=1.1 * slope * RIGID * 5e3)
    assert soft[turn : turn + 64][back > 6.1e-3].max() == pytest.approx(-5e3, rel=1e-9)
    played = pulls(**{"presliding_hysteresis.displacement": 6e-3, "backlash.gap": 3e-3})
    assert np.mean(np.abs(played) < 50.0) > np.mean(np.abs(soft) < 50.0) + 0.03


@needs["band-brake"]
def test_the_band_brake_slips_with_its_load_and_a_viscous_answer_fails_at_another_speed(tmp_path):
    recording = imported("band-brake", SHARED, tmp_path)
    found = band_brake.find("slice", recording, effects=(*band_brake.EXPECTED, band_brake.WRONG))
    assert set(found.named) == set(band_brake.EXPECTED)
    first, last = found.steps[0], found.steps[-1]
    assert last.heldout["force"] < 0.1 * first.heldout["force"]
    assert last.parameters["load_dependent_friction.coefficient"].value == pytest.approx(2.05, abs=0.1)
    assert 3e-3 < last.parameters["backlash.gap"].value < 5e-3
    viscous = next(a for a in found.alone if a.hypothesis.name == band_brake.WRONG)
    assert viscous.fit["force"] < first.fit["force"]  # at 0.5 Hz it passes for an improvement
    assert viscous.heldout["force"] > 1.1 * first.heldout["force"]  # at 1 Hz it does not
    # of both speeds its log odds are 5; those of what is named are 114 and more
    named = [a.gain for a in found.alone if a.hypothesis.name in band_brake.EXPECTED]
    assert viscous.gain < SURE_WHERE_LEARNT < 0.1 * min(named)


@needs["coupled-drives"]
def test_the_coupled_drives_sensor_rectifies_and_friction_explains_less(tmp_path):
    recording = imported("coupled-drives", SHARED, tmp_path)
    records = tuple(r for r in recording.records if r.name.startswith("uniform_1"))
    question = prepare(replace(recording, records=records), Request(only=("sensor_rectification", "coulomb_friction")))
    base, _ = reweighted_refit(question.fit, Start("", question.nominals, {}))
    left = {"": rmse(question.heldout, base)["speed_reading"]}
    for h in question.hypotheses:
        start = {**base.values, **{k: v for d in h.probes[-1] for k, v in d.items()}}
        fit, _ = reweighted_refit(question.fit, Start(h.name, (*base.free, *h.names), start))
        left[h.name] = rmse(question.heldout, fit)["speed_reading"]
        if h.name == "sensor_rectification":
            low, high = fit.interval(RECTIFIED)
            assert low > 1.5 and high < 2.6  # it turns negative speeds round; 1 would cut them off
    rectified = left["sensor_rectification"]
    assert rectified < 0.12 and min(left["coulomb_friction"], left[""]) > 1.7 * rectified


@needs["emps"]
def test_emps_parameters_come_out_by_two_ways(tmp_path):
    recording = imported("emps", SHARED, tmp_path)
    known = {**recording.known, "motor_mass": Quantity(0.0)}
    recording = replace(recording, known=known)
    inverse = emps.inverse_dynamics(recording)
    fit = recording.records[0]
    part = replace(fit, data={c: v[:9000] for c, v in fit.data.items()})
    short = replace(recording, records=(emps.thinned(part, 5), emps.thinned(recording.records[1], 5)))
    refitted = emps.coloured(short)
    tolerance = {"mass": 0.03, "viscous": 0.10, "coulomb": 0.15, "force_offset": 0.35}
    for name, published in emps.PUBLISHED.items():
        assert inverse[name].value == pytest.approx(published, rel=0.03)
        # half the record at a fifth of its rate; what the whole one gives is in docs/recordings
        assert refitted[name].value == pytest.approx(published, rel=tolerance[name])


@needs["emps"]
def test_emps_intervals_from_parts_of_the_record_hold_what_was_published(tmp_path):
    """What is left follows the motion. Taken for noise, its curvature gives the damping to a quarter of what it is."""
    recording = imported("emps", SHARED, tmp_path)
    nominal = {name: Quantity(value) for name, value in emps.STARTS.items()}
    thin = tuple(emps.thinned(record, 5) for record in recording.records)
    question = prepare(replace(recording, nominal=nominal, records=thin), Request(without=emps.WITHOUT))
    fit, _ = reweighted_refit(question.fit, Start("", question.nominals, {}))
    for name, published in emps.PUBLISHED.items():
        low, high = fit.interval(name)
        assert low < published < high and high - low < 0.5 * abs(published)
    whitened = refit_and_learn(question.fit, [Start("", question.nominals, fit.values)]).fit
    by_curvature, by_parts = (
        np.diff(f.interval("viscous"))[0] for f in (whitened, with_sandwich_covariance(question.fit, whitened))
    )
    assert by_parts > 2.0 * by_curvature
