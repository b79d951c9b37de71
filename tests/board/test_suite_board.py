"""Boards of score version 1 from made-up records: what stands on them, and that entrants do not move each other."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from cable_envs.core.errors import ConfigurationError
from cablebench.board.board import build_board
from cablebench.board.report import render_json, render_markdown
from cablebench.board.suite import RANKED
from cablebench.score.anchors import Anchor, task_hash, write_anchors
from tests.support.board_records import ENTRANTS, made_records, made_suite_protocol


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A protocol with anchors of its own, and records in which `pid` overloads and `mrac-g9` drops a load."""
    protocol = made_suite_protocol(tmp_path_factory.mktemp("anchors") / "made.yaml")
    records = made_records(protocol)
    for r in records:
        if r["track"] == "randomised" and r["seed"] == 2003:
            if r["entrant"] == "pid":
                r["metrics"]["overload"] = 0.3
            if r["entrant"] == "mrac-g9" and r["family"] == "CableHole":
                r["metrics"]["dropped"] = 1.0
    return protocol, records


@pytest.fixture(scope="module")
def board(made):
    return build_board(*made)


def rows(table):
    return {r.entrant: r for r in table.rows}


def test_scores_are_those_of_the_anchors(made, board):
    row = rows(board.table("CableHole-Position-Sine", "nominal"))["mrac-g22"]
    mine = ("CableHole-Position-Sine", "nominal", "mrac-g22")
    errors = [r["metrics"]["rmse"] for r in made[1] if (r["task"], r["track"], r["entrant"]) == mine]
    assert row.score.value == pytest.approx(stats.trim_mean(np.log(0.004 / np.array(errors)) / np.log(20), 0.25))


def test_removing_or_adding_entrants_moves_nobody_elses_numbers(made, board):
    protocol, records = made
    few = build_board(protocol, [r for r in records if r["entrant"] not in ("oracle", "open-loop", "pid")])
    for table in few.tables + tuple(t for t in few.overall):
        before = next(t for t in board.tables + board.overall
                      if (t.family, t.task, t.track) == (table.family, table.task, table.track))  # fmt: skip
        for name, row in rows(table).items():
            other = rows(before)[name]
            assert row.scores == other.scores and row.score == other.score
            assert (row.improvement, row.improvement_interval) == (other.improvement, other.improvement_interval)
            assert (row.worst_tenth, row.robustness, row.failures) == (
                other.worst_tenth, other.robustness, other.failures
            )  # fmt: skip


def test_overall_is_the_mean_over_tasks_for_each_mechanism_and_for_the_suite(board):
    for family, tasks in (("", 4), ("CableHole", 2)):
        table = next(t for t in board.overall if (t.family, t.track) == (family, "randomised"))
        assert table.tasks == tasks
        single = [t for t in board.tables if t.track == "randomised" and family in ("", t.family)]
        for name, row in rows(table).items():
            assert row.score.value == pytest.approx(np.mean([rows(t)[name].score.value for t in single]))
            assert row.worst_tenth == pytest.approx(np.mean([rows(t)[name].worst_tenth for t in single]))


def test_intervals_are_over_seeds_and_rigs_or_rigs_alone(board):
    found = rows(board.table("CableHole-Position-Sine", "randomised"))
    assert found["ppo"].score.unit == "training seeds and rigs" and found["pid"].score.unit == "rigs"
    for row in found.values():
        assert row.score.low <= row.score.value <= row.score.high


def test_failures_count_broken_rules_and_name_them(made, board):
    found = rows(board.table("CableHole-Position-Sine", "randomised"))
    assert (found["pid"].failures, found["pid"].violations) == (1, {"overload": 1})
    assert found["mrac-g9"].violations == {"dropped": 1} and found["oracle"].violations == {}
    assert found["ppo"].violations["torn"] == found["ppo"].failures > 0
    assert min(found["pid"].scores["CableHole-Position-Sine"][0]) == made[0].worst_score
    suite = rows(next(t for t in board.overall if (t.family, t.track) == ("", "randomised")))
    assert suite["pid"].violations == {"overload": 4} and suite["mrac-g9"].violations == {"dropped": 2}
    assert "1/8 (overload 1)" in render_markdown(board)


