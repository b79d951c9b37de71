"""The tables of the logs that rigs make: counts by kind of log, confidences beside right answers, intervals."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.logs import OUTSIDE, calibrated, coverage, errors, faults, in_turn, put_in, reliability, wider
from cable_envs.proof.logs.by_kind import by_chance, confidences, outcomes
from cable_envs.proof.scoring import Result


def row(kind, noise, outcome, intervals=()):
    return {"kind": kind, "noise": noise, "outcome": outcome, "intervals": intervals}


def result(kind, noise, outcome, band=""):
    return Result("case", "cable_hole", kind, (), band, noise, (), "", (), outcome)


def test_outcomes_are_counted_by_what_is_missing_and_by_kind_of_log():
    rows = [result("nothing", noise, o) for noise, o in (("hum", "none"), ("hum", "data"), ("jitter", "none"))]
    rows += [result("single", "hum", o, ">10") for o in ("exact", "class", "class")]
    rows += [result("strange", "hum", "unknown", ">10")]
    said = outcomes(rows)
    assert "| nothing missing | no mismatch | fault of the data | recordings |" in said
    assert "| hum | 1 | 1 | 2 |" in said and "| jitter | 1 | 0 | 1 |" in said and "| all | 2 | 1 | 3 |" in said
    assert "| effect adds more than 10 % | exact name | class that holds it | recordings |" in said
    assert "| all | 1 | 2 | 3 |" in said and "| physics outside the library | unknown | recordings |" in said


def test_the_calibration_error_is_the_mean_distance_of_stated_and_right():
    claims = [(0.9, k % 10 > 0) for k in range(50)] + [(0.5, k % 2 > 0) for k in range(50)]
    said = reliability(claims)
    error = float(said.split("error ")[1].split(",")[0])
    assert error < 0.06 and said.endswith("100 named effects")
    assert "error 0.500" in reliability([(1.0, False), (1.0, True)] * 10)
    assert reliability([]) == "no effect was named"


def test_chance_alone_makes_a_calibration_error_that_falls_with_the_root_of_the_answers():
    """Of n answers of one confidence p the mean of |share - p| is about sqrt(2 p (1 - p) / (pi n)), by its normal
    limit; of two confidences with n / 2 answers each it is larger by the root of two."""
    one, seldom = by_chance([0.8] * 400)
    assert one == pytest.approx(np.sqrt(2.0 * 0.16 / (np.pi * 400)), rel=0.05)
    assert seldom == pytest.approx(1.96 * np.sqrt(0.16 / 400), rel=0.1)
    two, _ = by_chance([0.8, 0.6] * 200)
    assert two == pytest.approx((0.4 + np.sqrt(0.24)) * np.sqrt(1.0 / (np.pi * 400)), rel=0.05)


def test_the_sentence_says_what_chance_makes_beside_what_was_found():
    claims = tuple((0.8, k % 5 > 0) for k in range(20))
    rows = [replace(result("single", "hum", "exact", ">10"), claims=claims)]
    said = confidences(rows)
    assert "of 20 named effects are off by 0.000 on average" in said
    usual, seldom = by_chance([0.8] * 20)
    assert said.endswith(f"off by {usual:.3f} on average, and one time in twenty by {seldom:.3f}.")


def test_the_line_of_right_names_over_their_odds_is_found_again():
    """Of names that are right as the logistic of -4 + 1.5 ln(log odds) says; known noise does not count."""
    rng = np.random.default_rng(0)
    gains = np.exp(rng.uniform(1.0, 6.0, 4000))
    right = rng.random(4000) < 1.0 / (1.0 + np.exp(4.0 - 1.5 * np.log(gains)))
    learnt = {"kind": "single", "learnt": True, "gains": list(gains), "claims": [(0.5, was) for was in right]}
    known = {**learnt, "learnt": False, "gains": [3.0], "claims": [(0.9, False)]}
    said = calibrated([learnt, known])
    constant, slope = (float(said.split(word)[1].split()[0]) for word in ("logit =", "+"))
    assert abs(constant + 4.0) < 0.3 and abs(slope - 1.5) < 0.1
    assert said.endswith(f"{right.sum()} of 4000 names are right")
    few = {**learnt, "gains": [5.0, 20.0], "claims": [(0.5, False), (0.5, True)]}  # no maximum by itself
    assert "1 of 2" in calibrated([few]) and calibrated([known]).startswith("no effect")


def test_logs_of_no_library_count_for_the_calibration_as_often_as_a_proof_has_them():
    """As many names are wrong in as many strange logs: were all logs so, half were right; one in ten is."""
    rows = [{"kind": "single", "learnt": True, "gains": [20.0], "claims": [(0.5, True)]} for _ in range(90)]
    rows += [{**row, "kind": "strange", "claims": [(0.5, False)]} for row in rows]
    constant, slope = (float(calibrated(rows).split(word)[1].split()[0]) for word in ("logit =", "+"))
    assert 1.0 / (1.0 + np.exp(-constant - slope * np.log(20.0))) == pytest.approx(1.0 - OUTSIDE, abs=0.01)


def test_intervals_are_counted_parameter_by_parameter():
    rows = [
        row("single", "hum", "exact", [("a.x", True), ("b.y", False)]),
        row("single", "hum", "exact", [("a.x", True)]),
    ]
    assert "| a.x | 2 of 2 |" in coverage(rows) and "| b.y | 0 of 1 |" in coverage(rows)
    assert coverage(rows).endswith("| all | 2 of 3 |")


def test_faults_that_are_said_are_held_against_those_that_were_put_in():
    log = {"fast": -1.7e-3, "resampled": 0.0, "filtered": {"velocity": 0.01}, "walk": {"force": 0.5}}
    log |= {"hum": {"load_position": (7.31, 0.5)}}
    said = {
        "the logger's clock is off by +0.172 %": True,
        "the logger's clock is off by +0.02 %": False,
        "all channels were brought from another clock, of 12.2 ms, by straight lines": False,
        "velocity was filtered with a time constant of 9.6 ms": True,
        "force: its zero drifts": True,
        "force: its zero drifts; velocity: its zero drifts": False,
        "load position: a steady tone of 21.9 Hz in this sensor": True,
        "drive position: a steady tone of 21.9 Hz in this sensor": False,
    }
    assert {text: put_in(text, log) for text in said} == said
    rows = [{"put_in": [True, False], "faulty": True}, {"put_in": [], "faulty": True}, row("single", "hum", "failed")]
    assert "1 of 2 said were put in; found in 1 of 2" in faults(rows)


def test_each_kind_of_log_is_made_of_three_systems_in_turn():
    cases = in_turn(3)
    assert len({case.name for case in cases}) == len(cases) == 42
    assert all(
        len({c.system for c in cases[k : k + 3]}) == len({c.kind for c in cases[k : k + 3]}) == 3 for k in (0, 39)
    )


def test_intervals_are_as_much_too_narrow_as_the_95th_of_a_hundred_errors_says():
    effect = {"name": "backlash", "parameters": {"gap": {"value": 1.3}}}
    named = {"effects": [{"name": "backlash", "parameters": {"gap": {"value": 1.0, "ci95": [0.8, 1.2]}}}]}
    assert errors({"effects": [effect]}, named) == [pytest.approx(1.5)]
    assert errors({"effects": [{**effect, "name": "slack"}]}, named) == []
    assert "96.00 times as wide" in wider([{"errors": [float(k)]} for k in range(1, 101)])  # (100 + 1) 0.95
    assert "too few" in wider([{"errors": [1.0] * 18}])
