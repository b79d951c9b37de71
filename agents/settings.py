"""How to train: one YAML file for each algorithm (configs/agents/), keys as in RL Baselines3 Zoo.

```yaml
default:                            # holds for every environment id
  n_envs: 64
  n_timesteps: 2.0e+6
  policy: MlpPolicy
  learning_rate: lin_1.0e-3         # falls linearly to 0 over the training
  policy_kwargs: {net_arch: [64, 64], activation_fn: tanh, log_std_init: -1.0}
cable_envs/CableHole-Position-Sine-v0:
  gamma: 0.98                       # changes that key for this id (policy_kwargs key by key)
```
"""

import inspect
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

from cable_envs.config import config_path, read_yaml
from cable_envs.errors import ConfigurationError, require_known
from cablebench.protocol import configuration_hash

ALGORITHMS: Mapping[str, type[BaseAlgorithm]] = {"ppo": PPO}
"""Name on the command line -> class; another algorithm is one entry here and its file in configs/agents/."""

ACTIVATIONS: Mapping[str, type[torch.nn.Module]] = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}

_OWN = ("n_envs", "n_timesteps", "policy", "policy_kwargs", "env_options", "stagger", "smoothing", "tuning_trials")
_NOT_FOR_FILES = {"self", "env", "seed", "device", "verbose", "tensorboard_log", "_init_setup_model", *_OWN}


@dataclass(frozen=True)
class Settings:
    """Everything but the seed that decides a training run."""

    algo: str
    env_id: str
    n_envs: int
    n_timesteps: int
    policy: str = "MlpPolicy"
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    learner: Mapping[str, Any] = field(default_factory=dict)
    """arguments of the algorithm's class, as in the file"""
    env_options: Mapping[str, Any] = field(default_factory=dict)
    stagger: bool = True
    """whether first episodes are cut short so that the environments spread over the episode (see `CableVecEnv`)"""
    smoothing: float = 0.0
    """share of the last action that is kept at every step (see `CableVecEnv`)"""
    tuning_trials: int = 0
    """trainings that were tried to find these settings; charged to the agent on the board"""

    def hash(self) -> str:
        """Twelve hex digits that change with any setting."""
        return configuration_hash(asdict(self))

    def algorithm(self) -> type[BaseAlgorithm]:
        """The class from stable-baselines3."""
        return ALGORITHMS[self.algo]

    def arguments(self) -> dict[str, Any]:
        """`learner` as the class takes it: "lin_" values become schedules."""
        return {key: _schedule(key, value) for key, value in self.learner.items()}

    def policy_arguments(self) -> dict[str, Any]:
        """`policy_kwargs` as the policy's class takes them: the activation by class."""
        arguments = dict(self.policy_kwargs)
        if "activation_fn" in arguments:
            name = arguments["activation_fn"]
            require_known("activation_fn", [name], ACTIVATIONS)
            arguments["activation_fn"] = ACTIVATIONS[name]
        return arguments


@dataclass(frozen=True)
class Linear:
    """A value that falls linearly from ``start`` to 0 over the training; called with the share that remains."""

    start: float

    def __call__(self, remaining: float) -> float:
        return self.start * remaining


def _schedule(key: str, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = value.removeprefix("lin_")
    try:
        number = float(text)
    except ValueError:
        raise ConfigurationError(f"{key}: expected a number or lin_<number>, got '{value}'") from None
    return Linear(number) if value.startswith("lin_") else number


def load_settings(
    algo: str, env_id: str, n_timesteps: int | None = None, env_options: Mapping[str, Any] | None = None
) -> Settings:
    """The settings in configs/agents/<algo>.yaml for ``env_id``.

    ``n_timesteps`` replaces the file's; ``env_options`` are added to the file's.
    Raises ConfigurationError for unknown algorithms and keys, with the nearest name.
    """
    require_known("algorithm", [algo], ALGORITHMS)
    path = config_path("agents", f"{algo}.yaml")
    data = read_yaml(path)
    merged: dict[str, Any] = {}
    for part in (data.get("default") or {}, data.get(env_id) or {}):
        nested = {k: {**merged.get(k, {}), **part[k]} for k in ("policy_kwargs", "env_options") if k in part}
        merged |= {**part, **nested}
    settings = make_settings(algo, env_id, merged, path.name)
    changes: dict[str, Any] = {"env_options": {**settings.env_options, **(env_options or {})}}
    if n_timesteps is not None:
        changes["n_timesteps"] = _count("steps", n_timesteps)
    return Settings(**{**asdict(settings), **changes})


def make_settings(algo: str, env_id: str, data: Mapping[str, Any], source: str = "settings") -> Settings:
    """Checked `Settings` from the keys of a file. Raises ConfigurationError that names ``source`` and the key."""
    allowed = [*_OWN, *(set(inspect.signature(ALGORITHMS[algo].__init__).parameters) - _NOT_FOR_FILES)]
    require_known(f"key in {source}", data, allowed)
    settings = Settings(
        algo=algo,
        env_id=env_id,
        n_envs=_count("n_envs", data.get("n_envs", 1)),
        n_timesteps=_count("n_timesteps", data.get("n_timesteps", 0)),
        policy=str(data.get("policy", "MlpPolicy")),
        policy_kwargs=dict(data.get("policy_kwargs") or {}),
        learner={k: v for k, v in data.items() if k not in _OWN},
        env_options=dict(data.get("env_options") or {}),
        stagger=bool(data.get("stagger", True)),
        smoothing=_share("smoothing", data.get("smoothing", 0.0)),
        tuning_trials=_count("tuning_trials", data.get("tuning_trials", 0), 0),
    )
    settings.arguments()
    settings.policy_arguments()
    require_known(f"policy in {source}", [settings.policy], ALGORITHMS[algo].policy_aliases)
    return settings


def _share(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < 1.0:
        raise ConfigurationError(f"{name}: expected a number in [0, 1), got {value!r}")
    return float(value)


def _count(name: str, value: Any, least: int = 1) -> int:
    """A whole number; YAML's 2.0e+6 and 2e6 (a string in YAML 1.1) count as whole."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = 0.5
    if isinstance(value, bool) or not number.is_integer() or number < least:
        raise ConfigurationError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    return round(number)
