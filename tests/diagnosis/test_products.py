"""Products that alone are known: a spring whose scale and gain no record tells apart, and one that hardens."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.report import answer
from cable_envs.diagnosis.report.products import Product, products
from cablebench.pages import diagnosis_words as words

FREE = ("stiffness", "gain", "offset")
FAR = 5.0


class Spring:
    """force = stiffness * gain^power * y + bend * stiffness * y^3 + offset along a slow sine; white noise."""

    def __init__(self, power=1.0, bend=0.0, std=None, noise=0.05, high=1e4):
        t = 0.01 * np.arange(1000)
        self.power, self.bend, self._y = power, bend, np.sin(3.0 * t)[:, None]
        self.parameters = (
            Free("stiffness", 40.0, 0.1, high, 40.0, std and 40.0 * std),
            Free("gain", 2.0, 0.01, 1e3, 2.0, std and 2.0 * std),
            Free("offset", 0.0, -100.0, 100.0, 1.0),
        )
        clean = self.predict(np.array([[44.0], [2.2], [0.3]]))[0][:, 0]
        seen = clean + np.random.default_rng(0).normal(0.0, noise, len(t))
        self.blocks = [Block("run", "force", t, seen, np.ones(len(t), dtype=bool))]

    def predict(self, values):
        k, gain, offset = values
        return [k * gain**self.power * self._y + self.bend * k * self._y**3 + offset]


def found_in(model, nulls=None, without=("offset",), wider=1.0):
    judged = refit_and_learn(model, [Start("", FREE, {})])
    fit = replace(judged.fit, covariance=wider**2 * judged.fit.covariance)
    return products(model, judged.whitener, fit, nulls or {}, without), fit


@pytest.mark.parametrize("power", [1.0, -1.0, 2.0])
def test_a_product_is_named_where_it_alone_is_known(power):
    """The claims know either factor to 30 %, the records their product; the claim's share in it is small."""
    (one,), _ = found_in(Spring(power, std=0.3))
    truth = 44.0 * 2.2**power
    exponents = dict(zip(one.names, one.exponents, strict=True))
    assert exponents["gain"] / exponents["stiffness"] == pytest.approx(power, rel=0.02)
    assert one.exponents[0] == 1.0 and max(map(abs, one.exponents)) == 1.0
    assert one.low < truth ** exponents["stiffness"] < one.high
    assert one.low < one.value < one.high < 1.02 * one.low
    for (low, high), name in zip(one.alone, one.names, strict=True):
        assert low < {"stiffness": 44.0, "gain": 2.2}[name] < high and high > 1.5 * low


def test_without_claims_the_factors_are_open_as_far_as_a_profile_goes():
    (one,), _ = found_in(Spring())
    assert set(one.names) == {"stiffness", "gain"} and one.low < 44.0 * 2.2 < one.high
    for low, high in one.alone:
        assert high > FAR**2 * low


def test_nothing_is_named_where_both_are_known():
    """The cubic part tells the stiffness, so that the gain is known, too."""
    assert found_in(Spring(bend=1.0, std=0.3))[0] == ()


def test_nothing_is_named_where_neither_the_factors_nor_a_product_are_known():
    """Noise as large as the force: both factors are known as their claims say, independently."""
    assert found_in(Spring(std=0.3, noise=1e4))[0] == ()


def test_a_product_is_as_wide_as_the_covariance_says():
    (one,), (other,) = (found_in(Spring(std=0.3), wider=w)[0] for w in (1.0, 3.0))
    assert np.log(other.high / other.low) == pytest.approx(3.0 * np.log(one.high / one.low), rel=0.3)


class Sum(Spring):
    """force = (stiffness + gain) * y: along a straight line in the sizes, which no product follows far."""

    def predict(self, values):
        k, gain, offset = values
        return [(k + 20.0 * gain) * self._y + offset]


def test_a_sum_that_is_known_is_no_product():
    """To first order about the optimum it is one; the profile bends away from it."""
    found, fit = found_in(Sum(std=0.6, noise=0.05))
    relative = fit.covariance / np.outer(*2 * [[fit.values[n] for n in fit.free]])
    correlation = relative[0, 1] / np.sqrt(relative[0, 0] * relative[1, 1])
    assert correlation < -0.99 and found == ()


