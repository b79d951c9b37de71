"""Headline, small print and JSON of an answer say the same: verdict, names, confidence, and what is left."""

import html
import re

import pytest

from cablebench.pages.diagnosis import render
from cablebench.pages.diagnosis_words import VERDICT, headline, lines, odds, plain

GAP = {"value": 5.01e-4, "unit": "m", "ci95": [4.6e-4, 5.4e-4], "parameter": "backlash.gap"}
FIT = {"nominal": 5.44, "refit": 5.02, "augmented": 0.2, "suspected": 0.19}


def effect(name, confidence, alternatives=()):
    return {
        "name": name, "hypothesis": name, "confidence": confidence, "alternatives": list(alternatives),
        "equation": f"law of {name}", "parameters": {"gap": GAP}, "separating_experiment": "turn slowly",
    }  # fmt: skip


def answer(verdict, left, effects=(), suspected=(), cause="", share=0.01):
    row = {
        "name": "backlash", "log_odds": 120.0, "score": 90.0, "absorbability_deg": 40.0, "looks_like": ["slack"],
        "state": "accepted", "effect": "backlash", "declared_confusable": [], "equation": "",
    }  # fmt: skip
    kind = {"channel": "drive_tension", "coordinate": "speed", "log_odds": left, "when": "after the model"}
    return {
        "verdict": verdict, "effects": list(effects), "suspected": list(suspected), "location": [], "absorbed": {},
        "fit": {"drive_tension": {"unit": "N", "noise_floor": 0.1, "heldout_rmse": FIT, "fit_rmse": FIT}},
        "test": {"p_value": 1e-30, "log_odds": 80.0, "log_odds_left": left, "share_left": share, "cause": cause,
                 "sure": 3.0, "minimum_detectable": {"backlash": "0.01 mm"}},
        "hypotheses": [row], "permutation": [],
        "leftover": [{**kind, "at": [], "height": [], "error": [], "unit": "m/s"}],
        "visited": {}, "notes": [], "steps": [], "spectra": [], "augmented_rig": "augmented.yaml",
        "about": {"recording": "rig", "system": "cable_hole", "seed": 0, "seconds": 3.0, "version": "1"},
    }  # fmt: skip


ONE, TWO = effect("backlash", 0.9), effect("viscoelastic_creep", 0.85)
EITHER = effect("backlash", 0.9, ("slack",))
CLOCK = "the logger's clock is off by +0.12 %"
CASES = {
    "named": answer("named", 0.3, [ONE]),
    "named, and more is left": answer("named", 88.0, [ONE]),
    "named, and the data have a fault": answer("named", 8.0, [ONE], cause=CLOCK),
    "two": answer("named", 1.0, [ONE, TWO]),
    "class": answer("equivalence_class", -4.0, [EITHER]),
    "class, and more is left": answer("equivalence_class", 19.0, [EITHER, TWO]),
    "probably": answer("partly_named", 25.0, [ONE], share=0.18),
    "unknown": answer("unknown", 27.0),
    "unknown, with what helps": answer("unknown", 27.0, suspected=[ONE]),
    "unknown, for another reason": answer("unknown", 0.2, suspected=[TWO]),
    "data": answer("data_fault", 40.0, cause=CLOCK),
    "nothing": answer("no_detectable_mismatch", 0.7),
    "nothing, beside the rig's own effects": answer("no_detectable_mismatch", 12.0),
}


def text_of(page):
    return html.unescape(
        re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<(style|script|svg).*?</\1>", " ", page)))
    )


@pytest.mark.parametrize("kind", CASES)
def test_headline_small_print_and_json_agree(kind):
    record = CASES[kind]
    said, page = headline(record), text_of(render(record))
    assert said in page and said == lines(record)[0] and VERDICT[record["verdict"]] in page
    names = {name for e in record["effects"] for name in (e["name"], *e["alternatives"])}
    for name in ("backlash", "slack", "viscoelastic_creep"):
        suspected = any(e["name"] == name for e in record["suspected"])
        assert (plain(name) in said) == (name in names or suspected)
    for e in record["effects"]:
        sure = f"{100 * e['confidence']:.0f} % sure"
        assert sure in said and page.count(sure) >= 2  # in the headline and beside the law
    if not record["effects"]:
        assert "% sure" not in page
    left, cause = record["test"]["log_odds_left"], record["test"]["cause"]
    more = left > record["test"]["sure"]
    assert (odds(left) in said) == (more and not cause)
    assert ("what is left is not noise" in said) == (more and not cause)
    assert (cause in said) if cause else True
    if record["verdict"] == "partly_named":
        assert "probably lacks" in said and "18% of the mismatch is unexplained" in said
    elif record["effects"] and more and not cause:
        assert "and something more" in said
    small = re.search(r"What is left is (not noise|noise) \((odds [^)]+)\)", page)
    assert small[2] == odds(left) and (small[1] == "not noise") == more


def test_what_is_known_as_a_product_only_is_on_the_page_and_in_the_terminal():
    product = {
        "names": ["gap", "stiffness"], "exponents": [1.0, -0.5], "less": [0.0, 0.0], "value": 2.0, "unit": "m",
        "ci95": [1.9, 2.1], "alone_ci95": [[1.0, 4.0], [1.0, 16.0]],
    }  # fmt: skip
    record = {**CASES["two"], "products": [product]}
    said = "Only the product gap * stiffness^-0.5 = 2 m is known"
    assert said in text_of(render(record)) and any(said in line for line in lines(record))
    assert "Only the product" not in text_of(render(CASES["two"]))


def test_odds_are_said_as_people_say_them():
    assert (odds(-2.0), odds(3.0), odds(27.6), odds(None)) == (
        "odds below 1 to 1", "odds 20 to 1", "odds 10^12 to 1", "odds below 1 to 1"
    )  # fmt: skip
