"""The logarithmic score, the failure rules and the frozen anchors."""

import math
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cablebench.board.scoring import score_episodes
from cablebench.protocol.failures import RULES, broken
from cablebench.protocol.files import load_protocol, parse_protocol
from cablebench.protocol.protocol import Task, Track
from cablebench.score.anchors import Anchor, anchors_of, load_anchors, task_hash, write_anchors
from cablebench.score.held import held
from cablebench.score.log_score import LEAST_SHARE, log_score, score_records, survived, violations

SUITE = load_protocol("suite-v1")
SINE = "cable_envs/CableHole-Position-Sine-v0"


def anchor(**more):
    return Anchor(**{
        "task": SINE, "track": "nominal", "open_loop": 0.01, "bound": 1e-4, "unit": "m", "open_loop_by": "open-loop",
        "bound_by": "oracle", "episodes": 20, "first_seed": 0, "task_hash": "0", "source": "0", **more,
    })  # fmt: skip


ANCHORS = {(SINE, "nominal"): anchor()}


def record(rmse=0.001, track="nominal", **metrics):
    return {"env_id": SINE, "track": track, "entrant": "x", "metrics": {"rmse": rmse, "failed": 0.0, **metrics}}


def test_a_factor_in_the_error_counts_alike_everywhere():
    assert log_score(1.0, 1.0, 0.01) == 0.0 and log_score(0.01, 1.0, 0.01) == pytest.approx(1.0)
    for error in (0.5, 0.1, 0.02):
        assert log_score(error / 2, 1.0, 0.01) - log_score(error, 1.0, 0.01) == pytest.approx(math.log(2, 100))
    assert log_score(0.001, 1.0, 0.01) == pytest.approx(1.5)  # better than the bound is more than 1


def test_the_score_is_clipped_below_and_finite_above():
    assert log_score(1e9, 1.0, 0.01) == -1.0 and log_score(150.0, 1.0, 0.01, worst=-0.25) == -0.25
    assert log_score(0.0, 1.0, 0.01) == pytest.approx(math.log(1.0 / (LEAST_SHARE * 0.01), 100))


def test_the_bound_of_the_same_episode_is_compared_and_who_made_it_is_not_below_it():
    bounds = (1e-4, 2e-4, 5e-5)
    anchors = {(SINE, "nominal"): anchor(bounds=bounds, episodes=3)}
    errors = (1e-4 * (1.0 - 4e-6), 1.5e-4, 1e-4)  # made it, below its own, above its own
    records = [{**record(error), "seed": seed, "sweep": ""} for seed, error in enumerate(errors)]
    failed = {**record(1e-6, failed=1.0), "seed": 0, "sweep": ""}
    swept = {**record(1e-6), "seed": 0, "sweep": "delay"}
    beyond = {**record(1e-6), "seed": 3, "sweep": ""}
    (one,) = held([*records, failed, swept, beyond], anchors)
    assert (one.task, one.episodes, one.below, one.nearest) == (SINE, 3, 1, "x")
    assert one.share == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("metrics", "rule"),
    [
        ({"failed": 1.0}, "torn"), ({"rmse": None}, "torn"), ({"dropped": 1.0}, "dropped"),
        ({"rmse": 0.101}, "runaway"), ({"slack": 0.0051}, "slack"), ({"overload": 0.0051}, "overload"),
    ],
)  # fmt: skip
def test_each_rule_makes_an_episode_fail_by_itself(metrics, rule):
    bad = record(**metrics)
    assert violations(bad, ANCHORS) == (rule,)
    assert score_records([bad, record()], SUITE, ANCHORS) == [-1.0, pytest.approx(0.5)]


def test_what_a_record_does_not_say_is_no_failure():
    assert broken({"rmse": 0.05, "failed": 0.0, "slack": None, "overload": 0.005, "dropped": math.nan}, 0.01) == ()
    assert {rule.__name__ for rule in RULES} == {"torn", "ended", "dropped", "runaway", "slack", "overload"}
    assert all(rule.__doc__ for rule in RULES)  # the page shows them


def test_without_an_anchor_there_is_no_score():
    assert math.isnan(score_records([record(track="elsewhere")], SUITE, ANCHORS)[0])


def test_other_entrants_never_move_a_score():
    mine = [record(0.001), record(0.0005)]
    others = [{**record(1e-6), "entrant": "oracle"}, {**record(5.0), "entrant": "open-loop"}]
    assert score_episodes(mine, SUITE, ANCHORS) == score_episodes([*mine, *others], SUITE, ANCHORS)[:2]


def test_a_value_of_a_sweep_is_survived_without_a_broken_rule_and_above_the_open_loop():
    found = [survived(r, s, SUITE, ANCHORS) for r, s in (
        (record(), 0.5), (record(), SUITE.survival), (record(), -1.0), (record(overload=0.2), 0.5),
    )]  # fmt: skip
    assert found == [True, False, False, False]


