"""Concealed physics of a pendulum and a cart, named at the ports of a simulator that does not have it."""

import numpy as np
import pytest

from cable_envs.diagnosis import diagnose
from tests.simulators.rigs import CART, cart, cart_records, pendulum, pendulum_records


def _within(found, parameter, true, share, verdict="named"):
    """Whether the only named effect has its size: within three standard errors and a share for the formulation."""
    assert found.verdict == verdict, found.verdict
    (effect,) = found.effects
    estimate = effect.parameters[parameter]
    error = (estimate.high - estimate.low) / 3.92
    assert abs(estimate.value - true) < 3.0 * error + share * true, estimate
    return effect


@pytest.mark.slow
def test_dry_friction_of_a_pendulum_is_named_with_its_size():
    found = diagnose(pendulum_records(coulomb=0.02, noise=1e-3, seconds=6.0), simulator=pendulum())
    effect = _within(found, "pivot.level", 0.02, 0.003)  # 0.3 %: steps of 10 ms
    assert effect.name == "coulomb_friction" and effect.parameters["pivot.level"].unit == "N m"
    assert found.rig["effects"]["coulomb_friction"]["pivot.level"]["unit"] == "N m"
    better = found.corrected(pendulum())
    again = diagnose(
        pendulum_records(seed=1, coulomb=0.02, noise=1e-3, seconds=6.0), simulator=better,
        effects=["coulomb_friction", "stribeck_friction", "actuator_lag"],
    )  # fmt: skip
    assert again.verdict == "no_detectable_mismatch"
    assert "the model has it" in again.not_asked["coulomb_friction.pivot"]


EFFECTS = ["coulomb_friction", "actuator_lag", "command_delay", "position_dependent_load", "sensor_scale"]


@pytest.mark.parametrize(
    ("concealed", "name", "parameter", "true", "verdict"),
    [
        ({"lag": 0.02}, "actuator_lag.force", "force.time", 0.02, "named"),
        ({"delay": 0.025}, "command_delay.force", "force.time", 0.025, "named"),
        ({"spring": 8.0}, "position_dependent_load.slide", "slide.stiffness", 8.0, "named"),
        # the other sensor may have the inverse scale, with another mass and damping within what is believed
        ({"scale": 1.1}, "sensor_scale.velocity", "velocity", 1.1, "equivalence_class"),
    ],
)
@pytest.mark.slow
def test_physics_of_a_cart_is_named_with_its_size(concealed, name, parameter, true, verdict):
    found = diagnose(
        cart_records(seed=3, seconds=4.0, noise=5e-4, **concealed), simulator=cart(), effects=EFFECTS
    )  # fmt: skip
    effect = _within(found, parameter, true, 0.01, verdict)  # 1 %: what acts is even over steps of 10 ms
    assert effect.hypothesis.name == name


@pytest.mark.slow
def test_what_a_cart_meets_is_named_with_its_place():
    records = cart_records(seed=5, seconds=4.0, noise=5e-4, met=(5.0, 0.5))
    asked = ["unilateral_contact", "position_dependent_load", "coulomb_friction", "position_ripple"]
    found = diagnose(records, simulator=cart(), effects=asked)
    effect = _within(found, "slide.stiffness", 5.0, 0.01)  # 1 %: what acts is even over steps of 10 ms
    assert effect.hypothesis.name == "unilateral_contact.slide"
    assert effect.parameters["slide.place"].value == pytest.approx(0.5, abs=2e-3)


@pytest.mark.slow
def test_a_stiff_stop_is_named_where_nothing_holds_the_simulator_to_its_record():
    """12 times as stiff as that; its size is wide, as refits of a cart that runs freely end in many valleys."""
    records = cart_records(seed=5, seconds=4.0, noise=5e-4, met=(60.0, 1.0))
    found = diagnose(records, simulator=cart(), effects=["unilateral_contact", "coulomb_friction", "position_ripple"])
    effect = _within(found, "slide.stiffness", 60.0, 0.01)
    assert effect.hypothesis.name == "unilateral_contact.slide"
    assert effect.parameters["slide.place"].value == pytest.approx(1.0, abs=2e-3)


@pytest.mark.slow
@pytest.mark.xfail(reason="of the many valleys of a cart that runs freely one at 0.62 m is found", strict=True)
def test_a_stiff_stop_that_is_met_sooner_has_its_size():
    records = cart_records(seed=5, seconds=4.0, noise=5e-4, met=(60.0, 0.8))
    asked = ["unilateral_contact", "position_dependent_load", "coulomb_friction", "position_ripple"]
    effect = _within(diagnose(records, simulator=cart(), effects=asked), "slide.stiffness", 60.0, 0.01)
    assert effect.parameters["slide.place"].value == pytest.approx(0.8, abs=2e-3)


def test_dry_friction_of_a_cart_is_named_also_by_workers():
    records = cart_records(seed=1, seconds=2.5, noise=5e-4, coulomb=1.5)
    asked = ["coulomb_friction"]
    found = diagnose(records, simulator=cart(), effects=asked)
    effect = _within(found, "slide.level", 1.5, 0.003)
    assert effect.hypothesis.name == "coulomb_friction.slide"
    shared = diagnose(records, simulator=cart(workers=2), effects=asked)
    estimate = shared.effects[0].parameters["slide.level"]
    assert np.isclose(estimate.value, effect.parameters["slide.level"].value, rtol=1e-9)


def test_where_nothing_is_missing_nothing_is_named_and_what_is_assumed_is_said():
    found = diagnose(
        cart_records(seed=2, seconds=3.0, noise=5e-4), simulator=cart(),
        effects=["coulomb_friction", "actuator_lag", "sensor_scale"],
    )  # fmt: skip
    assert found.verdict == "no_detectable_mismatch" and not found.effects
    mass = found.absorbed["mass"]
    assert mass["before"] == 2.1 and mass["ci95"][0] < 2.0 < mass["ci95"][1]
    origins = {p["name"]: (p["status"], p["source"]) for p in found.as_json()["parameters"]}
    assert origins == dict.fromkeys(("mass", "damping"), ("fitted", "declaration of cart"))
    assumed = found.as_json()["about"]["assumed"]
    assert any("force is exactly what the simulator was given" in one for one in assumed)
    assert all(one in found.notes for one in assumed)
    assert not any("standard deviation" in one for one in assumed)  # the cart declares them
    assert "backlash.force" in found.not_asked or "backlash" not in [p.name for p in CART.commands]


def test_a_trial_that_fails_costs_that_trial_only():
    """A simulator that raises for heavy masses, and is not finite for light ones."""
    from cable_envs.diagnosis.simulators import FunctionSimulator

    whole = cart()

    def run(state, commands, forces, parameters):
        if np.any(parameters["mass"] > 2.3) and len(parameters["mass"]) > 1:
            raise ZeroDivisionError("too heavy")
        state, outputs = whole._run(state, commands, forces, parameters)
        light = (parameters["mass"] < 1.9)[:, None]
        return state, {name: np.where(light, np.nan, series) for name, series in outputs.items()}

    found = diagnose(
        cart_records(seed=1, seconds=2.5, noise=5e-4, coulomb=1.5), effects=["coulomb_friction"],
        simulator=FunctionSimulator(CART, whole._start, run),
    )  # fmt: skip
    assert _within(found, "slide.level", 1.5, 0.003).hypothesis.name == "coulomb_friction.slide"
