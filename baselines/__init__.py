"""Reference controllers of the cable benchmark: SI in, SI out, no knowledge of environments.

>>> from cable_envs import baselines
>>> rig = {"load_mass": 5.0}
>>> controller = baselines.make_controller("mrac-g22", plant="cable_hole", action_mode="tension", task="position",
...                                        rig=rig, dt=0.01)
>>> controller.reset()
>>> command = controller.act(0.0, {"load_position": 0.0, "load_velocity": 0.0, "drive_tension": 49.0,
...                                "load_tension": 49.0}, (0.01, 0.0, 0.0))

The API is described in `cable_envs.baselines.base.Controller`.
"""

from collections.abc import Mapping
from importlib import import_module
from pkgutil import walk_packages
from types import MappingProxyType
from typing import Any

from cable_envs.baselines.base import Controller
from cable_envs.core.errors import ConfigurationError, nearest

if __name__ != "cable_envs.baselines":
    raise ImportError("the folder baselines/ of this checkout is imported as cable_envs.baselines")

SHOWN = (
    "open-loop", "pid", "scheduled-pid", "mrac-g22", "mrac-g9", "mrac", "adaptive-inverse", "lqg", "ilc", "mpc",
    "feedforward-pid", "uncompensated-pid", "virtual-jaw", "camera-jaw", "grasp-jaw", "drive-side", "sheath-drive-side",
    "oracle",
)  # fmt: skip
"""The order in which controllers are listed to people; what is not named here comes behind, by name."""


def _found() -> dict[str, type[Controller]]:
    modules = [import_module(module.name) for module in walk_packages(__path__, f"{__name__}.")]
    kinds = {
        kind.name: kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, Controller) and "name" in vars(kind)
    }
    return {name: kinds[name] for name in sorted(kinds, key=lambda n: (SHOWN.index(n) if n in SHOWN else 99, n))}


CONTROLLERS: Mapping[str, type[Controller]] = MappingProxyType(_found())
"""Every controller of every file in this folder and in those below it, by name."""


def controller_class(name: str) -> type[Controller]:
    """The class registered as ``name``; ConfigurationError with the nearest name when there is none."""
    if name not in CONTROLLERS:
        raise ConfigurationError(f"unknown controller '{name}'; {nearest(name, CONTROLLERS)}")
    return CONTROLLERS[name]


def make_controller(
    name: str, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float, **gains: Any
) -> Controller:
    """The controller ``name`` for one plant, action mode and task; see `Controller` for the arguments.

    Raises ConfigurationError for unknown names and gains (with the nearest) and where the controller does not apply.
    """
    return controller_class(name)(plant, action_mode, task, rig, dt, **gains)


__all__ = ["CONTROLLERS", "Controller", "controller_class", "make_controller"]
