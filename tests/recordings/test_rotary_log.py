"""A user's log of a rotary joint with torque, current or voltage, and no controller: in, diagnosed, loaded again."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording, diagnose
from cable_envs.diagnosis.systems import looked_at, prepare
from cable_envs.diagnosis.systems.common import Sampled
from cable_envs.diagnosis.systems.starts.rotary_joint import balance
from cable_envs.diagnosis.systems.stated.fitting import systems_for

INERTIA, WEIGHT, RUBBING, CONSTANT, RESISTANCE = 0.05, 1.2, 0.06, 0.5, 2.0  # kg m^2, N m, N m, N m/A, ohm


def run(rate, seconds=6.0, fine=50, friction=RUBBING):
    """A pendulum under an even PD loop in small explicit steps: times, angles, torques; friction stops, and holds."""
    count, h = round(seconds * 100), 0.01 / fine
    x = v = 0.0
    angles, torques = [], []
    for k in range(count):
        for j in range(fine):
            now = k * 0.01 + j * h
            reference = 0.6 * np.sin(2 * np.pi * rate * now) * min(2.0 * now, 1.0)
            torque = 20.0 * (reference - x) - 1.0 * v
            free = v + h * (torque - WEIGHT * np.sin(x)) / INERTIA
            v = np.sign(free) * max(abs(free) - h * friction / INERTIA, 0.0)
            x += h * v
        angles.append(x)
        torques.append(torque)
    return np.arange(count) * 0.01, np.array(angles), np.array(torques)


def log(channel="torque", friction=RUBBING, **more):
    """Two runs of it; the torque as it is, as a current, or as the voltage that drives that against the back-EMF."""
    runs, rng = {}, np.random.default_rng(0)
    for name, rate in (("one", 0.4), ("two", 0.55)):
        time, angle, torque = run(rate, friction=friction)
        current = torque / CONSTANT
        made = {
            "torque": torque, "current": current,
            "voltage": RESISTANCE * current + CONSTANT * np.gradient(angle, time),
        }[channel]  # fmt: skip
        runs[name] = {"time": time, "position": angle + rng.normal(0.0, 2e-4, len(time)), channel: made}
    return Recording.from_arrays("rotary_joint", runs, heldout="two", noise={"position": 2e-4}, **more)


KNOWN = {"load_mass": 1.2 / 9.81 / 0.3, "arm_length": 0.3, "inertia": INERTIA - 1.2 / 9.81 * 0.3}
MOTOR = {"torque_constant": CONSTANT, "resistance": RESISTANCE}


@pytest.mark.parametrize("channel", ["torque", "current", "voltage"])
def test_the_joint_predicts_the_angle_from_its_effort(channel):
    question = prepare(log(channel, known={**KNOWN, **MOTOR, "coulomb": RUBBING}))
    values = np.array([[p.start] for p in question.fit.parameters])
    (angle,), (block,) = question.fit.predict(values), question.fit.blocks
    # samples of the effort 10 ms apart, in straight lines: what is between them
    assert np.sqrt(np.mean((angle[:, 0] - block.measured)[block.good] ** 2)) < 5e-4
    assert looked_at(log(channel)).averages


def test_friction_of_an_unknown_joint_is_found_and_the_rig_loads():
    found = diagnose(log(known=KNOWN), effects=["coulomb_friction"])
    (effect,) = found.effects
    assert effect.name == "coulomb_friction"
    assert abs(effect.parameters["level"].value - RUBBING) < 0.05 * RUBBING
    assert found.rig["plant"] == "rotary_joint"


def test_what_nobody_states_is_asked_for():
    with pytest.raises(ConfigurationError, match="torque_constant must be stated: what a current does"):
        prepare(log("current"))
    with pytest.raises(ConfigurationError, match="torque_constant and resistance must be stated"):
        prepare(log("voltage", known=KNOWN))
    prepare(log("current", known=KNOWN))  # a known weight tells the torque


def sampled(values, factor=1.0):
    return Sampled(factor * values, np.ones(len(values), dtype=bool))


@pytest.mark.parametrize("friction", [0.0, RUBBING, 5.0 * RUBBING])
def test_the_balance_of_torque_tells_inertia_and_weight_whatever_rubs(friction):
    runs = [run(rate, friction=friction) for rate in (0.4, 0.55, 1.1)]
    found = balance([{"position": sampled(x), "torque": sampled(m)} for _, x, m in runs], 0.01, "torque")
    assert found.inertia == pytest.approx(INERTIA, rel=0.02)
    assert found.weight == pytest.approx(WEIGHT, rel=0.05)
    assert abs(found.hanging) < 0.02
    # of a current, and of a joint whose angle counts from elsewhere and the other way
    mirrored = [{"position": sampled(0.7 - x), "current": sampled(m, -2.0)} for _, x, m in runs]
    turned = balance(mirrored, 0.01, "current")
    assert turned.inertia == pytest.approx(2.0 * found.inertia, rel=1e-6)
    assert turned.weight == pytest.approx(2.0 * found.weight, rel=1e-6)
    assert turned.hanging == pytest.approx(0.7 - found.hanging, abs=1e-6)


def test_a_joint_at_rest_or_in_noise_tells_no_inertia():
    rng = np.random.default_rng(0)
    still = {"position": sampled(1e-4 * rng.standard_normal(3000)), "torque": sampled(rng.standard_normal(3000))}
    assert balance([still], 0.01, "torque") is None
    assert balance([{"position": sampled(np.zeros(30)), "torque": sampled(np.zeros(30))}], 0.01, "torque") is None


def test_what_nobody_states_of_a_joint_begins_where_its_records_put_it():
    start = {p.name: p for p in prepare(log()).fit.parameters}
    assert start["load_mass"].start * 9.81 * 0.1 == pytest.approx(WEIGHT, rel=0.05)
    turned = start["inertia"].start + start["load_mass"].start * 0.1**2
    assert turned == pytest.approx(INERTIA, rel=0.05)
    assert start["inertia"].std == pytest.approx(0.3 * start["inertia"].start)
    stated = {p.name: p for p in prepare(log(nominal={"inertia": 0.4})).fit.parameters}
    assert stated["inertia"].start == 0.4 and stated["inertia"].std is None
    # what a stated weight or inertia says of a current
    for known in (KNOWN, {n: KNOWN[n] for n in ("inertia", "arm_length")}):
        (constant,) = [p for p in prepare(log("current", known=known)).fit.parameters if p.name == "torque_constant"]
        assert constant.start == pytest.approx(CONSTANT, rel=0.05)


def test_a_joint_that_nobody_describes_is_answered_with_its_friction():
    """Of all effects of a joint; its friction is six times what the library takes for typical."""
    found = diagnose(log(), effects=["coulomb_friction", "viscous_friction", "gear_friction", "asymmetric_friction"])
    assert [e.name for e in found.effects] == ["coulomb_friction"]
    assert found.effects[0].parameters["level"].value == pytest.approx(RUBBING, rel=0.1)


def test_a_rotary_joint_is_the_system_of_angle_and_torque():
    best = systems_for(log())[0]
    assert best.system == "rotary_joint" and best.fits and not best.asks
    status = {o.name: o.status for o in best.parameters}
    assert status["inertia"] == "fitted" and status["arm_length"] == "assumed"