def test_a_bound_ends_what_is_open():
    """Where a factor cannot be more than what it is, it is not open to that side."""
    (free,), (bound,) = found_in(Spring(std=0.3))[0], found_in(Spring(std=0.3, high=62.0))[0]
    ends = [dict(zip(one.names, one.alone, strict=True))["stiffness"][1] for one in (free, bound)]
    assert ends[0] > 64.0 and ends[1] == pytest.approx(62.0, rel=1e-3)
    assert found_in(Spring(std=0.3, high=44.0))[0] == ()


class Excess(Spring):
    """A scale about 1 that only shows by what it is more than 1: force = stiffness * (gain - 1) * y."""

    def predict(self, values):
        k, gain, offset = values
        return [k * (gain - 1.0) * self._y + offset]


def test_a_size_counts_from_its_null():
    (one,), _ = found_in(Excess(std=0.3), {"gain": 1.0})
    exponents = dict(zip(one.names, one.exponents, strict=True))
    assert exponents["gain"] / exponents["stiffness"] == pytest.approx(1.0, rel=0.05)
    assert dict(zip(one.names, one.nulls, strict=True)) == {"stiffness": 0.0, "gain": 1.0}
    assert one.low < 44.0 * 1.2 < one.high


class Three(Spring):
    """Three factors, of which no two together are known."""

    def predict(self, values):
        k, gain, third = values
        return [k * gain * (third + 1.0) * self._y]


def test_three_factors_are_one_product():
    model = Three(std=0.3)
    model.parameters = (*model.parameters[:2], Free("offset", 0.2, -0.9, 10.0, 1.0, 0.4))
    (one,), _ = found_in(model, {"offset": -1.0}, without=())
    assert set(one.names) == set(FREE) and one.exponents == pytest.approx((1.0, 1.0, 1.0), rel=0.1)
    assert one.low < 44.0 * 2.2 * 1.3 < one.high


def test_units_are_those_of_the_product():
    one = Product(("a", "b", "c"), (1.0, -0.5, 1.0), (0.0, 0.0, 0.0), 2.0, 1.9, 2.1, ((0.1, 9.0),) * 3)
    data = one.as_json({"a": "N/m", "b": "m", "c": "1"})
    assert data["unit"] == "N/m (m)^-0.5" and data["ci95"] == [1.9, 2.1] and data["names"] == ("a", "b", "c")


@pytest.mark.parametrize("bands", [None, "spectra"])
def test_the_answer_says_what_is_known_as_a_product_only(bands):
    """An effect's size and a nominal, from all records; nothing where spectra were compared, and no offset."""
    model, held = Excess(std=0.3), Excess(std=0.3)
    judged = refit_and_learn(model, [Start("", FREE, {})])
    effect = SimpleNamespace(hypothesis=Hypothesis("gain", (model.parameters[1],), (), nulls={"gain": 1.0}))
    selection = SimpleNamespace(bands=bands, accepted=(effect,), taken=(effect,), final=judged)
    question = SimpleNamespace(fit=model, heldout=held, nuisance=("offset",), units={"stiffness": "N/m", "gain": "1"})
    found = answer._products(question, selection)
    if bands:
        assert found == []
        return
    (one,) = found
    assert set(one["names"]) == {"stiffness", "gain"} and one["ci95"][0] < 44.0 * 1.2 < one["ci95"][1]
    (said,) = words.products({"products": found})
    assert "(gain - 1)" in said and " N/m" in said and said.startswith("Only the product ") and "Each alone: " in said


def test_how_closely_a_product_is_known_is_said_in_words():
    one = {
        "names": ["stiffness", "hardening.excess"], "exponents": [1.0, 0.9], "less": [0.0, 0.0], "value": 1230.0,
        "unit": "N/m", "ci95": [1194.2, 1266.9], "alone_ci95": [[10.0, 40.0], [1.0, 1.96]],
    }  # fmt: skip
    assert words.products({"products": [one]}) == [
        "Only the product stiffness * hardening (excess)^0.9 = 1.23e+03 N/m is known, to 3 %. "
        "Each alone: stiffness to a factor of 2; hardening (excess) to 40 %."
    ]
    assert words.products({}) == []
