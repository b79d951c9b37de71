"""Headline, small print and JSON of an answer say the same: verdict, names, confidence, and what is left."""

import html
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.fit.score_tests import Score, ScoreTests
from cable_envs.diagnosis.intake import logged
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.leftover import Left
from cable_envs.diagnosis.model.verdict import VERDICTS, EffectGain
from cable_envs.diagnosis.report import answer as answers
from cable_envs.diagnosis.search.selection import REST, Selection
from cablebench.pages.diagnosis import render
from cablebench.pages.diagnosis_words import VERDICT, headline, lines, odds, plain, title
from tests.support.diagnosis_toy import HYPOTHESES

GAP = {"value": 5.01e-4, "unit": "m", "ci95": [4.6e-4, 5.4e-4], "parameter": "backlash.gap"}
FIT = {"nominal": 5.44, "refit": 5.02, "augmented": 0.2, "suspected": 0.19}


def effect(name, confidence, alternatives=()):
    return {
        "name": name, "hypothesis": name, "confidence": confidence, "alternatives": list(alternatives),
        "equation": f"law of {name}", "parameters": {"gap": GAP}, "separating_experiment": "turn slowly",
    }  # fmt: skip


def answer(verdict, left, effects=(), suspected=(), cause="", share=0.04, cause_left=None):
    row = {
        "name": "backlash", "log_odds": 120.0, "score": 90.0, "absorbability_deg": 40.0, "looks_like": ["slack"],
        "state": "accepted", "effect": "backlash", "declared_confusable": [], "equation": "",
    }  # fmt: skip
    kind = {"channel": "drive_tension", "coordinate": "speed", "log_odds": left, "when": "after the model"}
    return {
        "verdict": verdict, "effects": list(effects), "suspected": list(suspected), "location": [], "absorbed": {},
        "fit": {"drive_tension": {"unit": "N", "noise_floor": 0.1, "heldout_rmse": FIT, "fit_rmse": FIT}},
        "test": {"p_value": 1e-30, "log_odds": 80.0, "log_odds_left": left, "share_left": share, "cause": cause,
                 "cause_left": cause if cause_left is None else cause_left,
                 "sure": 3.0, "minimum_detectable": {"backlash": "0.01 mm"}},
        "hypotheses": [row], "permutation": [],
        "leftover": [{**kind, "at": [], "height": [], "error": [], "unit": "m/s"}],
        "visited": {}, "notes": [], "steps": [], "spectra": [], "augmented_rig": "augmented.yaml",
        "about": {"recording": "rig", "system": "cable_hole", "seed": 0, "seconds": 3.0, "version": "1"},
    }  # fmt: skip


ONE, TWO = effect("backlash", 0.9), effect("viscoelastic_creep", 0.85)
ASKED = {
    "elsewhere": {"load = 70": -40.0, "load = 10": 30.0, "load = 50": 0.4}, "holds": ["load = 10"],
    "local": ["load = 70"],
}  # fmt: skip
LOCAL, HELD = TWO | ASKED, ONE | {"elsewhere": {"load = 10": 30.0}, "holds": ["load = 10"], "local": []}
BEATEN = answer("unknown", 0.2, suspected=[TWO])
BEATEN["test"]["worse_than_claim"] = True
EITHER = effect("backlash", 0.9, ("slack",))
CLOCK = "the logger's clock is off by +0.12 %"
DRIFTS = "load position: its zero drifts"
TONE = "drive tension: a steady tone of 7.17 Hz in this sensor"
CASES = {
    "named": answer("named", 0.3, [ONE]),
    "named, and more is left": answer("named", 88.0, [ONE]),
    "named, and a little more is left": answer("named", 88.0, [ONE], share=0.0004),
    "named, and the data have a fault": answer("named", 8.0, [ONE], cause=DRIFTS),
    "named, and both": answer("named", 88.0, [ONE], cause=CLOCK, cause_left=""),
    "two": answer("named", 1.0, [ONE, TWO]),
    "two, and more is left": answer("named", 19.0, [ONE, TWO]),
    "two, one of them local": answer("named", 1.0, [LOCAL, HELD]),
    "local alone": answer("named", 1.0, [LOCAL]),
    "unknown, with what helps in places": answer("unknown", 27.0, suspected=[LOCAL]),
    "unknown, as the claim is better": BEATEN,
    "possibly": answer("named", 0.3, [ONE, effect("viscoelastic_creep", 0.4)]),
    "class": answer("equivalence_class", -4.0, [EITHER]),
    "class, and more is left": answer("equivalence_class", 19.0, [EITHER, TWO]),
    "probably": answer("partly_named", 25.0, [ONE], share=0.18),
    "probably a class": answer("partly_named", 25.0, [EITHER], share=0.18),
    "probably, and the data have a fault": answer("partly_named", 25.0, [ONE], share=0.18, cause=CLOCK, cause_left=""),
    "unknown": answer("unknown", 27.0, share=None),
    "unknown, with what helps": answer("unknown", 27.0, suspected=[ONE], share=0.6),
    "unknown, for another reason": answer("unknown", 0.2, suspected=[TWO]),
    "unknown, as it is unlikely": answer("unknown", 0.2, suspected=[effect("backlash", 0.26)]),
    "unknown, and the data have a fault": answer("unknown", 27.0, cause=CLOCK, share=None, cause_left=""),
    "data": answer("data_fault", 40.0, cause=DRIFTS),
    "data, and a little more": answer("data_fault", 12.0, cause=CLOCK, cause_left=""),
    "data, a tone": answer("data_fault", 40.0, cause=TONE),
    "data, with what helps": answer("data_fault", 40.0, cause=DRIFTS, suspected=[TWO]),
    "nothing": answer("no_detectable_mismatch", 0.7),
    "nothing, beside the rig's own effects": answer("no_detectable_mismatch", 12.0),
}


