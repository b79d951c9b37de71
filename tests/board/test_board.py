"""Boards from made-up records: scores, ranks, and what the reports must say."""

import io
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.text import count, number
from cablebench.board.board import build_board
from cablebench.board.cells import seed_text
from cablebench.board.pages.overview import render_board
from cablebench.board.report import print_board, render_json, render_markdown
from cablebench.board.scoring import latest, score_episodes
from cablebench.protocol.metrics import METRICS
from cablebench.run.store import ResultStore
from tests.support.board_records import ENTRANTS, made_protocol, made_records


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    protocol = made_protocol()
    store = ResultStore(tmp_path_factory.mktemp("store") / "made.jsonl")
    store.append(made_records(protocol, store))
    return protocol, store, store.records()


@pytest.fixture(scope="module")
def board(made):
    return build_board(made[0], made[2])


def record(entrant, rmse, seed=1, failed=0.0, **more):
    return {"entrant": entrant, "training_seed": None, "env_id": "e", "track": "t", "sweep": None, "sweep_value": None,
            "seed": seed, "metrics": {"rmse": rmse, "failed": failed}, **more}  # fmt: skip


def scores(*records, **changes):
    return score_episodes(list(records), made_protocol(**changes))


def test_score_is_zero_for_the_open_loop_and_one_for_the_oracle():
    assert scores(record("open-loop", 0.5), record("x", 0.3), record("oracle", 0.1)) == pytest.approx([0.0, 0.5, 1.0])


def test_score_is_taken_on_the_same_episode():
    found = scores(
        record("open-loop", 0.5, 1), record("oracle", 0.1, 1), record("x", 0.3, 1),
        record("open-loop", 0.9, 2), record("oracle", 0.3, 2), record("x", 0.3, 2),
    )  # fmt: skip
    assert (found[2], found[5]) == pytest.approx((0.5, 1.0))


def test_a_failed_episode_gets_the_worst_score_and_nobody_gets_less():
    found = scores(
        record("open-loop", 0.5), record("oracle", 0.1), record("torn", 0.2, failed=1.0), record("wild", 50.0)
    )
    assert found[2:] == [-1.0, -1.0]
    milder = scores(record("open-loop", 0.5), record("oracle", 0.1), record("torn", 0.2, failed=1.0), worst_score=-0.25)
    assert milder[2] == -0.25


def test_better_than_the_oracle_is_above_one():
    assert scores(record("open-loop", 0.5), record("oracle", 0.1), record("x", 0.06))[2] == pytest.approx(1.1)


def test_a_reference_that_failed_is_replaced_by_its_mean_over_the_other_episodes():
    found = scores(
        record("open-loop", 0.4, 1), record("open-loop", 0.6, 2), record("open-loop", 0.001, 3, failed=1.0),
        *(record("oracle", 0.1, k) for k in (1, 2, 3)), record("x", 0.3, 3),
    )  # fmt: skip
    assert found[2] == -1.0  # the reference's own failure is scored as everyone's
    assert found[-1] == pytest.approx((0.5 - 0.3) / (0.5 - 0.1))


def test_a_lucky_open_loop_does_not_blow_up_a_score():
    lucky = 0.1001  # the gap of this episode is a four-thousandth of the others'
    records = [record("open-loop", v, k) for k, v in enumerate((0.5, 0.5, lucky))]
    records += [record("oracle", 0.1, k) for k in range(3)] + [record("x", 0.05, 2)]
    assert scores(*records)[-1] == pytest.approx((lucky - 0.05) / (0.5 * 0.4))


@pytest.mark.parametrize("records", [
    [record("open-loop", 0.5), record("x", 0.3)],
    [record("oracle", 0.5), record("x", 0.3)],
    [record("open-loop", 0.1), record("oracle", 0.5), record("x", 0.3)],
])  # fmt: skip
def test_without_a_scale_there_is_no_score(records):
    assert all(map(math.isnan, scores(*records)))


def test_a_repeated_episode_counts_once_and_the_newest_wins():
    again = latest([record("x", 0.3), record("x", 0.2), record("x", 0.1, training_seed=4)])
    assert [r["metrics"]["rmse"] for r in again] == [0.2, 0.1]


def test_tables_hold_every_task_and_track_in_the_protocols_order(made, board):
    protocol = made[0]
    expected = [(t.short, track.name) for t in protocol.tasks for track in protocol.tracks]
    assert [(t.task, t.track) for t in board.tables] == expected
    for table in board.tables:
        assert {r.entrant for r in table.rows} == set(ENTRANTS)


def test_rows_are_ranked_within_their_information_class(board):
    table = board.table("CableHole-Position-Sine", "nominal")
    assert [r.information for r in table.rows] == ["model-free"] * 2 + ["nominal"] * 3 + ["oracle"]
    assert [r.rank for r in table.rows] == [1, 2, 1, 2, 3, 1]
    for a, b in zip(table.rows, table.rows[1:], strict=False):
        assert a.information != b.information or a.score.value >= b.score.value


