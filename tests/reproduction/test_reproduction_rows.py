"""The yardstick: one tolerance a kind, and what each word needs."""

import ast
import importlib
import inspect
import math

import numpy as np
import pytest

from cable_envs.reproduction import registry
from cable_envs.reproduction.rows import (
    NO_REASON,
    Band,
    Row,
    curve,
    digits,
    equation,
    missing,
    parameter,
    statement,
    within_truths,
)
from cable_envs.reproduction.yardstick import (
    CONSISTENT,
    CURVE,
    DIFFERS,
    DIGITS,
    EXPLAINED,
    KINDS,
    NOT_REPRODUCIBLE,
    REPRODUCED,
    STATEMENT,
)
from tests.support.tree import sources

MAKERS = (digits, equation, parameter, curve, within_truths, statement, missing)


def test_no_call_site_can_choose_a_tolerance_or_a_word():
    named = {name for maker in MAKERS for name in inspect.signature(maker).parameters}
    assert not named & {"tolerance", "absolute", "status", "rel", "abs"}
    assert "status" not in Row.__dataclass_fields__
    called = {path.name: _called(path) for path in sources("reproduction")}
    assert {maker.__name__ for maker in MAKERS} <= set().union(*called.values())
    assert {name for name, made in called.items() if "Row" in made} == {"rows.py"}
    assert {name for name, made in called.items() if {"Kind", "Status"} & made} == {"yardstick.py"}


