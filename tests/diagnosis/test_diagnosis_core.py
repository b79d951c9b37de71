"""Steps of the diagnosis that need no simulator: noise, refits, scores, selection."""

import numpy as np
import pytest

from cable_envs.diagnosis.fit.likelihood import raw_residuals, refit_and_learn
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.model import learn_whitener
from cable_envs.diagnosis.model.noise import Noise, learn_noise
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, Toy


def test_noise_is_learnt_with_its_colour():
    true = Noise(np.array([1.2, -0.4]), 0.5)
    seen = learn_noise([true.simulate(4000, np.random.default_rng(k)) for k in range(3)])
    # standard error of an AR coefficient is about 1 / sqrt(12000) = 0.009
    assert seen.order == 2
    np.testing.assert_allclose(seen.coefficients, true.coefficients, atol=0.04)
    assert seen.std == pytest.approx(0.5, rel=0.03)
    white = seen.whiten(true.simulate(8000, np.random.default_rng(9)))
    assert np.std(white) == pytest.approx(1.0, rel=0.03)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.04


def test_noise_leaves_gaps_out_and_needs_samples():
    series = Noise(np.array([0.9]), 1.0).simulate(3000, np.random.default_rng(0))
    series[100:130], series[2000] = np.nan, np.nan
    assert learn_noise([series]).coefficients[0] == pytest.approx(0.9, abs=0.05)
    with pytest.raises(ValueError, match="79 usable samples"):
        learn_noise([np.arange(87.0)])


@pytest.mark.parametrize("lost", [0.005, 0.02, 0.05])
def test_rows_that_are_lost_one_by_one_take_only_their_nearest_with_them(lost):
    long = np.r_[np.zeros(8), np.full(8, 0.3 / 8)]  # of the mean of 16 samples, the later half of them
    true = Noise(long + np.r_[0.5, np.zeros(15)], 1.0)
    series = [true.simulate(2700, np.random.default_rng(k)) for k in range(3)]
    goods = [np.random.default_rng(9 + k).random(2700) >= lost for k in range(3)]
    seen = learn_noise([np.where(good, s, np.nan) for s, good in zip(series, goods, strict=True)])
    assert len(seen.means)  # a long memory is in sight
    assert seen.std == pytest.approx(1.0, abs=0.03)
    white = np.concatenate([seen.flat(s, good) for s, good in zip(series, goods, strict=True)])
    used = white[white != 0.0]
    assert len(used) > (1.0 - lost) ** (len(seen.short) + 1) * 3 * (2700 - seen.order) * 0.95
    assert np.std(used) == pytest.approx(1.0, abs=0.03)


def test_refit_finds_parameters_and_their_intervals():
    covered = 0
    for seed in range(20):
        model = Toy({}, seed, colour=0.5)
        fit = refit_and_learn(model, [Start("", NOMINALS, {})]).fit
        truth = {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0}
        for name, value in truth.items():
            low, high = fit.interval(name)
            covered += low <= value <= high
        assert fit.at_bounds == ()
        assert fit.cost / len(fit.residual) == pytest.approx(1.0, rel=0.1)
    assert covered >= 52  # of 60: fewer has a probability of 0.3 % at 95 %


def test_refit_stops_at_bounds_and_says_so():
    model = Toy({"stiffness": 0.0, "coulomb": 0.0, "viscous": 0.0}, 1)
    fit = refit_and_learn(model, [Start("", ("mass", "viscous", "coulomb", "excess"), {"excess": 2.0})]).fit
    assert all(p.low <= fit.values[p.name] <= p.high for p in model.parameters)
    assert fit.at_bounds


def test_a_prior_holds_a_parameter_that_nothing_shows():
    model = Toy({}, 2)
    model.parameters = tuple(
        p if p.name != "stiffness" else type(p)("stiffness", 5.0, 0.0, 1e5, 100.0, 1e-3) for p in model.parameters
    )
    whitener = learn_whitener(model.blocks, [b.measured for b in model.blocks], 0)
    fit = refit(model, whitener, [Start("", (*NOMINALS, "stiffness"), {})])[0]
    assert fit.values["stiffness"] == pytest.approx(5.0, abs=5e-3)


def test_identical_effects_are_seen_as_such():
    model = Toy({"bias": 1.0}, 3)
    null = refit_and_learn(model, [Start("", NOMINALS, {})])
    found = score_tests(model, null, HYPOTHESES, np.random.default_rng(0))
    assert "difference_effect" in found.class_of("bias_effect")  # with Coulomb's level free they are one


CASES = {
    "stiffness_effect": {"stiffness": 12.0}, "excess_effect": {"excess": 1.0, "velocity": 0.03},
    "bias_effect": {"bias": 0.3}, "drift_effect": {"drift": 0.2},
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_selection_names_the_effect(name):
    right = 0
    for seed in range(3):
        found = select(
            Toy(CASES[name], seed, colour=0.5), Toy(CASES[name], 50 + seed, 1, colour=0.5), NOMINALS, HYPOTHESES,
            np.random.default_rng(seed),
        )  # fmt: skip
        names = [(a.hypothesis.name, *a.alternatives) for a in found.accepted]
        right += len(names) == 1 and name in names[0]
    assert right == 3


def test_selection_finds_two_effects():
    truth = {"stiffness": 15.0, "drift": 0.3}
    found = select(Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, HYPOTHESES, np.random.default_rng(0))
    assert {a.hypothesis.name for a in found.accepted} == {"stiffness_effect", "drift_effect"}
    for name, value in truth.items():
        low, high = found.final.fit.interval(name, 3.3)  # 99.9 %: two intervals of one seed
        assert low <= value <= high


def test_selection_of_a_right_model_finds_nothing():
    found = [select(Toy({}, s, colour=0.6), Toy({}, 70 + s, 1), NOMINALS, HYPOTHESES, np.random.default_rng(s))
             for s in range(10)]  # fmt: skip
    assert sum(bool(f.accepted) for f in found) <= 1


def test_raw_residuals_are_in_the_channels_unit():
    model = Toy({}, 4, std=0.3)
    fit = refit_and_learn(model, [Start("", NOMINALS, {})]).fit
    assert np.std(np.concatenate(raw_residuals(model, fit))) == pytest.approx(0.3, rel=0.1)
