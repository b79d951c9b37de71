"""Which names stand beside the best one, and which ends of a range are none of a search."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cable_envs.diagnosis.evidence.likely import EVEN
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.model.hypotheses import LOGGER, Hypothesis
from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.model.verdict import SURE, SURE_WHERE_LEARNT, EffectGain
from cable_envs.diagnosis.report.answer import answered_interval
from cable_envs.diagnosis.report.notes import constant
from cable_envs.diagnosis.search.comparison import holds
from cable_envs.diagnosis.search.effects import Search
from cable_envs.diagnosis.search.refits import Refits
from cable_envs.diagnosis.search.select import _constants, select
from cable_envs.diagnosis.search.selection import Found, confidence
from cable_envs.effects import EFFECTS
from cable_envs.effects.base import FORCE, PLACE
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Toy

COULOMB = Free("coulomb", 0.0, 0.0, 1e3, 5.0)
EXCESS, VELOCITY = Free("excess", 0.0, 0.0, 100.0, 1.0), Free("velocity", 0.02, 1e-3, 1e3, 0.02)
TOLD_APART = [h for h in HYPOTHESES if h.name != "difference_effect"]  # beside Coulomb's friction it is a bias
LAWS = [
    Hypothesis(
        "coulomb_friction", (COULOMB,), (({"coulomb": 1.0},),), confusable=("stribeck_friction",),
        nulls={"coulomb": 0.0},
    ),
    Hypothesis(
        "stribeck_friction", (EXCESS, VELOCITY),
        tuple(({"excess": 1.0, "velocity": v},) for v in (0.02, 0.08, 0.3, 5.0)), nulls={"excess": 0.0},
    ),
]  # fmt: skip


def _selected(truth, hypotheses, **own):
    """`select` on a toy whose model knows neither friction; ``own``: parameters of its own by name."""
    models = []
    for seed, records in ((1, 2), (51, 1)):
        model = Toy({"coulomb": 0.0, **truth}, seed, records)
        mine = {"coulomb": COULOMB, "velocity": VELOCITY, **own}
        model.parameters = tuple(mine.get(p.name, p) for p in PARAMETERS)
        model.blocks = [replace(b, unit="N") for b in model.blocks]
        models.append(model)
    return select(*models, ("mass", "viscous"), hypotheses, np.random.default_rng(0), stated={"force": 0.3})


def test_a_fuller_law_that_ended_in_a_simpler_one_is_no_alternative():
    found = _selected({"coulomb": 1.0}, LAWS)
    assert found.tried["stribeck_friction"] < found.tried["coulomb_friction"]  # it fits as well with more numbers
    (only,) = found.accepted
    assert only.hypothesis.name == "coulomb_friction" and only.alternatives == ()


def test_a_law_whose_shape_shows_is_named_itself():
    (only,) = _selected({"excess": 2.0, "velocity": 0.05}, LAWS).accepted
    assert only.hypothesis.name == "stribeck_friction" and only.alternatives == ()


@pytest.mark.parametrize(("offsets", "named"), [((), 2), ((PLACE,), 2), ((FORCE,), 1)])
def test_a_bias_beside_a_law_that_others_write_with_a_constant_is_not_named(offsets, named):
    law = replace(LAWS[1], effect=replace(EFFECTS["stribeck_friction"], offsets=offsets))
    bias = Hypothesis(
        "sensor_bias.force", (Free("bias", 0.0, -9.0, 9.0, 0.5),), (({"bias": 0.5},),), nulls={"bias": 0.0}
    )
    found = _selected({"excess": 2.0, "velocity": 0.05, "bias": 0.5}, [law, bias])
    assert found.verdict == "named" and len(found.accepted) == named
    assert [a.hypothesis.name for a in found.constants] == (["sensor_bias.force"] if named == 1 else [])
    assert found.final.fit.values["bias"] == pytest.approx(0.5, abs=0.1)  # the model keeps it


@pytest.mark.parametrize(
    ("offsets", "alternatives", "left_out"),
    [((FORCE,), ("sensor_bias.pull",), {"skew"}), ((FORCE,), ("sensor_bias.place",), set()), ((FORCE,), (), set()),
     ((), ("sensor_bias.pull",), set())],
)  # fmt: skip
def test_nor_is_what_cannot_be_distinguished_from_such_a_bias(offsets, alternatives, left_out):
    """In a hole under a constant weight the difference of friction by direction is a constant of the tension."""
    law = replace(LAWS[1], effect=replace(EFFECTS["stribeck_friction"], offsets=offsets))
    skew = replace(LAWS[0], name="skew")
    found = Found(
        None, None, SimpleNamespace(effects=(law, skew)), (), {law.name: 90.0, "skew": 30.0},
        {law.name: {"sensor_bias.pull": 0.1}, "skew": dict.fromkeys(alternatives, 0.2)},
    )  # fmt: skip
    assert _constants(found, {"pull": "N", "place": "m"}) == left_out
    gain = EffectGain(skew, 30.0)
    assert constant([gain])[0].startswith("skew is not named: it cannot be distinguished from a sensor's bias")


def test_where_the_noise_is_learnt_a_rival_is_excluded_if_that_is_rather_right_than_wrong():
    """Else the name alone has a confidence below one half, and a class of both is sure."""
    found = Found(None, None, None, (), {"own": 300.0}, {"own": {"near": 10.0, "far": 90.0}}, SURE_WHERE_LEARNT)
    assert SURE_WHERE_LEARNT < 10.0 < found.excluded < 90.0
    assert confidence([found.excluded], learnt=True) == pytest.approx(EVEN)
    assert found.alternatives("own") == ("near",) and found.against("own") == [300.0, 90.0]
    assert confidence([300.0, 10.0], learnt=True) < EVEN < 0.9 < confidence(found.against("own"), learnt=True)
    stated = replace(found, sure=float(np.log(SURE)))
    assert stated.excluded == np.log(SURE) and stated.alternatives("own") == ()


@pytest.mark.parametrize(
    ("name", "verdict"), [("sensor_rectification.force", "named"), ("bias", "no_detectable_mismatch")]
)
def test_all_of_an_effect_is_no_end_of_a_search(name, verdict):
    """The truth is at the upper bound: of a sensor that turns signs round, or of a search that ended too early."""
    most = Free("bias", 0.0, 0.0, 0.5, 0.5)
    hypothesis = Hypothesis(name, (most,), (({"bias": 0.5},),), nulls={"bias": 0.0})
    found = _selected({"bias": 0.55}, [hypothesis], bias=most)
    assert found.verdict == verdict or (verdict != "named" and not found.accepted)
    assert [a.hypothesis.name for a in found.accepted] == ([name] if verdict == "named" else [])
    if found.accepted:
        low, high = answered_interval(found.final.fit, most)
        assert 0.4 < low < 0.5 and high == 0.5


def _spring_with_more():
    """A spring, and a spring with a constant force beside it: without that force it is the spring."""
    spring = next(h for h in HYPOTHESES if h.name == "stiffness_effect")
    bias = next(p for p in PARAMETERS if p.name == "bias")
    more = tuple(({**one[0], "bias": 1.0},) for one in spring.probes)
    return spring, Hypothesis("gap_effect", (bias, *spring.free), more, nulls={"bias": 0.0})


@pytest.mark.parametrize("bias", [0.0, 1.0])
def test_what_holds_another_is_named_only_if_what_it_has_beside_that_is_sure(bias):
    spring, both = _spring_with_more()
    assert holds(both, spring) and not holds(spring, both)
    truth = {"stiffness": 25.0, "bias": bias}
    found = select(Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, [both, spring], np.random.default_rng(0))
    name = "gap_effect" if bias else "stiffness_effect"
    assert [(a.hypothesis.name, a.alternatives) for a in found.accepted] == [(name, ())]


def test_an_effect_that_ends_smaller_than_the_records_can_tell_is_given_up(monkeypatch):
    truth = {"stiffness": 15.0}
    small = [replace(h, least=20.0) if h.name == "stiffness_effect" else h for h in HYPOTHESES[:1]]
    asked, judge = [], Refits.against

    def at_first(self, hypothesis, fit):
        """As if the first refit had been larger."""
        asked.append(hypothesis)
        return judge(self, hypothesis, fit) if len(asked) > 1 else ""

    monkeypatch.setattr(Refits, "against", at_first)
    search = Search(Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, small, np.random.default_rng(0))
    found = search.run()
    assert not found.best.effects and found.rounds[0].bounded["stiffness_effect"].startswith("it is smaller than 20")
    base = refit_and_learn(search.fit, [Start("", (*NOMINALS, "stiffness"), {})])
    last, better = search._settled(found.null, tuple(small), base, found.rounds)
    assert last.without["stiffness_effect"] > last.sure and better is not None and not better.effects


@pytest.mark.parametrize(
    ("name", "least", "alternatives", "verdict"),
    [("sensor_bias.force", 9.0, ("sensor_scale.force",), "equivalence_class"), ("skew", 9.0, (), "named")],
)
def test_an_error_of_a_sensor_within_its_class_is_what_an_effect_that_looks_alike_may_be(
    name, least, alternatives, verdict
):
    """Beside Coulomb's friction a force in one direction alone is a constant: here in place of a small scale."""
    of, within = (next(h for h in HYPOTHESES if h.name == n) for n in ("bias_effect", "difference_effect"))
    bias = replace(of, name=name, effect=EFFECTS.get("sensor_bias") if name.startswith("sensor") else None)
    scale = replace(within, name="sensor_scale.force", effect=EFFECTS["sensor_scale"], least=least,
                    confusable=EFFECTS["sensor_scale"].confusable)  # fmt: skip
    truth = {"bias": 1.0}
    found = select(Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, [bias, scale], np.random.default_rng(0))
    (only,) = found.accepted
    assert (only.hypothesis.name, only.alternatives, found.verdict) == (name, alternatives, verdict)


