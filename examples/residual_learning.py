"""Residual learning: an agent that corrects a controller of the literature instead of replacing it.

The feedforward compensation of Zou et al. (2022) inverts the friction of a cable circuit with its nominal parameters.
Residual PPO adds a fifth of its own action to that command, and learns where the nominal parameters are wrong: on rigs
whose friction and pretension are drawn anew for every episode. The file trains with the package's own agents
(stable-baselines3 beneath) and prints the root mean square of the tracking error (RMSE, median over rigs that were not
trained on) of the controller alone and of both together.

    python examples/residual_learning.py --out runs/residual          # half a million steps: about two minutes
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)
from cable_envs.agents.settings import load_settings
from cable_envs.agents.train import train
from cablebench.entrants.entrant import controller_entrant
from cablebench.protocol.actors import PolicyActor
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ENV_ID = "cable_envs/PulleyCircuit-Position-Sine-v0"
CONTROLLER = "feedforward-pid"


def errors(actor, rigs: int, seconds: float) -> list[float]:
    """RMSE in rad on each of some rigs that are drawn from seeds which no training uses."""
    env = gym.make(ENV_ID, sensor_noise=True, randomize=True, duration=seconds)
    made = actor(env.unwrapped.setup)
    found = [measure(run_episode(env, made, 5_000_000 + k))["rmse"] for k in range(rigs)]
    env.close()
    return found


def run(steps: int, out: Path, rigs: int = 20, seconds: float = 25.0, seed: int = 0) -> dict[str, float]:
    """Train, save the policy in ``out``, and give the median RMSE in rad of the controller and of both together."""
    settings = load_settings("residual-ppo", ENV_ID, n_timesteps=steps)
    policy = train(settings, seed, out, overwrite=True)
    alone = errors(lambda setup: controller_entrant(CONTROLLER).make(setup), rigs, seconds)
    both = errors(lambda setup: PolicyActor(policy), rigs, seconds)
    return {CONTROLLER: float(np.median(alone)), "residual PPO on it": float(np.median(both))}


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=499_712, help="environment steps of the training")
    parser.add_argument("--rigs", type=int, default=20, help="rigs that are tested")
    parser.add_argument("--seconds", type=float, default=25.0, help="length of each tested episode")
    parser.add_argument("--out", type=Path, help="folder for the policy; without it the policy is not kept")
    chosen = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        found = run(chosen.steps, chosen.out or Path(folder), chosen.rigs, chosen.seconds)
    for name, rmse in found.items():
        print(f"{name:20} RMSE {1e3 * rmse:.2f} mrad")


if __name__ == "__main__":
    main()
