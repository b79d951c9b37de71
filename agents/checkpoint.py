"""Everything a training needs to go on to the bit: model, optimiser, replay buffer, environments, generators.

A checkpoint is taken between two rollouts, where stable-baselines3 keeps nothing in local variables. It is read with
pickle: load only your own. What is handed to others is the policy file (`cable_envs.agents.policy`), which holds no
code.
"""

import io
import random
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack, VecNormalize

from cable_envs.agents.settings import Settings
from cable_envs.agents.vec_env import CableVecEnv
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic

SCHEMA = "cable-checkpoint/1"


def layers(model: BaseAlgorithm) -> list[VecEnv]:
    """The wrappers around a model's environments.

    Parameters
    ----------
    model : BaseAlgorithm
        A model with environments.

    Returns
    -------
    list of VecEnv
        From the outside in, the `cable_envs.agents.vec_env.CableVecEnv` last.
    """
    env = model.get_env()
    assert env is not None, "a model without environments"
    found = [env]
    while isinstance(found[-1], VecEnvWrapper):
        found.append(found[-1].venv)
    return found


def save_checkpoint(model: BaseAlgorithm, settings: Settings, seed: int, recorder: dict[str, Any], path: Path) -> None:
    """Write the state of a training, whole or not at all.

    Parameters
    ----------
    model : BaseAlgorithm
        A model between two rollouts.
    settings : Settings
        Those of the training; their hash is kept.
    seed : int
        Seed of the training.
    recorder : dict
        Further state of the training, kept as it is.
    path : Path
        File to write or to replace.
    """
    buffer = io.BytesIO()
    model.save(buffer)
    state = {
        "schema": SCHEMA,
        "settings_hash": settings.hash(),
        "seed": seed,
        "model": buffer.getvalue(),
        "replay": _replay(model),
        "env": [_layer_state(layer) for layer in layers(model)],
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),
        # these two are set anew when a model is loaded
        "action_space": model.action_space.np_random.bit_generator.state,
        "memory": getattr(model, "_last_lstm_states", None),
        "recorder": recorder,
    }
    content = io.BytesIO()
    torch.save(state, content)
    write_atomic(path, content.getvalue())


def load_checkpoint(path: Path, settings: Settings, seed: int) -> dict[str, Any]:
    """The content of a checkpoint. It is read with pickle, which can run code: load only your own.

    Parameters
    ----------
    path : Path
        File that `save_checkpoint` has written.
    settings : Settings
        Those that the training should have.
    seed : int
        Seed that the training should have.

    Returns
    -------
    dict
        What `restore_model` takes.

    Raises
    ------
    ConfigurationError
        Where the file is no checkpoint of this version, or one of another training.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=False)
    except Exception as error:  # whatever unpickling can raise
        raise ConfigurationError(f"{path} is not a checkpoint of this version: {error}") from error
    if not isinstance(state, dict) or state.get("schema") != SCHEMA:
        raise ConfigurationError(f"{path}: schema is not '{SCHEMA}'")
    if (state["settings_hash"], state["seed"]) != (settings.hash(), seed):
        raise ConfigurationError(
            f"{path} was trained with other settings (configuration {state['settings_hash']}, seed {state['seed']}); "
            f"asked for are {settings.hash()}, seed {seed}"
        )
    return state


def restore_model(state: dict[str, Any], settings: Settings, env: VecEnv) -> BaseAlgorithm:
    """The model of a checkpoint, at work in environments that are set to where they stood.

    Parameters
    ----------
    state : dict
        As of `load_checkpoint`.
    settings : Settings
        Those of the training.
    env : VecEnv
        As of `cable_envs.agents.train.training_env` for these settings. It is changed.

    Returns
    -------
    BaseAlgorithm
        Ready to go on.

    Notes
    -----
    The global generators of Python, NumPy and torch are set to where they stood, too.
    """
    model = settings.algorithm().load(io.BytesIO(state["model"]), env=env, device="cpu", force_reset=False)
    if state["replay"] is not None:
        for name, value in state["replay"].items():
            setattr(cast(OffPolicyAlgorithm, model).replay_buffer, name, value)
    for layer, kept in zip(layers(model), state["env"], strict=True):
        _restore_layer(layer, kept)
    model.action_space.np_random.bit_generator.state = state["action_space"]
    if state["memory"] is not None:
        cast(RecurrentPPO, model)._last_lstm_states = state["memory"]
    own, legacy, tensor = state["random"]
    random.setstate(own)
    np.random.set_state(legacy)
    torch.set_rng_state(tensor)
    return model


def _replay(model: BaseAlgorithm) -> dict[str, Any] | None:
    """What changes in a replay buffer: its arrays, and where it stands."""
    if not isinstance(model, OffPolicyAlgorithm) or model.replay_buffer is None:
        return None
    buffer = model.replay_buffer
    changing = {k: v for k, v in vars(buffer).items() if isinstance(v, np.ndarray)}
    return {**changing, "pos": buffer.pos, "full": buffer.full}


def _layer_state(layer: VecEnv) -> dict[str, Any]:
    if isinstance(layer, CableVecEnv):
        return layer.state()
    if isinstance(layer, VecFrameStack):
        return {"frames": layer.stacked_obs.stacked_obs.copy()}
    if isinstance(layer, VecNormalize):
        names = ("obs_rms", "ret_rms", "returns", "old_obs", "old_reward")
        return {name: getattr(layer, name) for name in names if hasattr(layer, name)}
    raise TypeError(f"a checkpoint does not know the wrapper {type(layer).__name__}")


def _restore_layer(layer: VecEnv, state: dict[str, Any]) -> None:
    if isinstance(layer, CableVecEnv):
        layer.restore(state)
    elif isinstance(layer, VecFrameStack):
        layer.stacked_obs.stacked_obs[...] = state["frames"]
    else:
        for name, value in state.items():
            setattr(layer, name, value)