def test_intervals_are_over_training_seeds_where_there_are_several(board):
    rows = {r.entrant: r for r in board.table("CableHole-Position-Sine", "randomised").rows}
    assert (rows["ppo"].runs, rows["ppo"].score.unit) == (3, "training seeds")
    assert (rows["pid"].runs, rows["pid"].score.unit) == (1, "episodes")
    for row in rows.values():
        assert row.score.low <= row.score.value <= row.score.high
    # the made-up training seeds differ by 30 % each: the agent's interval must show it
    assert rows["ppo"].score.high - rows["ppo"].score.low > 0.05


def test_raw_values_are_medians_in_si_and_ignore_failed_episodes(made, board):
    row = next(r for r in board.table("PulleyCircuit-Position-Sine", "randomised").rows if r.entrant == "ppo")
    mine = [
        r
        for r in made[2]
        if (r["entrant"], r["task"], r["track"]) == ("ppo", "PulleyCircuit-Position-Sine", "randomised")
    ]
    complete = [r["metrics"]["rmse"] for r in mine if not r["metrics"]["failed"]]
    assert row.failures == len(mine) - len(complete) > 0
    assert row.raw["rmse"] == pytest.approx(np.median(complete))


def test_improvement_over_the_papers_controller_is_not_given_to_itself(board):
    rows = {r.entrant: r for r in board.table("CableHole-Position-Step", "nominal").rows}
    assert rows["mrac-g22"].improvement is None
    assert rows["open-loop"].improvement == 0.0 and rows["oracle"].improvement == 1.0


def test_the_overall_table_leaves_out_who_did_not_run_everything_and_says_so(made):
    protocol, _, records = made
    some = [r for r in records if not (r["entrant"] == "ppo" and r["task"] == "CableHole-Position-Step")]
    board = build_board(protocol, some)
    overall = next(t for t in board.overall if (t.family, t.track) == ("CableHole", "nominal"))
    assert overall.omitted == ("ppo",) and "ppo" not in {r.entrant for r in overall.rows}
    assert "Not in this table because they did not run all tasks: ppo" in render_markdown(board)
    row = next(r for r in overall.rows if r.entrant == "pid")
    assert set(row.scores) == {"CableHole-Position-Step", "CableHole-Position-Sine"}
    assert "rmse" not in row.raw  # errors of different units are not averaged


def test_there_is_no_overall_table_where_nobody_ran_everything(made):
    protocol, _, records = made
    split = [r for r in records if (r["entrant"] in ("pid", "ppo")) == (r["task"] == "CableHole-Position-Step")]
    board = build_board(protocol, split)
    assert not [t for t in board.overall if t.family == "CableHole"]
    assert [t for t in board.tables if t.family == "CableHole"]
    page = render_board(board)
    for task in ("CableHole-Position-Step", "CableHole-Position-Sine"):
        assert f'href="tasks/{task}.html"' in page


def test_a_board_repeats_exactly_from_the_same_records(made, board):
    again = build_board(made[0], made[2])
    assert again == board


def test_records_of_another_configuration_are_left_out_and_counted(made):
    protocol, _, records = made
    other = replace(protocol, episodes=99)
    board = build_board(protocol, [*records, *({**r, "protocol_hash": other.hash()} for r in records[:7])])
    assert board.episodes == len(records)
    assert any("7 records of other configurations" in n for n in board.notes)
    with pytest.raises(ConfigurationError, match="no whole run of protocol"):
        build_board(other, records)


def test_an_incomplete_run_is_left_out_and_named(made):
    protocol, _, records = made
    missing = next(i for i, r in enumerate(records) if r["entrant"] == "pid")
    board = build_board(protocol, records[:missing] + records[missing + 1 :])
    assert "pid" not in {r.entrant for r in board.table("CableHole-Position-Step", "nominal").rows}
    assert "pid" in {r.entrant for r in board.table("CableHole-Position-Sine", "nominal").rows}
    assert any("pid on CableHole-Position-Step nominal (7 of 8 episodes)" in n for n in board.notes)


def test_without_references_the_board_ranks_by_raw_error_and_says_so(made):
    protocol, _, records = made
    board = build_board(protocol, [r for r in records if r["entrant"] != "oracle"])
    table = board.table("CableHole-Position-Sine", "nominal")
    assert all(r.score is None for r in table.rows)
    assert [r.entrant for r in table.rows if r.information == "nominal"] == ["mrac-g22", "mrac-g9", "open-loop"]
    assert any("There are no scores" in n for n in board.notes)
    assert "CableHole-Position-Sine" in render_markdown(board) and len(render_json(board)) > 1000


