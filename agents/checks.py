"""Checks of single values in a settings file; each returns what is kept and names the key in its error."""

from collections.abc import Mapping
from typing import Any

from cable_envs.baselines import controller_class
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


def residual(value: Any, env_id: str) -> dict[str, Any]:
    """Checked fields of `Residual`; ``controller`` may be a mapping by an id's first word, or "other"."""
    if not value:
        return {}
    require_known("key of residual", value, ("controller", "share", "gains"))
    name = value.get("controller")
    if isinstance(name, Mapping):
        mechanism = env_id.split("/")[-1].split("-")[0]
        if "other" not in name:
            require_known("mechanism under residual.controller", [mechanism], name)
        name = name.get(mechanism, name.get("other"))
    kind = controller_class(str(name))
    limit = positive("residual.share", value.get("share", 0.2))
    if limit > 2.0:
        raise ConfigurationError(f"residual.share: expected a number in (0, 2], got {limit:g}")
    return {"controller": kind.name, "share": limit, "gains": dict(value.get("gains") or {})}


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
