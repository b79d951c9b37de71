"""The protocol of suite v1: which tasks it ranks, that the priced error is scored, that bad habits are not rewarded."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs.sim.registered import setup_of
from cablebench.board.board import build_board
from cablebench.board.report import render_markdown
from cablebench.bound import upper_bound
from cablebench.bound.candidates import oracles, without_effects
from cablebench.entrants.entrant import IDEAL, controller_entrant
from cablebench.protocol.episode import Episode
from cablebench.protocol.failures import broken, scored_error
from cablebench.protocol.files import load_protocol
from cablebench.protocol.metrics import ended_by_rule, measure, priced_rmse
from cablebench.protocol.protocol import Task, Track
from cablebench.run.evaluation import core_of, run_episode
from cablebench.score.anchors import Anchor, anchors_of, load_anchors, task_hash, write_anchors
from cablebench.score.held import held
from cablebench.score.log_score import score_records
from tests.support.board_records import made_protocol, made_records

SUITE = load_protocol("suite-v1")
EASY, HARD = "cable_envs/CableHole-Track-Easy-v1", "cable_envs/CableHole-Track-Hard-v1"
CLASSIC = "cable_envs/CableHole-Sine-Classic-v1"


# the protocol


def test_every_task_of_the_suite_is_there_and_the_papers_own_signals_stand_beside():
    assert {task.env for task in SUITE.tasks} == set(cable_envs.SUITE_IDS)
    beside = {task.env for task in SUITE.tasks if not task.ranked}
    assert beside >= {i for i in cable_envs.SUITE_IDS if "-Classic-" in i}


def test_test_rigs_are_those_that_nobody_trains_on_and_the_robust_track_draws_none():
    for cell in SUITE.cells((HARD,), ("test",)):
        conditions = setup_of(HARD, cell.environment_options()).conditions
        assert conditions.split == "test" and conditions.cable_rows
    for cell in SUITE.cells((HARD,), ("robust",)):
        setup = setup_of(HARD, cell.environment_options())
        assert not setup.randomize and not setup.conditions.cable_rows


def test_every_swept_quantity_reaches_the_episode():
    """Each sweep's last value gives another trajectory than the plain episode of the robust track."""
    found, entrant = {}, controller_entrant("pid")
    for cell in SUITE.cells((EASY,), ("robust",)):
        if cell.value != max(cell.sweep.values()) or cell.sweep.name in ("delay", "noise"):
            continue
        with gym.make(EASY, **entrant.enters(EASY, {**cell.environment_options(), "duration": 6.0})) as env:
            setup = core_of(env).setup
            episode = run_episode(env, entrant.make(setup), 5, cell.reset_options(setup))
            plain = run_episode(env, entrant.make(setup), 5)
        found[cell.sweep.name] = float(np.abs(episode.output - plain.output).max())
    assert set(found) == {"disturbance", "friction"} and min(found.values()) > 1e-6
    assert setup_of(EASY, {**SUITE.track("robust").options, "sensor_delay": 20}).sensor_delay == 20


def test_the_demonstration_is_a_part_of_the_suite_with_its_anchors():
    demo = load_protocol("demo")
    assert {t.env for t in demo.tasks} < {t.env for t in SUITE.tasks}
    assert set(anchors_of(demo)) == {(t.env, "test") for t in demo.tasks}
    assert anchors_of(demo)[EASY, "test"] == load_anchors("suite-v1")[EASY, "test"]


# what is scored


def made(**changes):
    """Two seconds at 10 Hz, the first half homing, with a priced error that is larger than the error."""
    t = 0.1 * np.arange(1, 21)
    error = np.where(t < 0.95, 5.0, 0.3)
    signals = {"priced_error": error + 0.1, "failure": np.zeros(20), "overload": np.ones(20), **changes}
    return Episode(t, error, 0 * t, 0 * t, 0 * t, 0 * t, signals, False, 0.1, 20, homing=1.0)


def test_the_priced_error_after_the_homing_is_scored():
    found = measure(made())
    assert found["priced_rmse"] == pytest.approx(0.4) == scored_error(found) and found["rmse"] > 3.0
    anchor = {(EASY, "test"): Anchor(EASY, "test", 4.0, 0.04, "m", "x", "y", 1, 0, "", "")}
    record = {"env_id": EASY, "track": "test", "metrics": found}
    assert score_records([record], SUITE, anchor) == [pytest.approx(math.log(10) / math.log(100))]


