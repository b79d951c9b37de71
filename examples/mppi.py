"""Plan through the simulator: model predictive path integral control (MPPI) on a batch that starts from one state.

Before every control step the state of the environment is put into all environments (lanes) of a batch
(`CableVectorEnv.restore`). Each lane tries another sequence of actions over a short horizon, and the first action of
their weighted mean is taken (Williams, Aldrich, Theodorou, J. Guid. Control Dyn. 40 (2017) 344). The planner knows
everything: the true rig, its state and the reference to come. So it cannot be compared with controllers that only see
measurements. It shows what they could reach.

    python examples/mppi.py                                     # the hole's position along a sine, 5 s
    python examples/mppi.py PulleyCircuit-Position-Sine --seconds 10 --lanes 512
"""

import argparse
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

import cable_envs  # registers the environments
from cable_envs.vector import CableVectorEnv


@dataclass(frozen=True)
class Settings:
    """What a planner may choose.

    Attributes
    ----------
    lanes : int
        Sequences that are tried at every step.
    horizon : int
        Control steps of each.
    spread : float
        Standard deviation of the changes to the present plan, in actions.
    hold : float
        Share of a change that goes over into the next step: sequences are smooth.
    sharpness : float
        How much of the weight the best sequences get: the weight falls to 1/e where the cost is the least one plus this
        share of the mean distance to it.
    """

    lanes: int = 256
    horizon: int = 10
    spread: float = 0.1
    hold: float = 0.8
    sharpness: float = 0.1


class Planner:
    """MPPI for one environment.

    Parameters
    ----------
    env_id : str
        Registered id.
    settings : Settings
        See there.
    options : dict
        Those of the environment.
    seed : int
        Of the changes that are tried.
    """

    def __init__(self, env_id: str, settings: Settings, options: dict, seed: int = 0):
        made = gym.make_vec(
            env_id, num_envs=settings.lanes, vectorization_mode="vector_entry_point", step_infos=False,
            autoreset_mode="Disabled", **options,
        )  # fmt: skip
        assert isinstance(made.unwrapped, CableVectorEnv)
        self.batch, self.settings = made.unwrapped, settings
        self.rng = np.random.default_rng(seed)
        self.plan = np.zeros(settings.horizon)

    def begin(self, state: dict) -> None:
        """Start with the action that keeps the mechanism at rest."""
        self.batch.restore(state)
        self.plan[:] = self.batch.simulation.buffers.named.action[0]

    def act(self, state: dict) -> np.ndarray:
        """The action for a state of the environment."""
        s = self.settings
        changes = self.rng.normal(0.0, s.spread, (s.horizon, s.lanes))
        for k in range(1, s.horizon):
            changes[k] = s.hold * changes[k - 1] + np.sqrt(1.0 - s.hold**2) * changes[k]
        changes[:, 0] = 0.0  # the plan as it is
        tried = np.clip(self.plan[:, None] + changes, -1.0, 1.0)
        costs = self.costs(state, tried)
        distance = costs - costs.min()
        weights = np.exp(-distance / max(s.sharpness * distance.mean(), 1e-300))
        self.plan = tried @ weights / weights.sum()
        action = self.plan[:1].astype(np.float32)
        self.plan = np.append(self.plan[1:], self.plan[-1])
        return action

    def costs(self, state: dict, tried: np.ndarray) -> np.ndarray:
        """Sum of squared errors of each sequence [horizon, lanes], over the task's scale of errors."""
        self.batch.restore(state)
        total, scale = np.zeros(self.settings.lanes), self.batch.setup.task.error_scale
        for actions in tried:
            _, _, terminated, truncated, _ = self.batch.step(actions[:, None].astype(np.float32))
            total += (self.batch.infos()["error"] / scale) ** 2 + 1e6 * terminated
            if (terminated | truncated).any():
                break
        return total


def run(env_id: str, seconds: float, settings: Settings, seed: int = 0) -> float:
    """One episode; returns the root mean square of the tracking error in SI."""
    options = {"duration": seconds}
    env = gym.make(env_id, **options)
    env.reset(seed=seed)
    planner = Planner(env_id, settings, options, seed)
    planner.begin(env.unwrapped.state())
    errors, done = [], False
    while not done:
        *_, terminated, truncated, info = env.step(planner.act(env.unwrapped.state()))
        errors.append(info["error"])
        done = terminated or truncated
    return float(np.sqrt(np.mean(np.square(errors))))


def main() -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="CableHole-Position-Sine")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--lanes", type=int, default=Settings.lanes)
    parser.add_argument("--horizon", type=int, default=Settings.horizon)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    env_id = f"cable_envs/{chosen.task}-v0"
    if env_id not in cable_envs.ENV_IDS:
        parser.error(f"unknown task {chosen.task}; valid: {', '.join(i[11:-3] for i in cable_envs.ENV_IDS)}")
    rmse = run(env_id, chosen.seconds, Settings(chosen.lanes, chosen.horizon), chosen.seed)
    unit = gym.make(env_id).unwrapped.setup.output_unit
    print(f"{chosen.task}: RMSE {rmse:.3g} {unit}")


if __name__ == "__main__":
    main()
