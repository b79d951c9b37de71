"""Identification of the hole's contact: derivatives, recovery of parameters, and what the data cannot tell."""

import math

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.identification.cma_es import cma_es
from cable_envs.identification.information import Information, delta_experiments, fisher, profile_interval, speed_shares
from cable_envs.identification.least_squares import least_squares
from cable_envs.identification.model import FORMS, NAMES, ratio_jacobian, ratio_slope_in_rho, ratios
from cable_envs.identification.problem import RatioProblem, ratio_at
from cable_envs.identification.pso import SwarmSettings, growth, stable_as_printed, swarm, typical_growth
from tests.reference.contact_reference import tension_ratio_printed

TABLE_2 = {"delta": 0.02, "mu": 0.43, "K": 6574.0, "omega": 2.03, "rho0": 1.5}
PAPER_EVALUATIONS = 550 * 40
"""iterations of section 5.2, Gu 2024, times the swarm assumed here"""


def grid(top=0.0108, truth=TABLE_2, noise=0.0, seed=0, model="exact", **changes):
    """75 points as in gu-table2, ratios by the closed form, ``noise`` N on a tension of 49.05 N."""
    wrap, speed = (a.ravel() for a in np.meshgrid(np.radians([30, 45, 60, 75, 90]), top * np.arange(1, 16) / 15))
    ratio = ratio_at(truth, wrap, speed, model)
    std = max(noise, 1e-3) / 49.05
    measured = ratio + (noise > 0) * std * np.random.default_rng(seed).standard_normal(75)
    return RatioProblem(wrap, speed, measured, std, model=model, **changes)


@pytest.mark.parametrize(("rho", "mu", "phi"), [(1.5, 0.43, 1.0), (0.3, 1.1, 1.5), (8.0, 0.2, 3.0), (1.5, 60.0, 1.5)])
def test_slope_in_rho_equals_the_complex_step_derivative(rho, mu, phi):
    expected = np.imag(tension_ratio_printed(rho + 1e-30j, mu, phi)) / 1e-30
    assert ratio_slope_in_rho(rho, mu, phi) == pytest.approx(expected, rel=1e-10)  # the print cancels at large rho / mu


@pytest.mark.parametrize("model", FORMS)
def test_jacobian_equals_differences(model):
    problem = grid(model=model)
    theta = np.array([TABLE_2[n] for n in NAMES])
    exact = ratio_jacobian(FORMS[model], theta, problem.wrap, problem.speed)
    for k, size in enumerate(theta):
        step = np.zeros(5)
        step[k] = 1e-5 * size
        pair = np.stack([theta + step, theta - step], axis=1)
        up, down = ratios(FORMS[model], pair, problem.wrap, problem.speed)
        # truncation of the difference: third derivative in omega, (omega ln v)^3 n / 6 = 130, times 1e-10
        assert exact[:, k] * size == pytest.approx((up - down) / 2e-5, abs=1e-8)


def test_gu_eq23_cost_is_the_sum_of_squares():
    problem = grid(noise=0.1)
    sets = np.random.default_rng(1).random((4, 3))
    theta = problem.theta(sets)
    for k, cost in enumerate(problem.costs(sets)):
        rho, friction = 1.5 * (1 + theta[0, k]), theta[1, k] + theta[2, k] * problem.speed ** theta[3, k]
        plain = np.sum((problem.ratio - tension_ratio_printed(rho, friction, problem.wrap)) ** 2)
        assert cost == pytest.approx(plain, rel=1e-11)  # the printed form of lambda cancels to about 1e-13
        assert cost == pytest.approx(np.sum(problem.residuals(sets[:, k]) ** 2), rel=1e-13)


def test_unit_box_maps_back():
    for log_gain in (False, True):
        problem = grid(log_gain=log_gain)
        assert problem.named(problem.unit(TABLE_2)) == pytest.approx(TABLE_2, rel=1e-13)


def test_gu_table_2_is_recovered_by_least_squares_from_20_of_20_seeds():
    problem = grid()
    for seed in range(20):
        fit = least_squares(problem, np.random.default_rng(seed))
        assert fit.parameters == pytest.approx(TABLE_2, rel=1e-4)  # ends when the cost, 1e-20, stops changing
        assert fit.evaluations <= PAPER_EVALUATIONS / 10
        assert fit.at_bounds == ()


@pytest.mark.parametrize("seed", range(3))
def test_gu_table_2_is_recovered_by_cma_es(seed):
    fit = cma_es(grid(), np.random.default_rng(seed))
    assert fit.parameters == pytest.approx(TABLE_2, rel=1e-4)
    assert fit.evaluations <= PAPER_EVALUATIONS / 10


