"""How to train: one YAML file for each agent (configs/agents/), keys as in RL Baselines3 Zoo.

```yaml
algorithm: ppo                      # default: the file's name
default:                            # holds for every environment id
  n_envs: 64
  n_timesteps: 2.0e+6
  policy: MlpPolicy
  learning_rate: lin_1.0e-3         # falls linearly to 0 over the training
  policy_kwargs: {net_arch: [64, 64], activation_fn: tanh, log_std_init: -1.0}
  frame_stack: 4                    # the last four observations
  normalize: true                   # running statistics, saved with the policy; or {norm_reward: false, ...}
  noise_type: normal                # exploration of TD3, with noise_std
  # not in the Zoo:
  smoothing: 0.9                    # share of the last action that is kept (agents/shaping.py)
  first_frame: true                 # the measurements at the start of the episode stay in view
  residual: {controller: mrac-g22, share: 0.2}       # learn a correction of that controller's action
  curriculum: {randomize: [0.0, 0.5]}                # randomisation grows from none to whole between these shares
  env_options: {sensor_noise: true, randomize: true}
  stagger: true                     # spread the environments over the episode
  tuning_trials: 25                 # charged on the board
cable_envs/CableHole-Position-Sine-v0:
  gamma: 0.98                       # changes that key for this id (mappings key by key)
search: {...}                       # what `cablebench tune` varies
```
"""

import inspect
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise

from cable_envs import FIRST_IDS, SUITE_IDS
from cable_envs.agents import checks
from cable_envs.agents.files import settings_file
from cable_envs.agents.shaping import Residual, Shaping
from cable_envs.baselines import controller_class
from cable_envs.core.config import config_names, configuration_hash, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.file_options import check_options_of_file
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup


def _algorithms() -> dict[str, type[BaseAlgorithm]]:
    kinds = {**vars(stable_baselines3), **vars(sb3_contrib)}.values()
    found = {_settings_name(kind): kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseAlgorithm)}
    return {name: found[name] for name in config_names("agents") if name in found}


def _settings_name(kind: type[BaseAlgorithm]) -> str:
    """What an algorithm is called in files: "recurrent-ppo" for RecurrentPPO, "crossq" for CrossQ."""
    return re.sub(r"(?<=[a-z])(?=[A-Z]{2})", "-", kind.__name__).lower()


ALGORITHMS: Mapping[str, type[BaseAlgorithm]] = _algorithms()
"""Name in a settings file -> class of stable-baselines3 or sb3-contrib: all that have a file in configs/agents/."""

NOISES = {"normal": NormalActionNoise, "ornstein-uhlenbeck": OrnsteinUhlenbeckActionNoise}

ACTIVATIONS: Mapping[str, type[torch.nn.Module]] = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}

_OWN = (
    "n_envs", "n_timesteps", "policy", "policy_kwargs", "env_options", "stagger", "smoothing", "tuning_trials",
    "frame_stack", "first_frame", "normalize", "noise_type", "noise_std", "residual", "curriculum",
)  # fmt: skip
_NOT_FOR_FILES = {
    "self", "env", "seed", "device", "verbose", "tensorboard_log", "_init_setup_model", "action_noise", *_OWN,
}  # fmt: skip
_MAPPINGS = ("policy_kwargs", "env_options", "residual", "curriculum")


