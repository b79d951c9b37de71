"""What decides an answer: probes near the size, noise stated or learnt anew, refusals, the start of a record."""

from dataclasses import replace

import numpy as np
import pytest

from cable_envs.diagnosis.fit.likelihood import refit_and_learn, refit_nominals
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.report import answer
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.systems.common import LEFT, SETTLING, at_first
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Toy


class Root(Toy):
    """A toy with an effect whose force grows with the root of its size, nearly all of which the mass can hide."""

    def __init__(self, size, seed):
        self._size = size
        super().__init__({}, seed)
        self.parameters = (*PARAMETERS, Free("root", 0.0, 0.0, 1e3, 1.0))
        for block, seen in zip(self.blocks, self._extra(np.array([size])), strict=True):
            block.measured[:] += seen[:, 0]

    def _extra(self, root):
        return [np.sqrt(root) * (0.5 * a + 4.0 * y)[:, None] for _, y, _, a in self._motion]

    def predict(self, values):
        plain = super().predict(values)
        return [p + e for p, e in zip(plain, self._extra(values[-1]), strict=True)]


def _white(model):
    model.blocks = [replace(b, memory=0) for b in model.blocks]
    return model


class Swing:
    """sin(rate t): from a claim that is half a turn off by the end, the nearest minimum is another."""

    def __init__(self):
        t = 0.01 * np.arange(1500)
        seen = np.sin(5.5 * t) + np.random.default_rng(0).normal(0.0, 0.1, len(t))
        self.parameters = (Free("rate", 5.0, 0.1, 50.0, 5.0, std=0.4),)
        self.blocks = [Block("run", "angle", t, seen, np.ones(len(t), dtype=bool))]

    def predict(self, values):
        return [np.sin(values[0] * block.time[:, None]) for block in self.blocks]


def test_nominals_are_refitted_from_several_starts():
    model = Swing()
    near = refit_and_learn(model, [Start("as claimed", ("rate",), {})])
    best = refit_nominals(model, ("rate",))
    assert abs(near.fit.values["rate"] - 5.5) > 0.1
    assert best.fit.values["rate"] == pytest.approx(5.5, abs=5e-3)
    assert best.deviance < near.deviance - 100.0


def test_probes_go_nearer_to_the_size_and_along_what_hides_them():
    model = _white(Root(1.0, 1))
    null = refit_and_learn(model, [Start("", NOMINALS, {})])
    far = Hypothesis("root_effect", (model.parameters[-1],), (({"root": 300.0},),), nulls={"root": 0.0})
    found = score_tests(model, null, [far], np.random.default_rng(0))
    sizes = [s.directions[0]["root"] for s in found.scores]
    assert sizes[0] == 300.0 and min(abs(np.log(s)) for s in sizes) < np.log(3.0)
    nearest = min(found.scores, key=lambda s: abs(np.log(s.directions[0]["root"])))
    assert nearest.directions[0]["mass"] < null.fit.values["mass"]  # the mass had taken most of it
    assert 0.5 < nearest.amount[0] < 2.0
    truth = refit_and_learn(model, [Start("", (*NOMINALS, "root"), {"root": 1.0})])
    assert found.best["root_effect"].gain == pytest.approx(null.deviance - truth.deviance, rel=0.3)


def test_a_bias_is_no_memory_of_the_noise():
    gains = []
    for treat in (lambda m: m, _white):
        found = select(
            treat(Toy({"bias": 0.2}, 3)), treat(Toy({"bias": 0.2}, 53, 1)), NOMINALS,
            [h for h in HYPOTHESES if h.name == "bias_effect"], np.random.default_rng(0),
        )  # fmt: skip
        gains.append(found.tried["bias_effect"])
    assert min(gains) > 20.0  # beside the level of every record, which is a drift's


def test_a_record_counts_once_it_has_moved():
    time = 0.01 * np.arange(1000)
    position = np.where(time < 2.0, 0.0, 0.1 * np.sin(time - 2.0))
    early = at_first(time, position + 1e-4 * np.random.default_rng(0).standard_normal(1000))
    left = time[~early][0]
    assert left == pytest.approx(2.0 + LEFT * 2.0, abs=0.03) and not early[int(left / 0.01) + 1 :].any()
    assert time[~at_first(time, np.zeros(1000))][0] == pytest.approx(SETTLING, abs=0.02)


def test_an_effect_that_the_data_want_with_the_other_sign_is_said_to_be_so():
    """Its size is bounded by its null; a spring that pulls the other way has the shape that the residual has."""
    model = _white(Toy({"stiffness": 40.0}, 4))
    null = refit_and_learn(model, [Start("", NOMINALS, {})])
    turned = Hypothesis("turned", (Free("stiffness", 0.0, -1e5, 0.0, 100.0),), (({"stiffness": -10.0},),))
    turned = replace(turned, nulls={"stiffness": 0.0})
    model.parameters = tuple(replace(p, low=-1e5, high=0.0) if p.name == "stiffness" else p for p in PARAMETERS)
    score = score_tests(model, null, [turned], np.random.default_rng(0)).best["turned"]
    assert score.amount[0] < 0.0 and answer.wrong_way(score, model, 6.0)
    right = replace(score, amount=(1.0,))
    assert not answer.wrong_way(right, model, 6.0)
    assert not answer.wrong_way(score, model, 2.0 * score.gain)