@pytest.mark.parametrize(("alternatives", "which"), [((), "it"), (("slack",), "it or a law that does as well")])
def test_what_is_rather_wrong_than_right_only_helps(alternatives, which):
    said = headline(answer("unknown", 0.2, suspected=[effect("backlash", 0.26, alternatives)]))
    assert "The fit improves with backlash, " in said
    assert f"but the probability that {which} is there is only 26 %" in said


def test_a_tone_of_one_sensor_may_be_of_the_rig():
    assert "shakes the rig" in headline(CASES["data, a tone"]) and "shakes" not in headline(CASES["data"])


def text_of(page):
    return html.unescape(
        re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<(style|script|svg).*?</\1>", " ", page)))
    )


def test_every_verdict_is_among_the_cases():
    assert {record["verdict"] for record in CASES.values()} == set(VERDICTS) == set(VERDICT)


def read(said):
    """What a headline says, in the JSON's terms: (share in percent or "", odds) of what is left, "" where none is."""
    found = re.search(
        r"((?:less than 1|\d+) %) of the mismatch is unexplained, and that is not noise \((odds .*?)\)", said
    )
    other = re.search(r"something is left, and that is not noise \((odds .*?)\)", said)
    return found.groups() if found else ("", other[1]) if other else ""


@pytest.mark.parametrize("kind", CASES)
def test_headline_small_print_and_json_agree(kind):
    record = json.loads(json.dumps(CASES[kind]))
    said, page = headline(record), text_of(render(record))
    assert said in page and said == lines(record)[0] and VERDICT[record["verdict"]] in page
    names = {name for e in record["effects"] for name in (e["name"], *e["alternatives"])}
    suspected = {e["name"] for e in record["suspected"]} if record["verdict"] in ("unknown", "data_fault") else set()
    for name in ("backlash", "slack", "viscoelastic_creep"):
        assert (plain(name) in said) == (name in names | suspected)
    test = record["test"]
    left, cause, share = test["log_odds_left"], test["cause"], test["share_left"]
    more = left > test["sure"]
    of_rig = more and not test["cause_left"]
    percent = "" if share is None else "less than 1 %" if share < 0.01 else f"{100 * share:.0f} %"
    assert read(said) == ((percent, odds(left)) if of_rig else "")  # the headline has the JSON's share and odds
    assert said.count("not noise") == of_rig and (cause in said)
    small = re.search(r"What is left is (not noise|noise) \((odds [^)]+)\)", page)
    assert small[2] == odds(left) and (small[1] == "not noise") == more
    after = page[small.end() : page.index("Seed", small.end())]
    assert read(after) == read(said)  # so has the small print
    for e in record["effects"]:
        sure = f"{100 * e['confidence']:.0f} % sure"
        of = " that it is one of them" if e["alternatives"] else " that it is there" if of_rig else ""
        assert f"({sure}{of})" in said and f", {sure}{of}." in page  # in the headline and beside the law
    if not record["effects"]:
        assert "% sure" not in page
    assert ("but that is not all" in said) == ("This is not all" in page) == bool(record["effects"] and of_rig)
    more = "it is not all" in title(record) or "something is left that is not noise" in title(record)
    assert more == bool(record["effects"] and of_rig)
    assert ("probably lacks" in said) == (record["verdict"] == "partly_named")
    unlikely = [plain(e["hypothesis"]) for e in record["effects"] if e["confidence"] < 0.5]
    assert re.findall(r"possibly ([a-z ]+[a-z])", said) == unlikely


