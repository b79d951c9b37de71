"""Entrants of saved policies, and of those that a policy file (`cablebench.entrants.policy_files`) names."""

import shlex
from dataclasses import replace
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.entrant import INFORMATION, Entrant, agent_entrant
from cablebench.entrants.policy_files import PolicyFile, load_policy_file


def policy_entrant(path: str) -> Any:
    """The `cablebench.entrants.entrant.Entrant` of a saved policy, with what it was charged and how it was trained."""
    if is_policy_file(path):
        return policy_file_entrant(path)
    from cable_envs.agents.policy import load_policy

    policy = load_policy(path)
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
    )


def is_policy_file(path: str) -> bool:
    """Whether a path is meant for a policy file, not for a policy."""
    return path.endswith((".yaml", ".yml"))


def policy_file_entrant(path: str) -> Entrant:
    """The entrant of a policy file. Raises ConfigurationError that names the file."""
    file = load_policy_file(path)
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