def test_a_bound_that_is_hardly_better_than_the_open_loop_is_refused():
    with pytest.raises(ConfigurationError, match=re.escape("at least 1.5 times")):
        anchor(bound=0.009)
    with pytest.raises(ConfigurationError, match="positive"):
        anchor(bound=0.0)


def test_the_shipped_anchors_are_of_the_tasks_as_they_are():
    found = anchors_of(SUITE)
    assert set(found) == {(t.env, track.name) for t in SUITE.tasks for track in SUITE.tracks}
    for a in found.values():
        assert a.first_seed in SUITE.test and a.episodes == len(a.bounds)
        assert np.median(a.bounds) == pytest.approx(a.bound, rel=1e-5)  # both are kept with six digits


def test_anchors_are_written_as_they_are_read(tmp_path):
    path = write_anchors(tmp_path / "mine.yaml", [anchor(), anchor(track="hard", bound=2e-4)], "for a test")
    found = load_anchors(str(path))
    assert [asdict(a) for a in found.values()] == [asdict(anchor(track="hard", bound=2e-4)), asdict(anchor())]


def test_a_changed_task_refuses_its_anchors(tmp_path):
    task, track = Task(SINE), Track("nominal", {"sensor_noise": True})
    path = tmp_path / "mine.yaml"
    protocol = replace(SUITE, tasks=(task,), tracks=(track,), run=(), anchors=str(path))
    write_anchors(path, [anchor(task_hash=task_hash(task, track))], "")
    assert set(anchors_of(protocol)) == {(SINE, "nominal")}
    for changed in (
        replace(protocol, tasks=(Task(SINE, {"duration": 10.0}),)),
        replace(protocol, tracks=(Track("nominal", {"sensor_noise": False}),)),
    ):
        with pytest.raises(ConfigurationError, match=r"another version of the task.*cablebench anchors"):
            anchors_of(changed)


def test_a_change_of_the_tasks_file_or_rig_changes_its_hash(monkeypatch):
    from cablebench.score import anchors

    before = task_hash(Task(SINE), Track("nominal"))
    assert task_hash(Task(SINE, {"rig": {"load_mass": 4.0}}), Track("nominal")) != before
    read = anchors.read_yaml
    monkeypatch.setattr(anchors, "read_yaml", lambda path: {**read(path), "success_error": 0.002})
    assert task_hash(Task(SINE), Track("nominal")) != before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "cable-anchors/9"}, "expected schema"),
        ({"anchors": {}}, "expected schema"),
        ({"anchors": [{"task": SINE}]}, "expected str"),
        ({"anchors": ["x"]}, "an anchor is a mapping"),
        ({"anchors": [{**asdict(anchor()), "bond": 1.0}]}, "unknown key"),
        ({"anchors": [{**asdict(anchor()), "bound": "small"}]}, "bound of an anchor"),
        ({"anchors": [asdict(anchor())] * 2}, "two anchors of"),
    ],
)
def test_a_file_of_anchors_that_is_wrong_is_refused(tmp_path, change, message):
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump({"schema": "cable-anchors/1", "note": "", "anchors": [], **change}))
    with pytest.raises(ConfigurationError, match=message):
        load_anchors(str(path))


def test_unknown_anchors_name_the_nearest():
    with pytest.raises(ConfigurationError, match="suite-v1"):
        load_anchors("suite-v2")


@pytest.mark.parametrize(
    ("score", "message"),
    [({"version": 2}, "there are 0 and 1"), ({"version": 1}, "anchors"), ({"anchors": "suite-v1"}, "anchors")],
)
def test_a_protocol_says_version_and_anchors_together(score, message):
    from cable_envs.core.config import config_path

    data = yaml.safe_load(config_path("protocols", "quick.yaml").read_text())
    with pytest.raises(ConfigurationError, match=message):
        parse_protocol({**data, "score": {**data["score"], **score}})


def test_version_0_keeps_the_hash_that_the_published_records_have():
    assert (load_protocol("quick").hash(), load_protocol("full").hash()) == ("9905133a1f76", "1c5737d4d60d")
    assert replace(SUITE, survival=0.2).hash() != SUITE.hash() != replace(SUITE, anchors="other").hash()


def test_a_disturbance_is_swept_through_the_resets():
    task = "cable_envs/CableHole-Sine-Hard-v1"
    cells = [c for c in SUITE.cells((task,), ("robust",)) if c.sweep.name == "disturbance"]
    assert [c.reset_options(None)["disturbance"]["amplitude"] for c in cells] == pytest.approx(
        list(np.linspace(0, 15, 6))
    )
    assert {c.sweep.name for c in SUITE.cells((task,), ("robust",))} == {"disturbance", "delay", "noise", "friction"}
    for task in SUITE.tasks:  # every task has all four
        assert len({c.sweep.name for c in SUITE.cells((task.env,), ("robust",))}) == 4
