"""What is met beyond a place, in records that plain integrations made: a carriage, a joint, a simulator of its own."""

import numpy as np
import pytest

from benchmarks.unlike.touch import run
from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.fit.promising import BEST, promising
from cable_envs.diagnosis.model.hypotheses import NO_TRAVEL, PLACES, Travel, hypotheses_for
from cable_envs.diagnosis.systems.common import Sampled
from cable_envs.diagnosis.systems.starts import UNSURE, begin
from cable_envs.plants import plant_for

NAME = "unilateral_contact"
ASKED = [NAME, "position_dependent_load", "position_ripple", "coulomb_friction"]
MASS, FRICTION, PLACE, STIFFNESS, LOSS = 1.2, 2.0, 0.008, 1500.0, 0.5
TRAVEL = Travel(-0.01, 0.03, 0.04)


def asked(travel):
    plant = plant_for("linear_drive")
    values = {p.name: p.default for p in plant.table}
    found = hypotheses_for(plant, values, {}, ["position"], only=[NAME], travel=travel)
    return {h.name: h for h in found.asked}.get(NAME), found.not_asked


def test_it_is_looked_for_all_along_the_travel_and_on_both_sides():
    hypothesis, _ = asked(TRAVEL)
    (place,) = [p for p in hypothesis.free if p.name == f"{NAME}.place"]
    assert (place.low, place.high) == (-0.01, 0.03)
    assert place.start == pytest.approx(0.01) and place.std == pytest.approx(0.04 / np.sqrt(12))  # as an even prior
    places = {probe[f"{NAME}.place"] for (probe,) in hypothesis.probes}
    assert sorted(places) == pytest.approx([-0.01 + 0.04 * share for share in PLACES])
    for size in ("stiffness", "damping", "friction"):
        sizes = [probe[f"{NAME}.{size}"] for (probe,) in hypothesis.probes if f"{NAME}.{size}" in probe]
        assert len(sizes) == 2 * len(PLACES) and min(sizes) == -max(sizes) < 0.0


def test_without_a_position_it_is_not_asked_and_the_reason_said():
    hypothesis, reasons = asked(None)
    assert hypothesis is None and reasons[NAME] == NO_TRAVEL


def test_each_of_its_sizes_may_be_missing_and_any_two_of_them():
    hypothesis, _ = asked(TRAVEL)
    kept = {frozenset(n.partition(".")[2] for n in part.nulls) for part in hypothesis.parts}
    singles = {frozenset([n]) for n in ("stiffness", "damping", "friction")}
    assert kept == singles | {a | b for a in singles for b in singles if a != b}
    for part in hypothesis.parts:
        assert {p.name for p in part.free} == {*part.nulls, f"{NAME}.place"}
        assert all(set(probe) <= {*part.nulls, f"{NAME}.place"} for (probe,) in part.probes)


def pressed(depth_of, seed=0):
    """Two records of a carriage that meets something, and one held out: position and force, 100 Hz, with noise."""
    rng, tables = np.random.default_rng(seed), {}
    for name, rate in {"one": 0.31, "two": 0.53, "three": 0.42}.items():

        def motion(t, rate=rate):
            grown = min(t, 1.0) ** 2 * (3.0 - 2.0 * min(t, 1.0))
            return grown * (0.003 + 0.012 * np.sin(2 * np.pi * rate * t) + 0.003 * np.sin(2 * np.pi * 1.1 * t))

        seen = run(MASS, 0.0, FRICTION, PLACE, depth_of, motion, 10.0, 60.0)[::10]
        tables[name] = {
            "time": 0.01 * np.arange(len(seen)), "position": seen[:, 0] + rng.normal(0.0, 2e-6, len(seen)),
            "force": seen[:, 1] + rng.normal(0.0, 0.02, len(seen)),
        }  # fmt: skip
    return tables


