"""Tuning: search spaces, studies that resume and repeat, and the command for controllers and agents."""

import json
from dataclasses import replace

import pytest
import yaml

from cable_envs.baselines import CONTROLLERS
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter, ParameterTable
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.jobs import Job, open_backend
from cablebench.protocol.files import load_protocol
from cablebench.tune.objective import training_seed, tuning_cells, tuning_seeds
from cablebench.tune.space import gain_space, nested, parse_space
from cablebench.tune.study import Search, best, read_trials, tune
from tests.support import jobs_support as support

HOLE = "CableHole-Position-Sine"
SPACE = parse_space({"x": {"linear": [0.0, 1.0]}, "y": {"log": [1.0, 1000.0]}}, "test")


def search(function=support.parabola, **changes):
    return Search(**{
        "name": "toy", "space": SPACE, "start": {"x": 1.0, "y": 1.0}, "about": {"steps": 1}, "batch": 3,
        "job": lambda number, values: Job(f"trial {number}", function, dict(values)), **changes,
    })  # fmt: skip


def points(trials):
    return [(t.number, dict(t.values), t.loss, t.state) for t in trials]


# ---- spaces


@pytest.mark.parametrize("name", [n for n in CONTROLLERS if CONTROLLERS[n].gain_tables])
def test_every_gain_can_be_searched_from_its_default_over_its_whole_range(name):
    for table in CONTROLLERS[name].gain_tables.values():
        for p, d in zip(table, gain_space(table), strict=True):
            assert d.value(d.coordinate(p.default)) == pytest.approx(p.default, rel=1e-6)
            low, high = d.coordinate(p.low), d.coordinate(p.high)
            assert d.value(low) == p.low and d.value(high) == p.high
            p.check(d.value(low + 0.37 * (high - low)))


def test_scales_follow_the_bounds():
    def gain(default, low, high):
        return gain_space(ParameterTable(Parameter("k", "1", default, low, high, "")))[0]

    assert gain(1.0, 0.5, 2.0).kind == "linear"
    assert gain(1.0, 1e-3, 1e3).kind == "log"
    zero = gain(40.0, 0.0, 1e7)
    assert (zero.kind, zero.scale) == ("asinh", 4.0)
    # half way from 0 to the bound lies between the default and the bound, not at half the bound
    assert 40.0 < zero.value(0.5 * zero.coordinate(1e7)) < 1e5
    assert gain(0.0, 0.0, 300.0).scale == 0.3
    both = gain(10.0, -500.0, 5e3)
    assert both.value(both.coordinate(-20.0)) == pytest.approx(-20.0, rel=1e-6)


def test_settings_of_agents_are_searched_as_written():
    space = {d.name: d for d in parse_space({
        "learning_rate": {"log": ["1e-4", 1e-2], "schedule": "lin"},
        "gamma": {"choice": [0.9, 0.95]},
        "policy_kwargs.net_arch": {"choice": [[64, 64], [128]]},
        "n_steps": {"log_int": [32, 256]},
    }, "x.yaml")}  # fmt: skip
    rate = space["learning_rate"]
    assert rate.value(rate.coordinate("lin_3.0e-3")) == "lin_0.003"
    arch = space["policy_kwargs.net_arch"]
    assert arch.value(arch.coordinate([128])) == [128]
    assert space["n_steps"].value(64) == 64
    with pytest.raises(ConfigurationError, match=r"gamma: 0.97 is not among the choices 0.9, 0.95"):
        space["gamma"].coordinate(0.97)
    with pytest.raises(ConfigurationError, match="outside its range"):
        rate.coordinate(1.0)
    assert nested({"a": 1, "b.c": 2, "b.d": 3}) == {"a": 1, "b": {"c": 2, "d": 3}}


@pytest.mark.parametrize(("data", "message"), [
    (None, "x.yaml has no 'search'"),
    ({"gamma": 0.9}, "search.gamma in x.yaml: expected a mapping"),
    ({"gamma": {"lineer": [0, 1]}}, "did you mean 'linear'"),
    ({"gamma": {"linear": [0, 1], "log": [1, 2]}}, "found linear and log"),
    ({"gamma": {"log": [0, 1]}}, "above 0 for log"),
    ({"gamma": {"linear": [1, 0]}}, "low < high"),
    ({"gamma": {"linear": ["a", 1]}}, "bounds must be numbers"),
    ({"gamma": {"choice": [1]}}, "at least two"),
    ({"gamma": {"linear": [0, 1], "schedule": "cos"}}, "schedule"),
])  # fmt: skip
def test_a_wrong_search_names_the_key(data, message):
    with pytest.raises(ConfigurationError, match=message):
        parse_space(data, "x.yaml")


# ---- studies


