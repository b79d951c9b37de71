"""Pages of the site that hold a board are made, without building the site or opening a browser."""

import json

import pytest

from docs.site.reports import BOARDS, board_pages

SMALLEST = "quick"


@pytest.mark.parametrize(
    "name", [SMALLEST, *(pytest.param(name, marks=pytest.mark.slow) for name in BOARDS if name != SMALLEST)]
)
def test_the_pages_of_a_board_are_made(name):
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import open_store
    from tests.support.tree import ROOT

    pages = json.loads(board_pages(name))
    records = open_store(ROOT / "boards" / name).read().records
    entrants, tasks = ({record[key] for record in records} for key in ("entrant", "task"))
    assert pages.keys() == {"board.html", *(f"tasks/{task}.html" for task in tasks)}
    assert load_protocol(name).title in pages["board.html"]
    assert entrants and [entrant for entrant in entrants if entrant not in pages["board.html"]] == []
    assert all(pages[f"tasks/{task}.html"].count("<svg") > 1 for task in tasks)  # figures
