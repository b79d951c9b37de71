"""Gymnasium environments for benchmarking learning-based tension control of cable mechanisms.

Importing this package registers ``cable_envs/{CableHole-Position, CableHole-Tension, PulleyCircuit-Position,
PulleyCircuit-Torque}-{Step, Sine}-v0`` for ``gymnasium.make`` and ``gymnasium.make_vec``; nothing is compiled before
the first environment is made.
"""

from gymnasium.envs.registration import register

from cable_envs.core.config import config_names

__version__ = "0.1.0"

ENV_IDS = tuple(f"cable_envs/{task}-{reference}-v0" for task in config_names("tasks") for reference in ("Step", "Sine"))
"""Every registered environment id: each task of configs/tasks with a step and with a sinusoid."""

for _id in ENV_IDS:
    _task, _reference = _id.removeprefix("cable_envs/").removesuffix("-v0").rsplit("-", 1)
    register(
        id=_id,
        entry_point="cable_envs.envs:CableEnv",
        vector_entry_point="cable_envs.vector:CableVectorEnv",
        kwargs={"task": _task, "reference": _reference},
        # what Gymnasium's default wrappers check the environments check themselves; a fifth of a step's time
        order_enforce=False,
        disable_env_checker=True,
    )