def test_methods_agree_on_noisy_data():
    problem = grid(noise=0.1)
    fits = [method(problem, np.random.default_rng(5)) for method in (least_squares, cma_es)]
    assert fits[0].cost == pytest.approx(fits[1].cost, rel=1e-6)  # CMA-ES ends at 1e-6
    assert fits[0].cost == pytest.approx(problem.noise_floor, rel=0.6)  # chi-square of 71: 17 % at one sigma


def test_gu_table_1_swarm_collapses_before_the_optimum():
    """The printed constants shrink the swarm by a third in an iteration; the usual ones reach the reported cost."""
    problem = grid()
    printed = [swarm(problem, np.random.default_rng(k)) for k in range(5)]
    sizes = [
        fit.details["spread"][100] / fit.details["spread"][0] for fit in printed if len(fit.details["spread"]) > 100
    ]
    assert np.median(sizes) < 1e-6
    assert all(fit.cost > 1e-6 for fit in printed)
    usual = SwarmSettings(w=0.729, c1=1.494, c2=1.494, iterations=400)
    assert np.median([swarm(problem, np.random.default_rng(k), usual).cost for k in range(5)]) < 1e-6


def test_swarm_is_reproducible_and_counts_its_evaluations():
    problem, settings = grid(), SwarmSettings(iterations=7, particles=5)
    fits = [swarm(problem, np.random.default_rng(3), settings) for _ in range(2)]
    assert fits[0].parameters == fits[1].parameters and fits[0].evaluations == 40
    assert np.all(np.diff(fits[0].history[1]) <= 0)


def test_gu_eq25_first_step_pulls_towards_the_best():
    """At rest each particle is its own best: the first step is c2 r2 (best of all - x)."""
    problem, settings = grid(), SwarmSettings(iterations=1, particles=6, edge="open")
    rng = np.random.default_rng(4)
    x = rng.random((4, 6))
    r2 = rng.random((2, 6))[1]
    best = x[:, [int(np.argmin(problem.costs(x)))]]
    moved = x + 0.8 * r2 * (best - x)
    fit = swarm(problem, np.random.default_rng(4), settings)
    assert fit.cost == min(problem.costs(x).min(), problem.costs(moved).min())
    assert fit.details["spread"][1] == pytest.approx(
        np.sqrt(np.mean(np.sum((moved - moved.mean(axis=1, keepdims=True)) ** 2, axis=0))), rel=1e-14
    )


@pytest.mark.parametrize("w", [0.0, 0.4, 0.729])
def test_second_moments_have_polis_limit(w):
    """Poli 2009: order-2 stable while c1 + c2 < 24 (1 - w^2) / (7 - 5 w) for c1 = c2."""
    limit = 12 * (1 - w * w) / (7 - 5 * w)
    assert (
        growth(w, limit * (1 - 1e-6), limit * (1 - 1e-6))[1] < 1 < growth(w, limit * (1 + 1e-6), limit * (1 + 1e-6))[1]
    )


def test_gu_eq27_forbids_constants_that_converge():
    assert stable_as_printed(0.4, 0.6, 0.8) and not stable_as_printed(0.4, 0.6, 2.6)
    assert growth(0.4, 0.6, 2.6)[1] < 1
    rng = np.random.default_rng(0)
    assert typical_growth(0.4, 0.6, 3.8, rng, 5000) < 1 < growth(0.4, 0.6, 3.8)[1]
    assert typical_growth(0.4, 0.6, 5.0, rng, 5000) > 1


def test_fisher_information_predicts_the_scatter_of_the_estimates():
    problem, estimates = grid(noise=0.1), []
    clean = ratio_at(TABLE_2, problem.wrap, problem.speed)
    wide = {"delta": (-0.1, 0.2)}  # an estimate stopped at a bound does not scatter
    for seed in range(60):
        noise = problem.noise_std * np.random.default_rng(seed).standard_normal(75)
        fit = least_squares(problem.changed(ratio=clean + noise, bounds=wide), np.random.default_rng(0))
        estimates.append([fit.parameters[n] for n in NAMES[:4]])
    expected = [fisher(problem, TABLE_2).std[n] for n in NAMES[:4]]
    assert np.std(estimates, axis=0, ddof=1) == pytest.approx(expected, rel=0.3)  # 60 draws know a std to 9 %


