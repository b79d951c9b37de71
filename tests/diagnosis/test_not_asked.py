"""Every effect of a plant is asked, or the answer says why it is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.model.verdict import Diagnosis, from_json
from cable_envs.diagnosis.search.comparison import smaller
from cable_envs.diagnosis.systems import plant_of
from cable_envs.effects.sensor_scale import ACCURATE
from cable_envs.plants import plant_for
from cablebench.pages import diagnosis_words as words

TIME = np.arange(0.0, 4.0, 0.01)
SWING = 0.02 * np.sin(5.0 * TIME) + 0.01 * np.sin(9.0 * TIME)
MOVES = {"time": TIME, "position": SWING, "force": 4.0 * np.gradient(np.gradient(SWING, 0.01), 0.01)}
HAULS = {"time": TIME, "drive_position": SWING, "drive_tension": 20.0 + SWING, "load_position": SWING}
TOLD = {**HAULS, "drive_velocity_command": np.gradient(SWING, 0.01)}
TURNS = {"time": TIME, "drive_angle": SWING, "drive_torque": 0.1 * SWING, "output_angle": SWING}
LUMPED = {**TURNS, "output_torque": 0.1 * SWING}
BRAKES = {
    "time": TIME, "position": SWING, "force": 900.0 * np.sign(np.gradient(SWING)), "band_tension_1": 10.0 + SWING,
    "band_tension_2": 500.0 + SWING,
}  # fmt: skip
READ = {"time": TIME, "voltage": np.sign(SWING), "speed_reading": np.abs(SWING)}
RIG = {"pretension_top": 60.0, "pretension_bottom": 60.0}
CASES = {
    "drive": ("linear_drive", MOVES, {"nominal": {"mass": 4.0}}),
    "belt": ("linear_drive", MOVES, {"nominal": {"mass": 4.0, "motor_mass": 1.0, "belt_stiffness": 3e4}}),
    "hole": ("cable_hole", TOLD, {"nominal": {"load_mass": 2.0}}),
    "followed hole": ("cable_hole", HAULS, {"nominal": {"load_mass": 2.0}}),
    "circuit": ("pulley_circuit", TURNS, {"nominal": RIG}),
    "transmission": ("pulley_circuit", LUMPED, {}),
    "band brake": ("linear_drive", BRAKES, {}),
    "coupled drives": ("linear_drive", READ, {}),
}


def question(system, table, given, **options):
    recording = Recording.from_arrays(system, {"one": table, "two": table}, heldout="two", **given)
    return recording, ask(recording, request_of(recording, **options))


@pytest.mark.parametrize("case", CASES)
def test_every_effect_is_asked_or_the_reason_is_given(case):
    recording, found = question(*CASES[case])
    asked = {h.canonical for h in found.hypotheses}
    said = {name.partition(".")[0] for name in found.not_asked}
    plant = plant_for(plant_of(recording), "chain" if case == "circuit" else "analytic")
    acting = {e.name for e in plant.effects.effects.values() if e.parameters}
    assert acting <= asked | said
    assert not {h.name for h in found.hypotheses} & set(found.not_asked)
    assert all(len(why) > 10 for why in found.not_asked.values())


def test_the_reason_is_the_one_for_which_it_is_left_out():
    _, drive = question(*CASES["drive"])
    assert "has no belt" in drive.not_asked["stiffness_hardening"]
    assert "motor's inertia" in drive.not_asked["cable_elongation"]
    assert drive.not_asked["sensor_bias.position"] == "the zero of a position says nothing"
    _, named = question("linear_drive", MOVES, {"nominal": {"mass": 4.0, "viscous": 3.0}, "known": {"coulomb": 2.0}})
    assert named.not_asked["viscous_friction"] == "viscous is refitted already"
    assert named.not_asked["coulomb_friction"] == "coulomb is stated as known"
    thin = {"nominal": {"load_mass": 2.0}, "known": {"extrusion_gain": 0.0, "extrusion_delta": 0.0}}
    _, hole = question("cable_hole", TOLD, thin)
    assert hole.not_asked["extrusion_delta"] == "it looks the same as the refitted friction_coefficient"
    _, followed = question(*CASES["followed hole"])
    assert "drives the simulator" in followed.not_asked["sensor_scale.drive_position"]


def test_a_default_that_nobody_wrote_is_a_reason_that_is_told():
    given = {"nominal": {"load_mass": 2.0}, "known": {"friction_coefficient": 0.0}}
    _, found = question("cable_hole", TOLD, given, rig={"schema": "cable-rig/1", "name": "r", "plant": "cable_hole",
                        "parameters": {"load_damping": {"value": 3.0, "unit": "N s/m"}}})  # fmt: skip
    assert found.not_asked["viscous_friction"].startswith("the model has it: load_damping is 3 N s/m")


def test_what_the_caller_left_out_is_not_listed():
    _, found = question(*CASES["drive"], without=["cable_elongation"])
    assert "cable_elongation" not in found.not_asked and "stiffness_hardening" in found.not_asked
    _, found = question(*CASES["drive"], effects=["cable_elongation", "coulomb_friction"])
    assert set(found.not_asked) == {"cable_elongation"}


def test_a_condition_that_every_record_states_is_a_reason():
    tables = {"one": HAULS, "two": HAULS}
    recording = Recording.from_arrays(
        "cable_hole", tables, heldout="two", nominal={"load_mass": 2.0},
        about={name: {"conditions": {"load_damping": 0.0}} for name in tables},
    )  # fmt: skip
    found = ask(recording, request_of(recording))
    assert found.not_asked["viscous_friction"] == "every record to fit states load_damping under its conditions"


def test_the_answer_keeps_the_reasons_and_the_words_say_each_once():
    why = {"slack": "no belt", "backlash": "no belt", "sensor_bias.position": "a zero says nothing"}
    found = Diagnosis("no_detectable_mismatch", (), (), {}, {}, {}, not_asked=why)
    assert from_json(found.as_json()).not_asked == why
    assert words.not_asked(found.as_json()) == [
        ("no belt", "slack, backlash"), ("a zero says nothing", "sensor bias (position)"),
    ]  # fmt: skip


def test_a_scale_within_the_class_of_its_sensor_is_no_fault():
    """Records may tell 0.2 % with log odds of 20; no transducer is sold for better than that."""
    _, found = question(*CASES["drive"])
    least = {h.name: h.least for h in found.hypotheses if h.least}
    assert least == {"sensor_scale.force": ACCURATE}
    (of_force,) = [h for h in found.hypotheses if h.name == "sensor_scale.force"]
    told = {scale: smaller(of_force, SimpleNamespace(values={of_force.free[0].name: scale})) for scale in (1.002, 0.98)}
    assert told[1.002].startswith("it is smaller than 0.005") and not told[0.98]