def test_sweeps_are_kept_by_value(board):
    line = next(s for s in board.sweeps if s["task"] == "CableHole-Position-Sine" and s["entrant"] == "open-loop")
    assert line["sweep"] == "friction" and line["values"] == [0.5, 0.875, 1.25, 1.625, 2.0]
    assert line["rmse"] == sorted(line["rmse"])  # more friction, more error: that is how the records were made


def test_json_is_complete_versioned_and_strict(board):
    data = json.loads(render_json(board), parse_constant=lambda c: pytest.fail(f"{c} is no JSON"))
    assert data["schema"] == 1 and data["configuration"] == board.configuration
    assert [m["name"] for m in data["metrics"]] == [m.name for m in METRICS]
    row = data["tables"][0]["rows"][0]
    assert {"entrant", "information", "score", "raw", "charged", "replay", "scores"} <= set(row)
    assert len(row["scores"]["CableHole-Position-Step"]) == row["runs"]
    assert data["seeds"] == list(range(2000, 2008))


def test_terminal_tables_show_units_scores_and_the_legend(board):
    from rich.console import Console

    out = io.StringIO()
    print_board(board, Console(file=out, width=220))
    text = out.getvalue()
    assert "RMSE [mm]" in text and "RMSE [rad]" in text  # not taken for markup
    assert re.search(r"1\.00 \[1\.00, 1\.00\]\*", text)
    assert "Score: 0 = open-loop, 1 = oracle" in text and board.configuration in text


def test_markdown_rows_have_as_many_cells_as_headings(board):
    for block in render_markdown(board).split("\n\n"):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines}) <= 1


def test_numbers_are_short_and_readable():
    assert [number(v) for v in (0.00012345, 1.2345, 123.456, 0, None, math.nan, -0.5)] == [
        "1.23e-4", "1.23", "123", "0", "–", "–", "-0.500"
    ]  # fmt: skip
    assert number(123456.7).replace("\N{NARROW NO-BREAK SPACE}", " ") == "123 457"
    assert [count(v) for v in (0, 850, 12_000, 1_500_000)] == ["0", "850", "12k", "1.5M"]
    assert [seed_text(s) for s in ((), (3,), (3, 4, 5), (1, 7))] == ["none", "3", "3-5", "1, 7"]


def test_records_of_another_version_are_left_out_and_named(made):
    protocol, _, records = made
    old = [{**r, "protocol": protocol.name, "protocol_version": 7, "protocol_hash": "old"} for r in records[:5]]
    board = build_board(protocol, [*records, *old])
    assert board.episodes == len(records)
    assert any("5 records of version 7 of the protocol were left out" in n for n in board.notes)
    assert replace(protocol, version=2).hash() != protocol.hash()


def test_notes_say_what_the_protocol_asks_for_and_nobody_ran(made):
    protocol, _, records = made
    keep = [r for r in records if r["task"] != "CableHole-Position-Step" and (r["training_seed"] or 0) < 2]
    notes = " ".join(build_board(protocol, keep).notes)
    assert "Incomplete board" in notes and "CableHole-Position-Step (nominal)" in notes
    assert "These have fewer than the protocol's 3 training seeds: ppo (2 on 3 tasks)." in notes
    few = " ".join(build_board(protocol, [r for r in records if r["seed"] < 2004]).notes)
    assert "fewer test episodes than the protocol asks for" in few and "(nominal): 4 of 8" in few


def test_robustness_is_the_mean_score_over_a_sweep(board):
    line = next(s for s in board.sweeps if s["task"] == "CableHole-Position-Sine" and s["entrant"] == "mrac-g22")
    assert len(line["score"]) == len(line["values"]) and line["robustness"] == pytest.approx(np.mean(line["score"]))
    ends = {s["entrant"]: s["robustness"] for s in board.sweeps if s["task"] == line["task"]}
    assert ends["open-loop"] == 0.0 and ends["oracle"] == 1.0 and 0.0 < line["robustness"] < 1.0


def test_entrants_beyond_the_colours_look_different():
    from types import SimpleNamespace

    from cablebench.board.pages.figures import styles

    names = tuple(f"n{i}" for i in range(20))
    found = styles(SimpleNamespace(entrants=names, protocol=made_protocol()))
    assert len({(s["color"], s["marker"]) for s in found.values()}) == 20
    assert len({(s["color"], str(s["dash"])) for s in found.values()}) == 20


def test_a_board_is_dated_by_its_newest_record_whatever_a_record_says(made):
    dates = ("2026-03-01T10:00:00+00:00", "2026-03-02T01:00:00+02:00", "yesterday", "2026-03-01T12:00:00")
    records = [{**record, "created": dates[k % len(dates)]} for k, record in enumerate(made[2])]
    assert build_board(made[0], records).created == "2026-03-01 23:00 UTC"
    assert build_board(made[0], [{**r, "created": "yesterday"} for r in records]).created == "no date"
