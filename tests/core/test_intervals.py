"""One type of interval: all that estimate something extend it, and a normal one is its standard errors wide."""

import pytest
from scipy.stats import norm

from cable_envs.core.intervals import NORMAL_95, Interval, normal_interval


def test_a_normal_interval_holds_95_percent():
    assert pytest.approx(norm.ppf(0.975), abs=5e-5) == NORMAL_95
    found = normal_interval(3.0, 0.1)
    assert (found.value, found.ends) == (3.0, (3.0 - NORMAL_95 * 0.1, 3.0 + NORMAL_95 * 0.1))
    assert found.holds(3.19) and not found.holds(3.2) and found.width == pytest.approx(0.392)


def test_every_estimate_is_an_interval():
    from cable_envs.diagnosis.model.verdict import Estimate
    from cable_envs.identification.information import ProfileInterval
    from cablebench.score.statistics import BootstrapInterval

    for kind in (BootstrapInterval, Estimate, ProfileInterval):
        assert issubclass(kind, Interval)
    assert BootstrapInterval(0.9, 0.8, 0.95, "training seeds", 3).holds(0.8)
