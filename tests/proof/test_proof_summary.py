"""The headline figures: exact names and classes apart, each with the cases it counts."""

from pathlib import Path

import pytest

from cable_envs.core.files import read_json
from cable_envs.proof.report import together
from cable_envs.proof.summary import LINES, main, summary

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "docs" / "proof" / "proof.json.xz"


@pytest.fixture(scope="module")
def record():
    return read_json(RECORD)


def test_exact_names_and_classes_are_counted_from_the_cases(record):
    cells = {line.split("|")[1].strip(): line.split("|")[3].strip() for line in summary(record).splitlines()[2:-2]}
    own = [r for r in together([record])["diagnose"] if r.kind == "single" and r.band == ">10"]
    exact, known = sum(r.outcome == "exact" for r in own), sum(r.outcome in ("exact", "class") for r in own)
    assert (len(own), exact, known) == (48, 40, 43)
    assert cells["effect adds more than 10 %: exact name"] == f"{exact} of {len(own)}"
    assert cells["effect adds more than 10 %: exact name or class"] == f"{known} of {len(own)}"


def test_every_line_is_a_row_of_the_proof(record):
    rows = {row["name"] for row in record["methods"]["diagnose"]["rows"]}
    assert set(LINES) <= rows
    with pytest.raises(KeyError, match="no such method"):
        summary(record, {"no such method": ""})


def test_its_page_shows_the_table_of_the_committed_proof(record):
    assert summary(record) in (ROOT / "docs" / "proof" / "README.md").read_text(encoding="utf-8")


def test_the_command_prints_it(record, capsys):
    assert main([str(RECORD)]) == 0
    assert capsys.readouterr().out == summary(record)
    assert main([]) == 2
