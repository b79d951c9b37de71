"""Notes beside an answer: parameters at an end of what is tried, and what a change with time is counted from."""

from types import SimpleNamespace

import numpy as np

from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.report.notes import on_bounds, since_it_began
from cable_envs.diagnosis.systems.common import motion_coordinates
from cable_envs.effects import EFFECTS

INERTIA = Free("output_inertia", 2e-5, 1e-9, 10.0, 2e-5)
DAMPING = Free("output_damping", 2e-4, 0.0, 10.0, 2e-4)


def said(values, free=(INERTIA, DAMPING)):
    names = tuple(p.name for p in free)
    question = SimpleNamespace(
        fit=SimpleNamespace(parameters=free), nominals=names, nuisance=(), units={"output_inertia": "kg m^2"}
    )
    return on_bounds(question, SimpleNamespace(values=dict(zip(names, values, strict=True))))


def test_an_inertia_of_nearly_nothing_is_said_and_no_damping_is_not():
    (note,) = said((1e-9, 0.0))
    assert note.startswith("output inertia ended at 1e-09 kg m^2, the least value")
    assert "largest value" in said((10.0, 1e-4))[0]
    assert said((1.9e-5, 0.0)) == []


def test_a_parameter_that_was_stated_there_is_not():
    assert said((1e-9,), (Free("output_inertia", 1e-9, 1e-9, 10.0, 1e-9),)) == []


def test_a_change_with_time_in_a_record_that_begins_in_motion_is_counted_from_there():
    time = 0.01 * np.arange(2000)
    moving, resting = np.sin(time), np.where(time < 1.0, 0.0, 1.0 - np.cos(time - 1.0))
    blocks = [
        Block(name, "force", time, place, np.ones(len(time), dtype=bool), "N", motion_coordinates(time, place))
        for name, place in (("run_1.csv", moving), ("run_2.csv", resting))
    ]
    drift, dry = (
        EffectGain(Hypothesis(name, (), (), effect=EFFECTS[name])) for name in ("friction_drift", "coulomb_friction")
    )
    (note,) = since_it_began(blocks, [dry, drift])
    assert note.startswith("friction_drift is counted from the beginning of each record; run_1.csv began in motion")
    assert since_it_began(blocks[1:], [drift]) == []
