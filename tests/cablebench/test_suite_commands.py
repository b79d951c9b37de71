"""Suites with frozen anchors on the command line: make the anchors, try an entrant, run all, replay a row."""

import json

import pytest
import yaml

HOLE = "CableHole-Position-Sine"


@pytest.fixture
def protocol(tmp_path):
    """One short task on two tracks, one of them with a sweep of two values."""
    path = tmp_path / "tiny.yaml"
    path.write_text(yaml.safe_dump({
        "schema": 1, "name": "tiny", "tasks": [{"env": f"cable_envs/{HOLE}-v0", "options": {"duration": 3.0}}],
        "tracks": {
            "nominal": {"options": {"sensor_noise": True}},
            "robust": {"episodes": 1, "sweeps": {
                "disturbance": {"from": 0, "to": 40, "points": 2, "disturb": {"CableHole": 1.0}},
            }},
        },
        "seeds": {k: {"first": 1000 * i, "count": 1000} for i, k in enumerate(("train", "tune", "test"))},
        "episodes": 3, "training_seeds": 1, "bootstrap": {"resamples": 50},
        "score": {"version": 1, "anchors": str(tmp_path / "anchors.yaml"), "paper": {"CableHole": "mrac-g22"}},
    }))  # fmt: skip
    return path


@pytest.fixture
def frozen(cli, protocol):
    code, out, err = cli("anchors", "--protocol", protocol, "--episodes", "2", "--rounds", "0")
    assert code == 0, err
    assert out.count("open loop 0.00696 m, bound 2.") == 2 and "(oracle 2)" in out and "upper-bound" not in out
    return protocol


def test_anchors_are_made_once_and_again_only_when_asked(cli, frozen):
    path = frozen.with_name("anchors.yaml")
    before = path.read_bytes()
    made = yaml.safe_load(before)["anchors"]
    assert [(a["track"], a["episodes"], a["first_seed"]) for a in made] == [("nominal", 2, 2000), ("robust", 2, 2000)]
    code, out, _ = cli("anchors", "--protocol", frozen, "--episodes", "3")
    assert code == 0 and "has all 2 anchors" in out and path.read_bytes() == before
    changed = yaml.safe_load(frozen.read_text())
    changed["tasks"][0]["options"]["duration"] = 2.0
    frozen.write_text(yaml.safe_dump(changed))
    code, _, err = cli("anchors", "--protocol", frozen)
    assert code == 2 and "has changed since its anchors were frozen" in err and path.read_bytes() == before
    code, _, err = cli("try", "pid", "--task", HOLE, "--protocol", frozen)
    assert code == 2 and "another version of the task" in err
    assert cli("anchors", "--protocol", frozen, "--replace", "--episodes", "1", "--rounds", "1")[0] == 0
    assert path.read_bytes() != before


def test_try_scores_between_the_anchors_and_says_si_values_and_violations(cli, frozen):
    arguments = ("--task", HOLE, "--protocol", frozen, "--episodes", "2", "--track", "nominal", "--track", "robust")
    code, out, err = cli("try", "pid", *arguments, "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["entrant"] == "pid" and found["units"]["rmse"] == "m"
    nominal, robust = found["tracks"]["nominal"], found["tracks"]["robust"]
    assert nominal["episodes"] == 2 and 0.0 < nominal["score"] < 1.0 and nominal["survived"] is None
    assert nominal["metrics"]["rmse"] < found["anchors"]["nominal"]["open_loop"]
    assert robust["episodes"] == 2 and 0.0 <= robust["survived"] <= 1.0
    code, out, _ = cli("try", "open-loop", *arguments)
    assert code == 0 and "error of the bound (anchor)" in out and "command travel" in out and "µs" in out


LIMP = """
from cable_envs.baselines.base import Controller


class Limp(Controller):
    name = "limp"
    information = "model-free"
    plants = ("cable_hole",)
    tasks = ("position",)
    gain_tables = {}

    def reset(self):
        pass

    def act(self, t, y, ref):
        return 0.0
"""


def test_try_reports_a_dropped_load_as_a_failure(cli, frozen, tmp_path):
    (tmp_path / "limp.py").write_text(LIMP)
    arguments = ("--task", HOLE, "--protocol", frozen, "--episodes", "2", "--track", "nominal", "--trust")
    code, out, err = cli("try", tmp_path / "limp.py", *arguments, "--json")
    assert code == 0, err
    found = json.loads(out)["tracks"]["nominal"]
    assert found["score"] == found["lowest"] == -1.0 and found["failed"] == 2
    assert found["violations"]["dropped"] == found["violations"]["runaway"] == 2
    assert "dropped" in cli("try", tmp_path / "limp.py", *arguments)[1]


def test_try_stops_in_time(cli, frozen):
    code, out, _ = cli("try", "pid", "--task", HOLE, "--protocol", frozen, "--seconds", "0", "--json")
    assert code == 0 and json.loads(out)["tracks"]["nominal"]["episodes"] == 1


def test_try_refuses_what_it_cannot_score(cli, frozen):
    code, _, err = cli("try", "pid", "--task", HOLE, "--protocol", "quick")
    assert code == 2 and "no frozen anchors" in err
    code, _, err = cli("try", "pid", "--task", "CableHole-Position-Sin", "--protocol", frozen)
    assert code == 2 and HOLE in err
    code, _, err = cli("try", "pidd", "--task", HOLE, "--protocol", frozen)
    assert code == 2 and "pid" in err
    code, _, err = cli("anchors", "--protocol", "quick")
    assert code == 2 and "needs no anchors" in err


def test_all_tasks_are_run_ranked_and_replayed_without_open_loop_and_oracle(cli, frozen, tmp_path):
    results = tmp_path / "results"
    run = ("evaluate", "--protocol", frozen, "--controller", "pid", "--results", results)
    code, _, err = cli(*run)
    assert code == 0, err
    code, out, _ = cli("leaderboard", "--results", results, "--protocol", frozen, "--json")
    row = json.loads(out)["tables"][0]["rows"][0]
    assert code == 0 and row["score"]["unit"] == "rigs" and row["robustness"] in (0.5, 1.0)
    arguments = ("--results", results, "--protocol", frozen, "--entrant", "pid", "--env", HOLE)
    code, out, err = cli("replay", *arguments, "--track", "nominal")
    assert code == 0 and "every metric is the same to the last digit" in out, err
    code, out, err = cli("anchors", "--protocol", frozen, "--check", results)
    assert code == 0 and "the bound is a bound in 100.00 % of 2 episodes (0 below it)" in out, err
    assert cli(*run)[0] == 0  # the same episodes again: the newest of each counts
    code, out, err = cli("anchors", "--protocol", frozen, "--check", results)
    assert code == 0 and "the bound is a bound in 100.00 % of 2 episodes (0 below it)" in out, err
    code, _, err = cli("anchors", "--protocol", frozen, "--check", tmp_path / "nothing")
    assert code == 2 and "no records of 'tiny'" in err
    code, _, err = cli("anchors", "--protocol", frozen, "--track", "nominl")
    assert code == 2 and "nominal" in err
