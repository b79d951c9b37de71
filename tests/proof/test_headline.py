"""The table of a proof with logs as rigs make them: each recording counts where it belongs."""

import pytest

from cable_envs.proof.logs.by_kind import headline
from cable_envs.proof.report import markdown, record
from cable_envs.proof.scoring import Result
from cable_envs.proof.summary import summary
from cablebench.pages.proof import render


def _case(kind, noise, outcome, band="", claims=(), intervals=()):
    return Result(
        f"{kind}-{noise}-{outcome}", "cable_hole", kind, ("backlash",), band, noise, (), "named", ("backlash",),
        outcome, claims, intervals, None, 100.0, None, False,
    )  # fmt: skip


CASES = [
    _case("single", "white", "exact", ">10", ((0.98, True),), (("backlash.gap", True),)),
    _case("single", "white", "class", ">10", ((0.7, True),)),
    _case("single", "rest", "wrong", ">10", ((0.96, False),)),
    _case("single", "user", "exact", ">10", ((0.9, True),), (("backlash.gap", False),)),
    _case("single", "user", "unknown", "1-3"),
    _case("nothing", "counts", "data"),
    _case("nothing", "user", "none"),
    _case("decoy", "rest", "unknown"),
    _case("strange", "user", "unknown", ">10"),
]


def _cells(text, name):
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {name} |")]
    return [cell.strip() for cell in line.split("|")[3:-1]]


@pytest.mark.parametrize(
    ("row", "cells"),
    [
        ("effect adds more than 10 %: exact name", ["2 of 4", "1 of 2", "0 of 1", "1 of 1"]),
        ("effect adds more than 10 %: exact name or class", ["3 of 4", "2 of 2", "0 of 1", "1 of 1"]),
        ("effect adds more than 10 %: wrong name", ["1 of 4", "0 of 2", "1 of 1", "0 of 1"]),
        ("effect adds 1 to 3 %: exact name", ["0 of 1", "–", "–", "0 of 1"]),
        ("nothing missing: a fault of the data", ["1 of 2", "–", "–", "1 of 2"]),
        ('only parameters wrong: "unknown"', ["1 of 1", "–", "1 of 1", "–"]),
        ('physics outside the library: "unknown"', ["1 of 1", "–", "–", "1 of 1"]),
        ("95 % intervals of parameters that contain the true value", ["1 of 2", "1 of 1", "–", "0 of 1"]),
    ],
)
def test_recordings_are_counted_by_kind_of_log(row, cells):
    assert _cells(headline(CASES), row) == cells


def test_how_far_confidences_are_off_is_the_expected_calibration_error():
    text = headline(CASES)
    # 0.98 right and 0.96 wrong share a bin, stated 0.97 and right in a half; 0.7 and 0.9 are right alone
    error = (2 * abs(0.97 - 0.5) + abs(0.7 - 1.0) + abs(0.9 - 1.0)) / 4
    assert f"of 4 named effects are off by {error:.3f} on average" in text
    assert "of 2 of 0.95 and more, 1 are right" in text


def test_a_proof_with_such_logs_has_the_table_in_its_page_and_summary():
    about = {"command": "cablebench blind-test", "cases_total": len(CASES)}
    table = headline(CASES)
    page = render({**record({"diagnose": CASES}, {**about, "command": "; ".join(["cablebench blind-test"] * 20)})})
    assert "<td>3 of 4</td>" in page and "of 4 named effects are off by" in page
    assert page.count("Limits exceeded by diagnose") == 1 and "<summary>The commands of its parts</summary>" in page
    assert table in markdown({"diagnose": CASES}, about)
    assert summary(record({"diagnose": CASES}, about)) == table
    with pytest.raises(KeyError, match="no such method"):
        summary(record({"diagnose": CASES}, about), {"no such method": ""})


def test_a_proof_of_laboratory_logs_has_a_column_for_each_method():
    own = [_case("single", "white", outcome, ">10") for outcome in ("exact", "class", "wrong")]
    other = [_case("single", "white", "wrong", ">10") for _ in own]
    about = {"command": "cablebench blind-test", "cases_total": 3}
    text = summary(record({"diagnose": own, "no refit": other, "sparse regression": other}, about))
    assert text.startswith("| in the recording | wanted | `diagnose` | without refit | SINDy |")
    (exact, known, _) = [line for line in text.splitlines() if "more than 10 %" in line] + [""]
    assert exact.endswith("1/3 | 0 of 3 | 0 of 3 |") and known.endswith("2/3 | 0 of 3 | 0 of 3 |")
