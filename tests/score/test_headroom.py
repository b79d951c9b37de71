"""The verdicts of benchmarks.headroom and the tables of benchmarks.references, on numbers chosen by hand."""

import json
import math

import numpy as np
import pytest

from benchmarks import headroom, references, suite_gains, verdicts
from benchmarks.verdicts import AGENT, CLASSICAL, NOTHING, ORACLE, Row
from cable_envs import SUITE_IDS

TASK = "cable_envs/CableHole-Track-Medium-v1"
EPISODES = 12


def row(name, part, level, spread=0.05, seed=0, failed=0):
    """Errors about ``level`` with a relative ``spread``; the first ``failed`` episodes are ended by a rule."""
    errors = level * np.exp(spread * np.random.default_rng(seed).standard_normal(EPISODES))
    errors[:failed] = math.inf
    return Row(name, part, tuple(errors), ("runaway",) * failed)


def rows(classical, agent, oracle=1e-4):
    return [
        row("nothing", NOTHING, 1e-2, seed=1), row("pid-suite", CLASSICAL, classical, seed=2),
        row("ppo", AGENT, agent, seed=3), row("oracle x 1", ORACLE, 5.0 * oracle, seed=4),
        row("oracle x 0.5", ORACLE, oracle, seed=5),
    ]  # fmt: skip


def test_ends_are_doing_nothing_and_the_best_oracle():
    assert verdicts.ends(rows(1e-3, 5e-4)) == pytest.approx((1e-2, 1e-4), rel=0.1)
    assert verdicts.ends(rows(1e-3, 5e-4), (2.0, 1.0)) == (2.0, 1.0)
    with pytest.raises(ValueError, match="nothing to win"):
        verdicts.ends(rows(1e-3, 5e-4, oracle=2e-2))


def test_a_failed_episode_has_the_worst_score():
    """Two decades between the ends: an error of 1e-3 scores a half."""
    found = verdicts.scores(row("a", CLASSICAL, 1e-3, 0.0, failed=2), (1e-2, 1e-4))
    assert found[:2].tolist() == [-1.0, -1.0]
    assert found[2:] == pytest.approx(0.5)


def test_a_task_discriminates_where_all_three_are_apart_and_something_is_left():
    assert verdicts.verdict(TASK, rows(3e-3, 1e-3)).discriminates is True
    assert verdicts.verdict(TASK, rows(1e-3, 1e-3)).discriminates is False  # classical and agent are the same
    assert verdicts.verdict(TASK, rows(1e-3, 1.5e-4)).discriminates is False  # the agent is near the end
    assert verdicts.verdict(TASK, [r for r in rows(3e-3, 1e-3) if r.part != CLASSICAL]).discriminates is None
    one = verdicts.verdict(TASK, rows(3e-3, 1e-3))
    assert one.best[ORACLE].entrant == "oracle x 0.5"
    assert len(one.pairs) == 3  # of the oracle's sizes the best one only


def test_table_names_best_controllers_failures_and_ranks():
    other = TASK.replace("Medium", "Hard")
    results = {TASK: [*rows(3e-3, 1e-3), row("lqg-suite", CLASSICAL, 5e-3, failed=1)], other: rows(3e-3, 1e-3)}
    text = verdicts.table(results, {})
    line = next(line for line in text.splitlines() if line.startswith("| CableHole-Track-Medium"))
    assert "| pid 0.00299 m, 0.26 [" in line
    assert line.endswith("6 of 6 | yes |")
    assert "9 of 9 pairs" in text
    assert "failed" not in line  # of the best one no episode is
    failing = [row("pid-suite", CLASSICAL, 1e-3, failed=3) if r.part == CLASSICAL else r for r in rows(1e-3, 1e-3)]
    assert ", 3 failed" in verdicts.table({TASK: failing}, {})


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


def test_kept_errors_are_read_as_they_were_written():
    kept = {TASK: {"ppo": {"part": AGENT, "errors": [1e-3, None], "failures": ["runaway"]}}}
    assert json.loads(headroom.as_lines(kept)) == kept
    (row,) = verdicts.rows_of(kept[TASK])
    assert row == Row("ppo", AGENT, (1e-3, math.inf), ("runaway",))


def test_rows_are_cut_to_the_episodes_that_all_have():
    kept = {
        "ppo": {"part": AGENT, "errors": [1e-3, None, 2e-3, None], "failures": ["runaway", "slack"]},
        "pid": {"part": CLASSICAL, "errors": [1e-3, 2e-3, 3e-3], "failures": []},
        "oracle": {"part": ORACLE, "errors": [1e-3], "failures": []},
    }
    rows = {row.entrant: row for row in verdicts.rows_of(kept)}
    assert rows["ppo"] == Row("ppo", AGENT, (1e-3, math.inf, 2e-3), ("runaway",))
    assert len(rows["pid"].errors) == 3
    assert "oracle" not in rows


def test_the_published_errors_are_whole():
    """Every task has those that do nothing, PPO and a classical controller, on at least eight episodes."""
    kept = json.loads(headroom.RESULTS.read_text(encoding="utf-8"))
    assert set(kept) == set(SUITE_IDS)
    for env_id, content in kept.items():
        rows = verdicts.rows_of(content)
        assert {NOTHING, CLASSICAL, AGENT} <= {row.part for row in rows}, env_id
        assert {len(row.errors) for row in rows} <= set(range(8, 21)), env_id
        assert all(sum(map(math.isinf, row.errors)) == len(row.failures) for row in rows), env_id
        verdicts.verdict(env_id, rows, headroom.anchors()[env_id])


def test_levels_with_the_same_training_share_a_policy():
    short = "PulleyCircuit-Track-{}-v1"
    assert headroom.policy_name(f"cable_envs/{short.format('Hard')}") == short.format("Medium")
    assert headroom.policy_name(TASK) == "CableHole-Track-Medium-v1"
