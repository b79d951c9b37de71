"""The data beside the refitted simulator: each fault is found by its own sign, and physics that is missing is none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.fit.likelihood import refit_and_learn, refit_nominals
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.intake.after import after_fit
from cable_envs.diagnosis.model.model import Block, Free
from cablebench.pages.diagnosis_words import headline
from tests.support import drive_recording as drive
from tests.support.diagnosis_toy import NOMINALS, Toy

UNITS = {"mass": "kg", "viscous": "N s/m", "coulomb": "N", "stiffness": "N/m"}


def claimed(model, share=0.1, **values):
    """The model with claims of a standard deviation; values replace what is claimed."""

    def claim(p):
        start = values.get(p.name, p.start)
        return replace(p, start=start, std=share * start) if p.name in NOMINALS else p

    model.parameters = tuple(claim(p) for p in model.parameters)
    return model


def seen(fit, heldout=None, nominals=NOMINALS):
    question = SimpleNamespace(
        fit=fit, heldout=heldout or fit, nominals=nominals, nuisance=(), units=UNITS
    )  # fmt: skip
    return [one.text for one in after_fit(question, refit_nominals(fit, nominals).fit)]


def changed(model, change):
    """Every block's measurements changed: change(number, block)."""
    model.blocks = [replace(b, measured=change(k, b)) for k, b in enumerate(model.blocks)]
    return model


def test_nothing_is_wrong_with_claims_that_are_off_by_what_they_say():
    assert seen(claimed(Toy({}, 1))) == []


@pytest.mark.parametrize(
    ("factor", "units"), [(9.81, "kilograms and newtons"), (1e-3, "'milli' or 'kilo'"), (4.448, "pounds")]
)
def test_an_effort_in_another_unit_moves_all_that_has_its_unit(factor, units):
    (text,) = seen(claimed(changed(Toy({}, 1), lambda k, b: factor * b.measured)))
    assert f"with mass, viscous, coulomb as claimed, an effort {factor:.3g} times" in text and units in text


def test_one_wrong_claim_is_no_wrong_unit():
    """A mass that is claimed at a tenth leaves the frictions where they are."""
    assert seen(claimed(Toy({}, 1), mass=11.0 / 9.81)) == []
    assert seen(claimed(Toy({}, 1), viscous=20.0 / 9.81)) == []


def test_claims_that_are_off_by_no_known_factor_are_no_wrong_unit():
    assert seen(claimed(changed(Toy({}, 1), lambda k, b: 2.3 * b.measured))) == []


def test_a_clock_in_another_unit_moves_masses_by_its_square():
    """Times that are half: the motion's slope is twice, its second derivative four times what it was."""
    model = claimed(Toy({}, 1), mass=11.0 * 4.0, viscous=20.0 * 2.0, coulomb=5.0)
    (text,) = seen(model)
    assert "with mass, viscous as claimed, a clock 0.5 times" in text


@pytest.mark.parametrize(
    "missing", [{"stiffness": 60.0}, {"difference": 4.0}, {"excess": 4.0}, {"bias": 5.0}, {"drift": 0.5}]
)
def test_physics_that_is_missing_is_no_fault_of_the_data(missing):
    assert seen(claimed(Toy(missing, 2)), claimed(Toy(missing, 52, 1))) == []


def jumping(number, height):
    def change(k, block):
        at = block.time > 0.45 * block.time[-1]
        return block.measured + np.where(at, height, 0.0) * (k in number)

    return change


def test_a_jump_of_one_record_is_found_and_what_all_records_do_is_none():
    (text,) = seen(claimed(changed(Toy({}, 1), jumping((0,), 3.0))), Toy({}, 51, 1))
    assert text.startswith("force of run0 jumps by 3") and "at 6.7" in text and "in no other record" in text
    assert seen(claimed(changed(Toy({}, 1), jumping((0, 1), 3.0)))) == []
    assert seen(claimed(changed(Toy({}, 1), jumping((0,), 0.3)))) == []  # a standard deviation of the noise
    assert seen(claimed(changed(Toy({}, 1, 1), jumping((0,), 3.0)))) == []  # one record cannot tell


