"""What stands for their own environments when other projects' test files are run here (tests/interop/peers.py).

The first substitution is an id: `SHORT` for CartPole and Pendulum. The second is a class: `Batch` for
stable-baselines3's DummyVecEnv, which gives the native batch wherever the environments are this project's.
"""

import gymnasium as gym
from stable_baselines3.common.vec_env import DummyVecEnv

import cable_envs  # noqa: F401 (registers the environments)
from cable_envs.agents.vec_env import CableVecEnv
from cable_envs.envs import CableEnv

SHORT = "CableShort-v0"
"""A hole whose episodes last 40 steps: their tests wait for the end of many."""

if SHORT not in gym.registry:
    spec = gym.spec("cable_envs/CableHole-Position-Sine-v0")
    gym.register(
        SHORT, entry_point=spec.entry_point, vector_entry_point=spec.vector_entry_point, max_episode_steps=40,
        kwargs={**spec.kwargs, "duration": 0.4}, order_enforce=spec.order_enforce,
        disable_env_checker=spec.disable_env_checker,
    )  # fmt: skip


class Batch(DummyVecEnv):
    """As DummyVecEnv is called; gives a `CableVecEnv` where the functions make environments of this project."""

    def __new__(cls, env_fns):
        """The adapter that fits; its constructor has run."""
        core = env_fns[0]().unwrapped
        if not isinstance(core, CableEnv):
            return DummyVecEnv(env_fns)
        options = {} if core.render_mode is None else {"render_mode": core.render_mode}
        return CableVecEnv(core.spec.id, len(env_fns), **options)
