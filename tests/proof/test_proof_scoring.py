"""Sealing and scoring of the blind proof on verdicts made by hand."""

import json

import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.proof import report
from cable_envs.proof.effects import CLASSES, LIBRARY, share_class
from cable_envs.proof.run import checked, write_manifest
from cable_envs.proof.scoring import calibration, confusion, failures, judge, limits, table
from cable_envs.proof.sealing import opened, seal


def key(name="c", kind="single", effects=("backlash",), band=">10", noise="white", **changes):
    entries = [{"name": e, "parameters": {"gap": {"value": 0.02, "unit": "rad"}} if e == "backlash" else {}}
               for e in effects]  # fmt: skip
    case = {"name": name, "system": "pulley_circuit", "kind": kind, "band": band, "noise": noise}
    return {
        "case": case, "effects": entries, "added": 0.2, "ambient": ["partial_slip"], "concealment": ["brief"],
        "mismatch": [[0.0, 0.5], [0.5, 0.3], [1.0, 0.2]], "noise_floor": {"output_angle": 1e-3}, **changes,
    }  # fmt: skip


def verdict(*names, kind="named", confidence=0.95, alternatives=(), gap=None, spans=(), augmented=None):
    effects = [
        {"name": n, "confidence": confidence, "alternatives": list(alternatives),
         "parameters": {"gap": {"value": 0.0, "unit": "rad", "ci95": gap}} if gap else {}}
        for n in names
    ]  # fmt: skip
    fit = {"output_angle": {"heldout_rmse": {"augmented": augmented}}} if augmented else {}
    return {
        "schema": "cable-diagnosis/1", "verdict": kind, "effects": effects, "fit": fit,
        "location": [{"intervals_s": [list(s) for s in spans]}],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("made", "outcome"),
    [
        (verdict("backlash"), "exact"),
        (verdict("backlash", "partial_slip"), "exact"),  # what is always there costs nothing
        (verdict("cable_elongation", kind="equivalence_class", alternatives=["backlash"]), "class"),
        (verdict("backlash", kind="equivalence_class", alternatives=["cable_elongation"]), "class"),
        (verdict("cable_elongation"), "wrong"),  # of the same class, but the doubt was not declared
        (verdict("actuator_lag", kind="equivalence_class", alternatives=["backlash"]), "wrong"),  # no declared class
        (verdict("backlash", "friction_drift"), "wrong"),
        (verdict("partial_slip"), "none"),
        (verdict("backlash", kind="partly_named"), "exact"),
        (verdict("slack", kind="partly_named"), "wrong"),
        (verdict(kind="unknown"), "unknown"),
        (verdict(kind="data_fault"), "data"),
        (verdict(kind="no_detectable_mismatch"), "none"),
        (None, "failed"),
    ],
)
def test_outcome_of_a_single_effect(made, outcome):
    assert judge(key(), made).outcome == outcome


def test_a_class_that_holds_too_much_is_wrong_and_says_that_the_truth_is_in_it():
    wide = judge(key(), verdict("actuator_lag", kind="equivalence_class", alternatives=["backlash"]))
    plain = judge(key(), verdict("actuator_lag", kind="equivalence_class", alternatives=["sensor_delay"]))
    assert wide.outcome == plain.outcome == "wrong"
    assert (wide.offered, plain.offered, judge(key(), verdict("backlash")).offered) == (True, False, False)
    rows = {row.name: row.count for row in table([wide, plain])}
    assert rows["effect adds more than 10 %: wrong name"] == 2
    assert rows["effect adds more than 10 %: wrong name, with the right one among its alternatives"] == 1


def test_outcomes_of_other_kinds():
    pair = key(kind="pair", effects=("backlash", "friction_drift"))
    assert judge(pair, verdict("friction_drift", "backlash")).outcome == "exact"
    assert judge(pair, verdict("backlash")).outcome == "partly"
    assert judge(pair, verdict("backlash", "slack")).outcome == "wrong"
    strange = key(kind="strange", effects=("ratchet",))
    assert judge(strange, verdict("backlash")).outcome == "wrong"
    assert judge(strange, verdict(kind="unknown")).outcome == "unknown"
    nothing = key(kind="nothing", effects=(), concealment=[], mismatch=[])
    assert judge(nothing, verdict("backlash")).outcome == "wrong"
    assert judge(nothing, verdict(kind="no_detectable_mismatch")).outcome == "none"


def test_the_band_is_what_the_effect_adds():
    for added, band in ((0.5, ">10"), (0.1, ">10"), (0.05, "3-10"), (0.02, "1-3"), (0.005, "<1")):
        assert judge(key(added=added), None).band == band


def test_intervals_overlap_and_heldout():
    result = judge(key(), verdict("backlash", gap=[0.015, 0.021], spans=[(0.0, 0.5), (0.25, 0.75)], augmented=1.1e-3))
    assert result.intervals == (("backlash.gap", True),)
    assert result.overlap == pytest.approx(0.5 + 0.3 * 0.5)  # half of the second bin
    assert result.heldout == pytest.approx(1.1)
    assert judge(key(), verdict("backlash", gap=[0.021, 0.03])).intervals == (("backlash.gap", False),)
    true = key()["effects"][0]["parameters"]["gap"]["value"]
    at_its_end = [0.5 * true, true * (1.0 - 1e-15)]  # as 2 + 4e-16 of an interval that ends at 2
    assert judge(key(), verdict("backlash", gap=at_its_end)).intervals == (("backlash.gap", True),)
    assert judge(key(), verdict("backlash", gap=[0.5 * true, 0.999 * true])).intervals == (("backlash.gap", False),)
    assert judge(key(), verdict("slack", gap=[0.0, 1.0], augmented=1e-3)).heldout is None