class Two:
    """Two channels of one unit that a motion of its own moves: scale * motion + noise."""

    parameters = (Free("scale", 1.0, 0.1, 10.0, 1.0), Free("friction", 1.0, 0.0, 10.0, 1.0, 0.1))

    def __init__(self, change=lambda one, other: (one, other)):
        self._time = 0.01 * np.arange(2000)
        rng, self._clean, self.blocks = np.random.default_rng(0), [], []
        for record in ("run_1", "run_2"):
            phase = rng.uniform(0.0, 6.0, 6)
            one, other = (
                np.sum([np.sin(w * self._time + p) for w, p in zip(rates, phases, strict=True)], axis=0)
                for rates, phases in (((0.7, 1.1, 2.3), phase[:3]), ((0.9, 1.7, 2.9), phase[3:]))
            )
            self._clean += [one, other]
            measured = [s + rng.normal(0.0, 0.02, s.size) for s in change(one, other)]
            for name, values in zip(("drive_angle", "output_angle"), measured, strict=True):
                self.blocks.append(Block(record, name, self._time, values, np.ones(values.size, dtype=bool), "rad"))

    def predict(self, values):
        return [values[0] * clean[:, None] for clean in self._clean]


def of_two(change=lambda one, other: (one, other), **values):
    model = Two(change)
    fit = refit_and_learn(model, [Start("", ("scale", "friction"), {})]).fit
    question = SimpleNamespace(
        fit=model, heldout=model, nominals=("scale", "friction"), nuisance=(), units={"friction": "1"}
    )  # fmt: skip
    return after_fit(question, replace(fit, values={**fit.values, **values}, at_bounds=tuple(values)))


def test_channels_in_each_others_column_late_and_turned_ones_are_found():
    assert of_two() == ()
    (swapped,) = of_two(lambda one, other: (other, one))
    assert swapped.text == "drive angle has the course of output angle, and that one its: exchange the two"
    late = of_two(lambda one, other: (one, np.roll(other, 20)))
    assert [s.text.partition(" ms")[0] for s in late] == ["output angle is 200"] and "late" in late[0].text
    early = of_two(lambda one, other: (one, np.roll(other, -20)))
    assert "output angle is 200 ms early" in early[0].text
    assert of_two(lambda one, other: (one, np.roll(other, 4))) == ()  # 40 ms: an actuator may do that
    (turned,) = of_two(lambda one, other: (one, -other))
    assert "output angle is -1 times" in turned.text
    assert all(s.fatal for s in (swapped, *late, *early, turned))


def test_friction_that_the_refit_has_taken_away_is_noted_only():
    (one,) = of_two(friction=0.0)
    assert not one.fatal and one.text.startswith("the refit has no friction, and 1 1 is claimed: an effort")


@pytest.mark.parametrize(("name", "value", "said"), [
    ("sensor_scale.force", -1.02, "force is -1.02 times what it should be: it is turned round"),
    ("sensor_scale.force", 9.9, "force is 9.9 times what it should be: it is in another unit"),
    ("sensor_scale.force", 1.3, ""),
    ("sensor_delay.force", 0.2, "force is 200 ms late"),
    ("sensor_delay.force", 0.03, ""),
])  # fmt: skip
def test_a_sensor_that_no_rig_has_is_a_fault_and_no_effect(name, value, said):
    model = claimed(Toy({}, 1))
    model.parameters = (*model.parameters, Free(name, 0.0, -100.0, 100.0, 1.0))
    predict = model.predict
    model.predict = lambda values: predict(values[:-1])
    fit = refit_nominals(model, NOMINALS).fit
    question = SimpleNamespace(fit=model, heldout=model, nominals=NOMINALS, nuisance=(), units=UNITS)
    found = after_fit(question, replace(fit, values={**fit.values, name: value}))
    assert [s.text for s in found if not s.text.startswith(said)] == [] and len(found) == bool(said)


def test_an_answer_names_nothing_before_the_data_are_mended(tmp_path):
    """A spring that is missing, and the force's zero is set anew half way in one record: the spring is not named."""

    def change(k, table):
        if k == 0:
            table[400:, 4] += 0.5
        return table

    folder = drive.write(tmp_path / "recording", lambda y, v, t: 5.0 * y, change=change)
    found = diagnose(folder, effects=["position_dependent_load"])
    assert found.verdict == "data_fault" and found.effects == ()
    assert "jumps by" in found.test["cause"] and any("jumps by" in note for note in found.notes)
    said = headline(found.as_json())
    assert said.startswith("Your data") and "jumps by" in said and "% sure" not in said
