"""Two effects of which neither is sure alone, and a search that has come from the wrong one first."""

import pytest

from cable_envs.diagnosis.engine import diagnose
from cable_envs.proof.cases import make, plan


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("case-0445", {"backlash", "viscoelastic_creep"}),  # neither has odds of 20 to 1 alone
        pytest.param(  # the drift is found first, and its valley is wrong
            "case-0085",
            {"cable_elongation", "friction_drift"},
            marks=pytest.mark.xfail(
                reason="how late a held effort is read has been fitted since, and takes up part of the elongation: its "
                "log odds beside the drift are -3.3 in place of 8.2",
                strict=True,
            ),
        ),
    ],
)
def test_two_effects_are_named_that_only_both_explain(tmp_path, name, truth):
    case = next(c for c in plan(seed=9001) if c.name == name)
    assert set(case.effects) == truth
    make(case, tmp_path)
    found = diagnose(tmp_path)
    assert found.verdict == "named" and {e.name for e in found.effects} == truth
    assert all(e.gain > 8.0 for e in found.effects)  # each beside the other
