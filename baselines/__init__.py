"""Reference controllers of the cable benchmark: SI in, SI out, no knowledge of environments.

>>> import baselines
>>> rig = {"load_mass": 5.0}
>>> controller = baselines.make_controller("mrac-g22", plant="cable_hole", action_mode="tension", task="position",
...                                        rig=rig, dt=0.01)
>>> controller.reset()
>>> command = controller.act(0.0, {"load_position": 0.0, "load_velocity": 0.0, "drive_tension": 49.0,
...                                "load_tension": 49.0}, (0.01, 0.0, 0.0))

The API is described in `baselines.base.Controller`.
"""

from collections.abc import Mapping
from typing import Any

from baselines.base import Controller
from baselines.feedforward import FeedforwardPid, UncompensatedPid
from baselines.mrac import MracG9, MracG22
from baselines.open_loop import OpenLoop
from baselines.oracle import Oracle
from baselines.pid import PidController
from cable_envs.core.errors import ConfigurationError, nearest

CABLE_BENCHMARK = True
"""Marks this package: other distributions also install a top-level `baselines`, and callers check for this name."""

CONTROLLERS: Mapping[str, type[Controller]] = {
    c.name: c for c in (OpenLoop, PidController, MracG22, MracG9, FeedforwardPid, UncompensatedPid, Oracle)
}
"""Registry: name -> class."""


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


__all__ = ["CABLE_BENCHMARK", "CONTROLLERS", "Controller", "controller_class", "make_controller"]
