"""Saved policies: one zip file with the weights and what they were trained for.

The file is stable-baselines3's own (``PPO.load`` reads it) with a further entry, ``cable-policy.json``. Loading here
reads only that entry and the weights: nothing is unpickled, so a policy from a stranger cannot run code.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.crossq.policies import CrossQPolicy
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy

from cable_envs import FIRST_IDS, SUITE_IDS
from cable_envs.agents import archive
from cable_envs.agents.files import policy_file
from cable_envs.agents.settings import ALGORITHMS, Settings
from cable_envs.agents.shaping import Shaping
from cable_envs.agents.vec_env import observation_space
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import jsonable, write_atomic
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cable_envs.spaces import make_spaces

SCHEMA = "cable-policy/1"
ENTRY = "cable-policy.json"
SHAPING = ("observe", "action_mode", "control_period")
"""Environment options that decide what a policy sees and does; a policy is evaluated under those of its training."""


@dataclass(frozen=True)
class Metadata:
    """What a policy was trained for and with, as saved beside the weights.

    Attributes
    ----------
    name : str
        Name of the agent.
    env_id : str
        Environment id.
    seed : int
        Seed of the training.
    steps : int
        Environment steps charged.
    complete : bool
        False where the training was stopped before its steps were done.
    channels : tuple of str
        Observation channels in order.
    settings : mapping
        Fields of `cable_envs.agents.settings.Settings`.
    settings_hash : str
        Their hash.
    versions : mapping of str to str
        Versions of torch and stable_baselines3.
    curve : tuple of (float, float, float)
        Learning curve: environment steps, seconds of training, mean reward per step of the last episodes.
    normalization : mapping, optional
        "mean", "variance", "clip" and "epsilon" of VecNormalize for what the network sees. None: it sees the scaled
        observation.
    """

    name: str
    env_id: str
    seed: int
    steps: int
    complete: bool
    channels: tuple[str, ...]
    settings: Mapping[str, Any]
    settings_hash: str
    versions: Mapping[str, str]
    curve: tuple[tuple[float, float, float], ...] = ()
    normalization: Mapping[str, Any] | None = None

    @property
    def options(self) -> dict[str, Any]:
        """The environment options that shape observation and action."""
        return {k: v for k, v in self.settings["env_options"].items() if k in SHAPING}


@dataclass
class PolicyState:
    """What a policy remembers between two steps of n environments; `Policy.predict` changes it in place.

    Attributes
    ----------
    shaping : Shaping
        What lies between the environments and the network.
    frames : ndarray of float32, shape (n, frame_stack * channels)
        The last observations, the newest last.
    memory : Any
        Of a recurrent network.
    """

    shaping: Shaping
    frames: np.ndarray
    memory: Any = None


@dataclass(frozen=True)
class Policy:
    """A loaded policy; `predict` is what `cablebench.run.evaluate` asks for.

    Attributes
    ----------
    network : BasePolicy
        The network with its weights.
    metadata : Metadata
        What it was trained for and with.
    path : str
        Where it was loaded from.
    digest : str
        First 12 hex digits of the file's SHA-256.
    settings : Settings
        Those of the training.
    setup : Setup
        That of the environment with the policy's options.
    """

    network: BasePolicy
    metadata: Metadata
    path: str
    digest: str
    settings: Settings
    setup: Setup

    def predict(
        self,
        observation: np.ndarray,
        state: PolicyState | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, PolicyState]:
        """The action for an observation, to be asked once at every step of an episode.

        Parameters
        ----------
        observation : ndarray, shape (channels,) or (n, channels)
            As the environment gives it.
        state : PolicyState, optional
            As returned by the last call; it is changed in place. None: all environments begin an episode.
        episode_start : ndarray of bool, shape (n,), optional
            Where an episode begins; by default nowhere.
        deterministic : bool
            False draws from the distribution of actions.

        Returns
        -------
        action : ndarray, shape (actions,) or (n, actions)
            Within [-1, 1].
        state : PolicyState
            What to give to the next call.
        """
        rows = observation if observation.ndim == 2 else observation[None]
        if state is None:
            state, starts = self._fresh(len(rows)), np.ones(len(rows), dtype=bool)
        else:
            starts = np.zeros(len(rows), dtype=bool) if episode_start is None else np.asarray(episode_start, dtype=bool)
        seen = self._see(rows, state, starts)
        if deterministic and self._mean is not None:
            with torch.inference_mode():
                asked = self._mean(torch.from_numpy(seen)).numpy()
        else:
            asked, state.memory = self.network.predict(
                seen, state=state.memory, episode_start=starts, deterministic=deterministic
            )
        action = state.shaping.apply(asked)
        return (action if observation.ndim == 2 else action[0]), state

    @cached_property
    def _mean(self) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """The network's deterministic action without the distribution around it, five times as fast; None: unknown."""
        network = self.network
        if isinstance(network, RecurrentActorCriticPolicy):
            return None
        if isinstance(network, ActorCriticPolicy):
            return lambda seen: network.action_net(network.mlp_extractor.forward_actor(seen))
        if isinstance(network, TD3Policy):
            return network.actor.mu
        if isinstance(network, (SACPolicy, TQCPolicy, CrossQPolicy)):
            return lambda seen: torch.tanh(network.actor.mu(network.actor.latent_pi(seen)))
        return None

    def _fresh(self, n: int) -> PolicyState:
        shaping = self.settings.shaping(self.setup, n)
        width = len(self.setup.channels) + len(shaping.extra_channels)
        return PolicyState(shaping, np.zeros((n, self.settings.frame_stack * width), dtype=np.float32))

    def _see(self, rows: np.ndarray, state: PolicyState, starts: np.ndarray) -> np.ndarray:
        """What the network gets: shaped, stacked as VecFrameStack does, normalised as VecNormalize does."""
        if starts.all():
            state.shaping.begin(rows)
        elif not starts.any():
            state.shaping.advance(rows)
        else:
            first, going = np.flatnonzero(starts), np.flatnonzero(~starts)
            state.shaping.advance(rows[going], going)
            state.shaping.begin(rows[first], first)
        seen = state.shaping.view(rows)
        if self.settings.frame_stack > 1:
            width = seen.shape[1]
            state.frames[:, :-width] = state.frames[:, width:]
            state.frames[starts] = 0.0
            state.frames[:, -width:] = seen
            seen = state.frames
        if self.metadata.normalization is None:
            return seen
        mean, deviation, clip = self._statistics
        return np.clip((seen - mean) / deviation, -clip, clip).astype(np.float32)

    @cached_property
    def _statistics(self) -> tuple[np.ndarray, np.ndarray, float]:
        n = self.metadata.normalization
        assert n is not None, "asked for where nothing is normalised"
        return np.array(n["mean"]), np.sqrt(np.array(n["variance"]) + n["epsilon"]), n["clip"]

    @property
    def steps(self) -> int:
        """Environment steps charged."""
        return self.metadata.steps


