"""Statistics against rliable (Agarwal et al. 2021), where it is installed: pip install rliable 'pandas<3'.

rliable's metrics need SciPy only; its bootstrap needs arch, whose version 7 cannot be imported beside pandas 3.
"""

import numpy as np
import pytest

from cablebench.score.statistics import bootstrap, interquartile_mean, optimality_gap, probability_of_improvement


def scores(seed, runs, tasks, low=0.0):
    """Scores of runs on tasks, {task: [runs, 1]} as ours take them and [runs, tasks] as rliable's do."""
    table = np.random.default_rng(seed).uniform(low, 1.2, (runs, tasks))
    return {f"task {k}": table[:, k : k + 1] for k in range(tasks)}, table


@pytest.fixture
def metrics():
    return pytest.importorskip("rliable.metrics")


@pytest.fixture
def library():
    """rliable.library; skips where its bootstrap library fails on import (TypeError of arch 7 beside pandas 3)."""
    pytest.importorskip("rliable")
    pandas = pytest.importorskip("pandas")
    if int(pandas.__version__.split(".")[0]) >= 3:
        pytest.skip("arch 7 cannot be imported beside pandas 3")
    return pytest.importorskip("rliable.library")


@pytest.mark.parametrize(("runs", "tasks"), [(3, 8), (10, 8), (5, 1), (7, 3)])
def test_point_estimates_equal_rliables(metrics, runs, tasks):
    ours, theirs = scores(runs, runs, tasks)
    pooled = np.concatenate([t.ravel() for t in ours.values()])
    # the same numbers summed in another order
    assert interquartile_mean(pooled) == pytest.approx(metrics.aggregate_iqm(theirs), rel=1e-12)
    assert optimality_gap(pooled) == pytest.approx(metrics.aggregate_optimality_gap(theirs), rel=1e-12)
    other, others = scores(runs + 100, runs + 2, tasks, low=-0.3)
    expected = metrics.probability_of_improvement(theirs, others)
    assert probability_of_improvement(ours, other) == pytest.approx(expected, rel=1e-12)


def test_stratified_bootstrap_agrees_with_rliables(metrics, library):
    ours, theirs = scores(1, 10, 4)
    both = {"x": theirs}
    np.random.seed(2)  # rliable draws from the global generator

    def statistic(table):
        return np.array([metrics.aggregate_iqm(table), metrics.aggregate_optimality_gap(table)])

    points, intervals = library.get_interval_estimates(both, statistic, reps=4000)
    for k, own in enumerate((interquartile_mean, optimality_gap)):
        interval = bootstrap(ours, own, np.random.default_rng(3), resamples=4000)
        assert interval.value == pytest.approx(points["x"][k], rel=1e-12)
        # standard error of a 2.5 % quantile of 4000 draws with spread 0.06: about 0.0025 for each of the two
        assert interval.low == pytest.approx(intervals["x"][0, k], abs=0.012)
        assert interval.high == pytest.approx(intervals["x"][1, k], abs=0.012)
