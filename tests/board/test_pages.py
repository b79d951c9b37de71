"""The pages of a board: the board's own and one for each task, their links, and what the trace viewer is given."""

import json
import posixpath
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cablebench.board.board import build_board
from cablebench.board.pages.task import board_pages, render_task
from cablebench.board.pages.traces import DIGITS, DRAWN_POINTS, TICKED, is_drawn, series_of, shown_runs
from cablebench.board.report import write_board
from cablebench.run.store import ResultStore
from tests.support.board_records import ENTRANTS, made_protocol, made_records

TASKS = ("CableHole-Position-Step", "PulleyCircuit-Position-Sine")
"""One of each mechanism; the second one on all tracks."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A board with a store of trajectories."""
    protocol = made_protocol(episodes=3, tasks=tuple(t for t in made_protocol().tasks if t.short in TASKS))
    store = ResultStore(tmp_path_factory.mktemp("store") / "made.jsonl")
    records = made_records(protocol, store)
    keep = [r for r in records if r["task"] == TASKS[1] or r["track"] == "nominal"]
    return build_board(protocol, keep, "", "--results x"), store


@pytest.fixture(scope="module")
def pages(made):
    return dict(board_pages(made[0], made[1].trajectories.of))


class Page(HTMLParser):
    """What the page loads, which ids it defines, which it refers to, and whether its tags close."""

    void = ("meta", "br", "img", "link", "hr", "input")

    def __init__(self, text):
        super().__init__()
        self.loads, self.ids, self.links, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.loads += [v for k, v in attrs if k in ("src", "srcset", "data") or (k == "href" and tag == "link")]
        if "id" in found:
            self.ids.append(found["id"])
        if tag == "a":
            self.links.append(found["href"])
        if tag not in self.void:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        found = dict(attrs)
        if "id" in found:
            self.ids.append(found["id"])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes another element"


def test_every_task_has_a_page_and_every_link_leads_somewhere(made, pages):
    assert set(pages) == {"board.html", *(f"tasks/{task}.html" for task in TASKS)} and list(pages)[-1] == "board.html"
    read = {address: Page(text) for address, text in pages.items()}
    for address, page in read.items():
        for link in page.links:
            target, _, anchor = link.partition("#")
            whole = posixpath.normpath(posixpath.join(posixpath.dirname(address), target)) if target else address
            assert whole in read and (not anchor or anchor in read[whole].ids), (address, link)
    overview = {link for link in read["board.html"].links if link.startswith("tasks/")}
    assert overview == set(pages) - {"board.html"}
    assert "../board.html" in read[f"tasks/{TASKS[0]}.html"].links
    assert f"../tasks/{TASKS[1]}.html" in read[f"tasks/{TASKS[0]}.html"].links  # the next one


def test_pages_are_whole_and_need_no_network(made, pages):
    for address, text in pages.items():
        page = Page(text)
        assert page.open == [] and page.loads == [], address
        assert not re.search(r"@import|url\((?!#)|https?://(?!www\.w3\.org)", text), address
        assert len(page.ids) == len(set(page.ids)), "two elements share an id"
        references = set(re.findall(r'(?:<use[^>]* href="#|url\(#)([^"$)]+)', text)) - {"panel-"}
        assert references <= set(page.ids), "a figure refers to an element of another figure"
        assert made[0].configuration in text
    for part in ("score τ", "RMSE delay", "median episode", "factor on nominal", "effort ∫u² dt", "cablebench replay"):
        assert part in pages[f"tasks/{TASKS[1]}.html"], part
    assert "2000-2002" in pages["board.html"] and "<figure" not in pages["board.html"]  # one task of each mechanism


def test_the_boards_files_and_pages_are_written(made, tmp_path):
    board, store = made
    paths = write_board(board, tmp_path / "out", store.trajectories.of)
    assert {k: p.name for k, p in paths.items()} == {
        "json": "board.json", "markdown": "board.md", "html": "board.html", "tasks": "tasks"
    }  # fmt: skip
    written = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*.html")}
    assert written == {"board.html", *(f"tasks/{task}.html" for task in TASKS)}


