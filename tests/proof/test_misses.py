"""`python -m benchmarks.misses`: which recordings it asks, which hypotheses a concealed effect is, and its table."""

import json
import lzma

import numpy as np

from benchmarks import misses
from benchmarks.misses import _laws, missed, table


def test_a_concealed_effect_is_all_formulations_of_its_law_or_that_of_its_channel():
    known = ["sensor_scale.force", "sensor_scale.position", "load_dependent_friction", "sensor_bias.force"]
    assert _laws({"name": "sensor_scale", "channel": "position"}, known) == ["sensor_scale.position"]
    assert _laws({"name": "sensor_scale", "channel": None}, known) == ["sensor_scale.force", "sensor_scale.position"]
    assert _laws({"name": "backlash", "channel": None}, known) == []


def test_only_concealed_effects_of_the_library_without_a_right_name_are_missed(tmp_path):
    cases = [
        {"name": f"case-{k}", "kind": kind, "outcome": outcome}
        for k, (kind, outcome) in enumerate(
            [("single", "exact"), ("single", "class"), ("single", "wrong"), ("pair", "partly"), ("strange", "none")]
        )
    ]
    record = {"methods": {"diagnose": {"cases": cases}}}
    (tmp_path / "proof.json.xz").write_bytes(lzma.compress(json.dumps(record).encode()))
    assert [c["name"] for _, c in missed([tmp_path])] == ["case-2", "case-3"]


def test_the_table_has_the_odds_of_both_and_why_there_are_none():
    line = {"case": "case-1", "noise": "hum", "truth": ["backlash"], "added": 0.123, "verdict": "named"}
    found = table(
        [
            {**line, "true_model": ("backlash",), "answered": ("slack",), "of_truth": 31.24, "of_answer": 12.0},
            {**line, "verdict": "unknown", "true_model": ("backlash",), "answered": (), "of_truth": 1.0},
            {**line, "refused": "a parameter does the same"},
        ]
    ).splitlines()[2:]
    assert found[0] == "| case-1 | hum | backlash | 12.3 % | named: slack | 31.2 | 12.0 |"
    assert found[1].endswith("| unknown | 1.0 | – |") and found[2].endswith("| a parameter does the same | – |")


def test_what_a_recording_tells_is_a_line_of_the_results(tmp_path, monkeypatch):
    name = misses.plan_of_b(seed=1)[0].name
    case = {"name": name, "kind": "single", "band": ">10", "outcome": "class", "truth": ["slack"]}
    record = {"plan": {"generator": "b", "seed": 1}, "methods": {"diagnose": {"cases": [case]}}}
    (tmp_path / "proof.json.xz").write_bytes(lzma.compress(json.dumps(record).encode()))
    monkeypatch.setattr(misses, "rivals_in_b", lambda _: {"slack": np.float64(40.0), "backlash": np.float64(2.0)})
    (line,) = (json.loads(json.dumps(one)) for one in misses.told_apart([tmp_path], ()))
    assert line["nearest"] == "backlash" and line["separable"] is False
    assert list(misses.told_apart([tmp_path], (name,))) == []
