"""Seeded diagnoses are what they were: names and numbers, to the bit of what is committed."""

import json

import pytest

from tests.support.diagnosis_digests import CASES, FILE, answered, content, digested

GOLDEN = json.loads(FILE.read_text(encoding="utf-8"))


def test_every_case_has_its_digest():
    assert set(GOLDEN) == set(CASES)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_diagnosis_is_what_it_was(name):
    """Made on one kind of processor: another one's rounding may differ, and then so do refits in the last digits."""
    assert digested(content(answered(CASES[name]))) == GOLDEN[name]
