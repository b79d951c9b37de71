"""Statistics against scipy's own and against direct counting."""

import numpy as np
import pytest
from scipy import stats

from cablebench.score.statistics import (
    bootstrap,
    interquartile_mean,
    median,
    optimality_gap,
    performance_profile,
    probability_of_improvement,
    worst_tenth,
)


@pytest.mark.parametrize("n", [1, 3, 4, 7, 10, 31, 100])
def test_interquartile_mean_equals_scipy_trim_mean(n):
    x = np.random.default_rng(n).standard_normal(n)
    # the same values are summed, perhaps in another order
    assert interquartile_mean(x) == pytest.approx(stats.trim_mean(x, 0.25), rel=1e-12)


def test_interquartile_mean_works_along_the_last_axis():
    x = np.random.default_rng(0).standard_normal((5, 12))
    np.testing.assert_allclose(interquartile_mean(x), [stats.trim_mean(r, 0.25) for r in x], rtol=1e-12)


def test_stratified_bootstrap_agrees_with_scipy_bootstrap_of_several_samples():
    rng = np.random.default_rng(1)
    a, b = rng.normal(0.6, 0.2, 12), rng.normal(0.8, 0.1, 9)

    def pooled(x, y, axis=-1):
        return stats.trim_mean(np.concatenate([x, y], axis=-1), 0.25, axis=axis)

    theirs = stats.bootstrap((a, b), pooled, n_resamples=20_000, method="percentile", rng=np.random.default_rng(2))
    ours = bootstrap({"a": a[:, None], "b": b[:, None]}, interquartile_mean, np.random.default_rng(3), 20_000)
    # two Monte-Carlo estimates of the same quantiles: standard error of each about 0.001 with 20 000 resamples
    assert ours.low == pytest.approx(theirs.confidence_interval.low, abs=0.006)
    assert ours.high == pytest.approx(theirs.confidence_interval.high, abs=0.006)
    assert ours.value == pytest.approx(pooled(a, b), rel=1e-12)
    assert ours.unit == "training seeds" and ours.runs == 9


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (interquartile_mean, lambda pooled: stats.trim_mean(pooled, 0.25, axis=-1)),
        (median, lambda pooled: np.quantile(pooled, 0.5, axis=-1)),
        (optimality_gap, lambda pooled: 1.0 - np.minimum(pooled, 1.0).mean(axis=-1)),
        (worst_tenth, lambda pooled: np.partition(pooled, 7, axis=-1)[..., :8].mean(axis=-1)),  # a tenth of 76, up
    ],
    ids=["interquartile mean", "median", "optimality gap", "worst tenth"],
)
def test_bootstrap_of_whole_runs_agrees_with_scipy(ours, theirs):
    """scipy resamples the numbers of the runs, each task's among themselves; a run brings all of its episodes."""
    rng = np.random.default_rng(1)
    tables = [
        rng.normal(level, 0.15, (runs, 1)) + rng.normal(0.0, 0.05, (runs, episodes))
        for level, runs, episodes in ((0.7, 10, 4), (0.95, 12, 3))
    ]

    def statistic(*picked, axis):
        drawn = [t[i.astype(int)] for t, i in zip(tables, picked, strict=True)]
        return theirs(np.concatenate([d.reshape(*d.shape[:-2], -1) for d in drawn], axis=-1))

    runs = tuple(np.arange(len(t)) for t in tables)
    expected = stats.bootstrap(runs, statistic, n_resamples=20_000, method="percentile", rng=np.random.default_rng(2))
    got = bootstrap({"a": tables[0], "b": tables[1]}, ours, np.random.default_rng(3), 20_000)
    assert got.value == pytest.approx(float(theirs(np.concatenate([t.ravel() for t in tables]))), rel=1e-12)
    # spread of the statistics below 0.06; two Monte-Carlo quantiles of 20 000 draws: standard error 0.0012 each
    assert got.low == pytest.approx(expected.confidence_interval.low, abs=0.006)
    assert got.high == pytest.approx(expected.confidence_interval.high, abs=0.006)


@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_bootstrap_levels_agree_with_scipy(level):
    x = np.random.default_rng(3).normal(0.5, 0.2, 15)
    theirs = stats.bootstrap(
        (x,), np.mean, n_resamples=20_000, confidence_level=level, method="percentile", rng=np.random.default_rng(4)
    ).confidence_interval
    ours = bootstrap({"t": x[:, None]}, lambda v: v.mean(-1), np.random.default_rng(5), 20_000, level)
    # spread of the mean 0.05; at 99 % the standard error of a quantile of 20 000 draws is 0.0017
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.007)


def test_probability_of_improvement_is_the_mean_of_mann_whitney_over_episodes_and_tasks():
    rng = np.random.default_rng(6)
    x = {t: rng.integers(0, 6, (n, 5)).astype(float) for t, n in (("a", 7), ("b", 3))}
    y = {t: rng.integers(0, 6, (n, 5)).astype(float) for t, n in (("a", 4), ("b", 9))}
    chances = [
        np.mean([
            stats.mannwhitneyu(x[t][:, k], y[t][:, k], method="asymptotic").statistic / (len(x[t]) * len(y[t]))
            for k in range(5)
        ])
        for t in ("a", "b")
    ]  # fmt: skip
    assert probability_of_improvement(x, y) == pytest.approx(np.mean(chances), rel=1e-12)
    assert probability_of_improvement(x, y) + probability_of_improvement(y, x) == pytest.approx(1.0, rel=1e-12)


