"""Jobs on local processes: every job ends once, whatever happens to its worker; Ctrl-C keeps work."""

import itertools
import os
import signal
from dataclasses import replace
from functools import partial

import pytest

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.entrant import controller_entrant
from cablebench.jobs import Job, JobError, open_backend
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import evaluate
from cablebench.run.jobs import evaluate_in_jobs
from cablebench.run.store import ResultStore
from tests.support import jobs_support as support

HOLE = "cable_envs/CableHole-Position-Sine-v0"
CIRCUIT = "cable_envs/PulleyCircuit-Position-Sine-v0"
RECIPES = tuple(partial(controller_entrant, name) for name in ("open-loop", "pid", "mrac-g22"))


def protocol():
    short = {"duration": 0.3}
    return Protocol(
        name="short", title="Short", tasks=(Task(HOLE, short), Task(CIRCUIT, short)),
        tracks=(Track("nominal", {"sensor_noise": True}), Track("randomised", {"randomize": True})),
        train=SeedRange(0, 10), tune=SeedRange(10, 10), test=SeedRange(20, 10), episodes=2,
    )  # fmt: skip


def run(jobs, workers=2, progress=None):
    with open_backend("local", workers) as backend:
        return {done.job.key: done for done in backend.run(jobs, progress)}


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_ends_once_with_its_result_or_its_error(workers):
    jobs = [Job(str(n), support.double, {"number": n}) for n in range(5)]
    jobs += [Job(kind, support.fail, {"kind": kind}) for kind in ("configuration", "defect")]
    heard = []
    done = run(jobs, workers, heard.append)
    assert [done[str(n)].value() for n in range(5)] == [0, 2, 4, 6, 8]
    with pytest.raises(ConfigurationError, match=r"^no such gain$"):
        done["configuration"].value()
    with pytest.raises(RuntimeError, match="it broke"):
        done["defect"].value()
    assert len(done) == len(jobs)
    assert sorted((p.key, p.text) for p in heard) == [(str(n), f"doubling {n}") for n in range(5)]


def test_workers_are_other_processes_with_one_thread():
    done = run([Job("a", support.environment), Job("b", support.unpicklable)])
    omp, numba, process = done["a"].value()
    assert (omp, numba) == ("1", "1") and process != os.getpid()
    with pytest.raises(JobError, match=r"[Pp]ickl"):
        done["b"].value()


def test_a_killed_workers_job_goes_on_from_what_it_kept(tmp_path):
    jobs = [
        Job(str(n), support.count, {"to": 6, "die_at": 4 if n == 1 else 0}, {support.RUN: tmp_path / str(n)})
        for n in range(4)
    ]
    done = run(jobs)
    assert done["1"].value() == {"first": 4, "last": 6, "attempt": 2} and done["1"].attempts == 2
    for n in (0, 2, 3):
        assert done[str(n)].value() == {"first": 0, "last": 6, "attempt": 1}


def test_a_job_that_kills_every_worker_is_given_up_and_says_how():
    done = run([Job("bad", support.always_dies), Job("good", support.double, {"number": 4})])
    with pytest.raises(JobError, match=r"'bad': its worker died 4 times, at last: killed by signal 9 \(SIGKILL\)"):
        done["bad"].value()
    assert done["good"].value() == 8


def test_ctrl_c_stops_running_jobs_keeps_their_work_and_starts_no_more():
    heard, ended = [], []

    def press(p):
        heard.append(p.key)
        if set(heard) == {"0", "1"}:
            os.kill(os.getpid(), signal.SIGINT)
            heard.append("pressed")

    before = signal.getsignal(signal.SIGINT)
    with open_backend("local", 2) as backend, pytest.raises(KeyboardInterrupt):  # noqa: PT012
        for done in backend.run([Job(str(n), support.patient) for n in range(4)], press):
            ended.append(done)  # noqa: PERF402 - what had ended stays where the loop is interrupted
    assert sorted(d.job.key for d in ended) == ["0", "1"]
    assert all(d.stopped and d.result["kept"] > 0 for d in ended)
    assert signal.getsignal(signal.SIGINT) is before


def test_wrong_use_is_refused():
    twice = [Job("a", support.double, {"number": 1})] * 2
    with pytest.raises(ValueError, match="the same key"):
        run(twice)
    with pytest.raises(ConfigurationError, match="did you mean 'local'"):
        open_backend("lokal")
    with pytest.raises(ConfigurationError, match="needs --backend ray"):
        open_backend("local", address="10.0.0.1:6379")


def numbers(records):
    """Everything that must be the same wherever an episode is run."""
    return [
        {**r, "created": "", "metrics": {k: v for k, v in r["metrics"].items() if k != "inference_us"}} for r in records
    ]


def test_an_evaluation_in_jobs_has_the_serial_records(tmp_path):
    serial = evaluate(protocol(), [recipe() for recipe in RECIPES])
    store, heard = ResultStore(tmp_path / "r.jsonl"), []
    with open_backend("local", 2) as backend:
        parallel = evaluate_in_jobs(protocol(), RECIPES, backend, store=store, progress=heard.append)
        assert numbers(parallel) == numbers(serial)
        stored = {(r["run"], r["seed"]): r["metrics"]["rmse"] for r in store.records()}
        assert stored == {(r["run"], r["seed"]): r["metrics"]["rmse"] for r in serial}
        assert all(store.trajectories.of(r["run"]) for r in serial)
        assert (heard[-1].done, heard[-1].total) == (len(serial), len(serial))
        assert all(a.done <= b.done for a, b in itertools.pairwise(heard))
        assert evaluate_in_jobs(protocol(), RECIPES, backend, store=store, resume=True) == []
    assert len(store.records()) == len(serial)


@pytest.mark.slow
def test_a_training_whose_worker_is_killed_ends_as_one_that_was_not(tmp_path):
    from cable_envs.agents.policy import load_policy
    from cable_envs.agents.settings import load_settings
    from cablebench.cli.shared.training import training_job

    settings = load_settings("ppo", HOLE, 4 * 8192, {"duration": 0.5})
    jobs = [
        training_job(settings, 3, tmp_path / "whole", checkpoint_every=0.0),
        replace(
            training_job(settings, 3, tmp_path / "killed", checkpoint_every=0.0),
            key="killed", function=support.killed_training,
        ),
    ]  # fmt: skip
    done = run(jobs)
    # it goes on after the first rollout; that rollout's own report has been made
    assert done["killed"].attempts == 2 and int((tmp_path / "killed" / "resumed").read_text()) == 16384
    whole, killed = done[jobs[0].key].value(), done["killed"].value()
    assert whole["steps"] == killed["steps"] == 4 * 8192 and killed["complete"]
    assert [point[::2] for point in whole["curve"]] == [point[::2] for point in killed["curve"]]
    weights = [load_policy(tmp_path / name).network.state_dict() for name in ("whole", "killed")]
    assert weights[0].keys() == weights[1].keys()
    assert all((weights[0][key] == weights[1][key]).all() for key in weights[0])
