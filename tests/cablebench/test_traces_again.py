"""`cablebench leaderboard --traces`: traces of rows whose episodes are simulated again."""

import json
import shutil

import numpy as np
import pytest
import yaml

from cable_envs.core.config import config_path
from cablebench.run.folders import open_store

TASK = "CableHole-Hold-Easy"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the records of two controllers on a task of the suite, and its protocol."""
    from cablebench.cli import main

    folder = tmp_path_factory.mktemp("again")
    plan = yaml.safe_load(config_path("protocols", "demo.yaml").read_text())
    plan |= {"name": "three", "tasks": [f"cable_envs/{TASK}-v1"], "episodes": 3}
    (folder / "three.yaml").write_text(yaml.safe_dump(plan))
    words = ["evaluate", "--protocol", str(folder / "three.yaml"), "--results", str(folder / "results")]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--controller", "scheduled-pid-suite", "--controller", "pid-suite"])
    assert not ended.value.code
    return folder


@pytest.fixture
def board(made, tmp_path):
    return shutil.copytree(made, tmp_path / "board")


def traced(board, cli):
    words = ("leaderboard", "--results", board / "results", "--protocol", board / "three.yaml")
    code, _, error = cli(*words, "--traces")
    assert code == 0, error
    return error


def test_median_and_worst_episode_are_those_that_the_evaluation_kept(board, cli):
    store = open_store(board / "results")
    runs = {r["run"]: store.trajectories.of(r["run"]) for r in store.read().records}
    assert len(runs) == 2 and all(set(found) == {"median", "worst"} for found in runs.values())
    store.trajectories.forget(())
    assert "traces of 2 runs: 2 kept" in traced(board, cli)
    for run, before in runs.items():
        again = open_store(board / "results").trajectories.of(run)
        for kind, arrays in before.items():
            for name, values in arrays.items():
                np.testing.assert_array_equal(again[kind][name], values)
    assert 'id="viewer"' in (board / "results" / "tasks" / f"{TASK}.html").read_text()
    assert "traces of 0 runs: 0 kept" in traced(board, cli)


def test_an_episode_that_comes_out_otherwise_has_no_trace(board, cli):
    store = open_store(board / "results")
    store.trajectories.forget(())
    lines = [json.loads(line) for line in store.path.read_text().splitlines()]
    for record in lines:
        if record["entrant"] == "scheduled-pid-suite":
            record["metrics"]["rmse"] *= 1.0 + 1e-12
    store.path.write_text("".join(json.dumps(record) + "\n" for record in lines))
    assert "traces of 2 runs: 1 kept, 1 not as recorded" in traced(board, cli)


def test_a_policy_that_is_gone_is_counted(board, cli):
    store = open_store(board / "results")
    store.trajectories.forget(())
    text = store.path.read_text().replace("--controller pid-suite", "--policy gone/policy.zip")
    store.path.write_text(text)
    assert "1 without a policy" in traced(board, cli)