@pytest.mark.parametrize(("odds_left", "share"), [(88.0, 0.01), (88.0, 0.2), (0.5, 0.0)])
def test_an_answer_of_the_tool_says_what_is_left_as_its_json_does(odds_left, share):
    """From a selection with an effect to its verdict and its words."""
    effect = EffectGain(HYPOTHESES[0], 90.0, confidence=0.9)
    left = Left(odds_left, share, ())
    judged = Judged(None, (), None, 0.0)
    selection = Selection(judged, judged, (effect,), (), left, left)
    test = answers._test(SimpleNamespace(hypotheses=()), selection, ())
    record = {"verdict": selection.verdict, "effects": [effect.as_answer()], "test": test, "location": []}
    said = headline(json.loads(json.dumps(record)))
    assert selection.verdict == ("partly_named" if share > REST else "named")
    effects = [replace(effect, confidence=c) for c in (0.3, 0.49)]
    assert replace(selection, accepted=tuple(effects)).verdict == "unknown"
    assert replace(selection, accepted=(*effects, effect)).verdict == selection.verdict
    assert read(said) == ((f"{100 * share:.0f} %", odds(odds_left)) if selection.more else "")


@pytest.mark.parametrize(("like", "verdict"), [(logged.LIKE_CLOCK, "equivalence_class"), ((), "unknown")])
def test_a_speed_in_another_scale_may_be_a_clock_that_is_off(like, verdict):
    scale, clock = Hypothesis("sensor_scale.velocity", (), ()), Hypothesis(logged.CLOCK, (), (), confusable=like)
    effect = EffectGain(scale, 90.0, alternatives=(logged.CLOCK, "sensor_scale.position"), confidence=0.98)
    left, judged = Left(0.5, 0.0, ()), Judged(None, (), None, 0.0)
    scores = ScoreTests((), {logged.CLOCK: Score(clock, (), 80.0, (), 0.0, 0.0)}, 0.0, 0.0, np.eye(1), None, 0.0)
    assert Selection(judged, judged, (effect,), (), left, left, scores).verdict == verdict
    assert plain(logged.CLOCK) == "the logger's clock"


def test_what_is_known_as_a_product_only_is_on_the_page_and_in_the_terminal():
    product = {
        "names": ["gap", "stiffness"], "exponents": [1.0, -0.5], "less": [0.0, 0.0], "value": 2.0, "unit": "m",
        "ci95": [1.9, 2.1], "alone_ci95": [[1.0, 4.0], [1.0, 16.0]],
    }  # fmt: skip
    record = {**CASES["two"], "products": [product]}
    said = "Only the product gap * stiffness^-0.5 = 2 m is known"
    assert said in text_of(render(record)) and any(said in line for line in lines(record))
    assert "Only the product" not in text_of(render(CASES["two"]))


@pytest.mark.parametrize("kind", ["two, one of them local", "local alone", "unknown, with what helps in places"])
def test_where_an_effect_holds_is_said(kind):
    record = CASES[kind]
    page, small = text_of(render(record)), " ".join(lines(record))
    for said in (
        "Local: fitted to the other records it does not hold on load = 70, where the model without it is better.",
        "Fitted to the other records it holds on load = 10.",
        "Whether it holds there, load = 50 does not tell.",
    ):
        assert said in page and said in small


def test_the_headline_says_what_is_local():
    assert headline(CASES["two, one of them local"]) == (
        "The simulator lacks backlash (90 % sure); viscoelastic creep (85 % sure) only where it was fitted."
    )
    assert headline(CASES["local alone"]) == (
        "The simulator lacks viscoelastic creep (85 % sure) only where it was fitted."
    )
    assert "better by the model as it was claimed" in headline(BEATEN)
    assert "only where" not in headline(CASES["two"]) and "Local" not in " ".join(lines(CASES["two"]))


def test_odds_are_said_as_people_say_them():
    assert (odds(-2.0), odds(3.0), odds(27.6), odds(None)) == (
        "odds below 1 to 1", "odds 20 to 1", "odds 10^12 to 1", "odds below 1 to 1"
    )  # fmt: skip
