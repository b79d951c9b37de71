"""What nobody stated: shown as assumed, refused before the fit where it makes no rig, and no end of a diagnosis."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.model.model import learn_whitener
from cable_envs.diagnosis.model.trials import Trials
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.question import Request
from cable_envs.diagnosis.systems.stated.fitting import systems_for
from cablebench.pages.diagnosis_words import numbers_of, start_of
from tests.support.diagnosis_toy import NOMINALS, Toy

T = np.arange(0.0, 10.0, 0.01)
WAY = 0.3 * np.sin(2.0 * T) + 0.1 * np.sin(5.0 * T)


def circuit(output=("output_angle",), **told):
    names = ("drive_angle", "drive_torque", *output)
    return Recording.from_arrays("pulley_circuit", {"a": {"time": T, **dict.fromkeys(names, WAY)}}, **told)


def test_a_rig_that_cannot_be_is_refused_before_the_fit_with_what_was_assumed():
    with pytest.raises(ConfigurationError) as said:
        prepare(circuit(nominal={"pretension_top": 5000.0, "pretension_bottom": 10.0}))
    text = str(said.value)
    assert "pretension alone exceeds breaking_tension" in text
    assert "pretension_top 5000 N (stated, nominal)" in text and "breaking_tension 223 N (assumed, default" in text
    assert "Nobody stated breaking_tension" in text
    stated = {"pretension_top": 5000.0, "pretension_bottom": 10.0, "breaking_tension": 6000.0}
    assert prepare(circuit(nominal=stated)).system == "pulley_circuit"


class Fragile(Toy):
    """The toy, of a plant that refuses all columns where one has a mass above `MOST`."""

    MOST = 10.5

    def __init__(self, *args, **more):
        super().__init__(*args, **more)
        self.refusals = 0

    def predict(self, values):
        if np.any(values[0] > self.MOST):
            self.refusals += 1
            raise ConfigurationError("too heavy")
        return super().predict(values)


def test_a_refused_trial_costs_that_trial_and_the_refit_ends_where_the_plant_allows():
    model = Fragile({}, seed=1)  # the truth is a mass of 11
    with pytest.raises(ConfigurationError):
        refit_and_learn(model, [Start("", NOMINALS, {})])
    found = refit_and_learn(Trials(model), [Start("", NOMINALS, {})]).fit
    assert model.refusals > 0 and found.values["mass"] <= Fragile.MOST
    free = refit_and_learn(Toy({}, seed=1), [Start("", NOMINALS, {})]).fit
    assert free.values["mass"] == pytest.approx(11.0, abs=0.2)
    assert found.values["viscous"] == pytest.approx(free.values["viscous"], abs=0.5)


def test_columns_beside_a_refused_one_are_predicted_and_a_slope_is_taken_from_the_other_side():
    model, plain = Trials(Fragile({}, seed=2)), Toy({}, seed=2)
    columns = np.array([[p.start] * 5 for p in model.parameters])
    columns[0] = (8.0, 11.0, 9.0, 12.0, 10.0)
    found, whole = model.predict(columns), plain.predict(columns)
    for one, other in zip(found, whole, strict=True):
        assert np.isnan(one[:, [1, 3]]).all()
        np.testing.assert_array_equal(one[:, [0, 2, 4]], other[:, [0, 2, 4]])
    whitener = learn_whitener(plain.blocks, [b.measured for b in plain.blocks])
    start = [Start("", ("mass",), {"mass": Fragile.MOST})]  # a step up is refused
    (edge,), (free,) = (refit(m, whitener, start, 0) for m in (model, plain))
    np.testing.assert_allclose(edge.jacobian, free.jacobian, rtol=1e-6, atol=1e-9)


def test_every_number_is_stated_assumed_or_fitted():
    run = {"time": T, "drive_position": WAY, "drive_tension": 50.0 + WAY}
    recording = Recording.from_arrays(
        "cable_hole", {"a": run}, known={"wrap_angle": 1.0}, nominal={"load_mass": {"value": 4.0, "std": 1.0}}
    )
    question = prepare(recording)
    found = {o.name: o for o in question.origins}
    assert (found["wrap_angle"].status, found["wrap_angle"].source) == ("stated", "known")
    assert (found["load_mass"].status, found["load_mass"].stated) == ("fitted", True)
    stiffness = found["cable_stiffness"]
    assert (stiffness.status, stiffness.stated) == ("fitted", False) and stiffness.source.startswith("default")
    assert found["radius_ratio"].status == "assumed" and found["radius_ratio"].value == 1.5
    assert {o.status for o in question.origins} == {"stated", "assumed", "fitted"}
    assert any(note.startswith("assumed, as nothing states them: ") for note in question.notes)
    record = {"parameters": [vars(o) for o in question.origins]}
    assert [start_of(record, n) for n in ("load_mass", "cable_stiffness")] == ["claimed", "assumed"]
    assert list(numbers_of(record)) == ["stated", "fitted", "assumed"]
    given = prepare(recording, Request(rig={"radius_ratio": 2.0}))
    assert next(o for o in given.origins if o.name == "radius_ratio").status == "stated"


def test_two_radii_of_a_jaw_bring_no_circuit_of_the_paper():
    both = circuit(("output_angle", "output_torque"), known={"drive_radius": 7e-3, "output_radius": 8e-3})
    question = prepare(both)
    assert "ratio" in question.nominals and not any(o.name.startswith("wrap_") for o in question.origins)
    said = [note for note in question.notes if note.startswith("stated, and not used")]
    assert len(said) == 1 and "drive_radius, output_radius" in said[0]
    stretched = circuit(("output_angle", "output_torque"), nominal={"pretension_top": 40.0, "pretension_bottom": 40.0})
    assert any(o.name.startswith("wrap_") and o.status == "assumed" for o in prepare(stretched).origins)


def test_systems_that_fit_say_what_they_lack_and_would_assume():
    run = {"time": T, "position": WAY, "force": WAY}
    found = {fit.system: fit for fit in systems_for(Recording.from_arrays("linear_drive", {"a": run}))}
    assert next(iter(found)) == "linear_drive"  # the one that is stated comes first
    drive, hole, circuit_ = found["linear_drive"], found["cable_hole"], found["pulley_circuit"]
    assert drive.fits and drive.asks == ()  # a recorded force tells the mass
    told_by_volts = Recording.from_arrays("linear_drive", {"a": {"time": T, "position": WAY, "voltage": WAY}})
    assert systems_for(told_by_volts)[0].asks == ("mass",)
    assert hole.fits and hole.channels == {"drive_position": "position", "drive_tension": "force"}
    assert next(p for p in hole.parameters if p.name == "load_mass").status == "fitted"
    assert not circuit_.fits and circuit_.missing[0] == ("drive_angle_command", "drive_angle")
    weighed = Recording.from_arrays("linear_drive", {"a": run}, nominal={"mass": 2.0})
    assert systems_for(weighed)[0].asks == ()
    alone = Recording.from_arrays("cable_hole", {"a": {"time": T, "drive_position": WAY}})
    assert systems_for(alone)[0].missing == (("drive_tension", "load_position", "load_tension"),)
    with pytest.raises(ConfigurationError, match="needs the channel drive_tension or load_position or load_tension"):
        prepare(alone)
