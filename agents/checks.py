"""Checks of single values in a settings file; each returns what is kept and names the key in its error."""

from collections.abc import Mapping
from typing import Any

from cable_envs.baselines import controller_class
from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known

NORMALIZE = {"norm_obs": True, "norm_reward": True, "clip_obs": 10.0, "clip_reward": 10.0, "epsilon": 1e-8}
"""Arguments of stable-baselines3's VecNormalize under ``normalize: true``."""


def normalize(value: Any) -> dict[str, Any]:
    """Arguments of VecNormalize; empty for false."""
    if isinstance(value, bool) or value is None:
        return dict(NORMALIZE) if value else {}
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"normalize: expected true, false or a mapping, got {value!r}")
    require_known("key of normalize", value, NORMALIZE)
    return {**NORMALIZE, **value} if value else {}


def residual(value: Any, env_id: str) -> tuple[dict[str, Any], int]:
    """Checked fields of `Residual`, and the trials behind gains that come from files.

    ``tuned`` names a file of configs/controllers, or one of configs/compositions that lists several: the first that has
    gains for the task says which controller is corrected, with which gains. Where none has, or without ``tuned``, it is
    ``controller``, which may be a mapping by an id's first word, or "other".
    """
    if not value:
        return {}, 0
    require_known("key of residual", value, ("controller", "share", "gains", "tuned"))
    limit = positive("residual.share", value.get("share", 0.2))
    if limit > 2.0:
        raise ConfigurationError(f"residual.share: expected a number in (0, 2], got {limit:g}")
    for file in _tuned(value.get("tuned")):
        if env_id in file["gains"]:
            kind = controller_class(str(file["controller"]))
            trials = count("charged.tuning_trials", (file.get("charged") or {}).get("tuning_trials", 0), 0)
            return {"controller": kind.name, "share": limit, "gains": dict(file["gains"][env_id])}, trials
    name = value.get("controller")
    if isinstance(name, Mapping):
        mechanism = env_id.split("/")[-1].split("-")[0]
        if "other" not in name:
            require_known("mechanism under residual.controller", [mechanism], name)
        name = name.get(mechanism, name.get("other"))
    kind = controller_class(str(name))
    return {"controller": kind.name, "share": limit, "gains": dict(value.get("gains") or {})}, 0


def _tuned(name: Any) -> list[Mapping[str, Any]]:
    """The contents of the controller files behind ``residual.tuned``."""
    if name is None:
        return []
    if name in config_names("compositions"):
        names = read_yaml(config_path("compositions", f"{name}.yaml"))["of"]
    else:
        require_known("residual.tuned", [name], (*config_names("controllers"), *config_names("compositions")))
        names = [name]
    return [read_yaml(config_path("controllers", f"{one}.yaml")) for one in names]


def curriculum(value: Any) -> dict[str, Any]:
    """Between which shares of the training the randomisation grows; empty for none."""
    if not value:
        return {}
    require_known("key of curriculum", value, ("randomize",))
    shares = value.get("randomize")
    if (
        not isinstance(shares, (list, tuple)) or len(shares) != 2
        or not all(isinstance(v, (int, float)) and 0.0 <= v <= 1.0 for v in shares) or shares[0] > shares[1]
    ):  # fmt: skip
        raise ConfigurationError(f"curriculum.randomize: expected two rising shares in [0, 1], got {shares!r}")
    return {"randomize": [float(v) for v in shares]}


def positive(name: str, value: Any) -> float:
    """A number above 0."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < float("inf"):
        raise ConfigurationError(f"{name}: expected a number above 0, got {value!r}")
    return float(value)


def share(name: str, value: Any) -> float:
    """A number from 0 up to, not including, 1."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < 1.0:
        raise ConfigurationError(f"{name}: expected a number in [0, 1), got {value!r}")
    return float(value)


def count(name: str, value: Any, least: int = 1) -> int:
    """A whole number; YAML's 2.0e+6 and 2e6 (a string in YAML 1.1) count as whole."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = 0.5
    if isinstance(value, bool) or not number.is_integer() or number < least:
        raise ConfigurationError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    return round(number)