@dataclass(frozen=True)
class Settings:
    """Everything but the seed that decides a training run.

    Attributes
    ----------
    algo : str
        Name of the agent: on boards, and of its file.
    env_id : str
        Environment id.
    n_envs : int
        Environments that are stepped together.
    n_timesteps : int
        Steps of the training, summed over the environments.
    policy : str
        stable-baselines3's name of the network.
    policy_kwargs : mapping
        Arguments of the network, as in the file.
    learner : mapping
        Arguments of the algorithm's class, as in the file.
    env_options : mapping
        Options of the environment.
    stagger : bool
        Whether first episodes are cut short so that the environments spread over the episode
        (`cable_envs.agents.vec_env.CableVecEnv`).
    smoothing : float
        Share of the last action that is kept at every step (`cable_envs.agents.shaping`), in [0, 1).
    tuning_trials : int
        Trainings that were tried to find these settings; charged to the agent on the board.
    algorithm_name : str
        Name in `ALGORITHMS`; empty: ``algo``.
    first_frame : bool
        Whether the measurements at the start of the episode stay in view.
    frame_stack : int
        Observations that the network sees: the present one and those before it, zeros before an episode.
    normalize : mapping
        Keys of `cable_envs.agents.checks.NORMALIZE`; empty: the task's own scales.
    noise_type : str
        Exploration noise on actions, a key of `NOISES`; empty: none.
    noise_std : float
        Its standard deviation (for Ornstein-Uhlenbeck noise sigma), where actions are in [-1, 1].
    residual : mapping
        Fields of `cable_envs.agents.shaping.Residual`; empty: the agent acts alone.
    curriculum : mapping
        ``{"randomize": [first, last]}``: the ranges of the randomisation open between these shares of the training;
        empty: they are whole from the start.
    """

    algo: str
    env_id: str
    n_envs: int
    n_timesteps: int
    policy: str = "MlpPolicy"
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    learner: Mapping[str, Any] = field(default_factory=dict)
    env_options: Mapping[str, Any] = field(default_factory=dict)
    stagger: bool = True
    smoothing: float = 0.0
    tuning_trials: int = 0
    algorithm_name: str = ""
    first_frame: bool = False
    frame_stack: int = 1
    normalize: Mapping[str, Any] = field(default_factory=dict)
    noise_type: str = ""
    noise_std: float = 0.1
    residual: Mapping[str, Any] = field(default_factory=dict)
    curriculum: Mapping[str, Any] = field(default_factory=dict)

    def hash(self) -> str:
        """Twelve hex digits that change with any setting."""
        return configuration_hash(asdict(self))

    def env_seeds(self, seed: int) -> range:
        """Seeds that the environments start from under a training seed: those of two training seeds differ."""
        return range(seed * self.n_envs, (seed + 1) * self.n_envs)

    def algorithm(self) -> type[BaseAlgorithm]:
        """The class from stable-baselines3 or sb3-contrib."""
        return ALGORITHMS[self.algorithm_name or self.algo]

    @property
    def information(self) -> str:
        """What the agent was told: a residual agent knows what its controller knows."""
        return controller_class(self.residual["controller"]).information if self.residual else "model-free"

    def correction(self) -> Residual | None:
        """The `Residual`, or None where the agent acts alone."""
        return Residual(**self.residual) if self.residual else None

    def shaping(self, setup: Setup, n: int) -> Shaping:
        """What lies between environments and the network.

        Parameters
        ----------
        setup : Setup
            What defines the environments.
        n : int
            Number of environments.

        Returns
        -------
        Shaping
            With nothing remembered yet.
        """
        return Shaping(setup, n, self.smoothing, self.correction(), self.first_frame)

    def spread(self, progress: float) -> float:
        """Share of the randomisation ranges that episodes are drawn from.

        Parameters
        ----------
        progress : float
            Share of the training that is done.

        Returns
        -------
        float
            Rises linearly from 0 to 1 over the ``curriculum``; 1 without one.
        """
        if not self.curriculum:
            return 1.0
        first, last = self.curriculum["randomize"]
        return float(np.clip((progress - first) / max(last - first, 1e-9), 0.0, 1.0)) if progress < last else 1.0

    def arguments(self) -> dict[str, Any]:
        """`learner` as the class takes it: "lin_" values become schedules."""
        found = {key: _schedule(key, value) for key, value in self.learner.items()}
        if self.noise_type:
            found["action_noise"] = NOISES[self.noise_type](np.zeros(1), np.full(1, self.noise_std))
        return found

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
    if not isinstance(value, str) or value.split("_")[0] == "auto":  # SAC's ent_coef: auto, auto_0.1
        return value
    text = value.removeprefix("lin_")
    try:
        number = float(text)
    except ValueError:
        raise ConfigurationError(f"{key}: expected a number or lin_<number>, got '{value}'") from None
    return Linear(number) if value.startswith("lin_") else number


