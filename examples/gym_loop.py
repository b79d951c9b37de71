"""The Gymnasium loop: reset, step, and what an episode says.

It follows a sine with a load of 5 kg that hangs from a cable through a hole, three times: with random tensions, with
the tension that carries the weight, and with that tension plus a gain times the error. It prints the root mean square
of the tracking error (RMSE), the mean reward, and how the episode ended.

    python examples/gym_loop.py

Random tensions jump between 0 and 120 N and drop or throw the load; a proportional gain alone leaves the friction of
the hole uncorrected, which is what the other examples go on from.
"""

import argparse

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"


def random_action(env: gym.Env, observation: np.ndarray) -> np.ndarray:
    """Any tension of the drive's range."""
    return env.action_space.sample()


def held_weight(env: gym.Env, observation: np.ndarray, gain: float = 0.0) -> np.ndarray:
    """The tension of the weight, and ``gain`` N for each metre of error, as an action in [-1, 1].

    An observation holds SI values over the scales of its channels; the drive's range is 0 to 120 N.
    """
    channels = {channel.name: k for k, channel in enumerate(env.unwrapped.channels)}
    error = observation[channels["error"]] * env.unwrapped.channels[channels["error"]].scale
    tension = 5.0 * 9.81 + gain * error
    return np.clip(np.array([tension / 60.0 - 1.0]), -1.0, 1.0).astype(np.float32)


def proportional(env: gym.Env, observation: np.ndarray) -> np.ndarray:
    """Carry the weight and correct the error with 5 N/mm."""
    return held_weight(env, observation, gain=5000.0)


def run(policy, seconds: float = 20.0, seed: int = 0) -> tuple[float, float, str]:
    """One episode: RMSE in m, mean reward, and how it ended."""
    env = gym.make(ENV_ID, sensor_noise=True, duration=seconds)
    env.action_space.seed(seed)
    observation, _ = env.reset(seed=seed)
    errors, rewards, terminated, truncated = [], [], False, False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(policy(env, observation))
        errors.append(info["error"])
        rewards.append(reward)
    env.close()
    rmse = float(np.sqrt(np.mean(np.square(errors))))
    return rmse, float(np.mean(rewards)), "the cable tore" if terminated else "at its time limit"


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each episode")
    chosen = parser.parse_args(arguments)
    for policy in (random_action, held_weight, proportional):
        rmse, reward, end = run(policy, chosen.seconds)
        print(f"{policy.__name__:14} RMSE {1e3 * rmse:8.3f} mm   mean reward {reward:.3f}   ended {end}")


if __name__ == "__main__":
    main()
