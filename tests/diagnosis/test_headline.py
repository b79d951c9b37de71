"""Headline, small print and JSON of an answer say the same: verdict, names, confidence, and what is left."""

import html
import re

import pytest

from cablebench.pages.diagnosis import render
from cablebench.pages.diagnosis_words import VERDICT, headline, lines, p_value, plain

GAP = {"value": 5.01e-4, "unit": "m", "ci95": [4.6e-4, 5.4e-4], "parameter": "backlash.gap"}
FIT = {"nominal": 5.44, "refit": 5.02, "augmented": 0.2, "suspected": 0.19}


def effect(name, confidence, alternatives=()):
    return {
        "name": name, "hypothesis": name, "confidence": confidence, "alternatives": list(alternatives),
        "equation": f"law of {name}", "parameters": {"gap": GAP}, "separating_experiment": "turn slowly",
    }  # fmt: skip


def answer(verdict, p_left, effects=(), suspected=(), judge="noise"):
    row = {
        "name": "backlash", "gain": 120.0, "score": 90.0, "absorbability_deg": 40.0, "looks_like": ["slack"],
        "state": "accepted", "effect": "backlash", "declared_confusable": [], "equation": "",
    }  # fmt: skip
    left = {"channel": "drive_tension", "coordinate": "speed", "p_value": p_left, "when": "after the model"}
    return {
        "verdict": verdict, "effects": list(effects), "suspected": list(suspected), "location": [], "absorbed": {},
        "fit": {"drive_tension": {"unit": "N", "noise_floor": 0.1, "heldout_rmse": FIT, "fit_rmse": FIT}},
        "test": {"p_value": 1e-30, "p_left": p_left, "minimum_detectable": {"backlash": "0.01 mm"}},
        "hypotheses": [row], "permutation": [],
        "leftover": [{**left, "at": [], "mean": [], "error": [], "unit": "m/s"}],
        "visited": {}, "notes": [], "steps": [], "spectra": [], "augmented_rig": "augmented.yaml",
        "about": {"recording": "rig", "system": "cable_hole", "judge": judge, "seed": 0, "seconds": 3.0,
                  "version": "1", "rules": {"gain": 25.0, "left_p": 1e-4, "alone_p": 1e-6}},
    }  # fmt: skip


ONE, TWO = effect("backlash", 0.9), effect("viscoelastic_creep", 0.85)
EITHER = effect("backlash", 0.9, ("slack",))
CASES = {
    "named": answer("named", 0.3, [ONE]),
    "named, and more is left": answer("named", 7e-39, [ONE]),
    "named, by records that were not fitted": answer("named", 0.0, [ONE], judge="unseen"),
    "two": answer("named", 2e-5, [ONE, TWO]),
    "class": answer("equivalence_class", 0.5, [EITHER]),
    "class, and more is left": answer("equivalence_class", 3e-9, [EITHER, TWO]),
    "unknown": answer("unknown", 1e-12),
    "unknown, with what helps": answer("unknown", 1e-12, suspected=[ONE]),
    "unknown, for another reason": answer("unknown", 0.2, suspected=[TWO]),
    "nothing": answer("no_detectable_mismatch", 0.7),
    "nothing, beside the rig's own effects": answer("no_detectable_mismatch", 1e-8),
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
    p, least = record["test"]["p_left"], 1e-4 if record["effects"] else 1e-6
    sentence = next(s for s in re.split(r"(?<=[.!])\s", said) if "lacks" in s or "missing" in s or "mismatch" in s)
    assert (p_value(p) in said) == (p < least)
    assert ("what is left is not noise" in said) == (p < least)
    if record["effects"] and p < least:
        assert p_value(p) in sentence and "and something more" in sentence
    small = re.search(r"What is left as noise alone: (p [=<] \S+), (which is(?: not)? noise)", page)
    assert small[1] == p_value(p) and (small[2] == "which is not noise") == (p < least)


def test_p_values_that_no_double_holds():
    assert (p_value(0.0), p_value(6.6e-39), p_value(0.25)) == ("p < 1e-300", "p = 7e-39", "p = 0.2")
