"""The board's page in a real browser: what filters and sorting leave visible."""

import re
import subprocess
from html.parser import HTMLParser

import pytest

from cablebench.board.board import build_board
from cablebench.board.page import render_html
from tests.support.board_records import made_protocol, made_records
from tests.support.browser import CHROMIUM

TASKS = ("CableHole-Position-Sine", "PulleyCircuit-Position-Sine")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (Debian: apt install chromium)")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with one task of each mechanism and two tracks; "<b>" must stay text."""
    protocol = made_protocol(episodes=3, tasks=tuple(t for t in made_protocol().tasks if t.short in TASKS))
    records = [r for r in made_records(protocol) if r["track"] != "stress"]
    path = tmp_path_factory.mktemp("page") / "board.html"
    path.write_text(render_html(build_board(protocol, records, "Remark with <b>markup</b>", "--results x")), "utf-8")
    return path


class Visible(HTMLParser):
    """Tables as the browser has them after its script ran: [(section's task, track, names of the visible rows)]."""

    void = ("meta", "br", "img", "link", "hr", "input")

    def __init__(self, text):
        super().__init__()
        self.stack, self.tables, self.sorted, self.output = [], [], [], ""
        self.feed(text)

    def _hidden(self):
        return any("hidden" in attributes for _, attributes in self.stack)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag not in self.void:
            self.stack.append((tag, found))
        if self._hidden():
            return
        if tag == "table" and "sortable" in found.get("class", ""):
            about = {k: a[k] for _, a in self.stack for k in ("data-task", "data-track") if k in a}
            details = any(t == "details" for t, _ in self.stack)
            self.tables.append((about.get("data-task"), about.get("data-track"), details, []))
        if tag == "tr" and "data-name" in found and any("sortable" in a.get("class", "") for _, a in self.stack):
            self.tables[-1][3].append(found["data-name"])
        if tag == "th" and "aria-sort" in found:
            self.sorted.append((found["data-key"], found["aria-sort"]))

    def handle_endtag(self, tag):
        while self.stack and self.stack.pop()[0] != tag:
            pass

    def handle_data(self, data):
        if self.stack and self.stack[-1][0] == "output":
            self.output += data


def opened(page, tmp_path, fragment):
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
         f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=2000", "--dump-dom",
         f"{page.as_uri()}#{fragment}"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_filters_and_sorting_by_address(page, tmp_path):
    text = opened(page, tmp_path, f"task={TASKS[0]}&track=randomised&information=model-free&sort=-rmse")
    seen = Visible(text)
    assert {(task, track) for task, track, _, _ in seen.tables} == {(TASKS[0], "randomised")}
    # the worse one first: pid was made with 0.34 of the open loop's error, ppo with 0.2 (and seeds up to 60 % worse)
    assert [names for _, _, _, names in seen.tables] == [["pid", "ppo"]] * 2
    assert set(seen.sorted) == {("rmse", "descending")}
    assert seen.output == "2 of 6 entrants, 2 tables" or seen.output.startswith("2 of 6 entrants")
    # figures show the same entrants: model-free ones come first in the board's order
    marks = re.findall(r'<g data-entrant="(\d)"( style="display: none;")?', text)
    assert {k for k, hidden in marks if not hidden} == {"0", "1"} and {k for k, hidden in marks if hidden} >= {"2", "3"}
    assert "<b>markup" not in text and "&lt;b&gt;markup" in text


def test_without_an_address_everything_is_there_by_rank(page, tmp_path):
    seen = Visible(opened(page, tmp_path, "method"))
    assert {task for task, _, _, _ in seen.tables} == set(TASKS) and seen.sorted == []
    assert {track for _, track, _, _ in seen.tables} == {"nominal", "randomised"}
    assert all(len(names) == 6 for _, _, _, names in seen.tables) and seen.output == "6 entrants"
