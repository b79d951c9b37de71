"""Settings of this project's agents as hyperparameter files of RL Baselines3 Zoo.

The zoo has one file for each algorithm, with everything written out below each environment id, ``policy_kwargs`` as
Python text and the environment's options as ``env_kwargs``. What lies between environment and network here and has no
name there (smoothing, curriculum, first_frame, ...) is left out and named in the file: a training of the zoo is then
another agent than the board's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic

NAMES = {"recurrent-ppo": "ppo_lstm"}
"""What the zoo calls an algorithm, where that is another name."""

LEFT_OUT = ("smoothing", "first_frame", "residual", "curriculum")
"""Fields of `cable_envs.agents.settings.Settings` that change the agent and that the zoo has no name for."""

HEAD = """# Hyperparameters of cable-envs for RL Baselines3 Zoo, from configs/agents/{agent}.yaml.
# python -m rl_zoo3.train --algo {algo} --env {env} --gym-packages cable_envs -conf {file}
# {lost}
"""


@dataclass(frozen=True)
class ZooFile:
    """One file that was written: the agent, the zoo's name of its algorithm, and the environments in it."""

    path: Path
    agent: str
    algo: str
    env_ids: tuple[str, ...]


def write_zoo(folder: Path, env_ids: Sequence[str]) -> tuple[ZooFile, ...]:
    """Write ``<algorithm>.yml`` for every agent in configs/agents that is an algorithm of the zoo.

    Parameters
    ----------
    folder : Path
        Where to; made if needed.
    env_ids : sequence of str
        Registered ids.

    Returns
    -------
    tuple of ZooFile
        What was written.

    Raises
    ------
    ConfigurationError
        Where no agent has settings for any of the environments.
    """
    from cable_envs.agents.files import agent_names
    from cable_envs.agents.settings import ALGORITHMS, load_settings

    files = []
    for agent in agent_names():
        if agent not in ALGORITHMS:  # a residual agent and the like: no algorithm of the zoo does what it does
            continue
        algo, lost, entries = NAMES.get(agent, agent), set(), {}
        for env_id in env_ids:
            settings = load_settings(agent, env_id)
            lost |= {name for name in LEFT_OUT if getattr(settings, name)}
            entries[env_id] = entry(settings)
        path = folder / f"{algo}.yml"
        words = "Everything is as on the board."
        if lost:
            words = f"Left out, since the zoo has no name for it: {', '.join(sorted(lost))}."
        head = HEAD.format(agent=agent, algo=algo, env=env_ids[0], file=path.name, lost=words)
        write_atomic(path, (head + yaml.safe_dump(entries, sort_keys=False, width=120)).encode())
        files.append(ZooFile(path, agent, algo, tuple(env_ids)))
    if not files:
        raise ConfigurationError("no agent in configs/agents is an algorithm of RL Baselines3 Zoo")
    return tuple(files)


def entry(settings: Any) -> dict[str, Any]:
    """The settings of one environment in the zoo's layout."""
    found = {
        "n_envs": settings.n_envs, "n_timesteps": settings.n_timesteps, "policy": settings.policy, **settings.learner,
    }  # fmt: skip
    if settings.policy_kwargs:
        found["policy_kwargs"] = text_of(settings.policy_kwargs)
    if settings.env_options:
        found["env_kwargs"] = dict(settings.env_options)
    if settings.frame_stack > 1:
        found["frame_stack"] = settings.frame_stack
    if settings.normalize:
        found["normalize"] = repr(dict(settings.normalize))
    if settings.noise_type:
        found |= {"noise_type": settings.noise_type, "noise_std": settings.noise_std}
    return found


def text_of(policy_kwargs: Any) -> str:
    """Arguments of a network as the zoo evaluates them: ``dict(net_arch=[64, 64], activation_fn=nn.Tanh)``."""
    classes = {"tanh": "nn.Tanh", "relu": "nn.ReLU", "elu": "nn.ELU"}
    words = []
    for key, value in policy_kwargs.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigurationError(f"policy_kwargs.{key} = {value} cannot be written to a file of the zoo")
        words.append(f"{key}={classes.get(value, value) if key == 'activation_fn' else repr(value)}")
    return f"dict({', '.join(words)})"
