"""A simulation that depends on its steps, or runs away, is found before any effect is looked for."""

from dataclasses import replace

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording, diagnose
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.intake.converged import AT_FIRST, FINEST, WORTH, coarser, converged, decided_by_steps
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.question import Question

TIME = np.arange(0.0, 8.0, 0.01)
MOTION = np.sin(3.0 * TIME)
NOISE = 1e-3


class Stepping:
    """A model whose steps err by ``error`` / substeps^order of the motion's square."""

    parameters = (Free("load_mass", 1.0, 0.0, 9.0, 1.0),)

    def __init__(self, error, order=2, substeps=2, chaos=0.0):
        self.error, self.order, self.substeps, self.chaos = error, order, substeps, chaos
        noise = NOISE * np.random.default_rng(0).standard_normal(len(TIME))
        self.blocks = [Block("one", "position", TIME, MOTION + noise, np.ones(len(TIME), dtype=bool), "m")]

    def resolve(self, substeps):
        self.substeps = substeps

    def predict(self, values):
        off = self.error / self.substeps**self.order + self.chaos * (-1) ** int(np.log2(self.substeps))
        return [np.repeat((MOTION + off * MOTION**2)[:, None], values.shape[1], axis=1)]


def asked(**how):
    fit, heldout = Stepping(**how), Stepping(**how)
    question = Question("cable_hole", fit, heldout, (), (), (), {}, lambda found, accepted: {})
    return converged(question)


def worth(error, order, substeps):
    """Log likelihood of the change with half the step, by the sum over all samples."""
    change = error / substeps**order * (1.0 - 0.5**order) * MOTION**2
    return 0.5 * np.sum((change / NOISE) ** 2)


@pytest.mark.parametrize("error", [1e-5, 2e-4, 1e-3, 4e-3])
@pytest.mark.parametrize("order", [1, 2])
def test_steps_are_halved_until_they_are_worth_less_than_odds_that_decide(error, order):
    found = asked(error=error, order=order)
    right = next((2 * k for k in (1, 2, 4, 8) if worth(error, order, 2 * k) <= WORTH), 2 * FINEST)
    assert found.fit.substeps == found.heldout.substeps == right
    assert bool(found.notes) == (right > 2)
    if right > 2:
        assert found.notes[0].startswith(f"the steps of integration are {right // 2} times as many")


def test_steps_that_no_halving_helps_are_kept_and_told():
    found = asked(error=0.0, chaos=0.01)
    assert found.fit.substeps == 2
    assert found.notes[0].startswith("the simulation depends on its steps: with half as long ones position changes by")


@pytest.mark.parametrize("error", [np.nan, np.inf, 1e7])
def test_a_simulation_that_runs_away_is_refused(error):
    with pytest.raises(ConfigurationError, match="one: the simulation at the claimed values runs away, its position"):
        asked(error=error)


SWING = 0.02 * np.sin(5.0 * TIME) + 0.01 * np.sin(9.0 * TIME)
FORCE = -4.0 * (0.5 * np.sin(5.0 * TIME) + 0.81 * np.sin(9.0 * TIME))


def drive(mass):
    table = {"time": TIME, "position": SWING, "force": FORCE}
    return Recording.from_arrays(
        "linear_drive", {"one": table, "two": table}, heldout="two", nominal={"mass": mass}, noise={"position": 1e-5}
    )


def test_a_drive_is_asked_as_it_was_and_one_that_weighs_nothing_is_refused():
    recording = drive(4.0)
    assert not any("steps" in note for note in converged(ask(recording, request_of(recording))).notes)
    with pytest.raises(ConfigurationError, match=r"e\+04 times what mass, acceleration and the claimed friction take"):
        diagnose(drive(1e-4))  # the servo that holds it is made for the mass that its force tells: nothing runs away


def test_a_stiff_cable_gets_the_steps_that_it_needs():
    """The load's vibration on the cable turns by 1 rad in each of four steps; 24 are the most that a start takes."""
    speed = np.where(TIME % 2.0 < 1.0, 0.02, -0.02)
    path = np.cumsum(speed) * 0.01
    pull = 19.62 + 1e-3 * np.random.default_rng(1).standard_normal(len(TIME))
    table = {"time": TIME, "drive_velocity_command": speed, "drive_tension": pull, "load_position": path}
    recording = Recording.from_arrays(
        "cable_hole", {"one": table, "two": table}, heldout="two",
        nominal={"load_mass": 2.0}, known={"cable_stiffness": 6e4, "friction_coefficient": 0.2},
    )  # fmt: skip
    question = ask(recording, request_of(recording))
    for model in (question.fit, question.heldout):
        model.resolve(4)
    found = converged(question)
    assert found.fit.substeps > 4 and found.heldout.substeps == found.fit.substeps
    assert any("steps of integration" in note for note in found.notes)
    column = np.array([[p.start] for p in found.fit.parameters])
    seen = found.fit.predict(column)
    found.fit.resolve(8 * found.fit.substeps)
    exact = found.fit.predict(column)
    found.fit.resolve(4)
    rough = found.fit.predict(column)
    for near, far, right in zip(seen, rough, exact, strict=True):
        assert np.std(near - right) < 0.6 * np.std(far - right)


def of(**how):
    fit, heldout = Stepping(**how), Stepping(**how)
    return Question("cable_hole", fit, heldout, (), (), (), {}, lambda found, accepted: {})


@pytest.mark.parametrize("error", [1e-5, 1e-3, 1e-2, 1.0])
def test_a_search_has_steps_that_are_as_long_as_decides_nothing(error):
    question = coarser(of(error=error, substeps=16))
    change = [error * (1.0 / k**2 - 1.0 / 16**2) * MOTION**2 for k in (8, 4)]
    told = [0.5 * np.sum((c / jitter(question.fit.blocks[0].measured)) ** 2) for c in change]
    right = 16 if told[0] > AT_FIRST else 8 if told[1] > AT_FIRST else 4
    assert question.fit.substeps == question.heldout.substeps == right


def test_steps_of_integration_are_at_least_one():
    assert coarser(of(error=0.0, substeps=1)).fit.substeps == 1
    assert coarser(of(error=0.0, substeps=3)).fit.substeps == 1


class Slowed(Stepping):
    """The same, whose error grows with its parameter."""

    def predict(self, values):
        own = [Stepping(self.error * v, self.order, self.substeps).predict(values[:, :1])[0] for v in values[0]]
        return [np.concatenate(own, axis=1)]


def test_what_is_found_says_whether_steps_decide_it():
    """Between 4 and 8 steps the model at the found value changes by more than odds that decide, at the claimed one not.

    Where 8 steps are not enough for it either, as with an error that falls with their square root, there is no reason
    to search again.
    """
    question = replace(of(error=0.0), fit=Slowed(1e-3, substeps=4))
    claimed, near, found = {}, {"load_mass": 2.0}, {"load_mass": 300.0}
    assert not decided_by_steps(question, 8, [claimed, near])
    assert decided_by_steps(question, 8, [claimed, found])
    assert question.fit.substeps == 4
    steep = replace(question, fit=Slowed(1e-3, order=4, substeps=4))
    assert decided_by_steps(steep, 8, [claimed, found])
    rough = replace(question, fit=Slowed(1e-3, order=0.5, substeps=4))
    assert not decided_by_steps(rough, 8, [found])