def test_every_ranked_column_has_places_from_the_least(board):
    table = board.table("CableHole-Position-Sine", "nominal")
    for name in RANKED:
        ordered = sorted(table.rows, key=lambda r: r.raw[name])
        assert ordered[0].places[name] == 1.0
        assert [r.places[name] for r in ordered] == sorted(r.places[name] for r in ordered)
    assert all(r.places["slack"] == 1.0 for r in table.rows)  # equals share the better place
    mean = rows(next(t for t in board.overall if (t.family, t.track) == ("CableHole", "nominal")))["pid"]
    single = [rows(t)["pid"].places["total_variation"] for t in board.tables
              if (t.family, t.track) == ("CableHole", "nominal")]  # fmt: skip
    assert mean.places["total_variation"] == pytest.approx(np.mean(single))


def test_the_robust_score_is_the_share_of_the_sweeps_values_that_was_survived(made, board):
    protocol, records = made
    assert {t.track for t in board.tables} == {"nominal", "randomised"}  # a column, no ranking of its own
    for name in ENTRANTS:
        row = rows(board.table("PulleyCircuit-Position-Sine", "nominal"))[name]
        own = [r for r in records if (r["task"], r["track"], r["entrant"]) ==
               ("PulleyCircuit-Position-Sine", "stress", name)]  # fmt: skip
        alive = {}
        for r in own:
            score = math.log(0.2 / r["metrics"]["rmse"]) / math.log(20)
            alive.setdefault(r["sweep_value"], []).append(score > protocol.survival and not r["metrics"]["failed"])
        assert row.robustness == pytest.approx(np.mean([np.mean(v) for v in alive.values()]))
    without = build_board(protocol, [r for r in records if not r["sweep"]])
    assert all(r.robustness is None for t in without.tables for r in t.rows)
    assert not any("Incomplete board" in n for n in without.notes)
    with pytest.raises(ConfigurationError, match="records of the sweeps"):
        build_board(protocol, [r for r in records if r["sweep"]])


def test_pairs_and_agreement_are_shown(board):
    table = board.table("CableHole-Position-Sine", "nominal")
    assert len(table.pairs) == 15 and table.separated == sum(p.adjusted < 0.05 for p in table.pairs) > 0
    text = render_markdown(board)
    assert f"Pairs that differ, after Holm's correction: {table.separated} of 15." in text
    assert re.search(
        r"Kendall's tau between the rankings of two tasks, nominal track: mean \d\.\d\d over 6 pairs", text
    )
    track = next(a for a in board.agreement if a["track"] == "nominal")
    first = track["pairs"][0]
    a, b = (rows(board.table(task, "nominal")) for task in first["tasks"])
    names = sorted(a)
    assert first["tau"] == pytest.approx(
        stats.kendalltau([a[n].score.value for n in names], [b[n].score.value for n in names]).statistic
    )


def test_markdown_json_and_page_hold_the_columns(made, board):
    from cablebench.board.pages.overview import render_board

    text = render_markdown(board)
    for name in ("robust", "worst rigs", *(f"{label} [" for label in RANKED.values())):
        assert name in text
    for block in text.split("\n\n"):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines}) <= 1
    data = json.loads(render_json(board), parse_constant=lambda c: pytest.fail(f"{c} is no JSON"))
    assert len(data["anchors"]) == 12 and data["tables"][0]["pairs"][0]["adjusted"] <= 1.0
    keep = [r for r in made[1] if r["task"] in ("CableHole-Position-Step", "PulleyCircuit-Position-Sine")]
    page = render_board(build_board(made[0], keep))
    for part in (
        "The whole suite",
        "frozen with the task",
        "command travel",
        "share of the values",
        "A cable was slack",
    ):
        assert part in page, part
    assert "oracle that knows the true rig" not in page


def test_a_condition_without_anchors_is_named_and_not_scored(made):
    protocol, records = made
    path = protocol.anchors.replace("made.yaml", "few.yaml")
    task = next(t for t in protocol.tasks if t.short == "CableHole-Position-Sine")
    track = protocol.track("nominal")
    one = Anchor(task.env, "nominal", 0.004, 0.0002, "m", "open-loop", "oracle", 20, 2000, task_hash(task, track), "")
    from pathlib import Path

    write_anchors(Path(path), [one], "")
    few = replace(protocol, anchors=path)
    board = build_board(few, [{**r, "protocol_hash": few.hash()} for r in records])
    assert all(r.score is None for r in board.table("CableHole-Position-Step", "nominal").rows)
    assert all(r.score is not None for r in board.table("CableHole-Position-Sine", "nominal").rows)
    assert any("has no anchors" in n and "CableHole-Position-Step (nominal)" in n for n in board.notes)


def test_a_board_repeats_exactly_from_the_same_records(made, board):
    assert build_board(*made) == board
