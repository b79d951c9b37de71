"""Offline reinforcement learning from a Minari dataset: learn from recorded episodes, without a simulator.

A controller of a hole (PID with its gains as shipped) is recorded on randomised rigs, with a little noise on its
commands, so that the episodes show more than its own habits. They become a Minari dataset, which any library for
offline learning reads. Here advantage-weighted regression (Peng et al. 2019) learns from it in plain PyTorch: it copies
the recorded commands, and those more that were followed by a higher return than usual. It is shown four observations at
once, since one does not tell which way the friction acts. The file prints the root mean square of the tracking error
(RMSE) on the paper's rig of the controller, of copying alone, and of advantage-weighted regression.

    python examples/offline_minari.py --out datasets         # a minute of one core
"""

import argparse
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from torch import nn

import cable_envs  # noqa: F401 (registers the environments)
from cablebench.entrants.entrant import controller_entrant
from cablebench.export.minari import load, write_dataset
from cablebench.export.trace import record
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ENV_ID, DATASET = "cable_envs/CableHole-Position-Sine-v0", "cable/CableHole-Position-Sine/shaken-pid-v0"
HISTORY, GAMMA, BATCH, NOISE = 4, 0.9, 512, 0.05


class Shaken:
    """A controller whose commands are shaken by noise with the standard deviation `NOISE`, in actions."""

    def __init__(self, actor, seed=0):
        self.actor, self.start, self.rng = actor, actor.start, np.random.default_rng(seed)

    def act(self, observation, t):
        return np.clip(self.actor.act(observation, t) + self.rng.normal(0.0, NOISE, 1), -1, 1).astype(np.float32)


def write(root, episodes, seconds):
    """Record episodes as a dataset below ``root``."""
    env, pid = gym.make(ENV_ID, randomize=True, sensor_noise=True, duration=seconds), controller_entrant("pid")
    shaken = replace(pid, make=lambda setup: Shaken(pid.make(setup)))
    write_dataset(record(env, shaken, range(episodes)), env, shaken, root, DATASET)


def read(root):
    """Observations with those before them, actions, and discounted returns of every step of the dataset."""
    parts = []
    for episode in load(root, DATASET).iterate_episodes():
        returns, rows = np.zeros(len(episode.rewards) + 1), np.arange(len(episode.rewards))
        for t in rows[::-1]:
            returns[t] = (1 - GAMMA) * episode.rewards[t] + GAMMA * returns[t + 1]
        seen = episode.observations[(rows[:, None] - np.arange(HISTORY)).clip(0)].reshape(len(rows), -1)
        parts.append((seen, episode.actions, returns[:-1, None]))
    return [torch.as_tensor(np.concatenate(part), dtype=torch.float32) for part in zip(*parts)]


class Policy(nn.Module):
    """A network of the last `HISTORY` observations, with their mean and spread."""

    def __init__(self, seen):
        super().__init__()
        self.mean, self.std = seen.mean(0), seen.std(0) + 1e-3
        n = seen.shape[1]
        self.net = nn.Sequential(nn.Linear(n, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 1))

    def forward(self, seen):
        return self.net((seen - self.mean) / self.std)

    def start(self, env):
        self.past = []

    def act(self, observation, t):
        self.past = [observation, *(self.past or [observation] * HISTORY)][:HISTORY]
        return self(torch.as_tensor(np.concatenate(self.past))).detach().numpy()


def fitted(seen, target, weight, steps):
    """A `Policy` that gives ``target`` for ``seen`` in weighted least squares."""
    made, scale = Policy(seen), target.std()
    optimiser = torch.optim.Adam(made.parameters())
    for k in range(steps):
        rows = torch.randint(len(seen), (BATCH,))
        loss = (weight[rows] * ((made(seen[rows]) - target[rows]) / scale).square()).mean()
        optimiser.param_groups[0]["lr"] = 3e-3 * (1 - k / steps)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return made


def evaluate(actor, seconds):
    return measure(run_episode(gym.make(ENV_ID, sensor_noise=True, duration=seconds), actor, seed=10_000_000))["rmse"]


def run(root, episodes=20, steps=3000, seconds=20.0):
    """RMSE in m by what acts; records the dataset where ``root`` has none."""
    torch.manual_seed(0)
    if not (root / DATASET).exists():
        write(root, episodes, seconds)
    seen, action, returns = read(root)
    found = {"PID": evaluate(controller_entrant("pid").make(gym.make(ENV_ID).unwrapped.setup), seconds)}
    even = torch.ones_like(returns)
    found["copied"] = evaluate(fitted(seen, action, even, steps), seconds)
    advantage = returns - fitted(seen, returns, even, steps)(seen).detach()
    weight = (2.0 * advantage / advantage.std()).exp().clamp(max=20.0)
    found["advantage-weighted"] = evaluate(fitted(seen, action, weight / weight.mean(), steps), seconds)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("datasets"), help="folder of Minari's datasets")
    for name, rmse in run(parser.parse_args().out).items():
        print(f"{name:20} RMSE {1e3 * rmse:.3f} mm")
