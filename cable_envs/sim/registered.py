"""A registered environment id: the setup behind it, and what Gymnasium is told of an environment."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.sim.rigs import Rig
from cable_envs.sim.setup import Setup, make_setup


def setup_of(env_id: str, options: Mapping[str, Any]) -> Setup:
    """The `Setup` that ``gymnasium.make(env_id, **options)`` would have, without making the environment.

    Parameters
    ----------
    env_id : str
        Registered id, namespace and version included.
    options : mapping
        Options of the environment (`cable_envs.envs.CableEnv`).

    Returns
    -------
    Setup
        What the environment would be made from.

    Raises
    ------
    ConfigurationError
        For an unknown id (with the nearest one) and for options that do not fit.

    Examples
    --------
    >>> setup_of("cable_envs/CableHole-Position-Step-v0", {"duration": 2.0}).steps
    200
    """
    import cable_envs  # importing it registers its environments

    spec = gym.registry.get(env_id)
    if spec is None or "task" not in spec.kwargs:
        known = cable_envs.ENV_IDS + cable_envs.V1_IDS + cable_envs.SUITE_IDS
        raise ConfigurationError(f"unknown environment '{env_id}'; {nearest(env_id, known)}")
    return make_setup(**{**spec.kwargs, **options})


def described(spec: EnvSpec | None, setup: Setup) -> EnvSpec | None:
    """What Gymnasium knows of an environment, with what only the environment knows of itself.

    Parameters
    ----------
    spec : EnvSpec or None
        As Gymnasium made it.
    setup : Setup
        What defines the environment.

    Returns
    -------
    EnvSpec or None
        With ``max_episode_steps``, which is ``duration`` over ``control_period``, and with a `Rig` as the content of
        its file, so that ``to_json`` writes what ``from_json`` and ``gymnasium.make`` take.
    """
    if spec is None:
        return None
    kwargs = {name: value.content() if isinstance(value, Rig) else value for name, value in spec.kwargs.items()}
    return replace(spec, max_episode_steps=setup.steps, kwargs=kwargs)
