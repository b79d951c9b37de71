"""The verdicts of benchmarks.headroom and the tables of benchmarks.references, on numbers chosen by hand."""

import math

import numpy as np
import pytest

from benchmarks import headroom, references, suite_gains, verdicts
from benchmarks.verdicts import AGENT, BOUND, CLASSICAL, NOTHING, Row
from cable_envs import SUITE_IDS
from cablebench.protocol.files import load_protocol
from cablebench.run.folders import published
from cablebench.score.log_score import log_score

TASK = "cable_envs/CableHole-Track-Medium-v1"
EPISODES = 12
ENDS = {TASK: (1e-2, 1e-4)}


def row(name, part, level, spread=0.05, seed=0, failed=0, runs=1):
    """Errors about ``level`` with a relative ``spread``; the first ``failed`` episodes are ended by a rule."""
    errors = level * np.exp(spread * np.random.default_rng(seed).standard_normal((runs, EPISODES)))
    scores = np.array([[log_score(e, 1e-2, 1e-4) for e in run] for run in errors])
    scores[:, :failed] = -1.0
    return Row(name, part, errors, scores)


def rows(classical, agent):
    return [
        row("open-loop", NOTHING, 1e-2, seed=1), row("pid-suite", CLASSICAL, classical, seed=2),
        row("suite-ppo", AGENT, agent, seed=3, runs=3), row("bound", BOUND, 1e-4, seed=5),
    ]  # fmt: skip


def test_a_failed_episode_is_counted_and_not_in_the_median():
    found = row("a", CLASSICAL, 1e-3, 0.0, failed=2)
    assert found.failed == 2 and found.median == pytest.approx(1e-3)
    assert found.scores[0, 2:] == pytest.approx(0.5)  # two decades between the ends
    assert math.isnan(row("a", CLASSICAL, 1e-3, failed=EPISODES).median)


def test_a_task_discriminates_where_all_three_are_apart_and_something_is_left():
    assert verdicts.verdict(TASK, rows(3e-3, 1e-3)).discriminates is True
    assert verdicts.verdict(TASK, rows(1e-3, 1e-3)).discriminates is False  # classical and agent are the same
    assert verdicts.verdict(TASK, rows(1e-3, 1.5e-4)).discriminates is False  # the agent is near the end
    assert verdicts.verdict(TASK, [r for r in rows(3e-3, 1e-3) if r.part != CLASSICAL]).discriminates is None
    assert len(verdicts.verdict(TASK, rows(3e-3, 1e-3)).pairs) == 3  # those that do nothing are not compared


def test_training_seeds_widen_the_interval():
    """One of three seeds that has not learned: over the rigs alone the other two hide it."""
    apart = row("suite-ppo", AGENT, 1e-3, runs=3)
    apart.scores[2] = 0.0
    found = verdicts.verdict(TASK, [*rows(3e-3, 1e-3)[:2], apart, rows(3e-3, 1e-3)[3]])
    assert found.discriminates is False


def test_table_names_best_controllers_failures_and_ranks():
    other = TASK.replace("Medium", "Hard")
    results = {TASK: [*rows(3e-3, 1e-3), row("lqg-suite", CLASSICAL, 5e-3, failed=1)], other: rows(3e-3, 1e-3)}
    ends = {**ENDS, other: ENDS[TASK]}
    text = verdicts.table(results, ends)
    line = next(line for line in text.splitlines() if line.startswith("| CableHole-Track-Medium"))
    assert (
        line.startswith("| CableHole-Track-Medium | 0.01 m | pid 0.00299 m, 0.26 [") and "], 3 seeds | 0.0001 m" in line
    )
    assert line.endswith("6 of 6 | yes |")
    assert "9 of 9 pairs" in text
    assert "failed" not in line  # of the best one no episode is
    failing = [row("pid-suite", CLASSICAL, 1e-3, failed=3) if r.part == CLASSICAL else r for r in rows(1e-3, 1e-3)]
    assert ", 3 of 12 failed" in verdicts.table({TASK: failing}, ENDS)


def test_parts_of_the_board():
    assert [headroom.part_of(n) for n in ("lqg-suite", "suite-ppo", "open-loop", "feedforward-pid")] == [
        CLASSICAL, AGENT, NOTHING, CLASSICAL
    ]  # fmt: skip
    assert (
        headroom.part_of("oracle")
        is headroom.part_of("suite-references")
        is headroom.part_of("suite-residual-ppo")
        is None
    )


def test_the_page_shows_the_published_board():
    """Every task with doing nothing, a classical controller, PPO and the bound, on all episodes."""
    protocol, store = load_protocol(headroom.NAME), published(headroom.NAME)
    found = headroom.rows_of(store.read().records, protocol)
    assert set(found) == set(SUITE_IDS)
    of_ten = {"cable_envs/CableHole-Step-Hard-v1", "cable_envs/TendonSheath-Track-Medium-v1"}
    for env_id, rows_here in found.items():
        seeds = 10 if env_id in of_ten else 3
        assert {row.part for row in rows_here} == {NOTHING, CLASSICAL, AGENT, BOUND}
        assert {row.scores.shape for row in rows_here if row.part == AGENT} == {(seeds, protocol.episodes)}
        assert {row.scores.shape for row in rows_here if row.part != AGENT} == {(1, protocol.episodes)}
    few = {env_id: rows for env_id, rows in found.items() if "TendonSheath" in env_id or "Track-Easy" in env_id}
    lines = [line for line in verdicts.table(few, headroom.ends(protocol)).splitlines() if line.startswith("| ")]
    page = (headroom.ROOT / "docs" / "suite.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + len(few) and set(lines) <= set(page)


def test_ranked_are_the_tasks_that_discriminate():
    """The rule of the suite: of the table that another test compares with the records."""
    page = (headroom.ROOT / "docs" / "suite.md").read_text(encoding="utf-8").split(headroom.BEGIN)[1]
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    found = {cells[0]: cells[-1] for cells in rows}
    tasks = load_protocol(headroom.NAME).tasks
    assert {task.short: "yes" if task.ranked else "no" for task in tasks}.items() <= found.items()


def test_every_suite_task_is_in_a_group_of_the_tuning():
    names = [name for pair in suite_gains.GROUPS.items() for name in (pair[0], *pair[1])]
    assert sorted(map(suite_gains.full, names)) == sorted(SUITE_IDS)


def test_page_compares_each_reference_with_the_textbook():
    task = "CableHole-Position-Sine"
    records = [
        {"entrant": name, "task": task, "track": track, "seed": seed, "training_seed": None, "output_unit": "m",
         "metrics": {"failed": 0.0, "rmse": error * (1.0 + 0.01 * seed)}}
        for track in references.TRACKS for seed in range(3)
        for name, error in (("lqg", 3e-5), ("mrac", 5e-5), ("textbook-hole", 4e-5))
    ]  # fmt: skip
    records += [dict(r, entrant="x", metrics={"failed": 1.0, "rmse": 0.0}) for r in records]
    found, unit = references.medians(records), references.units(records)
    assert found["lqg", task, "nominal"] == pytest.approx(3.03e-5)
    assert found["x", task, "nominal"] == math.inf
    said = references.claims(found, unit)
    assert "| 0.0404 | 0.0243 mm | `lqg` 0.0303 | `lqg` 0.0303, `mrac` 0.0505 |" in said  # nominal
    assert "| 0.0404 | 0.0295 mm |" in said
    assert "| `lqg` | 0.0303 / 0.0303 |" in references.errors_table("CableHole", found, unit)