def test_gu_eq17_delta_cannot_be_told_from_rho0():
    problem = grid(noise=0.1)
    free = fisher(problem, TABLE_2, NAMES)
    assert not free.regular and math.isinf(free.std["delta"]) and math.isinf(free.std["rho0"])
    assert math.isfinite(free.std["K"]) and math.isfinite(free.std["omega"])
    std, direction = free.directions[0]
    # undetermined: d rho0 / rho0 = -d delta / (1 + delta), in relative changes -delta / (1 + delta) of delta's
    assert math.isinf(std) and direction["rho0"] / direction["delta"] == pytest.approx(-0.02 / 1.02, rel=1e-3)
    shifted = {"rho0": 1.53}
    moved = least_squares(problem.changed(fixed=shifted, bounds={"delta": (-0.1, 0.1)}), np.random.default_rng(0))
    best = least_squares(problem.changed(bounds={"delta": (-0.1, 0.1)}), np.random.default_rng(0))
    assert moved.cost == pytest.approx(best.cost, rel=1e-9)  # same optimum
    product = (1 + best.parameters["delta"]) * 1.5
    assert (1 + moved.parameters["delta"]) * 1.53 == pytest.approx(product, rel=1e-6)


def test_gain_and_exponent_are_determined_together_only():
    found = fisher(grid(noise=0.1), TABLE_2)
    k, omega = found.names.index("K"), found.names.index("omega")
    assert found.correlation[k, omega] > 0.98


def test_what_separates_delta_from_rho0():
    found = {e.name: e for e in delta_experiments(grid(noise=0.1, model="g22"), TABLE_2, cable_radius=1e-3)}
    assert math.isinf(found["ratios alone"].std_delta)
    assert math.isinf(found["ratios again in a second hole"].std_delta)
    assert found["compressed diameter in the hole"].std_delta < 0.01  # the camera alone has 0.01 mm / 1 mm
    assert found["ratios again under another load"].std_delta < 0.005


def test_profile_interval_equals_the_normal_one_where_the_model_is_nearly_linear():
    problem = grid(noise=0.1, bounds={"delta": (-0.2, 0.3)})
    fit = least_squares(problem, np.random.default_rng(0))
    std = fisher(problem, fit.parameters).std["mu"]
    interval = profile_interval(problem, fit.parameters, "mu")
    assert not interval.low_open and not interval.high_open
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * std, rel=0.05)  # curvature over two sigma
    assert interval.curve[1].min() == 0.0 and np.all(np.diff(interval.curve[0]) > 0)


def test_profile_interval_is_open_where_the_data_set_no_limit():
    """Steel at 10.8 mm/s: C = 1e-4, so that K and omega do nothing."""
    steel = {"delta": 0.019, "mu": 0.283, "K": 1192.0, "omega": 3.53, "rho0": 1.5}
    problem = grid(truth=steel, noise=0.1)
    assert fisher(problem, steel).std["K"] > 100 * 1192
    interval = profile_interval(problem, steel, "omega")
    assert interval.high_open and interval.high == 4.0


def test_speed_shares_name_the_speeds_that_matter():
    shares = speed_shares(grid(noise=0.1), TABLE_2)
    assert len(shares["speed"]) == 15 and all(np.all(shares[n] > 1) for n in NAMES[:4])
    assert np.argmax(shares["delta"]) == 14  # friction, and with it the effect of rho, is largest at the top


def test_information_of_a_known_parameter():
    """A prior on one of two parameters that enter as their sum determines the other."""
    singular = Information(("a", "b"), np.ones(2), np.array([[4.0, 4.0], [4.0, 4.0]]))
    assert math.isinf(singular.std["a"]) and not singular.regular
    prior = Information(("a", "b"), np.ones(2), np.array([[4.0 + 1.0, 4.0], [4.0, 4.0]]))
    assert prior.std == pytest.approx({"a": 1.0, "b": math.sqrt(1.25)})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wrap": [0.5, 1.0]}, "speed: expected 2 numbers"),
        ({"ratio": np.full(75, np.nan)}, r"ratio\[0\] = nan must be finite and above 0"),
        ({"noise_std": 0.0}, r"noise_std\[0\] = 0 must be"),
        ({"fixed": {"rho": 1.5}}, "unknown parameter 'rho'; did you mean 'rho0'"),
        ({"bounds": {"K": (5.0, 1.0)}}, "bounds of K: .* is empty"),
        ({"bounds": {"K": (0.0, 1e4)}, "log_gain": True}, "lower bound must be positive"),
        ({"model": "g9"}, "unknown model 'g9'"),
        ({"fixed": TABLE_2}, "nothing to identify"),
        ({"wrap": [1.0], "speed": [0.01], "ratio": [1.3], "noise_std": [0.01]}, "1 points cannot determine 4"),
    ],
)
def test_bad_problems_are_refused(changes, message):
    with pytest.raises(ConfigurationError, match=message):
        grid().changed(**changes)


def test_bad_swarms_are_refused():
    with pytest.raises(ConfigurationError, match="edge 'bounce'"):
        SwarmSettings(edge="bounce")
    with pytest.raises(ConfigurationError, match="2 particles"):
        SwarmSettings(particles=1)