def recorded(tables, **stated):
    return Recording.from_arrays(
        "linear_drive", tables, noise={"position": 2e-6}, nominal={n: {"value": v} for n, v in stated.items()},
        heldout=["three"],
    )  # fmt: skip


def test_the_balance_of_force_tells_a_mass_beside_what_is_met():
    """Within 30 %, which is its prior: what is met has a corner that the straight lines between places cut."""
    for law in (soft, gripping):
        series = [
            {name: Sampled(table[name], np.ones(len(table[name]), dtype=bool)) for name in ("position", "force")}
            for table in pressed(law).values()
        ]
        plant, alone, geared = plant_for("linear_drive"), {"motor_mass": 0.0}, {"motor_mass": 0.4}
        told = begin(plant, series, alone, 0.01)["mass"]
        assert told == pytest.approx(MASS, rel=UNSURE)
        assert begin(plant, series, geared, 0.01)["mass"] == pytest.approx(told - 0.4)
        assert begin(plant, series, alone, 0.01, ["mass"]) == {}


def soft(depth, speed):
    return STIFFNESS * max(depth, 0.0) * (1.0 + LOSS * speed), 0.0


def gripping(depth, speed):
    return 0.0, 80.0 * max(depth, 0.0)


def test_only_places_are_probed_of_which_the_residual_has_most():
    recording = recorded(pressed(soft), mass=MASS)
    question = ask(recording, request_of(recording, effects=ASKED))
    base = refit_nominals(question.fit, question.nominals)
    (hypothesis,) = [h for h in question.hypotheses if h.name == NAME]
    kept = promising(question.fit, base, hypothesis)
    places = {probe[hypothesis.place] for (probe,) in kept}
    assert len(kept) == 2 * 3 * BEST and len(places) == BEST < len(PLACES)  # both sides of each, and every size
    assert min(abs(place - PLACE) for place in places) < 2e-3
    (other,) = [h for h in question.hypotheses if h.name == "position_dependent_load"]
    assert promising(question.fit, base, other) == other.probes


def test_a_carriage_that_presses_on_something_soft():
    found = diagnose(recorded(pressed(soft), mass=MASS), effects=ASKED)
    effects = {e.name: e for e in found.effects}
    assert set(effects) == {NAME, "coulomb_friction"}
    sizes = {name: p.value for name, p in effects[NAME].parameters.items()}
    assert sizes["stiffness"] == pytest.approx(STIFFNESS, rel=0.01)
    assert sizes["place"] == pytest.approx(PLACE, abs=5e-5)
    assert sizes["damping"] == pytest.approx(LOSS * STIFFNESS, rel=0.25) and sizes.get("friction", 0.0) < 3.0
    assert effects["coulomb_friction"].parameters["level"].value == pytest.approx(FRICTION, rel=0.02)


def test_a_carriage_that_is_gripped_the_more_the_deeper_it_is():
    found = diagnose(recorded(pressed(gripping), mass=MASS), effects=ASKED)
    effects = {e.name: e for e in found.effects}
    assert set(effects) == {NAME, "coulomb_friction"}
    sizes = {name: p.value for name, p in effects[NAME].parameters.items()}
    # the force is known at samples only, and friction and mass turn by what it did between them: 1 to 3 %
    assert sizes["friction"] == pytest.approx(80.0, rel=0.04) and sizes["place"] == pytest.approx(PLACE, abs=1e-4)
    assert abs(sizes.get("stiffness", 0.0)) < 3.0  # a spring of a thousandth of what the other test has


def test_nothing_need_be_stated_of_a_carriage_whose_force_was_recorded():
    found = diagnose(recorded(pressed(soft)), effects=[NAME, "coulomb_friction"])
    effects = {e.name: e for e in found.effects}
    assert set(effects) == {NAME, "coulomb_friction"}
    assert effects[NAME].parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=0.01)
    assert found.absorbed["mass"]["after_model"] == pytest.approx(MASS, rel=0.04)
    assert any("nobody states it" in note and "balance of force" in note for note in found.notes)