def test_a_page_of_a_task_that_the_board_has_not_is_refused(made):
    with pytest.raises(ConfigurationError, match="the board has no task 'Nowhere'; it has CableHole-Position-Step"):
        render_task(made[0], "Nowhere")


def episodes_of(text):
    """What the viewer of a page is given; None without a viewer."""
    found = re.search(r'<script type="application/json" id="episodes">(.*?)</script>', text)
    return json.loads(found[1]) if found else None


def numbers(series):
    """A series of the page as its script reads it: a step, then differences."""
    step, *differences = series
    whole = np.cumsum([0 if d is None else d for d in differences])
    return np.where([d is None for d in differences], np.nan, whole * step)


def assert_same(series, values):
    """Equal to half a step, which is less than a pixel: the step is at most 10^-4 of the largest value."""
    values = np.asarray(values, float)
    largest = np.nanmax(np.abs(values))
    assert series[0] <= largest * 10.0 ** (1 - DIGITS) * (1 + 1e-9) or largest == 0.0
    np.testing.assert_allclose(numbers(series), values, rtol=0, atol=0.5 * series[0] * (1 + 1e-6))


@pytest.mark.parametrize("task", TASKS)
def test_the_viewer_has_every_trace_of_the_store_to_the_rounding(made, pages, task):
    board, store = made
    data = episodes_of(pages[f"tasks/{task}.html"])
    tables = [t for t in board.tables if t.task == task]
    hole = task.startswith("CableHole")
    scale, output = (1e3, "mm") if hole else (1.0, "rad")
    assert data["units"] == {"output": output, "tension": "N", "command": "N" if hole else "rad"}
    assert [track["name"] for track in data["tracks"]] == [t.track for t in tables]
    names = ["drive_tension", "load_tension"] if hole else ["tension_drive_top", "tension_drive_bottom"]
    for table, track in zip(tables, data["tracks"], strict=True):
        assert [who["name"] for who in track["entrants"]] == [r.entrant for r in table.rows]
        assert sum(who["ticked"] for who in track["entrants"]) == TICKED
        for row, who in zip(table.rows, track["entrants"], strict=True):
            stored = store.trajectories.of(row.trajectory)
            assert set(who["episodes"]) == {"median", "worst"}
            for kind, seen in who["episodes"].items():
                arrays = stored[kind]
                for name, factor in (("time", 1.0), ("reference", scale), ("output", scale), ("command", 1.0)):
                    assert_same(data["series"][seen[name]], arrays[name] * factor)
                for (label, place), name in zip(seen["tension"], names, strict=True):
                    assert label == name.replace("tension_", "").replace("_tension", "").replace("_", " ")
                    assert_same(data["series"][place], arrays[name])
                assert seen["failed"] is bool(arrays["failed"])


def test_series_are_shared_and_short(pages):
    data = episodes_of(pages[f"tasks/{TASKS[1]}.html"])
    used = [e["time"] for t in data["tracks"] for who in t["entrants"] for e in who["episodes"].values()]
    assert len(set(used)) < len(used) / 2  # most episodes have the same times
    text = pages[f"tasks/{TASKS[1]}.html"]
    numbers_in = sum(len(s) for s in data["series"])
    assert len(re.search(r'id="episodes">(.*?)</script>', text)[1]) < 6 * numbers_in


@pytest.mark.parametrize("values", [
    [0.0, 0.0], [np.nan, np.nan], [1e-30, 2e-30], [-4e7, 3.0, np.nan, 5e7], [1.0, np.inf, -1.0],
    [0.1 * k for k in range(9)],
])  # fmt: skip
def test_a_series_keeps_any_numbers(values):
    finite = np.where(np.isfinite(values), values, np.nan)
    series = series_of(np.array(values))
    assert [d is None for d in series[1:]] == list(np.isnan(finite))
    if not np.isnan(finite).all():
        assert_same(series, finite)
    json.dumps(series, allow_nan=False)


