"""A parameter that the refit drives to an end of what it tries is said, because the corrected rig holds it."""

from types import SimpleNamespace

from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.report.notes import on_bounds

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
