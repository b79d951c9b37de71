"""Saved policies: one zip file with the weights and what they were trained for.

The file is stable-baselines3's own (``PPO.load`` reads it) with a further entry, ``cable-policy.json``. Loading here
reads only that entry and the weights: nothing is unpickled, so a policy from a stranger cannot run code.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy

from agents.settings import ALGORITHMS, Settings
from agents.smoothing import Smoothing
from cable_envs.envs import make_spaces
from cable_envs.errors import ConfigurationError, require_known
from cablebench.evaluate import setup_of
from cablebench.store import jsonable, write_atomic

SCHEMA = "cable-policy/1"
ENTRY = "cable-policy.json"
FILE = "policy.zip"
"""Name of the file in a training's folder."""

SHAPING = ("observe", "action_mode", "control_period")
"""Environment options that decide what a policy sees and does; a policy is evaluated under those of its training."""


@dataclass(frozen=True)
class Metadata:
    """What a policy was trained for and with, as saved beside the weights."""

    name: str
    env_id: str
    seed: int
    steps: int
    """environment steps charged"""
    complete: bool
    """False where the training was stopped before its steps were done"""
    channels: tuple[str, ...]
    """observation channels in order"""
    settings: Mapping[str, Any]
    settings_hash: str
    versions: Mapping[str, str]
    curve: tuple[tuple[float, float, float], ...] = ()
    """learning curve: (environment steps, s of training, mean reward per step of the last episodes)"""

    @property
    def options(self) -> dict[str, Any]:
        """The environment options that shape observation and action."""
        return {k: v for k, v in self.settings["env_options"].items() if k in SHAPING}


@dataclass(frozen=True)
class Policy:
    """A loaded policy; `predict` is what `cablebench.evaluate` asks for."""

    network: BasePolicy
    metadata: Metadata
    path: str
    digest: str
    """first 12 hex digits of the file's SHA-256"""
    smoothing: Smoothing

    def predict(
        self,
        observation: np.ndarray,
        state: np.ndarray | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(action, state) for observation [channels] or [n, channels]; action and state are [1] or [n, 1] in [-1, 1].

        The state is the last action, of which a policy trained with smoothing keeps a share; None, or where
        ``episode_start`` is true, the action at rest is taken, which the first observation shows.
        """
        action, _ = self.network.predict(observation, deterministic=deterministic)
        rest = self.smoothing.rest(observation)
        if state is None:
            state = rest
        elif episode_start is not None and np.any(episode_start):
            state = np.where(np.reshape(episode_start, np.shape(rest)), rest, state)
        action = self.smoothing.blend(state, action)
        return action, action

    @property
    def steps(self) -> int:
        """Environment steps charged."""
        return self.metadata.steps


def save_policy(model: BaseAlgorithm, metadata: Metadata, path: str | Path) -> Path:
    """Write model and metadata to ``path``, whole or not at all."""
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(ENTRY, json.dumps(jsonable({"schema": SCHEMA, **asdict(metadata)}), indent=1))
    return write_atomic(path, buffer.getvalue())


def load_policy(path: str | Path) -> Policy:
    """The policy in a file, or in the folder of a training run.

    Raises ConfigurationError where there is none, where it is no such file, and where the environment has other
    observation channels now than when it was trained.
    """
    file = policy_file(path)
    content, metadata = read_policy(file)
    settings = Settings(**metadata.settings)
    setup = setup_of(metadata.env_id, metadata.options)
    channels = tuple(c.name for c in setup.channels)
    if channels != metadata.channels:
        raise ConfigurationError(
            f"{file} was trained on the channels {', '.join(metadata.channels)}; "
            f"{metadata.env_id} has {', '.join(channels)}"
        )
    kind = settings.algorithm().policy_aliases[settings.policy]
    torch.set_num_threads(1)  # a network this small is slower on several
    network = kind(*make_spaces(setup), lambda remaining: 0.0, **settings.policy_arguments())
    with zipfile.ZipFile(io.BytesIO(content)) as archive, archive.open("policy.pth") as weights:
        network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
    network.set_training_mode(False)
    smoothing = Smoothing.of(setup, settings.smoothing)
    return Policy(network, metadata, str(path), hashlib.sha256(content).hexdigest()[:12], smoothing)


def policy_file(path: str | Path) -> Path:
    """``path`` itself, or policy.zip in it; ConfigurationError where there is none."""
    given = Path(path)
    file = given / FILE if given.is_dir() else given
    if not file.is_file():
        raise ConfigurationError(f"no policy at {path}; `cablebench train` writes {FILE} to the folder named by --out")
    return file


def read_policy(file: Path) -> tuple[bytes, Metadata]:
    """(content of the file, its metadata); ConfigurationError where it is no policy of ours."""
    content = file.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            data = json.loads(archive.read(ENTRY))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ConfigurationError(f"{file} is not a policy saved by `cablebench train`: {error}") from error
    if data.pop("schema", None) != SCHEMA:
        raise ConfigurationError(f"{file}: schema is not '{SCHEMA}'")
    fields = Metadata.__dataclass_fields__
    require_known(f"key in the metadata of {file}", data, fields)
    missing = [key for key in fields if key not in data]
    if missing:
        raise ConfigurationError(f"{file}: missing {', '.join(missing)}")
    data["channels"] = tuple(data["channels"])
    data["curve"] = tuple(tuple(point) for point in data["curve"])
    metadata = Metadata(**data)
    require_known(f"algorithm in {file}", [metadata.settings.get("algo")], ALGORITHMS)
    return content, metadata
