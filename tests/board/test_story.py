"""The five sentences of a board agree with its numbers; and when its rows were made."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cablebench.board.board import build_board
from cablebench.board.history import Made, history
from cablebench.board.pages.overview import render_board
from cablebench.board.story import main_track, story
from tests.support.board_records import ENTRANTS, made_protocol, made_records, made_suite_protocol

LEADERS, TIES, AGENTS, FAILURES, ROBUSTNESS = range(5)


def interval(row):
    return f"{row.score.value:.2f} [{row.score.low:.2f}, {row.score.high:.2f}]".replace("-", "−")


def competing(table):
    rows = [r for r in table.rows if r.entrant not in ("open-loop", "oracle") and r.score is not None]
    return sorted(rows, key=lambda r: -r.score.value)


def overlap(a, b):
    return a.score.low <= b.score.high and b.score.low <= a.score.high


@pytest.fixture(scope="module")
def linear():
    """A board of score version 0: two tasks of each mechanism, three tracks."""
    protocol = made_protocol(episodes=4)
    records = made_records(protocol)
    for r in records:
        if r["track"] == "randomised" and r["entrant"] == "ppo" and r["seed"] == 2003:
            r["metrics"]["failed"] = 1.0
        if r["track"] == "nominal" and r["entrant"] == "oracle" and r["seed"] == 2002:
            r["metrics"]["failed"] = 1.0  # not counted
    return protocol, records


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    """A board of score version 1."""
    protocol = made_suite_protocol(tmp_path_factory.mktemp("anchors") / "made.yaml", episodes=4)
    records = made_records(protocol)
    for r in records:
        if r["track"] == "randomised" and r["entrant"] == "pid" and r["seed"] == 2003:
            r["metrics"]["overload"] = 0.3
    return build_board(protocol, records)


def test_every_sentence_is_one_and_all_are_on_the_page(linear, suite):
    for board in (build_board(*linear), suite):
        found = story(board)
        assert len(found) == 5 and all(s.endswith(".") and "  " not in s and "nan" not in s for s in found)
        page = render_board(board)
        place = [page.index(s.replace("'", "&#39;").replace(">", "&gt;")) for s in found]
        assert place == sorted(place) and place[-1] < page.index('id="notes"')


def test_who_leads_with_its_interval_by_mechanism_and_over_the_suite(linear, suite):
    board = build_board(*linear)
    assert main_track(board) == "randomised"  # the last one without sweeps
    for family, title in (("CableHole", "Cable through a hole"), ("PulleyCircuit", "Closed pulley circuit")):
        table = next(t for t in board.overall if (t.family, t.track) == (family, "randomised"))
        first, second = competing(table)[:2]
        said = (
            f"{title}, 2 tasks: {first.entrant} leads with a score of {interval(first)} before {second.entrant} with "
        )
        assert said + interval(second) in story(board)[LEADERS]
        word = "are not told apart" if overlap(first, second) else "differ"
        assert f"{interval(second)}, and the two {word}" in story(board)[LEADERS]
    table = next(t for t in suite.overall if (t.family, t.track) == ("", "randomised"))
    first, second = competing(table)[:2]
    pair = next(p for p in table.pairs if {p.first, p.second} == {first.entrant, second.entrant})
    word = "differ" if pair.adjusted < 0.05 else "are not told apart"
    assert story(suite)[LEADERS] == (
        f"The whole suite, 4 tasks: {first.entrant} leads with a score of {interval(first)} before {second.entrant} "
        f"with {interval(second)}, and the two {word} (randomised track, 95 % intervals)."
    )


def test_where_no_entrant_is_in_a_table_over_several_tasks_single_ones_are_told(linear):
    protocol, records = linear
    one = build_board(protocol, [r for r in records if r["task"] == "CableHole-Position-Sine"])
    first, second = competing(one.table("CableHole-Position-Sine", "randomised"))[:2]
    assert story(one)[LEADERS].startswith(
        f"CableHole-Position-Sine: {first.entrant} leads with a score of {interval(first)} before {second.entrant}"
    )
    without = build_board(protocol, [r for r in records if r["entrant"] != "oracle"])
    assert story(without)[LEADERS].startswith("No entrant has a score on this board")
    assert story(without)[TIES].startswith("No task has two entrants with different scores")


def test_which_tasks_are_not_told_apart(linear, suite):
    board = build_board(*linear)
    tables = [t for t in board.tables if t.track == "randomised"]
    tied = [t.task for t in tables if overlap(*competing(t)[:2])]
    told = story(board)[TIES]
    assert [t.task for t in tables if t.task in told] == tied
    if tied and len(tied) < 4:
        assert told.startswith(f"On {len(tied)} of 4 tasks")
    tables = [t for t in suite.tables if t.track == "randomised"]
    tied = []
    for table in tables:
        names = {r.entrant for r in competing(table)[:2]}
        tied += [table.task] if next(p for p in table.pairs if {p.first, p.second} == names).adjusted >= 0.05 else []
    assert [t.task for t in tables if t.task in story(suite)[TIES]] == tied


def spread(board, **of):
    """The board with all scores of an entrant at one value, and an interval of that half-width around it."""

    def moved(row):
        if row.entrant not in of or row.score is None:
            return row
        value, half = of[row.entrant]
        score = replace(row.score, value=value, low=value - half, high=value + half)
        return replace(row, score=score, scores=dict.fromkeys(row.scores, ((value,),)))

    tables = tuple(replace(t, rows=tuple(map(moved, t.rows)), pairs=()) for t in board.tables)
    return replace(board, tables=tables)


NONE = "on none is a controller better and told apart from"


@pytest.mark.parametrize(("agent", "best", "says"), [
    ((0.9, 0.01), (0.5, 0.01), f"Trained agents lead on 4 of 4 tasks; {NONE}"),
    ((0.4, 0.20), (0.5, 0.01), f"Trained agents lead on 0 of 4 tasks; {NONE}"),
    ((0.4, 0.01), (0.5, 0.01), "lead on 0 of 4 tasks; on 4 a controller is better and told apart from them"),
    ((-0.4, 0.01), (0.5, 0.01), "and on 4 no agent scores above 0, the score of doing nothing (CableHole-Position-"),
    ((0.4, 0.01), (0.5, 0.01), "and on each of them an agent scores above 0"),
])  # fmt: skip
def test_what_agents_cannot_do(linear, agent, best, says):
    others = {name: (0.1, 0.01) for name in ENTRANTS if name not in ("ppo", "mrac-g22", "open-loop", "oracle")}
    board = spread(build_board(*linear), ppo=agent, **{"mrac-g22": best}, **others)
    assert says in story(board)[AGENTS]


def test_a_law_under_two_names_ties_with_nobody(linear):
    others = {name: (0.1, 0.01) for name in ENTRANTS if name not in ("open-loop", "oracle")}
    board = spread(build_board(*linear), **{**others, "mrac-g22": (0.5, 0.01), "mrac-g9": (0.5, 0.01)})
    assert story(board)[TIES] == "On all 4 tasks the first entrant is told apart from the second."


def test_a_board_without_agents_says_so(linear):
    protocol, records = linear
    board = build_board(protocol, [r for r in records if r["entrant"] != "ppo"])
    assert story(board)[AGENTS] == "No trained agent is on this board."


def test_failures_are_counted_without_open_loop_and_oracle(linear, suite):
    protocol, records = linear
    board = build_board(protocol, records)
    own = [r for r in records if r["entrant"] not in ("open-loop", "oracle")]
    failed = [r for r in own if r["metrics"]["failed"]]
    by_task = {t.short: sum(r["task"] == t.short for r in failed) for t in protocol.tasks}
    said = re.match(
        r"(\d+) of (\d+) test episodes failed .*most on (\S+) \((\d+)\) and by ppo \((\d+)\)\.", story(board)[3]
    )
    assert (int(said[1]), int(said[2])) == (len(failed), len(own)) and failed
    assert int(said[4]) == by_task[said[3]] == max(by_task.values()) and int(said[5]) == len(failed)
    rules = {}
    for row in (r for t in suite.tables for r in t.rows if r.entrant not in ("open-loop", "oracle")):
        for name, n in row.violations.items():
            rules[name] = rules.get(name, 0) + n
    assert rules["overload"] == 4 and f"overload {rules['overload']}" in story(suite)[FAILURES]
    none = build_board(protocol, [r for r in records if r["entrant"] != "ppo"])
    assert story(none)[FAILURES].startswith("None of the ") and "test episodes failed" in story(none)[FAILURES]


def test_robustness_names_the_best_and_the_hardest(linear, suite):
    board = build_board(*linear)
    own = {}
    for s in board.sweeps:
        if s["entrant"] not in ("open-loop", "oracle"):
            own.setdefault(s["entrant"], []).append(s["robustness"])
    best = max(own, key=lambda n: np.mean(own[n]))
    assert story(board)[ROBUSTNESS] == (
        f"Most robust is {best} (of 4 entrants on all sweeps) with a mean score of {np.mean(own[best]):.2f} over the "
        f"sweeps; hardest is friction, where the entrants' mean is {np.mean(np.concatenate(list(own.values()))):.2f}."
    )
    share = {n: np.mean([s["robustness"] for s in suite.sweeps if s["entrant"] == n]) for n in own}
    best = min(share, key=lambda n: (-share[n], n))
    assert (
        f"Most robust is {best} (of 4 entrants on all sweeps), which survives {100 * share[best]:.0f} %"
        in (story(suite)[ROBUSTNESS])
    )
    assert "says nothing of robustness" in story(replace(board, sweeps=()))[ROBUSTNESS]


def test_history_says_when_rows_were_made_and_by_which_source(linear):
    protocol, records = linear
    pid = [r for r in records if r["entrant"] == "pid"]
    made = {
        "CableHole": {"created": "2026-01-31T23:30:00-02:00", "versions": {"cable-envs": "0.1.0", "source": "aaa"}},
        "PulleyCircuit": {"created": "2026-01-05T10:00:00", "versions": {"cable-envs": "0.1.0", "source": "bbb"}},
    }
    dated = [{**r, **made[r["family"]]} for r in pid]
    dated[0] = {**dated[0], "created": "2026-01-30T10:00:00+00:00"}
    n = len(pid) // 2
    expected = (
        Made("pid", "0.1.0", "aaa", "2026-01-30", "2026-02-01", 6, n),
        Made("pid", "0.1.0", "bbb", "2026-01-05", "2026-01-05", 6, n),
    )
    assert history(dated) == expected
    board = build_board(protocol, [*dated, *(r for r in records if r["entrant"] != "pid")])
    assert [m for m in board.history if m.entrant == "pid"] == list(expected)
    assert next(m for m in board.history if m.entrant == "ppo") == Made("ppo", "0.1.0", "", "", "", 12, 3 * n * 2)
    page = render_board(board)
    part = page[page.index('id="history"') : page.index('id="provenance"')]
    line = next(line for line in part.split("<tr") if "<code>aaa</code>" in line)
    assert "2026-01-30" in line and "2026-02-01" in line and f">{n}<" in line and 'data-name="pid"' in line
    assert part.count('data-name="') == 7  # six entrants, one of them with two lines
