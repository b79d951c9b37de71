"""Each effect on the linear drive against small explicit steps in plain Python; energy; what a belt is needed for."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from tests.reference.drive_reference import Drive

PLANT = plant_for("linear_drive")
PERIOD, STEPS = 0.01, 120
BELT = {"belt_stiffness": 2e4, "belt_damping": 20.0}

CASES = {
    "nothing": {},
    "coulomb_friction": {"coulomb_friction.level": 8.0},
    "viscous_friction": {"viscous_friction.coefficient": 60.0},
    "stribeck_friction": {"stribeck_friction.excess": 6.0, "stribeck_friction.velocity": 0.05},
    "asymmetric_friction": {"asymmetric_friction.difference": 5.0},
    "asymmetric_friction, down": {"asymmetric_friction.difference": -5.0},
    "presliding_hysteresis": {"presliding_hysteresis.displacement": 0.02, "coulomb": 12.0},
    "friction_drift": {"friction_drift.change": 1.5, "friction_drift.time": 0.5},
    "friction_drift, travel": {"friction_drift.change": 1.5, "friction_drift.time": 1e9, "friction_drift.travel": 0.1},
    "position_ripple": {"position_ripple.force": 8.0, "position_ripple.period": 0.05, "position_ripple.phase": 0.7},
    "position_dependent_load": {"position_dependent_load.stiffness": 300.0, "position_dependent_load.neutral": 0.02},
    "unilateral_contact": {"unilateral_contact.stiffness": 900.0, "unilateral_contact.place": 0.02},
    "unilateral_contact, below": {"unilateral_contact.stiffness": -900.0, "unilateral_contact.place": 0.01},
    "unilateral_contact, belt": {**BELT, "unilateral_contact.stiffness": 900.0, "unilateral_contact.place": 0.02},
    "unilateral_contact, damping": {"unilateral_contact.damping": 3000.0, "unilateral_contact.place": 0.02},
    "unilateral_contact, damping below": {"unilateral_contact.damping": -3000.0, "unilateral_contact.place": 0.01},
    "unilateral_contact, friction": {"unilateral_contact.friction": 200.0, "unilateral_contact.place": 0.01},
    "unilateral_contact, friction below": {"unilateral_contact.friction": -200.0, "unilateral_contact.place": 0.03},
    "actuator_lag": {"actuator_lag.time": 0.04},
    "cable_elongation": BELT,
    "stiffness_hardening": {**BELT, "stiffness_hardening.coefficient": 0.1},
    "viscoelastic_creep": {**BELT, "viscoelastic_creep.share": 3.0, "viscoelastic_creep.time": 0.2},
    "slow_creep": {
        **BELT, "viscoelastic_creep.share": 1.5, "viscoelastic_creep.time": 0.05, "slow_creep.share": 2.0,
        "slow_creep.time": 0.4,
    },
    "backlash": {**BELT, "backlash.gap": 0.004},
}  # fmt: skip


def _force(t):
    return 30.0 * np.sin(2 * np.pi * 1.7 * t) + 15.0 * np.sin(2 * np.pi * 0.6 * t + 0.3)


def _record(changes, substeps=10, signals=("position", "motor_position", "velocity")):
    command = np.round(_force((np.arange(STEPS) + 1) * PERIOD), 6)
    values = PLANT.table.pack(changes)[:, None]
    out = replay(
        PLANT, values, command, PERIOD, drive="force", hold="step", signals=signals, substeps=substeps
    )  # fmt: skip
    return command, out[:, :, 0]


@pytest.mark.parametrize("case", CASES)
def test_effect_against_small_explicit_steps(case):
    """1e-3 of the motion: the reference's own step of 20 us is of order 1, as is the friction it switches."""
    changes = CASES[case]
    command, seen = _record(changes)
    values = PLANT.table.unpack(PLANT.table.pack(changes))
    reference = Drive(values, step=2e-5)
    reference.settle(command[0])
    expected = []
    for force in command:
        reference.advance(force, PERIOD)
        expected.append((reference.y, reference.xm))
    size = np.abs(expected).max()
    assert size > 0.01
    assert seen[:, :2] == pytest.approx(np.array(expected), abs=2e-3 * size)
    if case != "nothing":  # and the effect is seen at all
        plain = _record(BELT if "belt_stiffness" in changes and changes is not BELT else {})[1]
        motion, other = (np.column_stack([r[:, 0], r[:, 1] - r[:, 0]]) for r in (seen, plain))
        assert np.any(np.abs(motion - other).max(axis=0) > 0.02 * np.abs(motion).max(axis=0))


