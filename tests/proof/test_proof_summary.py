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
    cells = [[c.strip() for c in line.split("|")[2:-1]] for line in summary(record).splitlines()[2:]]
    own = [r for r in together([record])["diagnose"] if r.kind == "single" and r.band == ">10"]
    exact, known = sum(r.outcome == "exact" for r in own), sum(r.outcome in ("exact", "class") for r in own)
    assert (len(own), exact, known) == (338, 265, 321)
    assert cells[0][1].startswith("78 %") and cells[0][1].endswith(f"{exact}/{len(own)}")
    assert cells[1][1].startswith("95 %") and cells[1][1].endswith(f"{known}/{len(own)}")
    assert cells[1][0] == "at least 95 %, missed"  # 94.97 %: rounding does not make it a success


def test_every_line_is_a_row_of_the_proof(record):
    rows = {row["name"] for row in record["methods"]["diagnose"]["rows"]}
    assert set(LINES) <= rows
    with pytest.raises(KeyError, match="no such method"):
        summary(record, {"no such method": ""})


def test_the_page_of_the_diagnosis_shows_the_table_of_the_committed_proof(record):
    assert summary(record) in (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")


def test_the_command_prints_it(record, capsys):
    assert main([str(RECORD)]) == 0
    assert capsys.readouterr().out == summary(record)
    assert main([]) == 2
