"""Entrants of saved policies, and of those that a policy file (`cablebench.entrants.policy_files`) names."""

import importlib.metadata
import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cable_envs.agents.files import policy_file
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.setup import Setup
from cablebench.entrants.entrant import INFORMATION, Entrant, agent_entrant
from cablebench.entrants.onnx_policies import SUFFIX, load_onnx
from cablebench.entrants.policy_files import PolicyFile, load_policy_file
from cablebench.protocol.actors import PolicyActor


def policy_entrant(path: str) -> Any:
    """The `cablebench.entrants.entrant.Entrant` of a saved policy, with what it was charged and how it was trained."""
    if is_policy_file(path):
        return policy_file_entrant(path)
    if path.endswith(SUFFIX):
        return onnx_entrant(PolicyFile(Path(path).stem, existing(path)), path)
    file = policy_file(path)  # a missing one is said before torch is imported
    from cable_envs.agents.policy import load_policy

    policy = load_policy(file)
    m = policy.metadata
    settings = {"policy": policy.digest, "configuration": m.settings_hash, "complete": m.complete}
    return agent_entrant(
        m.name,
        policy,
        m.env_id,
        m.seed,
        m.steps,
        options=m.options,
        tuning_trials=m.settings["tuning_trials"],
        information=policy.settings.information,
        path=path,
        settings=settings,
        versions=m.versions,
        trained_on=policy.settings.env_seeds(m.seed),
    )


def is_policy_file(path: str) -> bool:
    """Whether a path is meant for a policy file, not for a policy."""
    return path.endswith((".yaml", ".yml"))


def policy_file_entrant(path: str) -> Entrant:
    """The entrant of a policy file. Raises ConfigurationError that names the file."""
    file = load_policy_file(path)
    if file.onnx:
        return onnx_entrant(file, path)
    entrant = _foreign(file) if file.algo else _own(path, file)
    return replace(
        entrant, name=file.name, arguments=f"--policy {shlex.quote(path)}", charged={**entrant.charged, **file.charged}
    )


def _own(path: str, file: PolicyFile) -> Entrant:
    entrant = policy_entrant(str(file.policy))
    if INFORMATION.index(file.information) > INFORMATION.index(entrant.information):
        entrant = replace(entrant, information=file.information)
    for key, least in entrant.charged.items():
        if file.charged.get(key, least) < least:
            raise ConfigurationError(f"{path}: charged.{key} is less than the policy's own file says: {least:g}")
    return entrant


def _foreign(file: PolicyFile) -> Entrant:
    from cable_envs.agents.foreign import load_foreign

    policy = load_foreign(file.policy, file.algo, file.env_id, file.options, file.policy_kwargs)
    return agent_entrant(
        file.name, policy, file.env_id, file.seed, int(file.charged["environment_steps"]), options=file.options,
        information=file.information, settings={"policy": policy.digest, "options": dict(file.options)},
    )  # fmt: skip


def existing(path: str) -> Path:
    """The path of a file that is there; ConfigurationError where there is none."""
    if not Path(path).is_file():
        raise ConfigurationError(f"no file at {path}")
    return Path(path)


def onnx_entrant(file: PolicyFile, path: str) -> Entrant:
    """The entrant of an ONNX file; ``path`` is what names it on the command line.

    Without an environment it enters wherever the observation has as many channels as its network takes.
    """
    from cable_envs.sim.registered import setup_of

    policy = load_onnx(file.policy, file.sight)
    if file.env_id:
        policy.require_channels(len(setup_of(file.env_id, file.options).channels), file.env_id)

    def needs(env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        if file.env_id:
            return file.options if env_id == file.env_id else None
        modes = [mode.name for mode in setup.plant.action_modes]
        if file.options.get("action_mode", modes[0]) not in modes:
            return None
        fits = len(setup_of(env_id, file.options).channels) == policy.channels
        return file.options if fits else None

    return Entrant(
        file.name, file.information, lambda setup: PolicyActor(policy), needs, f"--policy {shlex.quote(path)}",
        training_seed=file.seed if file.env_id else None, charged=file.charged,
        settings={"policy": policy.digest, "options": dict(file.options), **file.sight.settings()},
        versions={"onnxruntime": importlib.metadata.version("onnxruntime")},
    )  # fmt: skip
