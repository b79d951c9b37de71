"""A real Ray cluster of two nodes on this machine: the numbers of local workers, nothing lost or counted twice."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.training import RUN, training_job
from cablebench.jobs import Job, JobError
from cablebench.jobs.driver import CrewBackend
from cablebench.run.evaluation import evaluate
from cablebench.run.jobs import evaluate_in_jobs
from cablebench.run.store import ResultStore
from tests.cablebench.test_jobs import HOLE, RECIPES, numbers, protocol
from tests.support import jobs_support as support

ray = pytest.importorskip("ray", reason="the cluster's tests need Ray: pip install 'cable-envs[ray]'")
pytestmark = [pytest.mark.ray, pytest.mark.slow, pytest.mark.xdist_group("ray")]

SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "disabled",
    "PYTHONPATH": str(Path(__file__).parents[2]),
}


@pytest.fixture(scope="module")
def address():
    """A head and a second node with one core each."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        cluster = Cluster()
        _add_node(cluster, include_dashboard=False)
        _add_node(cluster)
        yield cluster.address
        ray.shutdown()
        cluster.shutdown()


def _add_node(cluster, **options):
    """A node has 30 s to come up, which Ray does not let one change; on a busy machine the first try may fail."""
    for left in (2, 1, 0):
        try:
            return cluster.add_node(num_cpus=1, object_store_memory=100_000_000, **options)
        except Exception as error:
            if not left or "timed out during startup" not in str(error):
                raise
    return None


@pytest.fixture
def backend(address):
    from cablebench.jobs.ray_cluster import RayCrew

    with CrewBackend(RayCrew(address=address, upload_every=0.5)) as made:
        assert len(ray.nodes()) == 2 and ray.cluster_resources()["CPU"] == 2.0
        yield made


def by_key(runs):
    return {done.job.key: done for done in runs}


def test_jobs_end_once_and_killed_ones_go_on_from_what_the_caller_was_sent(backend, tmp_path):
    """Workers have temporary folders of their own, so what a second attempt finds has been to the caller and back."""
    jobs = [
        Job(str(n), support.count, {"to": 6, "die_at": 4 if n == 1 else 0, "wait": 2.0}, {RUN: tmp_path / str(n)})
        for n in range(4)
    ]
    jobs += [Job("refused", support.fail, {"kind": "configuration"}), Job("bad", support.always_dies)]
    heard = []
    done = by_key(backend.run(jobs, heard.append))
    assert len(done) == len(jobs)
    assert done["1"].value() == {"first": 4, "last": 6, "attempt": 2} and done["1"].attempts == 2
    for n in (0, 2, 3):
        assert done[str(n)].value() == {"first": 0, "last": 6, "attempt": 1}
        assert (tmp_path / str(n) / "count").read_text() == "6"
    with pytest.raises(ConfigurationError, match=r"^no such gain$"):
        done["refused"].value()
    with pytest.raises(JobError, match="'bad': its worker died 4 times"):
        done["bad"].value()
    assert {p.key for p in heard} == {"0", "1", "2", "3"}


def test_an_evaluation_on_two_nodes_has_the_serial_records(backend, tmp_path):
    serial = evaluate(protocol(), [recipe() for recipe in RECIPES])
    store = ResultStore(tmp_path / "r.jsonl")
    assert numbers(evaluate_in_jobs(protocol(), RECIPES, backend, store=store)) == numbers(serial)
    assert sorted((r["run"], r["seed"]) for r in store.records()) == sorted((r["run"], r["seed"]) for r in serial)


def test_trainings_on_two_nodes_end_as_here_even_where_a_worker_is_killed(backend, tmp_path):
    from cable_envs.agents.policy import load_policy
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train

    settings = load_settings("ppo", HOLE, 4 * 8192, {"duration": 0.5})
    jobs = [
        replace(
            training_job(settings, 3, tmp_path / "killed", checkpoint_every=0.0),
            key="killed", function=support.killed_training,
        ),
        training_job(settings, 4, tmp_path / "other"),
    ]  # fmt: skip
    jobs[0] = replace(jobs[0], arguments={**jobs[0].arguments, "wait": 2.0})
    done = by_key(backend.run(jobs))
    # which checkpoint had reached the caller when the worker was killed depends on the machine's load
    assert done["killed"].attempts == 2 and int((tmp_path / "killed" / "resumed").read_text()) in (8192, 16384, 24576)
    for seed, name in ((3, "killed"), (4, "other")):
        here = train(settings, seed, tmp_path / f"here-{seed}")
        there = load_policy(tmp_path / name)
        assert there.metadata.complete and there.steps == here.steps
        expected, found = here.network.state_dict(), there.network.state_dict()
        assert all((expected[key] == found[key]).all() for key in expected)


def test_ctrl_c_brings_home_what_running_jobs_kept(backend):
    ended, heard = [], set()

    def press(p):
        heard.add(p.key)
        if heard == {"0", "1"}:
            os.kill(os.getpid(), signal.SIGINT)
            heard.add("pressed")

    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        for done in backend.run([Job(str(n), support.patient) for n in range(3)], press):
            ended.append(done)  # noqa: PERF402 - what had ended stays where the loop is interrupted
    assert sorted(d.job.key for d in ended) == ["0", "1"]
    assert all(d.stopped and d.result["kept"] > 0 for d in ended)