def test_an_effect_that_is_not_sure_beside_the_rest_is_given_up_at_the_end():
    """It was taken when less stood beside it; where the noise is learnt, log odds of 7 are not enough to be named."""
    search = Search(Toy({"stiffness": 15.0, "bias": 0.08}, 1), Toy({"stiffness": 15.0, "bias": 0.08}, 51, 1), NOMINALS,
                    TOLD_APART, np.random.default_rng(0))  # fmt: skip
    found = search.run()
    both = tuple(h for h in TOLD_APART if h.name in ("stiffness_effect", "bias_effect"))
    base = refit_and_learn(search.fit, [Start("", (*NOMINALS, "stiffness", "bias"), {})])
    last, better = search._settled(found.null, both, base, found.rounds)
    assert 0.0 < last.without["bias_effect"] < last.sure < last.without["stiffness_effect"]
    assert better is not None and [h.name for h in better.effects] == ["stiffness_effect"]


@pytest.mark.parametrize(("bias", "beside"), [(0.25, False), (1.0, True)])
def test_what_explains_less_than_laws_may_be_formulated_otherwise_is_no_further_effect(bias, beside):
    """A spring's 3.2 N RMS beside the mass: a further 8 % of them may be how springs are formulated; 31 % are not."""

    def names(truth):
        found = select(
            Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, TOLD_APART, np.random.default_rng(0), stated={"force": 0.3}
        )
        return {a.hypothesis.name: a for a in found.accepted}

    assert set(names({"bias": bias})) == {"bias_effect"}
    found = names({"stiffness": 100.0, "bias": bias})
    assert set(found) == ({"stiffness_effect", "bias_effect"} if beside else {"stiffness_effect"})