def test_a_rule_of_the_task_that_ends_the_episode_is_a_failure_and_nothing_else_is_a_rule_there():
    assert broken(measure(made()), 4.0) == ()  # overload in every step, yet the task did not end it
    ended = measure(replace(made(failure=np.r_[np.zeros(19), 2.0]), horizon=30))
    assert broken(ended, 4.0) == ("ended",)
    assert broken({**measure(made()), "rmse": 41.0}, 4.0) == ("runaway",)
    record = {"env_id": EASY, "track": "test", "metrics": ended}
    anchor = {(EASY, "test"): Anchor(EASY, "test", 4.0, 0.04, "m", "x", "y", 1, 0, "", "")}
    assert score_records([record], SUITE, anchor) == [-1.0]


def test_other_tasks_have_no_priced_error():
    episode = replace(made(), signals={})
    assert math.isnan(priced_rmse(episode)) and math.isnan(ended_by_rule(episode))
    assert scored_error(measure(episode)) == measure(episode)["rmse"]


HABITS = {
    "saturating": lambda k, u: math.copysign(1.0, math.sin(0.2 * k)),
    "dithering at 23 Hz": lambda k, u: u + 0.06 * math.sin(2 * math.pi * 23.0 * 0.01 * k),
    "cycling at 5 Hz": lambda k, u: u + 0.25 * math.sin(2 * math.pi * 5.0 * 0.01 * k),
}


class Habit:
    """A controller with a habit on top."""

    def __init__(self, actor, habit):
        self.actor, self.habit = actor, habit

    def start(self, env):
        self.actor.start(env)
        self.k = 0

    def act(self, observation, t):
        self.k += 1
        u = float(self.actor.act(observation, t)[0])
        return np.array([np.clip(self.habit(self.k, u), -1.0, 1.0)], np.float32)


def test_bad_habits_cost_score_on_the_rigs_of_the_test():
    """Of one controller, with and without; the scores are those of the shipped anchors."""
    entrant, anchors = controller_entrant("pid"), anchors_of(SUITE, (SUITE.task(EASY),))
    (cell,) = SUITE.cells((EASY,), ("test",))
    with gym.make(EASY, **entrant.enters(EASY, {**cell.environment_options(), "duration": 8.0})) as env:
        actor, metrics = entrant.make(core_of(env).setup), {}
        for name, habit in {"none": lambda k, u: u, **HABITS}.items():
            metrics[name] = measure(run_episode(env, Habit(actor, habit), SUITE.tune.seed(0)))
    records = [{"env_id": EASY, "track": "test", "metrics": found} for found in metrics.values()]
    scores = dict(zip(metrics, score_records(records, SUITE, anchors), strict=True))
    assert scores["none"] > 0.3
    assert scores["saturating"] == -1.0
    assert max(scores["dithering at 23 Hz"], scores["cycling at 5 Hz"]) < scores["none"] - 0.2


# boards


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """Made-up records of three tasks of the suite, one of them beside the ranking."""
    path = tmp_path_factory.mktemp("anchors") / "made.yaml"
    tasks = (Task(EASY), Task(HARD), Task(CLASSIC, ranked=False))
    protocol = made_protocol(
        tasks=tasks, tracks=(Track("test"),), score_version=1, anchors=str(path), paper={"CableHole": "mrac-g22"}
    )
    write_anchors(path, [
        Anchor(t.env, "test", 0.004, 0.0002, "m", "open-loop", "oracle", 8, 2000, task_hash(t, protocol.tracks[0]), "")
        for t in tasks
    ], "made up")  # fmt: skip
    records = made_records(protocol)
    for r in records:
        r["metrics"] |= {"priced_rmse": 1.1 * r["metrics"]["rmse"], "ended_by_rule": 0.0}
    return protocol, records


def test_tasks_beside_the_ranking_have_a_table_of_their_own_and_no_part_in_the_overall_score(board):
    protocol, records = board
    found = build_board(protocol, records)
    assert {t.task for t in found.tables} == {"CableHole-Track-Easy", "CableHole-Track-Hard", "CableHole-Sine-Classic"}
    (overall,) = found.overall
    assert overall.tasks == 2 and "CableHole-Sine-Classic" not in overall.rows[0].scores
    others = build_board(protocol, [r for r in records if r["env_id"] != CLASSIC])
    assert [r.score for r in overall.rows] == [r.score for r in others.overall[0].rows]
    text = render_markdown(found)
    assert "beside the ranking, in no table over several tasks: CableHole-Sine-Classic" in text
    assert "priced error [mm]" in text