@pytest.mark.parametrize("case", [c for c in CASES if "friction" in c or "presliding" in c])
def test_friction_never_gives_energy(case):
    """Thrown without force the carriage only slows down, and what it has lost is never given back."""
    changes = {"coulomb": 2.0, **CASES[case]}
    p = PLANT.prepare(PLANT.table.pack(changes)[:, None])
    for speed in (0.5, -0.5):
        state = PLANT.rest(p, np.zeros(1))
        state[PLANT.row("velocity")] = state[PLANT.row("motor_velocity")] = speed
        values = PLANT.table.pack(changes)[:, None]
        out = replay(
            PLANT, values, np.zeros(400), PERIOD, drive="force", signals=["velocity"], state=state
        )[:, 0, 0]  # fmt: skip
        energy = out**2
        assert energy[0] <= speed**2 + 1e-12 and energy[-1] < 1e-6
        # the elements are springs: at most what they hold, level displacement / 2 = 0.02 J of 1.4 J, swings back
        swing = 0.015 if "presliding" in case else 1e-12
        assert np.all(np.diff(energy) <= swing * speed**2)


@pytest.mark.parametrize("stiffness", [3e2, 3e4, 2e6])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_stop_gives_back_no_more_than_it_took(stiffness, way):
    """Thrown against a spring that is met at 20 mm the carriage comes back with its speed, and is free again.

    In a step of 1 ms the vibration of the springs turns by 0.006, 0.06 and 0.5 rad. The speed is kept to 0.5 % of it,
    wherever in a step the carriage is when it meets the spring.
    """
    changes = {
        "coulomb": 0.0, "viscous": 0.0, "mass": 8.0, "motor_mass": 0.0, "unilateral_contact.stiffness": way * stiffness,
        "unilateral_contact.place": way * 0.02,
    }  # fmt: skip
    at = -np.linspace(0.0, 3e-4, 7) * way
    values = np.repeat(PLANT.table.pack(changes)[:, None], len(at), axis=1)
    state = PLANT.rest(PLANT.prepare(values), at)
    state[PLANT.row("velocity")] = state[PLANT.row("motor_velocity")] = way * 0.3
    out = replay(
        PLANT, values, np.zeros(100), PERIOD, drive="force", signals=["position", "velocity"], state=state, substeps=10
    )
    met = way * out[:, 0, 0] > 0.02
    assert np.all(way * out[-1, 0] < 0.02)
    assert -way * out[-1, 1] == pytest.approx(np.full(len(at), 0.3), rel=5e-3 if stiffness > 1e5 else 1e-4)
    if stiffness == 3e2:  # half a period of the vibration, pi sqrt(m / k) = 0.513 s, of which 0.51 are 51 samples
        assert np.count_nonzero(met) == pytest.approx(np.pi * np.sqrt(8.0 / stiffness) / PERIOD, abs=1.5)


def test_what_is_met_pulls_nothing_and_is_held_at_rest():
    values = PLANT.table.pack({"unilateral_contact.stiffness": 500.0, "unilateral_contact.place": 0.01})
    for place, force in ((0.03, 10.0), (0.01, 0.0), (-0.2, 0.0)):
        state = PLANT.rest(PLANT.prepare(values[:, None]), np.array([place]))
        assert state[PLANT.row("force"), 0] == pytest.approx(force, abs=1e-12)


def test_a_servo_reaches_its_command():
    values = PLANT.table.pack({"coulomb": 0.0})[:, None]
    out = replay(PLANT, values, np.full(300, 0.1), PERIOD, drive="position", signals=["position", "force"])
    assert out[-1, :, 0] == pytest.approx([0.1, 0.0], abs=1e-6)  # 3 s are 96 time constants of the servo


@pytest.mark.parametrize(
    "name", ["backlash.gap", "viscoelastic_creep.share", "slow_creep.share", "stiffness_hardening.coefficient"]
)
def test_what_needs_a_belt_says_so(name):
    with pytest.raises(ConfigurationError, match="needs a belt"):
        PLANT.prepare(PLANT.table.pack({name: 0.01})[:, None])


def test_dead_band_and_steps_change_what_a_command_does():
    """The force is the printed function of the command."""
    command, plain = _record({"coulomb": 0.0}, signals=("position", "force"))
    for changes, force in (
        ({"dead_band.width": 0.1}, np.sign(command) * np.maximum(np.abs(command) - 0.1 * 200.0, 0.0)),
        ({"quantised_command.steps": 5.0}, np.round(command / 40.0) * 40.0),
    ):
        _, seen = _record({"coulomb": 0.0, **changes}, signals=("position", "force"))
        np.testing.assert_allclose(seen[:, 1], force, atol=1e-9)
        assert np.abs(seen[:, 0] - plain[:, 0]).max() > 0.02 * np.abs(plain[:, 0]).max()
