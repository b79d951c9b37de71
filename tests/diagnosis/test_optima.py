"""Refits of models that hold each other: none stays in a valley that a smaller or a larger one shows to be wrong."""

import numpy as np

from cable_envs.diagnosis.evidence.optima import nested
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.model.model import Block, Free, Whitener
from cable_envs.diagnosis.model.noise import Noise


class Wave:
    """``sin(a t) + b``, whose sum of squares has many valleys along a."""

    parameters = (Free("a", 1.0, 0.1, 9.0, 0.1), Free("b", 0.0, -5.0, 5.0, 0.5))

    def __init__(self, b=0.2, std=0.05):
        t = 0.02 * np.arange(1500)
        measured = np.sin(t) + b + std * np.random.default_rng(1).normal(size=len(t))
        self.blocks = [Block("one", "y", t, measured, np.ones(len(t), dtype=bool))]

    def predict(self, values):
        """As `cable_envs.diagnosis.model.model.Model`."""
        a, b = values
        return [np.sin(np.outer(self.blocks[0].time, a)) + b]


WHITE = Whitener({"y": Noise(np.empty(0), 0.05)})


def _fits(*starts):
    return refit(Wave(), WHITE, [Start("", tuple(values), values) for values in starts])


def test_a_larger_model_in_a_worse_valley_begins_again_where_a_smaller_one_is():
    small, lost = _fits({"a": 0.99}, {"a": 2.1, "b": 0.0})
    assert abs(lost.values["a"] - 1.0) > 0.2 and lost.cost > small.cost  # else there is nothing to mend
    kept, mended = nested(Wave(), WHITE, [small, lost])
    assert abs(kept.values["a"] - 1.0) < 0.01
    assert abs(mended.values["a"] - 1.0) < 1e-3 and abs(mended.values["b"] - 0.2) < 0.01
    assert mended.cost < small.cost


def test_a_smaller_model_that_has_left_a_valley_follows_a_larger_one():
    lost, large = _fits({"a": 2.1}, {"a": 0.99, "b": 0.0})
    assert abs(lost.values["a"] - 1.0) > 0.2
    mended, kept = nested(Wave(), WHITE, [lost, large])
    assert abs(mended.values["a"] - 1.0) < 0.01 and kept.cost == large.cost


def test_models_that_do_not_hold_each_other_are_left_alone():
    one, other = _fits({"a": 2.1}, {"b": 0.0})
    assert nested(Wave(), WHITE, [one, other]) == [one, other]
