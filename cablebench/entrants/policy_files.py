"""Policy files: a short YAML that enters one saved policy, where the policy's own file does not say everything.

```yaml
schema: cable-policy-file/1
name: my-sac                          # as on the board
policy: policy.zip                    # beside this file: of `cablebench train`, or of stable-baselines3's model.save()
information: model-free               # optional; model-free without it
charged: {environment_steps: 2000000} # optional for a policy of `cablebench train`, which knows what it was charged
# for a file of stable-baselines3 alone, whose own description would have to be unpickled:
env: CableHole-Position-Sine          # the environment it was trained for
algo: sac                             # stable-baselines3's name of the algorithm
seed: 0                               # training seed
policy_kwargs: {net_arch: [64, 64], activation_fn: tanh}
options: {observe: output}            # observe and action_mode, nothing else: the rest is the protocol's
```

A network of any library as ONNX (`cablebench.entrants.onnx_policies`), one input of observations [n, channels], the
actions [n, 1] in [-1, 1] as its first output, both float32:

```yaml
schema: cable-policy-file/1
name: my-network
policy: network.onnx
env: CableHole-Position-Sine          # without it: wherever the observation has as many channels as the network takes
charged: {environment_steps: 2000000}
options: {observe: output, action_mode: tension}
history: 4                            # observations side by side, the newest last; 1 without it
padding: first                        # before the first observation: first (that one again) or zero
normalization: {mean: [0.0, ...], std: [1.0, ...], clip: 10.0}  # of each channel, before they are put side by side
```

Only weights are read (``torch.load(..., weights_only=True)``): nothing is unpickled, an ONNX file with anything but
operators of the standard is refused, and ``options`` cannot name a file that is run, so such a policy cannot run code.
A pickled normaliser (``vecnormalize.pkl``) and TorchScript are not read for that reason.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number
from cablebench.entrants.entrant import BUDGETS, INFORMATION, check_choices
from cablebench.entrants.onnx_policies import PADDINGS, SUFFIX, Sight
from cablebench.protocol.protocol import Task

SCHEMA = "cable-policy-file/1"
_KEYS = (
    "schema",
    "name",
    "policy",
    "information",
    "charged",
    "env",
    "algo",
    "seed",
    "policy_kwargs",
    "options",
    "note",
    "history",
    "padding",
    "normalization",
)


@dataclass(frozen=True)
class PolicyFile:
    """The checked content of a policy file."""

    name: str
    policy: Path
    information: str = "model-free"
    charged: Mapping[str, float] = field(default_factory=dict)
    env_id: str = ""
    """empty: the policy's own file says it"""
    algo: str = ""
    seed: int = 0
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    sight: Sight = field(default_factory=Sight)
    """of an ONNX file only"""

    @property
    def onnx(self) -> bool:
        """Whether it names an ONNX file."""
        return self.policy.suffix == SUFFIX


def load_policy_file(path: str | Path) -> PolicyFile:
    """Read and check a policy file. Raises ConfigurationError that names the file and the key."""
    import cable_envs

    path = Path(path)
    data = read_yaml(path)
    require_known(f"key in {path}", data, _KEYS)
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"{path}: schema {data.get('schema')!r}; expected '{SCHEMA}'")
    policy = _weights(path, data)
    information = str(data.get("information") or "model-free")
    require_known(f"information class in {path}", [information], INFORMATION)
    charged = _charged(path, data)
    foreign = [key for key in ("env", "algo") if data.get(key)]
    if policy.suffix == SUFFIX:
        _refuse(path, data, ("algo", "policy_kwargs"), f"belongs to a .zip of stable-baselines3, not to {policy.name}")
    else:
        _refuse(
            path, data, ("history", "padding", "normalization"), f"belongs to an {SUFFIX} file, not to {policy.name}"
        )
    if len(foreign) == 1 and policy.suffix != SUFFIX:
        raise ConfigurationError(f"{path}: 'env' and 'algo' belong together; only '{foreign[0]}' is there")
    known = cable_envs.FIRST_IDS + cable_envs.SUITE_IDS
    env_id = {Task(e).short: e for e in known}.get(str(data.get("env")), str(data.get("env") or ""))
    require_known(f"environment in {path}", filter(None, [env_id]), known)
    if foreign and "environment_steps" not in charged:
        raise ConfigurationError(f"{path}: charged.environment_steps is missing: what did the training take?")
    seed = data.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise ConfigurationError(f"{path}: seed = {seed!r}; expected a whole number")
    options = _mapping(path, data, "options")
    check_choices(options, str(path))
    return PolicyFile(
        data["name"].strip(), policy, information, charged, env_id, str(data.get("algo") or ""), seed,
        _mapping(path, data, "policy_kwargs"), options, _sight(path, data),
    )  # fmt: skip


def _refuse(path: Path, data: Mapping[str, Any], keys: tuple[str, ...], reason: str) -> None:
    for key in keys:
        if data.get(key):
            raise ConfigurationError(f"{path}: '{key}' {reason}, not to {data['policy']}")


def _sight(path: Path, data: Mapping[str, Any]) -> Sight:
    """What an ONNX file's network sees."""
    history, padding = data.get("history", 1), data.get("padding", PADDINGS[0])
    if isinstance(history, bool) or not isinstance(history, int) or not 1 <= history <= 1000:
        raise ConfigurationError(f"{path}: history = {history!r}; expected a whole number from 1 to 1000")
    require_known(f"padding in {path}", [str(padding)], PADDINGS)
    given = _mapping(path, data, "normalization")
    require_known(f"key of normalization in {path}", given, ("mean", "std", "clip"))
    if not given:
        return Sight(history, padding)
    for key in ("mean", "std"):
        values = given.get(key)
        if not isinstance(values, list) or not values or not all(map(is_number, values)):
            raise ConfigurationError(f"{path}: normalization.{key} must be a list of numbers, found {values!r}")
    if len(given["mean"]) != len(given["std"]) or min(given["std"]) <= 0.0:
        raise ConfigurationError(f"{path}: normalization.std must be as long as mean, and above 0")
    clip = given.get("clip")
    if clip is not None and (not is_number(clip) or clip <= 0):
        raise ConfigurationError(f"{path}: normalization.clip = {clip!r}; expected a number above 0")
    return Sight(history, padding, tuple(given["mean"]), tuple(given["std"]), clip)


def _weights(path: Path, data: Mapping[str, Any]) -> Path:
    for key in ("name", "policy"):
        if not isinstance(data.get(key), str) or not data[key].strip():
            raise ConfigurationError(f"{path}: '{key}' must be a text, found {data.get(key)!r}")
    policy = path.parent / data["policy"]
    if not policy.is_file():
        raise ConfigurationError(f"{path}: no file at {policy}")
    if policy.suffix not in (".zip", SUFFIX):
        raise ConfigurationError(
            f"{path}: {policy.name} is no .zip of `cablebench train` or of stable-baselines3, and no {SUFFIX} file"
        )
    return policy


def _charged(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    charged = _mapping(path, data, "charged")
    require_known(f"budget in {path}", charged, BUDGETS)
    for key, value in charged.items():
        if not is_number(value) or value < 0:
            raise ConfigurationError(f"{path}: charged.{key} = {value!r}; expected a number of at least 0")
    return charged


def _mapping(path: Path, data: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = data.get(key) or {}
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{path}: '{key}' must be a mapping, found {value!r}")
    return dict(value)
