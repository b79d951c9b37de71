"""Pages of the site that hold a board are made, without building the site or opening a browser."""

import pytest

from docs.site.reports import BOARDS, board_page

SMALLEST = "full"


@pytest.mark.parametrize(
    "name", [SMALLEST, *(pytest.param(name, marks=pytest.mark.slow) for name in BOARDS if name != SMALLEST)]
)
def test_the_page_of_a_board_is_made(name):
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import open_store
    from tests.support.tree import ROOT

    text = board_page(name).decode()
    entrants = {record["entrant"] for record in open_store(ROOT / "boards" / name).read().records}
    assert load_protocol(name).title in text
    assert entrants and [entrant for entrant in entrants if entrant not in text] == []
    assert text.count("<svg") > 1  # its figures, trajectories among them
