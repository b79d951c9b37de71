"""Pages of a board in a real browser: what filters and sorting leave visible."""

import re
import subprocess
from html.parser import HTMLParser

import pytest

from cablebench.board.board import build_board
from cablebench.board.pages.task import board_pages
from tests.support.board_records import made_protocol, made_records
from tests.support.browser import CHROMIUM

TASKS = ("CableHole-Position-Sine", "PulleyCircuit-Position-Sine")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (Debian: apt install chromium)")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Pages of a board with one task of each mechanism and two tracks; "<b>" must stay text."""
    protocol = made_protocol(episodes=3, tasks=tuple(t for t in made_protocol().tasks if t.short in TASKS))
    records = [r for r in made_records(protocol) if r["track"] != "stress"]
    folder = tmp_path_factory.mktemp("page")
    (folder / "tasks").mkdir()
    for address, text in board_pages(build_board(protocol, records, "Remark with <b>markup</b>", "--results x")):
        (folder / address).write_text(text, "utf-8")
    return folder


class Visible(HTMLParser):
    """Tables as the browser has them after its script ran: [(track, within details, names of the visible rows)]."""

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
            tracks = [a["data-track"] for _, a in self.stack if "data-track" in a]
            details = any(t == "details" for t, _ in self.stack)
            self.tables.append((tracks[-1] if tracks else None, details, []))
        if tag == "tr" and "data-name" in found and any("sortable" in a.get("class", "") for _, a in self.stack):
            self.tables[-1][2].append(found["data-name"])
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


def test_filters_and_sorting_of_a_tasks_page_by_address(pages, tmp_path):
    page = pages / "tasks" / f"{TASKS[0]}.html"
    text = opened(page, tmp_path, "track=randomised&information=model-free&sort=-rmse")
    seen = Visible(text)
    assert {track for track, _, _ in seen.tables} == {"randomised"}
    # the worse one first: pid was made with 0.34 of the open loop's error, ppo with 0.2 (and seeds up to 60 % worse)
    assert [names for _, _, names in seen.tables] == [["pid", "ppo"]] * 2
    assert set(seen.sorted) == {("rmse", "descending")}
    assert seen.output.startswith("2 of 6 entrants")
    # figures show the same entrants: model-free ones come first in the board's order
    marks = re.findall(r'<g data-entrant="(\d)"( style="display: none;")?', text)
    assert {k for k, hidden in marks if not hidden} == {"0", "1"} and {k for k, hidden in marks if hidden} >= {"2", "3"}


def test_a_boards_page_is_filtered_by_track_and_name_and_remarks_stay_text(pages, tmp_path):
    text = opened(pages / "board.html", tmp_path, "track=nominal&name=mrac")
    seen = Visible(text)
    assert {track for track, _, _ in seen.tables} == {None}  # when rows were made: no track, and mrac's rows only
    assert [set(names) for _, _, names in seen.tables] == [{"mrac-g9", "mrac-g22"}]
    assert seen.output.startswith("2 of 6 entrants")
    assert "<b>markup" not in text and "&lt;b&gt;markup" in text


def test_without_an_address_everything_is_there_by_rank(pages, tmp_path):
    seen = Visible(opened(pages / "tasks" / f"{TASKS[1]}.html", tmp_path, "rankings"))
    assert {track for track, _, _ in seen.tables} == {"nominal", "randomised"} and seen.sorted == []
    assert all(len(names) == 6 for _, _, names in seen.tables) and seen.output == "6 entrants"


def test_a_board_of_one_track_hides_nothing_though_its_pages_have_no_choice_of_track(tmp_path):
    protocol = made_protocol(episodes=3, tasks=tuple(t for t in made_protocol().tasks if t.short in TASKS))
    records = [r for r in made_records(protocol) if r["track"] == "nominal"]
    made = dict(board_pages(build_board(protocol, records, "", "--results x")))
    page = tmp_path / "task.html"
    page.write_text(made[f"tasks/{TASKS[0]}.html"], "utf-8")
    seen = Visible(opened(page, tmp_path, "rankings"))
    assert 'name="track"' not in page.read_text("utf-8")
    assert {track for track, _, _ in seen.tables} == {"nominal"} and seen.output == "6 entrants"