def test_episodes_of_one_run_are_not_independent():
    """Runs that differ, episodes that do not: ten thousand episodes must not shrink the interval of three runs."""
    runs = np.array([0.2, 0.5, 0.8])
    few = bootstrap({"t": np.repeat(runs[:, None], 2, axis=1)}, interquartile_mean, np.random.default_rng(0))
    many = bootstrap({"t": np.repeat(runs[:, None], 3000, axis=1)}, interquartile_mean, np.random.default_rng(0))
    assert many.high - many.low > 0.9 * (few.high - few.low)
    assert many.low == pytest.approx(0.2) and many.high == pytest.approx(0.8)


def test_a_single_run_resamples_its_episodes_and_says_so():
    x = np.random.default_rng(5).normal(0.7, 0.1, (1, 40))
    ours = bootstrap({"t": x}, lambda v: v.mean(-1), np.random.default_rng(6), 20_000)
    theirs = stats.bootstrap((x[0],), np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(7))
    # standard error of a 2.5 % quantile of 20 000 draws with spread 0.016 is below 0.0003
    assert ours.low == pytest.approx(theirs.confidence_interval.low, abs=0.002)
    assert ours.high == pytest.approx(theirs.confidence_interval.high, abs=0.002)
    assert ours.unit == "episodes" and ours.runs == 1


def test_runs_and_single_runs_together_are_both_named():
    rng = np.random.default_rng(0)
    mixed = bootstrap({"a": rng.random((3, 4)), "b": rng.random((1, 4))}, interquartile_mean, rng)
    assert mixed.unit == "training seeds and episodes" and mixed.runs == 1


def test_bootstrap_repeats_from_its_generator_and_is_stratified():
    data = {"a": np.full((4, 5), 0.1), "b": np.full((4, 5), 0.9)}
    one, two = (bootstrap(data, interquartile_mean, np.random.default_rng(8), 300) for _ in range(2))
    assert one == two
    # every resample holds as many of each task: without stratification the mean would scatter
    assert one.low == one.high == pytest.approx(0.5)


def test_bootstrap_refuses_a_task_without_episodes():
    with pytest.raises(ValueError, match="at least one episode"):
        bootstrap({"a": np.zeros((0, 3))}, interquartile_mean, np.random.default_rng(0))


def test_bootstrap_interval_covers_the_truth_about_as_often_as_it_says():
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(200):
        result = bootstrap({"t": rng.normal(0.5, 0.1, (20, 1))}, lambda v: v.mean(-1), rng, 400)
        hits += result.low <= 0.5 <= result.high
    # percentile intervals of 20 values cover about 93 %; 200 trials have a standard error of 1.8 %
    assert 0.86 <= hits / 200 <= 0.99


def test_optimality_gap_counts_nothing_above_the_target():
    assert optimality_gap(np.array([0.0, 0.5, 1.0, 7.0])) == pytest.approx(1.5 / 4)


def test_worst_tenth_is_the_mean_of_the_lowest_values():
    x = np.arange(30.0)
    assert worst_tenth(np.random.default_rng(0).permutation(x)) == 1.0  # of 0, 1, 2
    assert worst_tenth(np.array([3.0, -1.0])) == -1.0


def test_probability_of_improvement_equals_the_mann_whitney_statistic_on_one_episode():
    rng = np.random.default_rng(4)
    x, y = rng.integers(0, 6, (15, 1)).astype(float), rng.integers(0, 6, (11, 1)).astype(float)
    u = stats.mannwhitneyu(x[:, 0], y[:, 0], method="asymptotic").statistic
    assert probability_of_improvement({"t": x}, {"t": y}) == pytest.approx(u / (15 * 11), rel=1e-12)


def test_probability_of_improvement_pairs_episodes_and_averages_tasks():
    x = {"a": np.array([[1.0, 5.0, 9.0]]), "b": np.array([[0.0, 0.0]])}
    y = {"a": np.array([[0.0, 4.0, 8.0]]), "b": np.array([[0.0, 1.0]]), "c": np.array([[3.0]])}
    # a: better on each episode although the values overlap; b: one tie and one loss
    assert probability_of_improvement(x, y) == pytest.approx((1.0 + 0.25) / 2)
    assert np.isnan(probability_of_improvement({"a": x["a"]}, {"c": y["c"]}))


def test_performance_profile_counts_the_share_at_or_above():
    x = np.array([0.1, 0.5, 0.5, 0.9])
    np.testing.assert_array_equal(performance_profile(x, np.array([0.0, 0.1, 0.5, 0.6, 1.0])), [1, 1, 0.75, 0.25, 0])
    # the area under the profile of scores in [0, 1] is their mean; the grid of 1e-4 limits the agreement
    grid = np.linspace(0, 1, 10_001)
    assert np.trapezoid(performance_profile(x, grid), grid) == pytest.approx(x.mean(), abs=2e-4)


def test_improvement_does_not_depend_on_the_order_of_the_tasks():
    """Bit for bit: names in a set come in another order in every process, and a board must repeat exactly."""
    rng = np.random.default_rng(0)
    x, y = ({f"task {k}": rng.normal(size=(1, 7)) for k in range(9)} for _ in range(2))
    wanted = probability_of_improvement(x, y)
    for _ in range(20):
        order = rng.permutation(list(x))
        assert probability_of_improvement({str(k): x[str(k)] for k in order}, y) == wanted
