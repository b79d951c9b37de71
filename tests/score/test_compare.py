"""Comparisons against worked examples and SciPy's own."""

import numpy as np
import pytest
from scipy import stats

from cablebench.score.compare import holm, improvement, kendall, paired, pairs, separated
from cablebench.score.two_level import Plan, task_draws

PLAN = Plan("c", 1, 4000)


def draws(name, scores, task="t"):
    return task_draws(name, task, np.atleast_2d(scores), PLAN)


def test_holm_is_the_worked_example():
    """Five p-values; by hand, from the smallest: 5 x 0.005, 4 x 0.01, 3 x 0.02, then 2 x 0.025 < 0.06, then 0.4."""
    assert holm([0.01, 0.4, 0.005, 0.025, 0.02]) == pytest.approx([0.04, 0.4, 0.025, 0.06, 0.06])
    assert holm([]) == [] and holm([0.7, 0.6]) == [1.0, 1.0]


def test_holm_rejects_falsely_no_more_often_than_it_says():
    rng = np.random.default_rng(0)
    false = sum(min(holm(list(rng.uniform(size=6)))) < 0.05 for _ in range(2000))
    # 2000 trials at 4.9 % (1 - (1 - 0.05/6)^6): standard error 0.48 %
    assert false / 2000 < 0.049 + 3 * 0.0048


def test_a_paired_difference_on_the_same_rigs_is_students_paired_test():
    """With a mild trim the IQM of near-normal scores is close to a mean; its p-value to that of scipy's ttest_rel."""
    rng = np.random.default_rng(2)
    rigs = rng.normal(0, 0.3, 40)
    x, y = 0.6 + rigs + rng.normal(0, 0.02, 40), 0.59 + rigs + rng.normal(0, 0.02, 40)
    found = paired("x", [draws("x", x)], "y", [draws("y", y)], 0.95)
    theirs = stats.ttest_rel(x, y)
    # the rigs' spread is thirty times the difference: only pairing shows it
    assert stats.ttest_ind(x, y).pvalue > 0.5 and theirs.pvalue < 0.05
    assert found.difference == pytest.approx(stats.trim_mean(x, 0.25) - stats.trim_mean(y, 0.25), rel=1e-12)
    assert found.low < found.difference < found.high


def test_a_paired_difference_finds_a_difference_as_often_as_there_is_one():
    """Level and power: without a difference 5 % of the p-values are below 0.05, with a clear one nearly all."""
    small, plan = [], Plan("c", 1, 300)
    for shift in (0.0, 0.1):
        below = 0
        for k in range(200):
            rng = np.random.default_rng([3, k])
            rigs = rng.normal(0, 0.2, 30)
            scores = {n: s + rigs + rng.normal(0, 0.1, (4, 1)) * 0.3 + rng.normal(0, 0.05, (4, 30))
                      for n, s in (("x", 0.5 + shift), ("y", 0.5))}  # fmt: skip
            found = [task_draws(n, "t", s, plan) for n, s in scores.items()]
            below += paired("x", [found[0]], "y", [found[1]], 0.95).p < 0.05
        small.append(below / 200)
    # 200 trials: standard error 1.5 % at 5 %; four of them
    assert small[0] < 0.05 + 4 * 0.0154 and small[1] > 0.9


def test_where_nothing_varies_the_sign_test_over_the_rigs_stands_in():
    a, b = [draws("a", np.full(10, 0.9))], [draws("b", np.full(10, 0.1))]
    assert paired("a", a, "b", b, 0.95).p == pytest.approx(2 * 0.5**10)
    assert paired("a", a, "c", [draws("c", np.full(10, 0.9))], 0.95).p == 1.0


def test_pairs_hold_every_two_entrants_once_the_better_one_first():
    rng = np.random.default_rng(4)
    scores = {n: [draws(n, m + rng.normal(0, 0.05, 20))] for n, m in (("a", 0.1), ("b", 0.9), ("c", 0.9))}
    found = pairs(scores, 0.95)
    assert len(found) == 3 and all(p.difference >= 0.0 for p in found)
    assert {frozenset((p.first, p.second)) for p in found} == {frozenset(s) for s in ("ab", "ac", "bc")}
    assert [p.adjusted for p in found] == pytest.approx(holm([p.p for p in found]))
    assert separated(found, 0.95) == 2  # a from both others; b and c are alike


def test_an_added_entrant_moves_no_other_pair_but_for_holms_count():
    rng = np.random.default_rng(5)
    scores = {n: [draws(n, rng.normal(0.5, 0.1, (3, 20)))] for n in "abcd"}
    few = {(p.first, p.second): p for p in pairs({n: scores[n] for n in "abc"}, 0.95)}
    many = {(p.first, p.second): p for p in pairs(scores, 0.95)}
    for key, pair in few.items():
        other = many[key]
        assert (pair.difference, pair.low, pair.high, pair.p) == (other.difference, other.low, other.high, other.p)


def test_improvement_is_the_count_and_its_resamples_are_counts_too():
    rng = np.random.default_rng(6)
    x, y = rng.normal(0.2, 1, (4, 25)), rng.normal(0, 1, (3, 25))
    found = improvement("x", {"t": x}, "y", {"t": y}, PLAN)
    plain = np.mean([[[a > b for a in x[:, j]] for b in y[:, j]] for j in range(25)])
    assert found.value == pytest.approx(plain, rel=1e-12)
    seeds, others, rigs = PLAN.seeds("x", "t", 4), PLAN.seeds("y", "t", 3), PLAN.rigs("t", 25)
    one = [np.mean([[x[i, j] > y[k, j] for j in rigs[b]] for i in seeds[b] for k in others[b]]) for b in range(400)]
    # quantiles of 400 of the 4000 resamples, spread 0.08: standard error 0.011; the interval is wider than theirs
    low, high = np.quantile(one, [0.025, 0.975])
    assert found.low < low + 0.03 and found.high > high - 0.03 and 0.0 <= found.low < found.high <= 1.0


def test_improvement_that_every_rig_agrees_on_has_the_binomials_end():
    found = improvement("x", {"t": np.ones((1, 10))}, "y", {"t": np.zeros((1, 10))}, PLAN)
    theirs = stats.binomtest(10, 10).proportion_ci(0.95, method="exact")
    assert found.ends == pytest.approx((theirs.low, theirs.high))
    assert improvement("x", {"t": np.ones((1, 3))}, "y", {"u": np.ones((1, 3))}, PLAN) is None


def test_kendall_is_scipys_over_the_entrants_that_both_tasks_have():
    scores = {"s": {"a": 1, "b": 2, "c": 3, "d": 4}, "t": {"a": 1, "b": 3, "c": 2, "e": 9}, "u": {"a": 1.0, "b": 2.0}}
    # a, b, c are common to s and t: of three pairs two in the same order, one not
    assert kendall(scores) == {("s", "t"): pytest.approx(1 / 3)}
