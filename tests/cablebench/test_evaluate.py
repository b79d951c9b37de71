"""Evaluation on the real environments, with episodes of half a second."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import cablebench.run.evaluation as evaluation
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.board.board import build_board
from cablebench.board.scoring import latest
from cablebench.entrants.entrant import Entrant, agent_entrant, controller_entrant
from cablebench.entrants.named import entering, reference_entrants
from cablebench.jobs.work import Context, Done, perform
from cablebench.protocol.actors import ControllerActor, PolicyActor
from cablebench.protocol.protocol import Protocol, SeedRange, Sweep, Task, Track
from cablebench.run.evaluation import evaluate, run_episode
from cablebench.run.jobs import evaluate_in_jobs
from cablebench.run.store import ResultStore

HOLE = "cable_envs/CableHole-Position-Sine-v0"
CIRCUIT = "cable_envs/PulleyCircuit-Position-Sine-v0"
SHORT = {"duration": 0.5}


def protocol(**changes):
    friction = Sweep("friction", 0.5, 1.5, 3, scale={"CableHole": ("friction_coefficient",)})
    delay = Sweep("delay", 0, 2, 2, option="sensor_delay", integer=True)
    return Protocol(**{
        "name": "short", "title": "Short", "tasks": (Task(HOLE, SHORT), Task(CIRCUIT, SHORT)),
        "tracks": (Track("nominal", {"sensor_noise": True}), Track("randomised", {"randomize": True}),
                   Track("stress", episodes=1, sweeps=(friction, delay))),
        "train": SeedRange(0, 10), "tune": SeedRange(10, 10), "test": SeedRange(20, 10), "episodes": 2,
        "run": ("nominal", "randomised"), "resamples": 50, **changes,
    })  # fmt: skip


class Spy:
    """A controller that holds a command and remembers what it was given."""

    name = "spy"
    information = "nominal"
    levels = {"cable_hole": "full", "pulley_circuit": "drive"}  # noqa: RUF012
    made: list = []  # noqa: RUF012

    @classmethod
    def applies(cls, plant, mode, task):
        return True

    def __init__(self, plant, action_mode, task, rig, dt, **gains):
        self.rig, self.dt, self.true, self.seen, self.gains = dict(rig), dt, [], [], gains
        self.command = {"tension": 60.0, "position": 0.1}[action_mode]
        Spy.made.append(self)

    def set_rig(self, rig):
        self.true.append(dict(rig))

    def reset(self):
        self.seen.append([])

    def act(self, t, y, ref):
        self.seen[-1].append((t, dict(y), ref))
        return self.command


@pytest.fixture
def spies():
    Spy.made = []
    yield Spy.made
    Spy.made = []


class Policy:
    """A recurrent stand-in for a trained policy: the state counts its steps, the action repeats one number."""

    def __init__(self, value=0.0):
        self.value, self.calls = value, []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        count = 0 if state is None else state
        self.calls.append((observation.copy(), count, bool(episode_start[0]), deterministic))
        return np.array([self.value], dtype=np.float32), count + 1


def agent(policy, env=HOLE, seed=0, **more):
    return agent_entrant("held", policy, env, training_seed=seed, environment_steps=1000, **more)


def make(env_id, **options):
    return gym.make(env_id, disable_env_checker=True, **SHORT, **options)


def numbers(records):
    """Everything that must repeat: all metrics but the time the policy took."""
    return [{k: v for k, v in r["metrics"].items() if k != "inference_us"} for r in records]


def test_an_episode_is_recorded_from_the_first_step_to_the_last():
    env = make(HOLE)
    e = run_episode(env, PolicyActor(Policy(0.1)), seed=3)
    assert len(e.time) == e.horizon == 50 and e.complete
    np.testing.assert_allclose(e.time, 0.01 * np.arange(1, 51), rtol=1e-12)
    assert (e.output_unit, e.command_unit, e.step_time) == ("m", "N", None)
    # the action mode's range is 0 .. 120 N: 0.1 means 66 N; the action is float32
    np.testing.assert_allclose(e.command, 66.0, rtol=1e-6)
    np.testing.assert_allclose(e.error, e.reference - e.output)
    assert {"drive_tension", "slack_fraction", "overload", "peak_tension"} <= set(e.signals)
    assert e.settings["seed"] == 3 and e.settings["env_id"] == HOLE


def test_the_step_time_comes_from_the_reference():
    step = make("cable_envs/CableHole-Position-Step-v0", reference={"kind": "step", "start": 0.2, "amplitude": 0.001})
    assert run_episode(step, PolicyActor(Policy()), 0).step_time == 0.2
    other = {"reference": {"kind": "step", "start": 0.1, "amplitude": 0.001}}
    assert run_episode(step, PolicyActor(Policy()), 0, options=other).step_time == 0.1


def test_a_controller_gets_si_measurements_and_answers_in_si():
    env = make(HOLE, observe="full")
    setup = env.unwrapped.setup
    spy = Spy("cable_hole", "tension", "position", setup.rig.values, 0.01)
    e = run_episode(env, ControllerActor(spy, setup), seed=0)
    np.testing.assert_allclose(e.command, 60.0, rtol=1e-6)
    t, y, ref = spy.seen[0][1]
    assert t == pytest.approx(0.01)
    # without noise it sees the signals of the step before, to the precision of the float32 observation
    for name in ("drive_tension", "load_position", "drive_position"):
        assert y[name] == pytest.approx(e.signals[name][0] if name in e.signals else e.output[0], rel=1e-6, abs=1e-12)
    assert ref[0] == pytest.approx(e.reference[0], rel=1e-6) and len(ref) == 3


def test_controller_and_agent_see_the_same_noise():
    env = make(HOLE, observe="full", sensor_noise=True)
    setup = env.unwrapped.setup
    spy, policy = Spy("cable_hole", "tension", "position", setup.rig.values, 0.01), Policy(0.0)
    run_episode(env, ControllerActor(spy, setup), seed=7)
    run_episode(env, PolicyActor(policy), seed=7)
    scale = {c.name: (k, c.scale) for k, c in enumerate(setup.channels)}
    k, s = scale["drive_tension"]
    # both commands are 60 N, so the whole episodes are the same
    agents = [obs[k] * s for obs, *_ in policy.calls]
    np.testing.assert_allclose([y["drive_tension"] for _, y, _ in spy.seen[0]], agents, rtol=1e-6)
    quiet = make(HOLE, observe="full")
    clean = Spy("cable_hole", "tension", "position", setup.rig.values, 0.01)
    run_episode(quiet, ControllerActor(clean, quiet.unwrapped.setup), seed=7)
    assert clean.seen[0][5][1]["drive_tension"] != spy.seen[0][5][1]["drive_tension"]


def test_a_recurrent_policy_keeps_its_state_within_an_episode_only():
    env, policy = make(HOLE), Policy()
    actor = PolicyActor(policy)
    run_episode(env, actor, 0)
    run_episode(env, actor, 1)
    assert [c[1] for c in policy.calls] == [*range(50), *range(50)]
    assert [c[2] for c in policy.calls] == ([True] + [False] * 49) * 2
    assert all(c[3] for c in policy.calls)  # deterministic


def test_an_answer_that_is_not_finite_fails_the_episode():
    class Late(Policy):
        def predict(self, *args, **kwargs):
            action, state = super().predict(*args, **kwargs)
            return (action if state < 10 else action * np.nan), state

    e = run_episode(make(HOLE), PolicyActor(Late()), 0)
    assert e.terminated and not e.complete and len(e.time) == 10
    first = run_episode(make(HOLE), PolicyActor(Policy(np.nan)), 0)
    assert first.terminated and len(first.time) == 1


def test_every_entrant_sees_the_same_episodes_and_only_true_rigs_differ(spies):
    two = controller_entrant(Spy), controller_entrant(Spy, gains={"a": 1.0})
    evaluate(protocol(), two, tasks=[HOLE], tracks=["randomised"])
    first, second = spies
    assert first.true == second.true and len(first.true) == 2
    assert first.true[0]["friction_coefficient"] != first.true[1]["friction_coefficient"]
    # the model that a controller is made with stays the nominal one
    nominal = setup_of(HOLE, {}).rig.values
    assert first.rig == dict(nominal) and first.true[0] != first.rig


def test_the_same_evaluation_gives_the_same_numbers():
    entrants = reference_entrants(["open-loop", "pid"])
    one, two = (evaluate(protocol(), entrants, tasks=[HOLE]) for _ in range(2))
    assert numbers(one) == numbers(two)
    assert [r["run"] for r in one] == [r["run"] for r in two]
    # sensor noise and drawn rigs make the episodes of a run differ
    assert one[2]["metrics"]["rmse"] != one[3]["metrics"]["rmse"]


def test_every_reference_enters_where_it_applies_and_the_board_scores_it(tmp_path):
    store, reports = ResultStore(tmp_path / "r.jsonl"), []
    plan = protocol()
    records = evaluate(
        plan, entering(reference_entrants(), plan), tracks=["nominal"], store=store, progress=reports.append
    )
    assert store.records() and len(store.records()) == len(records)
    assert [p.done for p in reports] == [*range(len(records)), len(records)]
    entered = {r["entrant"] for r in records if r["env_id"] == HOLE}
    assert {"open-loop", "pid", "mrac-g22", "oracle"} <= entered
    for r in records:
        assert r["seed"] in plan.test and r["training_seed"] is None
        assert r["versions"]["source"] and r["machine"]
        assert r["replay"].startswith(f"cablebench evaluate --protocol short --env {r['env_id']} --track nominal")
    board = build_board(plan, store.records())
    rows = {r.entrant: r for r in board.table(HOLE, "nominal").rows}
    assert rows["open-loop"].score.value == 0.0 and rows["oracle"].score.value == pytest.approx(1.0)
    kept = store.trajectories.of(rows["pid"].trajectory)
    assert set(kept) == {"median", "worst"} and len(kept["worst"]["time"]) == 50


def test_a_sweep_changes_the_rig_and_not_the_controllers_model(spies):
    records = evaluate(protocol(), [controller_entrant(Spy)], tasks=[HOLE], tracks=["stress"])
    nominal = setup_of(HOLE, {}).rig.values["friction_coefficient"]
    friction = list(spies[:3])
    assert [s.true[0]["friction_coefficient"] for s in friction] == pytest.approx(
        [0.5 * nominal, nominal, 1.5 * nominal]
    )
    assert all(s.rig["friction_coefficient"] == nominal for s in friction)
    assert [(r["sweep"], r["sweep_value"]) for r in records] == [
        ("friction", 0.5), ("friction", 1.0), ("friction", 1.5), ("delay", 0.0), ("delay", 2.0)
    ]  # fmt: skip
    assert records[-1]["options"]["sensor_delay"] == 2
    # delayed by two steps: what is seen at step 12 is what was seen without delay at step 10
    fresh, late = spies[3].seen[0], spies[4].seen[0]
    assert late[12][1]["drive_position"] == fresh[10][1]["drive_position"] != fresh[12][1]["drive_position"]


def test_one_environment_serves_all_entrants_with_the_same_options(monkeypatch):
    made = []
    real = gym.make
    monkeypatch.setattr(evaluation.gym, "make", lambda env_id, **kw: made.append((env_id, kw)) or real(env_id, **kw))
    evaluate(protocol(), reference_entrants(["mrac-g22", "mrac-g9"]), tasks=[HOLE], tracks=["nominal"])
    assert len(made) == 1
    evaluate(protocol(), [agent(Policy()), agent(Policy(), seed=1)], tasks=[HOLE], tracks=["nominal"])
    assert len(made) == 2


def test_an_evaluation_that_was_stopped_resumes_and_counts_nothing_twice(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    entrants = reference_entrants(["open-loop", "pid"])

    def stop(p):
        if p.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(protocol(), entrants, tasks=[HOLE], store=store, progress=stop)
    assert len(store.records()) == 3
    rest = evaluate(protocol(), entrants, tasks=[HOLE], store=store, resume=True)
    whole = evaluate(protocol(), entrants, tasks=[HOLE])
    # the first run was whole; the second had one of its two episodes and is run anew
    assert len(rest) == len(whole) - 2 and len(store.records()) == len(whole) + 1
    counted = latest(store.records())
    assert sorted(map(str, numbers(counted))) == sorted(map(str, numbers(whole)))
    assert all(store.trajectories.of(r["run"]) for r in counted)
    assert evaluate(protocol(), entrants, tasks=[HOLE], store=store, resume=True) == []


def test_an_agent_enters_its_own_environment_only_and_is_charged(tmp_path):
    trained = agent(Policy(), options={"observe": "drive"}, tuning_trials=7, path="runs/my ppo.zip")
    records = evaluate(protocol(), [trained], tracks=["nominal"])
    assert {r["env_id"] for r in records} == {HOLE}
    r = records[0]
    assert r["charged"] == {"environment_steps": 1000, "tuning_trials": 7} and r["training_seed"] == 0
    assert r["options"] == {"duration": 0.5, "sensor_noise": True, "observe": "drive"}
    assert "'runs/my ppo.zip'" in r["replay"]


def test_gains_decide_the_run_and_stand_in_the_replay_command():
    tuned = controller_entrant("pid", gains={"kp": 0.123456789012345678}, envs=(HOLE,))
    assert float(tuned.arguments.split("--gain kp=")[1]) == 0.123456789012345678
    plan = protocol()
    cell = plan.cells()[0]
    keys = {evaluation.run_key(plan, cell, e, {}) for e in (tuned, controller_entrant("pid"))}
    assert len(keys) == 2


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'mrac-g22'"):
        controller_entrant("mrac-g2")
    with pytest.raises(ConfigurationError, match="did you mean 'nominal'"):
        evaluate(protocol(), reference_entrants(["pid"]), tracks=["nominl"])
    with pytest.raises(ConfigurationError, match="enters none of the chosen tasks"):
        evaluate(protocol(), [agent(Policy())], tasks=[CIRCUIT])
    with pytest.raises(ConfigurationError, match="did you mean 'cable_envs/CableHole-Position-Sine-v0'"):
        setup_of("cable_envs/CableHole-Position-Sin-v0", {})
    with pytest.raises(ConfigurationError, match="did you mean 'nominal'"):
        Entrant("x", "nominl", make=lambda s: PolicyActor(Policy()), needs=lambda e, s: {}, arguments="")


class Killed(Exception):
    """Stands for the end of the process at this point."""


class DyingStore(ResultStore):
    """A store whose process ends before its n-th write."""

    def __init__(self, path, writes):
        super().__init__(path)
        self.writes = writes
        keep = self.trajectories.keep
        self.trajectories.keep = lambda run, episodes: (self._write(), keep(run, episodes))[1]

    def _write(self):
        if self.writes == 0:
            raise Killed
        self.writes -= 1

    def append(self, records):
        self._write()
        super().append(records)


class Here:
    """A backend that runs its jobs in this process."""

    def run(self, jobs, progress):
        for job in jobs:
            yield Done(job, *perform(job, Context(lambda *_: None, {})))


@pytest.mark.parametrize("jobs", [False, True], ids=["serial", "jobs"])
def test_whoever_is_killed_a_whole_run_has_its_trajectories(tmp_path, jobs):
    """The record that makes a run whole is written last: a resumed evaluation leaves nothing out that is missing."""

    def run(store, resume=False):
        if jobs:
            return evaluate_in_jobs(
                protocol(), [partial(controller_entrant, "pid")], Here(), [HOLE], ["nominal"], store, resume=resume
            )
        return evaluate(protocol(), [controller_entrant("pid")], [HOLE], ["nominal"], store, resume=resume)

    for writes in range(4):
        store = DyingStore(tmp_path / f"{writes}.jsonl", writes)
        try:
            run(store)
        except Killed:
            pass
        else:
            break
        again = ResultStore(store.path)
        run(again, resume=True)
        records = latest(again.records())
        assert len(records) == 2 and set(again.trajectories.of(records[0]["run"])) == {"median", "worst"}, writes
    assert writes == (2 if jobs else 3)  # every place to be killed at was tried