def load_settings(
    algo: str,
    env_id: str,
    n_timesteps: int | None = None,
    env_options: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Settings:
    """Settings of an agent for an environment, from its file.

    Parameters
    ----------
    algo : str
        Name of a file in configs/agents (`agent_names`), or path of a YAML file.
    env_id : str
        Environment id, whose section of the file is laid over the default.
    n_timesteps : int, optional
        Replaces the file's.
    env_options : mapping, optional
        Added to the file's.
    changes : mapping, optional
        Keys of the file (mappings key by key) for this call only.

    Returns
    -------
    Settings

    Raises
    ------
    ConfigurationError
        For unknown agents and keys, with the nearest, and for values that cannot be.

    Examples
    --------
    >>> settings = load_settings("ppo", "cable_envs/CableHole-Position-Sine-v0", n_timesteps=5000)
    >>> settings.n_timesteps, settings.algorithm().__name__
    (5000, 'PPO')
    """
    path = settings_file(algo)
    data = read_yaml(path)
    require_known(f"key in {path.name}", data, ("algorithm", "default", "search", *FIRST_IDS, *SUITE_IDS))
    merged: dict[str, Any] = {}
    for part in (data.get("default") or {}, data.get(env_id) or {}, changes or {}):
        check_options_of_file(part.get("env_options") or {}, f"env_options in {path.name}")
        nested = {k: {**(merged.get(k) or {}), **(part[k] or {})} for k in _MAPPINGS if k in part}
        merged |= {**part, **nested}
    merged["env_options"] = {**(merged.get("env_options") or {}), **(env_options or {})}
    if n_timesteps is not None:
        merged["n_timesteps"] = checks.count("steps", n_timesteps)
    return make_settings(path.stem, env_id, merged, path.name, str(data.get("algorithm") or ""))


def make_settings(
    algo: str, env_id: str, data: Mapping[str, Any], source: str = "settings", algorithm: str = ""
) -> Settings:
    """Checked settings from the keys of a file.

    Parameters
    ----------
    algo : str
        The agent's name.
    env_id : str
        Environment id.
    data : mapping
        Keys as in the file.
    source : str
        What errors call the file.
    algorithm : str
        Name in `ALGORITHMS` where ``algo`` is another one.

    Returns
    -------
    Settings

    Raises
    ------
    ConfigurationError
        Names ``source`` and the key.
    """
    require_known(f"algorithm in {source}", [algorithm or algo], ALGORITHMS)
    kind = ALGORITHMS[algorithm or algo]
    allowed = [*_OWN, *(set(inspect.signature(kind.__init__).parameters) - _NOT_FOR_FILES)]
    require_known(f"key in {source}", data, allowed)
    corrected, behind = checks.residual(data.get("residual"), env_id)
    settings = Settings(
        algo=algo,
        env_id=env_id,
        n_envs=checks.count("n_envs", data.get("n_envs", 1)),
        n_timesteps=checks.count("n_timesteps", data.get("n_timesteps", 0)),
        policy=str(data.get("policy", "MlpPolicy")),
        policy_kwargs=dict(data.get("policy_kwargs") or {}),
        learner={k: v for k, v in data.items() if k not in _OWN},
        env_options=dict(data.get("env_options") or {}),
        stagger=bool(data.get("stagger", True)),
        smoothing=checks.share("smoothing", data.get("smoothing", 0.0)),
        tuning_trials=checks.count("tuning_trials", data.get("tuning_trials", 0), 0) + behind,
        algorithm_name=algorithm,
        first_frame=bool(data.get("first_frame", False)),
        frame_stack=checks.count("frame_stack", data.get("frame_stack", 1)),
        normalize=checks.normalize(data.get("normalize", False)),
        noise_type=str(data.get("noise_type") or ""),
        noise_std=checks.positive("noise_std", data.get("noise_std", 0.1)),
        residual=corrected,
        curriculum=checks.curriculum(data.get("curriculum")),
    )
    if settings.noise_type:
        require_known("noise_type", [settings.noise_type], NOISES)
    settings.arguments()
    settings.policy_arguments()
    require_known(f"policy in {source}", [settings.policy], kind.policy_aliases)
    return _observing(settings)


def _observing(settings: Settings) -> Settings:
    """With a base controller that needs to observe more than the task's default: the option that shows it."""
    if not settings.residual:
        return settings
    setup = setup_of(settings.env_id, settings.env_options)
    kind = controller_class(settings.residual["controller"])
    kind.check_case(setup.plant.name, setup.action_mode.name, setup.task.kind)
    if "observe" in settings.env_options or kind.levels[setup.plant.name] == setup.task.observe:
        return settings
    return replace(settings, env_options={**settings.env_options, "observe": kind.levels[setup.plant.name]})