@pytest.mark.parametrize("spring", [20.0, 100.0])
@pytest.mark.parametrize("bias", [1.0, 1.5])
def test_an_effect_that_gains_much_is_taken_although_a_function_of_the_motion_does_as_well(spring, bias):
    """A constant force is one: its odds over that are 40 to 140, and the sum of squares falls by far more."""
    truth = {"stiffness": spring, "bias": bias}
    found = select(
        Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, TOLD_APART, np.random.default_rng(0), stated={"force": 0.3}
    )
    assert {a.hypothesis.name for a in found.accepted} == {"stiffness_effect", "bias_effect"}


def test_a_small_effect_that_is_clear_enough_is_taken_whatever_the_others_explain():
    """Its 8 % of a spring are refused where the noise is 0.3 N, and have log odds of a thousand where it is 0.01 N."""
    truth, clean = {"stiffness": 100.0, "bias": 0.25}, {"force": 0.01}
    fit, held_out = Toy(truth, 1, std=0.01), Toy(truth, 51, 1, std=0.01)
    best = Search(fit, held_out, NOMINALS, TOLD_APART, np.random.default_rng(0), stated=clean).run().best
    assert {h.name for h in best.effects} == {"stiffness_effect", "bias_effect"}


def test_what_may_be_how_others_are_formulated_is_less_sure():
    assert confidence([50.0, 60.0]) == 0.98
    assert confidence([50.0, 60.0], over_formulation=1.0) == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_what_a_logger_did_is_no_law_that_may_be_formulated_otherwise():
    """The fault explains a hundred times as much as the effect, which is taken nevertheless."""
    faulty = [replace(h, name=f"{LOGGER}fault") if h.name == "stiffness_effect" else h for h in TOLD_APART]
    truth = {"stiffness": 100.0, "bias": 0.25}
    search = Search(Toy(truth, 1), Toy(truth, 51, 1), NOMINALS, faulty, np.random.default_rng(0))
    best = search.run().best
    assert {h.name for h in best.effects} == {f"{LOGGER}fault", "bias_effect"}
    of_bias = 0.5 * 4500 * (0.25 / 0.3) ** 2
    assert search.odds.explained(best) == pytest.approx(of_bias, rel=0.2)
