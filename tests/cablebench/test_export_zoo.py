"""`cablebench export --format zoo`: the zoo's layout, with what it cannot say named in the file."""

import gymnasium as gym
import pytest
import yaml
from torch import nn

from cable_envs.agents.settings import load_settings
from cablebench.cli import main

HOLE = "cable_envs/CableHole-Position-Sine-v0"


def exported(tmp_path, *words):
    with pytest.raises(SystemExit) as end:
        main(["export", "CableHole-Position-Sine", "--format", "zoo", "--out", str(tmp_path), *words])
    return end.value.code or 0


def test_every_algorithm_of_the_zoo_gets_its_file(tmp_path):
    assert exported(tmp_path) == 0
    assert {p.stem for p in tmp_path.iterdir()} == {"ppo", "sac", "td3", "tqc", "crossq", "ppo_lstm"}
    for path in tmp_path.iterdir():
        entry = yaml.safe_load(path.read_text())[HOLE]
        assert {"n_envs", "n_timesteps", "policy", "learning_rate"} <= set(entry)
        gym.make(HOLE, **entry["env_kwargs"])


def test_a_file_says_what_the_agent_says(tmp_path):
    exported(tmp_path)
    text = (tmp_path / "ppo.yml").read_text()
    entry, settings = yaml.safe_load(text)[HOLE], load_settings("ppo", HOLE)
    network = eval(entry["policy_kwargs"], {"dict": dict, "nn": nn})
    assert network == settings.policy_arguments()
    assert {k: entry[k] for k in settings.learner} == dict(settings.learner)
    assert "Left out, since the zoo has no name for it: curriculum, smoothing." in text


def test_it_takes_no_entrant(tmp_path, capsys):
    assert exported(tmp_path, "--controller", "pid") == 2
    assert "no entrant and no options" in capsys.readouterr().err
