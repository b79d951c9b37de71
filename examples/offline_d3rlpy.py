"""Offline reinforcement learning with d3rlpy: policies learnt from data sets alone, and scored like everybody else.

    cablebench datasets --env CableHole-Track-Medium --episodes 20 --out datasets
    pip install d3rlpy                                    # wants Gymnasium 1.0.0, and runs with 1.4 (--no-deps)
    python examples/offline_d3rlpy.py --task CableHole-Track-Medium --datasets datasets --out learnt
    cablebench try learnt/bc-reference-CableHole-Track-Medium.yaml --task CableHole-Track-Medium

Behaviour cloning (BC) copies the commands of the reference, and then those of the expert. TD3+BC (Fujimoto and Gu
2021) and implicit Q-learning (IQL, Kostrikov et al. 2021) are offline algorithms: they learn from random, reference and
expert behaviour with the rewards. One observation does not tell which way the friction acts, so that each policy sees
the last 16, side by side. It is written as an ONNX file with a YAML file that says so, which `cablebench try`,
`evaluate` and `submit` take.
"""

import argparse
import logging
from pathlib import Path

import d3rlpy
import numpy as np
import structlog
import torch
import yaml

from cablebench.export.minari import load

HISTORY, BATCH, LARGEST_GAP = 16, 256, 1.05
LEARNERS = {
    "bc-reference": (("reference",), "bc"),
    "bc-expert": (("expert",), "bc"),
    "td3bc": (("random", "reference", "expert"), "td3bc"),
    "iql": (("random", "reference", "expert"), "iql"),
}
"""The data sets that each learner reads, and its algorithm."""


def stacked(observations):
    """Each observation with the `HISTORY` - 1 before it, the newest last; the first one stands for those before it."""
    rows = np.arange(len(observations))[:, None] - np.arange(HISTORY - 1, -1, -1)
    return observations[rows.clip(0)].reshape(len(observations), -1).astype(np.float32)


def read(root, task, behaviours):
    """The episodes of data sets as d3rlpy's, with histories of observations."""
    seen, actions, rewards, ended, over = [], [], [], [], []
    for behaviour in behaviours:
        for episode in load(root, f"cable/{task}/{behaviour}-v0").iterate_episodes():
            n = len(episode.actions)
            seen.append(stacked(episode.observations[:n]))
            actions.append(episode.actions)
            rewards.append(episode.rewards[:, None])
            ended.append(episode.terminations)
            over.append(~episode.terminations & (np.arange(n) == n - 1))
    parts = [np.concatenate(part) for part in (seen, actions, rewards, ended, over)]
    return d3rlpy.dataset.MDPDataset(*parts[:4], timeouts=parts[4])


def learner(kind, actions):
    """An algorithm of d3rlpy whose policy gives commands within those of the data, a little beyond at most."""
    middle, half = 0.5 * (actions.max() + actions.min()), 0.5 * LARGEST_GAP * (actions.max() - actions.min())
    common = {
        "batch_size": BATCH,
        "observation_scaler": d3rlpy.preprocessing.StandardObservationScaler(),
        "action_scaler": d3rlpy.preprocessing.MinMaxActionScaler(
            minimum=np.array([middle - half]), maximum=np.array([middle + half])
        ),
    }
    if kind == "bc":
        return d3rlpy.algos.BCConfig(learning_rate=1e-3, **common).create()
    if kind == "iql":
        return d3rlpy.algos.IQLConfig(gamma=0.98, expectile=0.7, weight_temp=3.0, **common).create()
    return d3rlpy.algos.TD3PlusBCConfig(
        actor_learning_rate=3e-4, critic_learning_rate=3e-4, gamma=0.98, alpha=2.5, **common
    ).create()


class Deployed(torch.nn.Module):
    """A learnt policy from observations to actions in [-1, 1], both scalers within."""

    def __init__(self, made):
        super().__init__()
        self.policy, self.seen, self.done = made.impl.policy, made.observation_scaler, made.action_scaler

    def forward(self, observations):
        return self.done.reverse_transform(self.policy(self.seen.transform(observations)).squashed_mu)


def write_onnx(network, width, file):
    """Write a network as one ONNX file (d3rlpy's own export does not take PyTorch from 2.9 on)."""
    example = torch.zeros(1, width)
    torch.onnx.export(
        network.eval(), (example,), str(file), input_names=["observations"], output_names=["actions"],
        dynamic_axes={"observations": {0: "n"}, "actions": {0: "n"}}, dynamo=False,
    )  # fmt: skip


def learn(name, root, task, out, steps, seed):
    """Learn from data sets, and write the policy; returns its file for `cablebench`."""
    d3rlpy.seed(seed)
    behaviours, kind = LEARNERS[name]
    data = read(root, task, behaviours)
    actions = np.concatenate([episode.actions for episode in data.episodes])
    made = learner(kind, actions)
    made.fit(data, n_steps=steps, n_steps_per_epoch=steps, show_progress=False, save_interval=10**9,
             logger_adapter=d3rlpy.logging.NoopAdapterFactory())  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    file = out / f"{name}-{task}.onnx"
    write_onnx(Deployed(made), data.episodes[0].observations.shape[1], file)
    about = {
        "schema": "cable-policy-file/1", "name": name, "policy": file.name, "env": task, "history": HISTORY,
        "seed": seed, "charged": {"environment_steps": len(actions)},
    }  # fmt: skip
    file.with_suffix(".yaml").write_text(yaml.safe_dump(about), encoding="utf-8")
    return file.with_suffix(".yaml")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="CableHole-Track-Medium", help="task, by its short id")
    parser.add_argument("--datasets", type=Path, default=Path("datasets"), help="folder of Minari's data sets")
    parser.add_argument("--learner", choices=LEARNERS, action="append", help="default: all of them")
    parser.add_argument("--steps", type=int, default=50_000, help="gradient steps")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("learnt"))
    given = parser.parse_args()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))  # d3rlpy's
    for name in given.learner or LEARNERS:
        print(learn(name, given.datasets, given.task, given.out, given.steps, given.seed))