def test_a_study_begins_at_the_start_and_finds_better(tmp_path):
    with open_backend("local") as backend:
        trials = tune(tmp_path / "a.db", search(), 14, backend)
        again = tune(tmp_path / "b.db", search(), 14, backend)
        other = tune(tmp_path / "c.db", search(seed=1), 4, backend)
    assert [t.number for t in trials] == list(range(14)) and trials[0].values == {"x": 1.0, "y": 1.0}
    assert points(trials) == points(again) and points(trials)[:4] != points(other)
    assert best(trials).loss < 0.2 * trials[0].loss


def test_a_study_that_was_stopped_goes_on_as_if_it_was_not(tmp_path):
    """Stopped within a batch: finished trials are kept, the unfinished ones of the batch run under their numbers."""
    file, calls = tmp_path / "a.db", []

    def stop(done, total, text):
        calls.append(done)
        if done == 7 and text.startswith("best"):
            raise KeyboardInterrupt

    with open_backend("local") as backend:
        whole = tune(tmp_path / "whole.db", search(), 12, backend)
        with pytest.raises(KeyboardInterrupt):
            tune(file, search(), 12, backend, stop)
        kept = read_trials(file, search())
        assert [t.state for t in kept] == ["complete"] * 7 + ["unfinished"] * 2
        assert points(tune(file, search(), 12, backend)) == points(whole)
        # asked for as many as there are: nothing runs; for more: only those
        assert points(tune(file, search(), 12, backend)) == points(whole)
        assert points(tune(file, search(), 14, backend))[:12] == points(whole)


def test_workers_do_not_change_the_numbers(tmp_path):
    with open_backend("local") as here, open_backend("local", 2) as there:
        assert points(tune(tmp_path / "a.db", search(), 7, here)) == points(tune(tmp_path / "b.db", search(), 7, there))


def test_failed_trials_count_and_say_why(tmp_path):
    remarks = []
    with open_backend("local") as backend:
        trials = tune(tmp_path / "a.db", search(support.sometimes_fails), 9, backend, remark=remarks.append)
    failed = [t for t in trials if t.state == "failed"]
    assert len(trials) == 9 and 0 < len(failed) < 9 and all(t.loss is None and t.values["x"] < 0.5 for t in failed)
    assert len(remarks) == len(failed) and "too small" in remarks[0]
    assert best(trials).values["x"] >= 0.5


def test_a_study_of_something_else_is_refused(tmp_path):
    file = tmp_path / "a.db"
    with open_backend("local") as backend:
        tune(file, search(), 2, backend)
        with pytest.raises(ConfigurationError, match=r"begun with other settings \(steps: 1, not 2\)"):
            tune(file, search(about={"steps": 2}), 3, backend)
        with pytest.raises(ConfigurationError, match="batch: 3, not 2"):
            tune(file, search(batch=2), 3, backend)

        def nested_run(done, total, text):
            tune(file, search(), 4, backend)

        with pytest.raises(ConfigurationError, match="in use by another"):
            tune(file, search(), 3, backend, nested_run)
        (tmp_path / "no.db").write_text("this is no database, and long enough to be seen as none " * 20)
        with pytest.raises(ConfigurationError, match=r"no.db is no study"):
            tune(tmp_path / "no.db", search(), 3, backend)


# ---- command


@pytest.fixture
def protocol(tmp_path):
    path = tmp_path / "tiny.yaml"
    path.write_text(
        "schema: 1\nname: tiny\ntasks:\n"
        f"  - {{env: cable_envs/{HOLE}-v0, options: {{duration: 0.5}}}}\n"
        "tracks:\n  nominal: {options: {sensor_noise: true}}\n"
        "  randomised: {options: {sensor_noise: true, randomize: true}}\n"
        "seeds: {train: {first: 0, count: 5000}, tune: {first: 5000, count: 10}, test: {first: 6000, count: 10}}\n"
        "episodes: 2\n"
    )
    return path


