"""Policies that stable-baselines3 alone has trained and saved: they act as there, are submitted and replayed."""

import io
import json
import pickle
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import torch

from cable_envs.agents.settings import ALGORITHMS
from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.cli.shared.policies import policy_file_entrant
from cablebench.protocol.actors import PolicyActor
from cablebench.protocol.episode import Episode
from cablebench.run.evaluation import run_episode
from tests.cablebench.test_submit import TINY

HOLE = "cable_envs/CableHole-Position-Sine-v0"
NETWORK = {"net_arch": [8]}
ABOUT = """
schema: cable-policy-file/1
name: from-elsewhere
policy: theirs.zip
charged: {environment_steps: 192}
env: CableHole-Position-Sine
algo: %s
policy_kwargs: {net_arch: [8]}
"""


def trained(algo, folder):
    """A model of stable-baselines3's own, after a few real updates on the single environment; saved with its YAML."""
    env = gym.make(HOLE, duration=0.5, sensor_noise=True)
    on_policy = "ppo" in algo
    more = {"n_steps": 64, "batch_size": 64, "n_epochs": 2} if on_policy else {"learning_starts": 64, "batch_size": 32}
    policy = "MlpLstmPolicy" if algo == "recurrent-ppo" else "MlpPolicy"
    kwargs = {**NETWORK, "lstm_hidden_size": 8} if algo == "recurrent-ppo" else dict(NETWORK)
    model = ALGORITHMS[algo](policy, env, policy_kwargs=kwargs, seed=0, device="cpu", **more)
    before = torch.cat([p.detach().flatten().clone() for p in model.policy.parameters()])
    model.learn(192)
    assert not torch.equal(before, torch.cat([p.detach().flatten() for p in model.policy.parameters()]))
    model.save(folder / "theirs.zip")
    text = (ABOUT % algo).replace("[8]}", "[8], lstm_hidden_size: 8}" if algo == "recurrent-ppo" else "[8]}")
    (folder / "theirs.yaml").write_text(text)
    return model


def episode(policy) -> Episode:
    return run_episode(gym.make(HOLE, duration=0.5, sensor_noise=True), PolicyActor(policy), seed=2000)


@pytest.mark.parametrize("algo", ["ppo", "sac", "td3", "tqc", "crossq", "recurrent-ppo"])
def test_it_acts_as_in_stable_baselines3(algo, tmp_path):
    model = trained(algo, tmp_path)
    entrant = policy_file_entrant(str(tmp_path / "theirs.yaml"))
    assert (entrant.name, entrant.information, entrant.training_seed) == ("from-elsewhere", "model-free", 0)
    assert entrant.charged["environment_steps"] == 192
    setup = gym.make(HOLE).unwrapped.setup
    assert entrant.needs(HOLE, setup) == {} and entrant.needs(HOLE.replace("Sine", "Step"), setup) is None
    theirs, ours = episode(model), episode(entrant.make(setup).policy)
    assert np.array_equal(theirs.reward, ours.reward) and len(np.unique(ours.reward)) > 10


def cli(capsys, *arguments):
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    out = capsys.readouterr()
    return end.value.code or 0, out.out, out.err


def test_it_is_submitted_without_trust_and_its_row_replays(tmp_path, capsys):
    trained("sac", tmp_path)
    (tmp_path / "tiny.yaml").write_text(TINY)
    place = ("--protocol", tmp_path / "tiny.yaml", "--results", tmp_path / "results")
    code, _, err = cli(capsys, "submit", tmp_path / "theirs.yaml", *place)
    assert code == 0 and "place 1 of 1 (model-free)" in err, err
    rows = json.loads((tmp_path / "results" / "board.json").read_text())["tables"][0]["rows"]
    row = next(r for r in rows if r["entrant"] == "from-elsewhere")
    assert row["charged"]["environment_steps"] == 192 and row["score"] is not None
    (tmp_path / "theirs.zip").unlink()  # the results folder has its own copy
    code, out, err = cli(
        capsys, "replay", *place, "--env", "CableHole-Position-Sine", "--entrant", "from-elsewhere", "--json"
    )
    assert code == 0 and json.loads(out)["same"], err


def rewritten(path, change):
    """The same zip with another policy.pth."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    entries["policy.pth"] = change
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content)


class Trap:
    def __reduce__(self):
        return (open, ("sprung", "w"))


def test_nothing_in_the_file_is_executed(tmp_path, monkeypatch):
    trained("ppo", tmp_path)
    monkeypatch.chdir(tmp_path)
    content = io.BytesIO()
    torch.save({"weights": Trap()}, content)
    rewritten(tmp_path / "theirs.zip", content.getvalue())
    with pytest.raises(ConfigurationError, match="holds more than weights"):
        policy_file_entrant("theirs.yaml")
    with zipfile.ZipFile(tmp_path / "theirs.zip", "w") as archive:
        archive.writestr("data", pickle.dumps(Trap()))
    with pytest.raises(ConfigurationError, match=r"theirs\.zip holds 0 entries 'policy\.pth'; a policy has one"):
        policy_file_entrant("theirs.yaml")
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("net_arch: [8]", "net_arch: [9]", "the weights do not fit ppo with policy_kwargs as given"),
        ("net_arch: [8]", "net_arc: [8]", "do not fit ppo with policy_kwargs as given.*net_arc"),
        ("algo: ppo", "algo: sac", "the weights do not fit sac"),
        ("algo: ppo", "algo: pppo", "did you mean 'ppo'"),
        ("env: CableHole-Position-Sine", "env: PulleyCircuit-Position-Sine", "the weights do not fit"),
        ("charged: {environment_steps: 192}", "", "charged.environment_steps is missing"),
        ("algo: ppo", "", "'env' and 'algo' belong together"),
        ("env: CableHole-Position-Sine\nalgo: ppo", "", "holds 0 entries 'cable-policy.json'; a policy has one"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, old, new, expected):
    trained("ppo", tmp_path)
    text = (tmp_path / "theirs.yaml").read_text()
    assert old in text
    (tmp_path / "theirs.yaml").write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=expected):
        policy_file_entrant(str(tmp_path / "theirs.yaml"))
