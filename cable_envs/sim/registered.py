"""The setup behind a registered environment id."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from cable_envs.core.errors import ConfigurationError, nearest
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
        raise ConfigurationError(f"unknown environment '{env_id}'; {nearest(env_id, cable_envs.ENV_IDS)}")
    return make_setup(**{**spec.kwargs, **options})