def test_entrants_do_not_move_each_other(board):
    protocol, records = board
    whole = build_board(protocol, records)
    few = build_board(protocol, [r for r in records if r["entrant"] not in ("oracle", "open-loop", "ppo")])
    for table in (*few.tables, *few.overall):
        same = next(t for t in (*whole.tables, *whole.overall) if (t.task, t.track) == (table.task, table.track))
        for row in table.rows:
            other = next(r for r in same.rows if r.entrant == row.entrant)
            assert (row.score, row.scores, row.worst_tenth) == (other.score, other.scores, other.worst_tenth)


def test_records_stay_those_of_the_protocol_when_a_task_joins_the_ranking(board):
    protocol, records = board
    joined = replace(protocol, tasks=(*protocol.tasks[:2], Task(CLASSIC)))
    assert joined.hash() == protocol.hash() != replace(protocol, tasks=protocol.tasks[:2]).hash()
    assert build_board(joined, records).overall[0].tasks == 3


# the bound


def test_the_bound_is_counted_against_the_same_episodes():
    anchor = Anchor(EASY, "test", 1.0, 0.1, "m", "x", "y", 2, 10, "", "", bounds=(0.1, 0.2))
    record = {"env_id": EASY, "track": "test", "entrant": "a", "sweep": None}
    errors = {10: 0.15, 11: 0.15, 12: 0.01}  # the last has no bound
    records = [{**record, "seed": s, "metrics": {"rmse": e, "failed": 0.0}} for s, e in errors.items()]
    (found,) = held(
        [*records, {**record, "seed": 10, "metrics": {"rmse": 0.01, "failed": 1.0}}], {(EASY, "test"): anchor}
    )
    assert (found.episodes, found.below, found.nearest) == (2, 1, "a") and found.share == pytest.approx(0.75)


def test_the_oracle_sees_everything_and_none_of_the_effects_that_it_is_not_told_of():
    options = {"split": "test"}
    (entrant, *_) = oracles(HARD, options)
    assert entrant.enters(HARD, options) == {**options, **IDEAL, "observe": "full"}
    plain = setup_of(HARD, without_effects(HARD, options)).randomize
    whole = setup_of(HARD, options).randomize
    assert [name for name, _, _ in whole if "." not in name] == [name for name, _, _ in plain]
    assert whole[: len(plain)] == plain  # drawn first: the rigs are the same
    assert len({e.name for e in oracles(HARD, options)}) == 3


def test_who_needs_more_sensors_than_a_level_has_does_not_enter():
    assert controller_entrant("pid").enters("cable_envs/CableHole-Series-Hard-v1", {"split": "test"}) is None
    assert controller_entrant("pid").enters("cable_envs/CableHole-Series-Medium-v1", {"split": "test"}) is not None


def test_the_search_beats_the_oracle_by_commands_that_the_environment_confirms():
    options = {"split": "test", "duration": 5.0}
    (bound,) = upper_bound(EASY, [2000001], options, rounds=2)
    assert bound.rmse < min(bound.starts.values()) and "oracle x 0.25" in bound.starts
    with gym.make(EASY, **options, **IDEAL, observe="full") as env:
        setup, priced = core_of(env).setup, []
        env.reset(seed=2000001)
        for k, u in enumerate(bound.command):
            action = np.array([2.0 * (u - setup.low) / (setup.high - setup.low) - 1.0], np.float32)
            info = env.step(action)[4]
            if k + 1 >= round(setup.task.homing / setup.control_period):
                priced.append(info["priced_error"])
    # actions of an environment are float32: 100 N have steps of 6e-6 N
    assert math.sqrt(np.mean(np.square(priced))) == pytest.approx(bound.rmse, rel=0.02)


def test_a_swept_rig_gets_the_substeps_that_it_needs():
    """Friction in a sheath makes it quicker: with 1.4 times its own a reset was refused for 20 substeps."""
    protocol = load_protocol("suite-v1")
    cells = [
        c for c in protocol.cells(("cable_envs/TendonSheath-Track-Hard-v1",), ("robust",)) if c.sweep.name == "friction"
    ]
    assert ["substeps" in c.environment_options() for c in cells] == [c.level > 1.2 for c in cells]
    last = cells[-1]
    with gym.make(last.task.env, **last.environment_options()) as env:
        env.reset(seed=protocol.test.seed(0), options=last.reset_options(env.unwrapped.setup))