def _called(path) -> set[str]:
    """Names that a file calls."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}


def test_every_kind_has_one_tolerance():
    assert {kind.name: kind.tolerance for kind in KINDS} == {
        "digits": None,
        "equation": 1e-6,
        "parameter": 0.01,
        "curve": 0.05,
        "statement": None,
    }
    assert curve("a", 1.0, 1.0499, "N").status is REPRODUCED and curve("a", 1.0, 1.0501, "N").status is DIFFERS
    assert curve("a", -2.0, -2.09, "N").status is REPRODUCED  # of the size
    assert parameter("a", 1.0, 1.0099, "N").status is REPRODUCED and parameter("a", 1.0, 1.0101, "N").status is DIFFERS
    assert equation("a", 1.0, 1.0 + 9e-7, "N", how="x").status is REPRODUCED
    assert equation("a", 1.0, 1.0 + 2e-6, "N", how="x").status is DIFFERS
    with pytest.raises(TypeError, match="digits"):
        DIGITS.within(1.0, 1.0)


@pytest.mark.parametrize(
    ("printed", "computed", "agrees"),
    [("0.051", 0.05149, True), ("0.051", 0.05151, False), ("57", 57.296, True), ("57", 18.5, False),
     ("2.70", 2.704, True), ("2.70", 2.71, False), ("10", 10.4, True), ("-1.5", -1.54, True)],
)  # fmt: skip
def test_digits_agree_to_half_a_unit_of_the_last_one(printed, computed, agrees):
    row = digits("a", printed, computed, "N")
    assert (row.status is REPRODUCED) == agrees and row.as_json("x")["published"] == float(printed)


def test_rounded_inputs_widen_what_agrees_and_are_told():
    assert digits("a", "4.622", 4.62148, "1").status is DIFFERS
    row = digits("a", "4.622", 4.62148, "1", inputs=(4.6203, 4.6226))
    assert row.status is REPRODUCED and "4.6203 to 4.6226" in row.why
    assert digits("a", "4.739", 4.7300, "1", inputs=(4.7289, 4.7311)).status is DIFFERS


def test_a_number_fitted_to_the_row_makes_it_consistent_at_best():
    assert curve("a", 33.0, 32.7, "N", chosen="5 kg were inferred from it.").status is CONSISTENT
    assert curve("a", 33.0, 36.7, "N", chosen="5 kg were inferred from it.").status is DIFFERS
    assert statement("a", "grows", "grows", True, chosen="The values were chosen.").status is CONSISTENT
    assert "inferred" in curve("a", 33.0, 32.7, "N", chosen="5 kg were inferred from it.").why


def test_a_band_decides_whatever_the_median():
    inside = curve("a", 3.17, 1.85, "deg", band=Band(0.888, 3.47, "5 to 95 % of 40 truths"))
    assert inside.status is CONSISTENT and "0.888 to 3.47 deg" in inside.why
    assert inside.as_json("x")["band"] == [0.888, 3.47]
    near = curve("a", 1.00, 1.01, "deg", band=Band(1.005, 1.02, "x"))
    assert near.status is DIFFERS
    values = np.linspace(1.0, 2.0, 101)
    assert within_truths("a", 1.9, values, "N", "truths").status is CONSISTENT
    assert within_truths("a", 2.0, values, "N", "truths", reason="Because.").status is EXPLAINED
    assert within_truths("a", 2.0, values, "N", "truths").computed == pytest.approx(1.5)


def test_a_band_too_wide_to_tell_is_not_called_consistent():
    for band in (Band(0.005, 0.053, "99 %"), Band(-math.inf, 0.03, "99 %"), Band(-0.01, 0.03, "99 %")):
        row = parameter("delta", 0.02, 0.02, "1", band=band)
        assert row.status is NOT_REPRODUCIBLE and "determines no number" in row.why
    assert parameter("mu", 0.43, 0.42, "1", band=Band(0.41, 0.44, "99 %")).status is CONSISTENT
    assert (
        parameter("delta", 0.07, 0.02, "1", band=Band(0.005, 0.053, "99 %")).status is DIFFERS
    )  # it excludes the print


def test_a_difference_is_explained_only_by_a_reason():
    plain, told = statement("a", "x", "y", False), statement("a", "x", "y", False, reason="The equation cannot.")
    assert plain.status is DIFFERS and plain.why == NO_REASON
    assert told.status is EXPLAINED and told.why == "The equation cannot."
    assert statement("a", "x", "x", True, reason="The equation cannot.").status is REPRODUCED  # the reason is not shown
    assert "cannot" not in statement("a", "x", "x", True, reason="The equation cannot.").why


def test_what_is_missing_is_said_and_needs_no_number():
    row = missing("a", None, math.inf, "1", "It is not printed.", how="Assumed.")
    assert row.status is NOT_REPRODUCIBLE and row.as_json("x")["computed"] is None and row.rel_error is None
    assert row.why == "It is not printed. Assumed."
    with pytest.raises(ValueError, match="no reason to differ"):
        Row(CURVE, "a", 1.0, 2.0, "N", reason="x", missing="y")
    with pytest.raises(ValueError, match="needs a printed number"):
        Row(STATEMENT, "a", "words", 2.0, "N", band=Band(1.0, 2.0, "x"))


def test_texts_of_the_rows_are_whole_sentences():
    """Every literal text of a row in the items begins as a sentence and ends as one."""
    found = []
    for path in sources("reproduction"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            if node.func.id not in {maker.__name__ for maker in MAKERS}:
                continue
            for keyword in node.keywords:
                text = _ends(keyword.value) if keyword.arg in ("how", "chosen", "reason") else None
                if text is None:
                    continue
                first, last = text
                if (first and not (first[0].isupper() or first[0].isdigit() or first.startswith("lambda"))) or (
                    last and not last.rstrip().endswith(".")
                ):
                    found.append((path.name, node.lineno, first[:30], last[-30:]))
    assert found == []


def _ends(node) -> tuple[str, str] | None:
    """First and last piece of a literal text; "" where it is a number put in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value, node.value
    if isinstance(node, ast.JoinedStr):
        pieces = [v.value if isinstance(v, ast.Constant) else "" for v in node.values]
        return pieces[0], pieces[-1]
    return None


def test_every_item_names_a_module_that_exists():
    for item in registry.ITEMS:
        assert callable(importlib.import_module(f"cable_envs.reproduction.{item.module}").reproduce)