def test_tuned_gains_are_no_worse_and_enter_a_board(cli, protocol, tmp_path):
    out, study = tmp_path / "pid-fast.yaml", tmp_path / "pid.db"
    arguments = ("tune", "--controller", "pid", "--env", HOLE, "--protocol", protocol, "--episodes", 2)
    where = ("--study", study, "--out", out, "--name", "pid-fast")
    code, text, _ = cli(*arguments, "--trials", 8, *where, "--json")
    result = json.loads(text)["environments"][f"cable_envs/{HOLE}-v0"]
    assert code == 0 and len(result["trials"]) == 8
    assert result["loss"] <= result["start"] == result["trials"][0]["loss"]
    # going on to ten keeps the eight
    code, text, _ = cli(*arguments, "--trials", 10, *where, "--json")
    more = json.loads(text)["environments"][f"cable_envs/{HOLE}-v0"]
    assert code == 0 and more["trials"][:8] == result["trials"] and len(more["trials"]) == 10
    code, text, _ = cli(*arguments, "--trials", 10, *where)
    assert code == 0 and "10 trials" in text and "(start)" in text and f"wrote {out}" in text
    written = yaml.safe_load(out.read_text())
    trial = more["trials"][more["best"]]
    assert written["gains"] == {f"cable_envs/{HOLE}-v0": trial["values"]}
    assert written["charged"] == {"tuning_trials": 10 + CONTROLLERS["pid"].charged["tuning_trials"]}
    entrant = controller_file_entrant(out)
    assert (entrant.name, entrant.charged["tuning_trials"]) == ("pid-fast", 130)
    # the command in the file finds the same again
    words = written["made_by"].split()
    assert words[:2] == ["cablebench", "tune"]
    code, text, _ = cli(*words[1:], "--study", tmp_path / "again.db", "--json", "--jobs", 1)
    assert code == 0 and json.loads(text)["environments"][f"cable_envs/{HOLE}-v0"]["trials"] == more["trials"]


def test_seeds_of_tuning_are_those_of_the_protocol(protocol):
    chosen = load_protocol(protocol)
    assert tuning_seeds(chosen, 3) == (5000, 5001, 5002)
    assert training_seed(chosen) == 1000
    assert [c.key for c in tuning_cells(chosen, f"cable_envs/{HOLE}-v0", "randomised")] == [f"{HOLE} randomised"]
    with pytest.raises(ConfigurationError, match="seed number 10"):
        tuning_seeds(chosen, 11)


AGENT = """
algorithm: ppo
default:
  n_envs: 4
  n_timesteps: 256
  policy: MlpPolicy
  n_steps: 32
  batch_size: 64
  gamma: 0.95
  learning_rate: lin_1.0e-3
  policy_kwargs: {net_arch: [8], log_std_init: -1.0}
  tuning_trials: 3
search:
  learning_rate: {log: [1.0e-4, 1.0e-2], schedule: lin}
  gamma: {choice: [0.9, 0.95, 0.98]}
  policy_kwargs.log_std_init: {linear: [-2.0, 0.0]}
"""


def test_agents_are_tuned_by_short_trainings(cli, protocol, tmp_path):
    pytest.importorskip("torch")
    from cable_envs.agents.settings import load_settings

    file, out = tmp_path / "mine.yaml", tmp_path / "best.yaml"
    file.write_text(AGENT)
    code, text, _ = cli(
        "tune", "--algo", file, "--env", HOLE, "--protocol", protocol, "--episodes", 1, "--trials", 3, "--steps", 256,
        "--study", tmp_path / "mine.db", "--out", out, "--batch", 2, "--json",
    )  # fmt: skip
    result = json.loads(text)["environments"][f"cable_envs/{HOLE}-v0"]
    assert code == 0 and [t["state"] for t in result["trials"]] == ["complete"] * 3
    first = result["trials"][0]["values"]
    assert first == {"learning_rate": "lin_0.001", "gamma": 0.95, "policy_kwargs.log_std_init": -1.0}
    assert len({t["loss"] for t in result["trials"]}) == 3
    # the block goes into the file as it is, and what was written is such a file
    block = yaml.safe_load(out.read_text())[f"cable_envs/{HOLE}-v0"]
    assert block["tuning_trials"] == 6
    settings = load_settings(str(file), f"cable_envs/{HOLE}-v0", changes=block)
    assert settings.learner["gamma"] == block["gamma"] and settings.tuning_trials == 6
    assert settings.policy_kwargs == {"net_arch": [8], **block["policy_kwargs"]}
    written = load_settings(str(out), f"cable_envs/{HOLE}-v0")
    assert written == replace(settings, algo="best", algorithm_name="ppo")


BAD = {
    "nothing": ((), "name either --controller or --algo"),
    "both": (("--controller", "pid", "--algo", "ppo"), "name either --controller or --algo"),
    "steps": (("--controller", "pid", "--steps", 5), "--steps belongs to --algo"),
    "no steps": (("--algo", "ppo"), "--algo needs --steps"),
    "controller": (("--controller", "pidd"), "did you mean 'pid'"),
    "no gains": (("--controller", "open-loop"), "'open-loop' has no gains"),
    "not here": (("--controller", "feedforward-pid"), "feedforward-pid"),
    "track": (("--controller", "pid", "--track", "nominl"), "did you mean 'nominal'"),
    "backend": (("--controller", "pid", "--backend", "rey"), "did you mean 'ray'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_exit_code_2(cli, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, expected = BAD[name]
    code, out, err = cli("tune", "--env", HOLE, "--trials", 2, *arguments)
    assert (code, out) == (2, "") and err.count("\n") == 1 and expected in err
    assert list(tmp_path.iterdir()) == []
