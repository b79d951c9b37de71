"""Who makes the anchors beside the open loop: a drive that stays, oracles of several sizes, and laws to begin from."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.baselines import controller_class
from cable_envs.sim.registered import setup_of
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.entrants.entrant import Entrant, controller_entrant

SIZES = (1.0, 0.5, 0.25)
"""Of the oracle's gains per second: the full ones shake the drive of some tasks, and that has its price."""


LAWS = (
    "pid-suite", "scheduled-pid-suite", "adaptive-inverse-suite", "lqg-suite", "camera-jaw-suite", "grasp-jaw-suite",
    "drive-side-suite", "sheath-drive-side-suite",
)  # fmt: skip
"""Files of gains (configs/controllers) that belong to the anchors: whoever else is shipped or enters moves none."""


class Stay:
    """The action of the start, whatever happens."""

    def start(self, env: Any) -> None:
        """Keep the action that holds the drive where the episode begins."""
        self._action = env.simulation.buffers.named.action.astype(np.float32)

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        """The same action again."""
        return self._action


def staying() -> Entrant:
    """A drive that stays where it began: the other way of doing nothing, beside the open loop."""
    return Entrant("stay", "model-free", lambda setup: Stay(), lambda env_id, setup: {}, "")


def oracles(env_id: str, options: Mapping[str, Any], name: str = "oracle") -> tuple[Entrant, ...]:
    """An oracle with each of the `SIZES` of its gains per second, the full ones first.

    Parameters
    ----------
    env_id : str
        Registered id.
    options : mapping
        Of the environment.
    name : str
        The reference controller that is told the true rig.

    Returns
    -------
    tuple of Entrant
        Named "oracle", "oracle x 0.5" and so on.
    """
    setup = setup_of(env_id, options)
    case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
    kind = controller_class(name)
    if not kind.applies(*case):
        return ()
    table = kind.parameters_for(*case)
    rates = {gain: table[gain] for gain in table.names if table[gain].unit == "1/s"}
    found = [controller_entrant(name)]
    for size in SIZES[1:]:
        gains = {gain: max(one.default * size, one.low) for gain, one in rates.items()}
        found.append(replace(controller_entrant(name, gains), name=f"{name} x {size:g}"))
    return tuple(found)


def laws(env_id: str, options: Mapping[str, Any]) -> tuple[tuple[Entrant, dict[str, Any]], ...]:
    """Those of the `LAWS` that enter a task of suite v1, with the sensors of its level.

    Parameters
    ----------
    env_id : str
        Registered id.
    options : mapping
        Of the environment.

    Returns
    -------
    tuple of (Entrant, dict)
        Each with the options of the environment that it enters.
    """
    found = [(entrant, entrant.enters(env_id, options)) for entrant in map(controller_file_entrant, LAWS)]
    return tuple((entrant, own) for entrant, own in found if own is not None)


def without_effects(env_id: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options of the same rigs without the effects that are drawn besides, which the oracle is not told.

    Effects are drawn last, so that all other parameters of the episodes stay as they were.
    """
    drawn = setup_of(env_id, options).randomize
    told = {name: {"low": low, "high": high} for name, low, high in drawn if "." not in name}
    return {**options, "randomize": told} if len(told) < len(drawn) else dict(options)
