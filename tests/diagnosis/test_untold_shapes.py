"""Effects whose shape the records do not tell: their evidence, and that they are no other effect by another name."""

from dataclasses import replace

import numpy as np
import pytest

from cable_envs.diagnosis.evidence.candidates import SHAPES, log_odds, under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Free, Whitener
from cable_envs.diagnosis.model.noise import Noise
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Moving

TYPICAL = 5.0
TIME = Free("time", TYPICAL, 1e-3, 1e6, TYPICAL)
BIAS = replace(next(h for h in HYPOTHESES if h.name == "bias_effect"), confusable=("settled_effect",))
SETTLED = Hypothesis(
    "settled_effect", (*BIAS.free, TIME), (({"bias": 1.0, "time": TYPICAL},),), nulls=BIAS.nulls,
    confusable=("bias_effect",),
)  # fmt: skip
STRIBECK = next(h for h in HYPOTHESES if h.name == "excess_effect")


class Settled(Moving):
    """The toy with a time of which nothing is to be seen."""

    def __init__(self, truth, seed, **options):
        super().__init__(truth, seed, **options)
        self.parameters = (*PARAMETERS, TIME)


def _compared(hypothesis, truth, values):
    """A model with an effect beside the nominal one, from refits that begin at some values."""
    fit = Settled(truth, 3)
    joint = Joint(fit, Settled(truth, 1003, records=1))
    noise, fits = Whitener({"force": Noise(np.empty(0), 0.3)}), []
    for effects in ((hypothesis,), ()):
        free = (*NOMINALS, *(n for h in effects for n in h.names))
        (one,) = refit(fit, noise, [Start("", free, values if effects else {})])
        fits.append((effects, one))
    return under_one_noise(fit, joint, fits, 0, {"force": 0.3}, {"force": 1.0})


@pytest.mark.parametrize("away", [3.0, 1e3])
def test_a_shape_that_is_not_told_costs_no_odds_wherever_least_squares_have_ended(away):
    one, null = _compared(SETTLED, {"bias": 0.4}, {"time": away * TYPICAL})
    beside, _ = _compared(SETTLED, {"bias": 0.4}, {"time": TYPICAL})
    cost = 0.5 * (np.log(away) / SHAPES) ** 2  # what the prior has there, where it is not unusual
    found = log_odds(beside, one)
    assert one.peak.values["time"] == pytest.approx(TYPICAL if away > 100.0 else away * TYPICAL)
    assert one.fit.values["time"] == one.peak.values["time"]
    assert found == pytest.approx(0.0 if away > 100.0 else cost, abs=0.05)
    assert log_odds(one, null) > 30.0 and one.peak.values["bias"] == pytest.approx(0.4, abs=0.1)


def test_an_unusual_shape_that_the_records_tell_stays():
    truth = {"excess": 4.0, "velocity": 0.3}  # fifteen times what is typical
    one, null = _compared(STRIBECK, truth, {"velocity": 0.1, "excess": 2.0})
    assert one.remainder.priced.is_unusual({"velocity"}) and log_odds(one, null) > 20.0
    assert one.peak.values["velocity"] == pytest.approx(0.3, rel=0.3)


def test_an_effect_of_a_usual_shape_is_no_other_effect_by_another_name():
    fit, heldout = Settled({"bias": 1.0}, 7), Settled({"bias": 1.0}, 1007, records=1)
    found = select(fit, heldout, NOMINALS, [BIAS, SETTLED], np.random.default_rng(0))
    (accepted,) = found.accepted
    assert {accepted.hypothesis.name, *accepted.alternatives} == {"bias_effect", "settled_effect"}