def save_policy(model: BaseAlgorithm, metadata: Metadata, path: str | Path) -> Path:
    """Write model and metadata, whole or not at all.

    Parameters
    ----------
    model : BaseAlgorithm
        Its weights are saved, and all that stable-baselines3 saves with them.
    metadata : Metadata
        What it was trained for and with.
    path : str or Path
        File to write or to replace.

    Returns
    -------
    Path
        The file.
    """
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as packed:
        packed.writestr(ENTRY, json.dumps(jsonable({"schema": SCHEMA, **asdict(metadata)}), indent=1))
    return write_atomic(path, buffer.getvalue())


NOT_ACTING = (
    "critic", "critic_target", "actor_target", "value_net", "mlp_extractor.value_net", "lstm_critic",
    "vf_features_extractor",
)  # fmt: skip
"""First parts of the names of weights that only training needs."""


def load_policy(path: str | Path) -> Policy:
    """A policy from a file, or from the folder of a training.

    Parameters
    ----------
    path : str or Path
        A policy.zip, or the folder that holds one.

    Returns
    -------
    Policy
        With ``predict`` as stable-baselines3's, and its `Metadata`.

    Raises
    ------
    ConfigurationError
        Where there is none, where it is no such file, and where the environment has other observation channels now than
        when it was trained.
    """
    file = policy_file(path)
    content, metadata = read_policy(file)
    try:
        settings, setup, network = _network(file, metadata)
    except ConfigurationError as error:
        text = str(error)
        raise ConfigurationError(text if text.startswith(str(file)) else f"{file}: {text}") from None
    except Exception as error:  # stable-baselines3 takes whatever the settings say
        text = " ".join(str(error)[:300].split())
        raise ConfigurationError(
            f"{file}: no network can be made of its settings: {type(error).__name__}: {text}"
        ) from None
    found = archive.weights(file, content)
    try:
        missing, unknown = network.load_state_dict(found, strict=False)
    except RuntimeError as error:
        text = " ".join(str(error)[:300].split())
        raise ConfigurationError(f"{file}: the weights do not fit the network of its settings: {text}") from None
    wrong = [*unknown, *(name for name in missing if not name.startswith(NOT_ACTING))]
    if wrong:
        raise ConfigurationError(f"{file}: the weights do not fit the network of its settings: {', '.join(wrong[:3])}")
    network.set_training_mode(False)
    return Policy(network, metadata, str(path), hashlib.sha256(content).hexdigest()[:12], settings, setup)


