"""Evidence: the marginal likelihood against the Gaussian itself, what a likelihood ratio is worth, what is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cable_envs.diagnosis.evidence.candidates import Candidate, log_odds
from cable_envs.diagnosis.evidence.marginal import Frame, Remainder
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.features import families
from cable_envs.diagnosis.model.model import Block, Whitener
from cable_envs.diagnosis.model.noise import Noise
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, Moving, along


def _frame(count=120):
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(count)
    blocks = [
        Block(
            record,
            channel,
            time,
            np.zeros(count),
            np.ones(count, dtype=bool),
            along=along(np.sin(7.0 * time), 7.0 * np.cos(7.0 * time)),
        )
        for record in ("one", "two")
        for channel in ("a", "b")
    ]
    whitener = Whitener({c: Noise(np.empty(0), 1.0) for c in ("a", "b")})
    return rng, Frame(blocks, whitener, list(families(blocks, [b.measured for b in blocks])))


def _remainder(frame, left, sizes, occam=0.0):
    return Remainder(left, occam, sizes, frame.products(left))


@pytest.mark.parametrize("chosen", [None, (0,), (1, 3)])
def test_the_marginal_likelihood_is_that_of_the_gaussian(chosen):
    """Written out, z is normal with mean 0 and covariance 1 + G S S' G'."""
    rng, frame = _frame()
    left, sizes = rng.standard_normal(frame.count), {"a": 1.5, "b": 0.7}
    model = _remainder(frame, left, sizes, -3.0)

    def written_out(scale):
        covariance = np.eye(frame.count)
        for channel in ("a", "b") if scale else ():
            own = [j for j, f in enumerate(frame.families) if f.channel == channel and (chosen is None or j in chosen)]
            for j in own:
                family, rows = frame.families[j], np.zeros((frame.count, frame.families[j].count))
                for k, columns in family.columns.items():
                    rows[frame.rows[k]] = columns
                covariance += (scale * sizes[channel]) ** 2 / len(own) * rows @ rows.T
        return multivariate_normal(np.zeros(frame.count), covariance).logpdf(left)

    found = frame.marginal(model, 0.4, chosen)
    none = frame.marginal(model, 0.0)
    assert found.log - none.log == pytest.approx(written_out(0.4) - written_out(0.0), rel=1e-7)
    assert none.log == pytest.approx(-0.5 * float(left @ left) - 3.0)


def test_the_discrepancy_comes_back_in_its_own_unit_with_its_errors():
    _, frame = _frame()
    shape = frame.families[0].columns[0]
    left = np.zeros(frame.count)
    left[frame.rows[0]] = 20.0 * shape[:, 1]
    model = _remainder(frame, left, {"a": 20.0, "b": 20.0})
    found = frame.marginal(model, 1.0)
    raw = frame.raw(found.weights)
    assert np.allclose(raw[0], left[frame.rows[0]], atol=1.0)
    assert np.allclose(np.concatenate(raw), frame.explained(found), atol=1e-9)
    alone = frame.marginal(model, 1.0, (0,))
    height, error = frame.map_of(model, alone, 0)
    assert height[1] == pytest.approx(20.0, rel=0.05) and np.all(error < 0.3)


def test_a_ratio_counts_whole_in_white_noise_and_less_where_scores_belong_together():
    rng, frame = _frame(3000)
    signal = np.ones(frame.count)
    white = rng.standard_normal(frame.count)
    slow = np.repeat(rng.standard_normal(frame.count // 50), 50)
    assert frame.adjustment(signal, white) > 0.8
    assert frame.adjustment(signal, slow) < 0.1


def _found(truth, seed, **options):
    fit, heldout = Moving(truth, seed, **options), Moving(truth, seed + 1000, records=1, **options)
    return select(fit, heldout, NOMINALS, HYPOTHESES, np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_named_where_nothing_is_missing(seed):
    found = _found({}, seed, colour=0.5 * (seed % 2))
    assert found.verdict == "no_detectable_mismatch"


@pytest.mark.parametrize(("name", "size"), [("stiffness", 30.0), ("excess", 4.0), ("drift", 0.3)])
def test_what_is_missing_is_named_with_its_size(name, size):
    found = _found({name: size}, 7)
    (accepted,) = found.accepted
    assert accepted.hypothesis.name == f"{name}_effect"
    assert found.verdict in ("named", "equivalence_class")
    assert found.final.fit.values[name] == pytest.approx(size, rel=0.15)
    assert accepted.confidence > 0.5  # the noise is learnt, and odds are then less than they say


def test_what_no_hypothesis_has_is_unknown():
    found = _found({}, 5, extra=lambda t, y, v: 6.0 * np.sin(60.0 * y))
    assert found.verdict == "unknown"


def test_intervals_are_wider_where_scores_belong_together():
    rng, frame = _frame(3000)
    slopes = np.ones((frame.count, 1))
    white, slow = rng.standard_normal(frame.count), np.repeat(rng.standard_normal(frame.count // 50), 50)
    errors = {}
    for name, left in (("white", white), ("slow", slow)):
        left = left - left.mean()
        fit = Fit("", ("level",), {"level": 0.0}, 0.0, left, slopes, np.array([[1.0 / frame.count]]), (), 1)
        one = Candidate((), fit, fit, frame, _remainder(frame, left, {"a": 1.0, "b": 1.0}))
        errors[name] = float(np.sqrt(one.covariance[0, 0]))
    plain = 1.0 / np.sqrt(frame.count)
    assert errors["white"] == pytest.approx(plain, rel=0.1) and errors["slow"] > 3.0 * plain
    moved = replace(one, peak=replace(fit, values={"level": 0.5}))
    assert np.sqrt(moved.covariance[0, 0]) > 0.5


def test_the_surest_discrepancy_is_that_of_all_though_few_are_weighed():
    """What a likelihood ratio is at the most leaves out those that cannot be the surest."""
    rng, frame = _frame()
    left = rng.standard_normal(frame.count) + 2.0 * np.tile(np.sin(7.0 * 0.01 * np.arange(120)), 4)
    fit = Fit("", (), {}, 0.0, left, np.empty((len(left), 0)), np.empty((0, 0)), (), 0)
    one = Candidate((), fit, fit, frame, _remainder(frame, left, {"a": 1.5, "b": 0.7}))
    weighed = []

    class Counted(Candidate):
        def over_none(self, marginal):
            weighed.append(marginal)
            return super().over_none(marginal)

    few = Counted((), fit, fit, frame, one.remainder)
    assert few.left == max(one.over_none(m) for m in one._beside) > 0.0
    assert 0 < len(weighed) < len(one._beside)


def test_models_are_compared_with_discrepancies_that_are_sure():
    """Slow errors ask for a discrepancy, which may not be trusted: its prior alone would count against the model."""
    rng, frame = _frame(3000)
    left = np.repeat(rng.standard_normal(frame.count // 50), 50)

    def candidate(left):
        fit = Fit("", (), {}, 0.0, left, np.empty((len(left), 0)), np.empty((0, 0)), (), 0)
        return Candidate((), fit, fit, frame, _remainder(frame, left, {"a": 1.0, "b": 1.0}))

    null, other = candidate(left), candidate(0.998 * left)
    assert null.best.scale > 0.0 > null.left
    assert null.sure == null.plain
    gain = other.plain.fit - null.plain.fit
    assert gain > 10.0 > log_odds(other, null) > 0.0
    lasting = candidate(left + np.tile(np.sin(7.0 * 0.01 * np.arange(3000)), 4))
    assert lasting.left > 0.0 and lasting.sure.scale > 0.0


def test_a_discrepancy_of_one_family_is_that_of_its_own_functions():
    rng, frame = _frame()
    model = _remainder(frame, rng.standard_normal(frame.count), {"a": 1.5, "b": 0.7})
    found = frame.marginal(model, 0.4, (1, 3))
    written_out = frame.whitener.flat(frame.blocks, frame.raw(found.weights))
    assert frame.explained(found) == pytest.approx(written_out, abs=1e-12)
