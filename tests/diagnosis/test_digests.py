"""Seeded diagnoses name what they named, on every kind of processor."""

import json

import pytest

from tests.support.diagnosis_digests import CASES, FILE, answered, content, digested

GOLDEN = json.loads(FILE.read_text(encoding="utf-8"))


def test_every_case_has_its_answer():
    assert set(GOLDEN) == set(CASES)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_diagnosis_names_what_it_named(name):
    found = digested(content(answered(CASES[name])))
    assert {key: found[key] for key in GOLDEN[name]} == GOLDEN[name]