def _network(file: Path, metadata: Metadata) -> tuple[Settings, Setup, BasePolicy]:
    """Settings of the training, setup of the environment, and the network, still without its weights."""
    settings = Settings(**metadata.settings)
    archive.check_size(file, settings.policy_kwargs)
    setup = setup_of(metadata.env_id, metadata.options)
    shaping = settings.shaping(setup, 1)
    channels = (*(c.name for c in setup.channels), *shaping.extra_channels)
    if channels != metadata.channels:
        raise ConfigurationError(
            f"{file} was trained on the channels {', '.join(metadata.channels)}; "
            f"{metadata.env_id} has {', '.join(channels)}"
        )
    if metadata.normalization is not None:
        width = settings.frame_stack * len(channels)
        for key in ("mean", "variance"):
            if len(metadata.normalization[key]) != width:
                raise ConfigurationError(f"{file}: normalization.{key} must hold {width} numbers")
    kind = settings.algorithm().policy_aliases[settings.policy]
    torch.set_num_threads(1)  # a network this small is slower on several
    seen, action = observation_space(setup, shaping), make_spaces(setup)[1]
    if settings.frame_stack > 1:
        seen = spaces.Box(np.tile(seen.low, settings.frame_stack), np.tile(seen.high, settings.frame_stack))
    return settings, setup, kind(seen, action, lambda remaining: 0.0, **settings.policy_arguments())


def read_policy(file: Path) -> tuple[bytes, Metadata]:
    """The content of a policy's file, without making its network.

    Parameters
    ----------
    file : Path
        A policy.zip.

    Returns
    -------
    content : bytes
        The whole file.
    metadata : Metadata
        What the policy was trained for and with.

    Raises
    ------
    ConfigurationError
        Where it is no policy that `save_policy` or `publish_policy` has written, or one with unknown settings.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"cannot read {file}: {error.strerror or error}") from None
    data = archive.mapping(file, archive.entry(file, content, ENTRY, archive.LARGEST_TEXT), ENTRY)
    if data.pop("schema", None) != SCHEMA:
        raise ConfigurationError(f"{file}: schema is not '{SCHEMA}'")
    fields = Metadata.__dataclass_fields__
    require_known(f"key in the metadata of {file}", data, fields)
    missing = [key for key, field in fields.items() if key not in data and field.default is MISSING]
    if missing:
        raise ConfigurationError(f"{file}: missing {', '.join(missing)}")
    archive.check_metadata(file, data)
    data["channels"] = tuple(data["channels"])
    data["curve"] = tuple(tuple(point) for point in data.get("curve", ()))
    metadata = Metadata(**data)
    require_known(f"key of the settings in {file}", metadata.settings, Settings.__dataclass_fields__)
    algorithm = metadata.settings.get("algorithm_name") or metadata.settings.get("algo")
    require_known(f"algorithm in {file}", [str(algorithm)], ALGORITHMS)
    require_known(f"environment in {file}", [metadata.env_id], FIRST_IDS + SUITE_IDS)
    return content, metadata
