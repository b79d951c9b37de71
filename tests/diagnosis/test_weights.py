"""Refits whose residual is the model's own error: their intervals, from parts of the records."""

import numpy as np
import pytest

from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.weights import autocorrelation_time, reweighted_refit
from tests.support.diagnosis_toy import NOMINALS, PARAMETERS, Toy

TRUTH = {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0}


@pytest.mark.parametrize("colour", [0.0, 0.95])
def test_intervals_from_parts_cover_the_truth_under_noise_of_any_colour(colour):
    covered = 0
    for seed in range(20):
        fit, _ = reweighted_refit(Toy({}, seed, colour=colour), Start("", NOMINALS, {}))
        for name, value in TRUTH.items():
            low, high = fit.interval(name)
            covered += low <= value <= high
    assert covered >= 52  # of 60: fewer has a probability of 0.3 % at 95 %


def test_what_no_part_shows_is_as_open_as_its_bounds():
    fit, _ = reweighted_refit(Toy({}, 0), Start("", (*NOMINALS, "velocity"), {"velocity": 0.02}))
    (velocity,) = (p for p in PARAMETERS if p.name == "velocity")  # shapes an excess that is not there
    assert fit.covariance[3, 3] == pytest.approx((velocity.high - velocity.low) ** 2 / 12.0, rel=0.01)


def test_autocorrelation_time_of_noise_with_a_memory():
    """An autoregression of first order hangs together over (1 + a) / (1 - a) samples."""
    rng = np.random.default_rng(0)
    series = [np.zeros(20_000) for _ in range(3)]
    for one in series:
        for k in range(1, len(one)):
            one[k] = 0.9 * one[k - 1] + rng.normal()
    assert autocorrelation_time(series) == pytest.approx(
        19.0, rel=0.25
    )  # the sum ends at the first negative one: chance adds
    assert autocorrelation_time([rng.normal(size=20_000)]) == pytest.approx(1.0, abs=0.1)
