"""Rivals that only the width of a prior excludes: the price of sizes, and an answer that does not rest on it."""

from dataclasses import replace

import numpy as np
import pytest

from cable_envs.diagnosis.evidence.candidates import Candidate, log_odds, remainder
from cable_envs.diagnosis.evidence.joint import Joint, noise_of
from cable_envs.diagnosis.evidence.marginal import Frame
from cable_envs.diagnosis.evidence.rivals import over_rival
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Moving

WIDE = 1e5
"""Size at which the second bias of `Twice` is typical, that of the first being 1 N."""


class Twice(Moving):
    """The toy with its bias under another name, too, the same but for the size at which it is typical."""

    def __init__(self, truth, seed, **options):
        super().__init__(truth, seed, **options)
        self.parameters = (*PARAMETERS, Free("offset", 0.0, -1e6, 1e6, WIDE))

    def predict(self, values):
        """As the protocol says."""
        return [out + values[-1] for out in super().predict(values)]


BIAS = replace(next(h for h in HYPOTHESES if h.name == "bias_effect"), confusable=("offset_effect",))
OFFSET = Hypothesis(
    "offset_effect", (Free("offset", 0.0, -1e6, 1e6, WIDE),), (({"offset": 1.0},),), nulls={"offset": 0.0},
    confusable=("bias_effect",),
)  # fmt: skip
STIFF = next(h for h in HYPOTHESES if h.name == "stiffness_effect")


def _candidates(*models, truth):
    """Models with these effects, refitted to the same records under the noise that is in them."""
    fit = Twice(truth, 3)
    joint = Joint(fit, Twice(truth, 1003, records=1))
    noise, sizes = noise_of(joint.blocks, [b.measured for b in joint.blocks], {"force": 0.3}), {"force": 1.0}
    frame, found = Frame(joint.blocks, noise, []), []
    for effects in models:
        free = (*NOMINALS, *(n for h in effects for n in h.names))
        (peak,) = refit(joint, noise, [Start("", free, {})])
        found.append(Candidate(effects, peak, peak, frame, remainder(joint, frame, effects, peak, sizes)))
    return found


def test_the_price_of_a_parameter_is_what_its_prior_costs_the_model():
    """With all else as it is, a model without it pays that much less: a determinant by blocks."""
    one, bare = _candidates((BIAS,), (), truth={"bias": 0.4})
    price = one.remainder.priced.of(BIAS.names)
    rest = bare.remainder.occam - one.remainder.occam
    assert price == pytest.approx(rest, abs=0.02) and price > 2.0
    assert one.remainder.priced.of(()) == 0.0


def test_a_rival_that_differs_by_its_prior_alone_is_not_behind():
    one, other = _candidates((BIAS,), (OFFSET,), truth={"bias": 0.4})
    assert log_odds(one, other) == pytest.approx(np.log(WIDE), abs=0.1)
    assert over_rival(one, other) == pytest.approx(0.0, abs=0.1)
    assert over_rival(other, one) == log_odds(other, one)  # the wider prior leads by nothing


def test_what_the_records_say_against_a_rival_counts_in_full():
    one, other = _candidates((BIAS,), (STIFF,), truth={"bias": 0.4})
    assert one.plain.fit - other.plain.fit > 1000.0
    assert log_odds(one, other) - 10.0 < over_rival(one, other) <= log_odds(one, other)


def test_effects_that_both_models_have_are_no_part_of_what_is_made_even():
    alone, behind = (
        over_rival(*_candidates(*models, truth={"bias": 0.4, "stiffness": 40.0}))
        for models in (((STIFF, BIAS), (STIFF, OFFSET)), ((STIFF, BIAS), (STIFF,)))
    )
    assert alone == pytest.approx(0.0, abs=0.1) and behind > 50.0


def test_a_size_far_beyond_the_typical_one_costs_as_its_logarithm():
    """A bias of one is typical, and the prior of a larger one than three is as wide as that is large."""
    prices = []
    for size in (0.4, 9.0, 90.0):
        one, bare = _candidates((BIAS,), (), truth={"bias": size})
        prices.append(bare.remainder.occam - one.remainder.occam)
    assert prices[2] - prices[1] == pytest.approx(np.log(10.0), abs=0.1)
    assert prices[1] - prices[0] == pytest.approx(np.log(9.0 / 3.0) + 0.5, abs=0.1)


def test_an_answer_names_both_of_two_effects_that_differ_by_their_priors_alone():
    fit, heldout = Twice({"bias": 1.0}, 7), Twice({"bias": 1.0}, 1007, records=1)
    found = select(fit, heldout, NOMINALS, [BIAS, OFFSET], np.random.default_rng(0))
    (accepted,) = found.accepted
    assert {accepted.hypothesis.name, *accepted.alternatives} == {"bias_effect", "offset_effect"}
    assert found.verdict == "equivalence_class"
