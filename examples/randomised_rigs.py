"""Randomised rigs: one controller on 256 rigs at once, and which unknown parameter matters most.

The paper's rig is never the rig on the bench. `randomize=True` draws mass, wrap angle, friction, extrusion, radius
ratio and stiffness of the hole anew for every episode; the native batch runs all rigs in one loop. The controller is
the same on all of them: the nominal weight, and PID on the measured load position. The file prints quantiles of the
root mean square of the tracking error (RMSE), and the rank correlation (Spearman) of that error with each parameter.

    python examples/randomised_rigs.py                       # a few seconds
"""

import argparse

import gymnasium as gym
import numpy as np
from scipy.stats import spearmanr

import cable_envs  # noqa: F401 (registers the environments)

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"
WEIGHT = 5.0 * 9.81
"""N: of the nominal load."""


def run(rigs: int = 256, seconds: float = 20.0, seed: int = 0, kp=8000.0, ki=60000.0, kd=200.0):
    """RMSE in m of each rig, and the parameters that differ between them, by name.

    ``kp``, ``ki``, ``kd``: gains in N/m, N/(m s) and N s/m.
    """
    made = gym.make_vec(
        ENV_ID, num_envs=rigs, vectorization_mode="vector_entry_point", autoreset_mode="Disabled",
        randomize=True, sensor_noise=True, duration=seconds, step_infos=False,
    )  # fmt: skip
    batch = made.unwrapped
    observation, _ = batch.reset(seed=seed)
    setup, place = batch.setup, {c.name: k for k, c in enumerate(batch.channels)}
    scale = np.array([c.scale for c in batch.channels])
    integral, squares, steps = np.zeros(rigs), np.zeros(rigs), round(seconds / setup.control_period)
    for _ in range(steps):
        y = observation * scale
        error = y[:, place["reference"]] - y[:, place["load_position"]]
        rate = y[:, place["reference_rate"]] - y[:, place["load_velocity"]]
        integral += error * setup.control_period
        tension = WEIGHT + kp * error + ki * integral + kd * rate
        action = np.clip(2.0 * (tension - setup.low) / (setup.high - setup.low) - 1.0, -1.0, 1.0)
        observation, *_ = batch.step(action[:, None].astype(np.float32))
        squares += batch.infos()["error"] ** 2
    drawn = {name: np.array([rig[name] for rig in batch.true_rig]) for name in batch.true_rig[0]}
    drawn = {name: values for name, values in drawn.items() if np.ptp(values) > 0.0}
    batch.close()
    return np.sqrt(squares / steps), drawn


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=256)
    parser.add_argument("--seconds", type=float, default=20.0)
    chosen = parser.parse_args(arguments)
    rmse, drawn = run(chosen.rigs, chosen.seconds)
    for share in (0.1, 0.5, 0.9, 1.0):
        print(f"RMSE of {100 * share:3.0f} % of the rigs is at most {1e3 * np.quantile(rmse, share):.3f} mm")
    found = {name: float(spearmanr(values, rmse).statistic) for name, values in drawn.items()}
    for name in sorted(found, key=lambda n: -abs(found[n])):
        print(f"{name:22} rank correlation with the error {found[name]:+.2f}")


if __name__ == "__main__":
    main()