def test_a_packed_store_keeps_what_the_viewer_shows_of_the_entrants_that_are_ticked(made, tmp_path):
    board, store = made
    copy = ResultStore(tmp_path / "copy.jsonl")
    for path in store.trajectories.folder.glob("*.npz"):
        copy.trajectories.keep(path.stem, store.trajectories.of(path.stem))
    kept = shown_runs(board)
    copy.trajectories.forget(kept)
    copy.trajectories.thin(kept, is_drawn, DRAWN_POINTS)
    copy.trajectories.pack()
    whole = episodes_of(render_task(board, TASKS[0], store.trajectories.of))
    data = episodes_of(render_task(board, TASKS[0], copy.trajectories.of))
    ticked = [who["name"] for who in whole["tracks"][0]["entrants"] if who["ticked"]]
    assert [who["name"] for who in data["tracks"][0]["entrants"]] == ticked
    for who in data["tracks"][0]["entrants"]:
        for episode in who["episodes"].values():
            assert len(episode["tension"]) == 2
            assert all(len(data["series"][episode[key]]) == 1 + 300 for key in ("time", "output", "command"))


def test_what_is_ticked_has_traces(made):
    board, store = made
    other = next(r for r in board.tables[0].rows if r.trajectory not in shown_runs(board))
    text = render_task(board, TASKS[0], lambda run: store.trajectories.of(run) if run == other.trajectory else {})
    (entrant,) = episodes_of(text)["tracks"][0]["entrants"]
    assert entrant["name"] == other.entrant and entrant["ticked"]


def test_tensions_within_a_sheath_are_left_out():
    known = (
        "time",
        "command",
        "drive_tension",
        "tension_drive_top",
        "span_tension_7",
        "tension_output_top",
        "peak_tension",
    )
    assert [name for name in known if is_drawn(name)] == ["time", "command", "drive_tension", "tension_drive_top"]


def test_without_traces_a_page_says_how_to_get_them(made):
    board, _ = made
    for trajectories in (None, lambda run: {}, lambda run: {"median": {"time": np.zeros(0)}}):
        text = render_task(board, TASKS[0], trajectories)
        assert episodes_of(text) is None and 'id="viewer"' not in text and "Traces = " not in text
        assert "has no traces of this task" in text and "<pre>cablebench leaderboard --results x --traces\n" in text
        assert "\ncablebench replay --results x --entrant mrac-g22 --env CableHole-Position-Step" in text
    plain = build_board(board.protocol, made_records(board.protocol, entrants={"pid": ENTRANTS["pid"]}))
    assert "cablebench evaluate --results DIR" in render_task(plain, TASKS[0])


def test_traces_without_the_command_say_so(made):
    board, store = made

    def old(run):
        return {k: {n: a for n, a in v.items() if n != "command"} for k, v in store.trajectories.of(run).items()}

    text = render_task(board, TASKS[0], old)
    assert "The command is missing" in text and "The command is missing" not in render_task(
        board, TASKS[0], store.trajectories.of
    )
    assert all(
        e["command"] is None for who in episodes_of(text)["tracks"][0]["entrants"] for e in who["episodes"].values()
    )


def test_names_from_records_cannot_become_markup(made):
    board, store = made
    evil = "<script>alert(1)</script>"
    records = made_records(board.protocol, entrants={"pid": ENTRANTS["pid"], "oracle": ENTRANTS["oracle"]})
    named = build_board(board.protocol, [{**r, "entrant": evil} if r["entrant"] == "pid" else r for r in records])
    for text in dict(board_pages(named, lambda run: store.trajectories.of(next(iter(shown_runs(board)))))).values():
        assert evil not in text
