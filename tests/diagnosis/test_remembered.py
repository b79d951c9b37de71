"""Predictions that are kept: the same numbers as the model's own, each column asked for once, within the limit."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.remembered import Remembered
from cable_envs.diagnosis.model.trials import Trials

TIME = np.linspace(0.0, 1.0, 50)


class Parabolas:
    """Two blocks of unequal lengths; counts the columns that it is asked for, and refuses negative ones."""

    def __init__(self):
        self.parameters = [Free("a", 1.0, 0.0, 9.0, 1.0), Free("b", 0.0, -9.0, 9.0, 1.0)]
        self.blocks = [Block("one", name, t, t, t >= 0.0) for name, t in (("x", TIME), ("y", TIME[:20]))]
        self.substeps, self.asked = 2, []

    def predict(self, values):
        if np.any(values[0] < 0.0):
            raise ConfigurationError("a is negative")
        self.asked.append(values.shape[1])
        return [values[0] * b.time[:, None] ** self.substeps + values[1] for b in self.blocks]


def test_each_column_is_predicted_once_and_as_the_model_does():
    model, plain = Parabolas(), Parabolas()
    kept = Remembered(model)
    first = np.array([[1.0, 2.0, 1.0], [0.5, 0.0, 0.5]])  # the last is the first again
    second = np.array([[3.0, 2.0], [1.0, 0.0]])
    for values in (first, second, second, first):
        for got, right in zip(kept.predict(values), plain.predict(values), strict=True):
            assert np.array_equal(got, right)  # to the bit: nothing is computed again
    assert model.asked == [2, 1]


def test_what_the_caller_does_to_a_prediction_is_not_kept():
    kept = Remembered(Parabolas())
    values = np.array([[1.0], [0.5]])
    before = kept.predict(values)[0].copy()
    kept.predict(values)[0][:] = 7.0
    assert np.array_equal(kept.predict(values)[0], before)


def test_other_steps_of_integration_are_other_predictions():
    model = Parabolas()
    kept, values = Remembered(model), np.array([[1.0], [0.5]])
    before = kept.predict(values)[0]
    model.substeps = 3
    assert not np.array_equal(kept.predict(values)[0], before)


def test_the_columns_that_were_asked_for_last_are_kept_within_the_limit():
    model = Parabolas()
    kept = Remembered(model, limit=2 * 70 * 8)  # two columns of 70 samples
    one, two, three = (np.array([[a], [0.0]]) for a in (1.0, 2.0, 3.0))
    for values in (one, two, one, three):  # the third drives out the second, which was not asked for again
        kept.predict(values)
    assert model.asked == [1, 1, 1]
    kept.predict(one)
    assert model.asked == [1, 1, 1]
    kept.predict(two)
    assert model.asked == [1, 1, 1, 1]


def test_more_columns_than_are_kept_are_predicted_all_the_same():
    kept = Remembered(Parabolas(), limit=70 * 8)
    values = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    assert np.array_equal(kept.predict(values)[1], Parabolas().predict(values)[1])


def test_what_the_plant_refuses_is_refused_and_costs_the_others_nothing():
    model = Parabolas()
    kept = Remembered(model)
    with pytest.raises(ConfigurationError, match="negative"):
        kept.predict(np.array([[-1.0], [0.0]]))
    got = Trials(kept).predict(np.array([[1.0, -1.0], [0.0, 0.0]]))[0]
    assert np.isfinite(got[:, 0]).all() and np.isnan(got[:, 1]).all()
