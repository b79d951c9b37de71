"""Policies saved by stable-baselines3 alone (``model.save()``): weights only, the rest must be told.

SB3's own loader unpickles what is in the file, which can run anything; here ``policy.pth`` is the only entry read, by
``torch.load(..., weights_only=True)``.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.policies import BasePolicy

from cable_envs.agents import archive
from cable_envs.agents.settings import ALGORITHMS, make_settings
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.registered import setup_of
from cable_envs.spaces import make_spaces


@dataclass(frozen=True)
class ForeignPolicy:
    """A policy that stable-baselines3 saved by itself.

    Attributes
    ----------
    network : BasePolicy
        The network with its weights.
    digest : str
        First 12 hex digits of the file's SHA-256.
    """

    network: BasePolicy
    digest: str

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """The action for an observation, as `BasePolicy.predict` of stable-baselines3.

        Parameters
        ----------
        observation : ndarray, shape (channels,) or (n, channels)
            As the environment gives it.
        state : Any, optional
            Memory of a recurrent network, as returned by the last call.
        episode_start : ndarray of bool, shape (n,), optional
            Where an episode begins, for a recurrent network.
        deterministic : bool
            False draws from the distribution of actions.

        Returns
        -------
        action : ndarray, shape (actions,) or (n, actions)
            Within [-1, 1].
        state : Any
            Memory to give to the next call.
        """
        return self.network.predict(observation, state, episode_start, deterministic)


def load_foreign(
    path: str | Path,
    algo: str,
    env_id: str,
    options: Mapping[str, Any] | None = None,
    policy_kwargs: Mapping[str, Any] | None = None,
    policy: str = "",
) -> ForeignPolicy:
    """A policy that stable-baselines3 saved by itself. Only weights are read: nothing in the file is executed.

    Parameters
    ----------
    path : str or Path
        A .zip of ``model.save()``.
    algo : str
        Name of the algorithm in stable-baselines3, in lower case.
    env_id : str
        The environment that it was trained on.
    options : mapping, optional
        Environment options that shaped observation and action.
    policy_kwargs : mapping, optional
        As of the training: net_arch, activation_fn.
    policy : str
        stable-baselines3's name of the network; empty: the algorithm's network on vectors.

    Returns
    -------
    ForeignPolicy
        With ``predict`` as stable-baselines3's.

    Raises
    ------
    ConfigurationError
        For unknown names, for a file without weights, and where the weights do not fit the network that the arguments
        describe.
    """
    path = Path(path)
    content = path.read_bytes()
    require_known("algorithm", [algo], ALGORITHMS)
    kinds = ALGORITHMS[algo].policy_aliases
    policy = policy or next(name for name in kinds if name.startswith("Mlp"))
    archive.check_size(path, dict(policy_kwargs or {}))
    data = {"n_timesteps": 1, "policy": policy, "policy_kwargs": dict(policy_kwargs or {})}
    settings = make_settings(algo, env_id, data, str(path))
    torch.set_num_threads(1)  # a network this small is slower on several
    found = archive.weights(path, content)
    try:
        network = kinds[policy](
            *make_spaces(setup_of(env_id, options or {})), lambda remaining: 0.0, **settings.policy_arguments()
        )
        network.load_state_dict(found)
    except ConfigurationError:
        raise
    except Exception as error:  # stable-baselines3 takes whatever the arguments say
        text = " ".join(str(error).split())[:300]
        raise ConfigurationError(f"{path}: the weights do not fit {algo} with policy_kwargs as given: {text}") from None
    network.set_training_mode(False)
    return ForeignPolicy(network, hashlib.sha256(content).hexdigest()[:12])