def test_clopper_pearson_by_hand():
    assert limits(0, 10) == (0.0, pytest.approx(1 - 0.025**0.1))  # closed forms at both ends
    assert limits(10, 10) == (pytest.approx(0.025**0.1), 1.0)
    assert limits(5, 100) == (pytest.approx(0.01643, abs=1e-5), pytest.approx(0.11283, abs=1e-5))  # tables
    assert limits(0, 0) == (0.0, 1.0)


def _results(right, wrong, unknown, quiet, alarms):
    made = [judge(key(f"r{k}"), verdict("backlash", gap=[0.0, 0.1])) for k in range(right)]
    made += [judge(key(f"w{k}"), verdict("slack")) for k in range(wrong)]
    made += [judge(key(f"u{k}"), verdict(kind="unknown")) for k in range(unknown)]
    nothing = {"kind": "nothing", "effects": (), "band": ""}
    made += [judge(key(f"q{k}", **nothing), verdict(kind="no_detectable_mismatch")) for k in range(quiet)]
    return made + [judge(key(f"a{k}", **nothing), verdict("slack", confidence=0.6)) for k in range(alarms)]


def test_table_confusion_and_calibration_count():
    results = _results(7, 2, 1, 18, 2)
    rows = {row.name: row for row in table(results)}
    named = rows["effect adds more than 10 %: exact name or class"]
    assert (named.count, named.total, named.reached) == (7, 10, False)
    alarms = rows["nothing missing, white noise: something is reported"]
    assert (alarms.count, alarms.total, alarms.reached) == (2, 20, False)
    assert rows["effect that is brief: exact name or class"].total == 10
    assert rows["two effects at once: exact name or class of both"].share is None
    assert confusion(results)["backlash"] == {"backlash": 7, "slack": 2, "unknown": 1}
    assert confusion(results)["nothing"] == {"no mismatch": 18, "slack": 2}
    (high,) = [b for b in calibration(results) if b["from"] == 0.95]
    assert (high["answers"], high["right"]) == (9, 7)


def test_limits():
    assert failures(_results(20, 0, 0, 40, 2)) == []  # 2 of 42 are 4.8 %
    assert [b.split(":")[0] for b in failures(_results(20, 0, 0, 37, 2))] == ["false alarms"]  # 2 of 39: 5.1 %
    assert "confidence of 0.9" in failures(_results(5, 1, 0, 1, 0))[0]  # 5 of 6: 83 %
    missed = [judge(key(), verdict("backlash", gap=[0.5, 0.6])) for _ in range(2)] + _results(17, 0, 0, 1, 0)
    assert "intervals that contain the true value: 17 of 19" in failures(missed)[0]
    assert failures([]) == []
    few = _results(20, 0, 0, 10, 2)  # 2 of 12 are 17 %, but the lower limit is 2 %
    assert failures(few) and failures(few, sample=True) == []
    assert failures(_results(20, 0, 0, 9, 3), sample=True)  # 3 of 12: the lower limit is 5.5 %


def test_declared_classes_name_effects_that_exist():
    names = {e.name for effects in LIBRARY.values() for e in effects}
    assert {n for c in CLASSES for n in c} <= names
    assert share_class("actuator_lag", "sensor_delay") and not share_class("actuator_lag", "backlash")


def test_a_key_that_was_changed_is_refused(tmp_path):
    digest, text = seal(key())
    file = tmp_path / "key.json"
    file.write_text(text)
    assert opened(file, digest) == json.loads(json.dumps(key()))
    file.write_text(text.replace('"backlash"', '"slack"'))
    with pytest.raises(ConfigurationError, match="not the key that was sealed"):
        opened(file, digest)
    assert seal(key())[0] != digest  # salted: the same key never shows
    file.write_text("{}")
    with pytest.raises(ConfigurationError, match="no sealed key"):
        opened(file, digest)


def test_a_manifest_is_never_rewritten(tmp_path):
    lines = {"case-1": {"sealed": "a", "recording": "b"}}
    write_manifest(tmp_path, lines, {"plan": "p"})
    assert write_manifest(tmp_path, lines, {"plan": "p"})["cases"] == lines
    with pytest.raises(ConfigurationError, match="case-1 changed since the keys were sealed"):
        write_manifest(tmp_path, {"case-1": {"sealed": "x", "recording": "b"}}, {"plan": "p"})


def test_verdicts_are_checked():
    with pytest.raises(ValueError, match="schema"):
        checked({"verdict": "named"})
    with pytest.raises(ValueError, match="none of"):
        checked({"schema": "cable-diagnosis/1", "verdict": "perhaps"})


def test_report_and_page():
    from cable_envs.core.files import jsonable
    from cablebench.pages.proof import render

    results = {"diagnose": _results(7, 2, 1, 18, 2), "black box": _results(0, 0, 3, 2, 0)}
    about = {"command": "cablebench blind-test", "cases_total": 30}
    text = report.markdown(results, about)
    assert (
        "| effect adds more than 10 %: exact name or class | at least 95 % | 70 % (35-93), 7/10 | 0 % (0-71), 0/3 |"
        in text
    )
    assert "Limits exceeded by diagnose: false alarms: 2 of 20" in text
    page = render(jsonable(report.record(results, about)))
    assert page.count("<svg") == 3  # two matrices; only one method stated confidence
    assert "http://" not in page.replace("http://www.w3.org", "") and "src=" not in page
