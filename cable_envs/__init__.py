"""Gymnasium environments for benchmarking learning-based tension control of cable mechanisms.

Importing this package registers ``cable_envs/{CableHole-Position, CableHole-Tension, PulleyCircuit-Position,
PulleyCircuit-Torque, TendonSheath-Position, TendonSheath-Tension}-{Step, Sine}-{v0, v1}`` and
``cable_envs/{AntagonistJoint-Position, AntagonistJoint-Torque, Wrist-Position, LinearDrive-Position,
RotaryJoint-Position}-{Step, Sine}-v1`` for ``gymnasium.make`` and ``gymnasium.make_vec``, and the tasks of suite v1 at
their levels, as ``cable_envs/CableHole-Track-Hard-v1`` (`SUITE_IDS`). Nothing is
compiled before the first environment is made.

What the package offers beside the ids is imported when it is first asked for:

====================== ================================================================================
``CableEnv``           one environment (`cable_envs.envs`)
``CableVectorEnv``     many, stepped in one call (`cable_envs.vector`)
``EFFECTS``            physics that a simulator may lack, by name (`cable_envs.effects`)
``load_rig``           a rig by preset name, path or mapping, as a ``Rig`` (`cable_envs.sim.rigs`)
``Rig``                the parameters of one test rig (`cable_envs.sim.rigs`)
``model``              a rig as equations of motion, without Gymnasium (`cable_envs.continuous.models`)
``replay``             recorded inputs through many mechanisms at once (`cable_envs.sim.replay`)
``ConfigurationError`` what every mistake in an option, a rig or a name raises (`cable_envs.core.errors`)
====================== ================================================================================

Examples
--------
>>> import cable_envs
>>> cable_envs.load_rig("gu-inferred").plant
'cable_hole'
"""

import re
import warnings
from importlib import import_module
from typing import Any

from gymnasium.envs.registration import register

from cable_envs.core.config import config_names, config_path, read_yaml

__version__ = "0.1.0"

_NAMES = {
    f"cable_envs/{task}-{reference}": "\nsince: v1\n"
    in config_path("tasks", f"{task}.yaml").read_text(encoding="utf-8")
    for task in config_names("tasks")
    for reference in ("Step", "Sine")
}
"""Id without its version -> whether there is none before v1."""

ENV_IDS = tuple(f"{name}-v0" for name, new in _NAMES.items() if not new)
"""The registered environment ids that protocols, boards and tuned entrants are for: each task of configs/tasks with a
step and with a sinusoid. Their numbers do not change."""

V1_IDS = tuple(f"{name}-v1" for name in _NAMES)
"""The same tasks on plants that have been mended since, and newer tasks (see the version history of
`cable_envs.envs.CableEnv`)."""

FIRST_IDS = tuple(f"{name}-{'v1' if new else 'v0'}" for name, new in _NAMES.items())
"""Each task in the first version that it has: what agents are trained for."""


def _levels(text: str) -> list[str]:
    """Names of the levels in a file of configs/suite; to parse the whole file takes 30 ms at every import."""
    below = re.split(r"^(?=\S)", text.partition("\nlevels:\n")[2], maxsplit=1, flags=re.MULTILINE)[0]
    return re.findall(r"^  (\w+):", below, re.MULTILINE)


SUITE_IDS = tuple(
    f"cable_envs/{task}-{level}-v1"
    for task in config_names("suite")
    for level in _levels(config_path("suite", f"{task}.yaml").read_text(encoding="utf-8"))
)
"""Suite v1: each task of configs/suite at each of its levels (docs/suite.md)."""

_THRESHOLDS = {_task: read_yaml(config_path("thresholds", f"{_task}.yaml")) for _task in config_names("thresholds")}
"""Task -> reference -> return of an episode from which it counts as solved."""

for _id in ENV_IDS + V1_IDS:
    _name, _version = _id.removeprefix("cable_envs/").rsplit("-", 1)
    _task, _reference = _name.rsplit("-", 1)
    register(
        id=_id,
        entry_point="cable_envs.envs:CableEnv",
        vector_entry_point="cable_envs.device:make_batch",
        kwargs={"task": _task, "reference": _reference} | ({"version": "v0"} if _version == "v0" else {}),
        reward_threshold=_THRESHOLDS.get(_task, {}).get(_reference.lower()),
        # what Gymnasium's default wrappers check the environments check themselves; a fifth of a step's time
        order_enforce=False,
        disable_env_checker=True,
    )

for _id in SUITE_IDS:
    _task, _level = _id.removeprefix("cable_envs/").removesuffix("-v1").rsplit("-", 1)
    register(
        id=_id,
        entry_point="cable_envs.envs:CableEnv",
        vector_entry_point="cable_envs.device:make_batch",
        kwargs={"task": _task, "level": _level},
        order_enforce=False,
        disable_env_checker=True,
    )

# Gymnasium calls every id but the newest out of date. These are not: the boards are for them.
warnings.filterwarnings("ignore", message=r".*The environment cable_envs/\S+-v0 is out of date")

_OFFERED = {
    "CableEnv": "envs", "CableVectorEnv": "vector", "EFFECTS": "effects", "load_rig": "sim.rigs", "Rig": "sim.rigs",
    "model": "continuous.models", "replay": "sim.replay", "ConfigurationError": "core.errors",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module 'cable_envs' has no attribute '{name}'")
    return getattr(import_module(f"cable_envs.{_OFFERED[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_OFFERED])
