"""Texts of records stay texts: on the page, in Markdown, on the terminal, in figures."""

import io
from html.parser import HTMLParser

import numpy as np
import pytest
from rich.console import Console

from cable_envs.core.errors import ConfigurationError
from cablebench.board.board import build_board
from cablebench.board.pages.task import board_pages
from cablebench.board.report import print_board, render_markdown
from cablebench.entrants.entrant import Entrant
from tests.support.board_records import ENTRANTS, made_protocol, made_records

EVIL = "<script>alert(1)</script>\"'><img src=x onerror=alert(1)>|`x`[a](javascript:b)"
PROTOCOL = made_protocol(episodes=2, tracks=made_protocol().tracks[:1], tasks=made_protocol().tasks[:2])
RECORDS = made_records(PROTOCOL, entrants={name: ENTRANTS[name] for name in ("open-loop", "ppo", "oracle")})


class Tags(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.found = set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found |= {tag, *(f"{tag}.{name}" for name, _ in attributes)}


def board(**changes):
    return build_board(PROTOCOL, [{**r, **(changes if r["entrant"] == "ppo" else {})} for r in RECORDS])


def hostile():
    # a store does not take such a name: here the pages are held to it all the same
    return board(entrant=EVIL, machine=EVIL, versions={EVIL: EVIL}, replay=EVIL)


def traces(run):
    """Of an episode of ten samples, whatever the run."""
    arrays = {name: np.linspace(0.0, 1.0, 10) for name in ("time", "reference", "output", "drive_tension", "command")}
    return {"median": {**arrays, "failed": np.array(True)}}


def test_the_pages_have_no_tag_and_no_attribute_more():
    before, found = (dict(board_pages(made, traces)) for made in (board(), hostile()))
    assert before.keys() == found.keys() and len(before) == 3
    for address, text in found.items():
        known = Tags(before[address]).found
        assert Tags(text).found <= known and "script" in known  # the page's own


def test_markdown_has_no_html_no_link_and_whole_rows():
    from markdown_it import MarkdownIt

    text = render_markdown(hostile())
    page = MarkdownIt("commonmark", {"html": True}).enable("table").render(text)
    assert Tags(page).found <= {*Tags(MarkdownIt("commonmark").enable("table").render(render_markdown(board()))).found}
    rows = [line.replace("\\|", "") for line in text.splitlines() if line.startswith("| ")]
    assert {line.count("|") for line in rows if "alert" in line} == {line.count("|") for line in rows}


@pytest.mark.parametrize("name", ["[/b]", "[red]x", EVIL])
def test_the_terminal_shows_a_name_as_it_is(name):
    out = io.StringIO()
    print_board(board(entrant=name), Console(file=out, width=400))
    assert name in out.getvalue()


@pytest.mark.parametrize("name", ["", "x" * 101, "<b>", "a|b", "$x$", "[/b]", "a\nb", "`x`", "\x1b[31m", "\u202eabc"])
def test_no_entrant_gets_such_a_name(name):
    with pytest.raises(ConfigurationError, match="is no name for a board") as caught:
        Entrant(name, "nominal", lambda setup: None, lambda env, setup: None, "")
    assert str(caught.value).isprintable()


def test_names_of_every_script_are_good():
    for name in ("Müller-PID (v2)", "控制器 1", "a/b_c.d+e@f#1, 50 %"):
        Entrant(name, "nominal", lambda setup: None, lambda env, setup: None, "")
