"""Laws for every plant that has a view (`cable_envs.plants.view`): statics forward, PID on the output."""

from collections.abc import Mapping

from cable_envs.baselines.base import Reference
from cable_envs.baselines.parts import Pid, Smoother, follow_direction
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.plants import family_of
from cable_envs.plants.view import View

_MEANINGS = {
    "kp": "proportional gain", "ki": "integral gain", "kd": "derivative gain",
    "filter_time": "time constant of the derivative's filter",
}  # fmt: skip


def has_view(plant: str) -> bool:
    """Whether a plant's family says how reference controllers see it."""
    return bool(family_of(plant).view)


def view_of(plant: str, rig: Mapping[str, float], action_mode: str, task: str) -> View:
    """The view of a rig. Raises ConfigurationError where the plant has none, or cannot do the task."""
    return family_of(plant).sees()(rig, action_mode, task)


def pid_table(plant: str, action_mode: str, task: str, *more: Parameter) -> ParameterTable:
    """The PID gains that the plant's view declares for a case, and ``more``."""
    gains = family_of(plant).sees().pid[action_mode, task]
    named = (Parameter(n, unit, value, 0.0, high, _MEANINGS[n]) for n, (unit, value, high) in gains.items())
    return ParameterTable(*named, *more)


FEEDFORWARD = Parameter("feedforward", "1", 1.0, 0.0, 1.0, "share of the static feedforward")
SMOOTH = (
    Parameter("smooth_time", "s", 0.1, 0.0, 1.0, "time constant of jumps of the reference"),
    Parameter("turn_time", "s", 0.03, 0.0, 1.0, "time constant of changes of direction"),
)


class SteadyPid:
    """u = steady command + PID of the output's error.

    The steady command has the friction of the way in which the reference moves where ``compensates``; its direction
    changes within ``turn_time``, and is kept at rest. The output follows the reference with its jumps spread over
    ``smooth_time``.
    """

    def __init__(self, view: View, gains: Mapping[str, float], dt: float, compensates: bool):
        self._view, self._gains, self._compensates = view, gains, compensates
        self._pid = Pid(gains["kp"], gains["ki"], gains["kd"], gains["filter_time"], dt)
        self._side = Smoother(dt, gains.get("turn_time", 0.0))
        self._smooth = Smoother(dt, gains.get("smooth_time", 0.0))

    def reset(self) -> None:
        self._pid.reset()
        self._side.reset()
        self._smooth.reset()
        self._direction = 0.0
        self._last: float | None = None

    def act(self, y: Mapping[str, float], ref: Reference, low: float, high: float) -> float:
        """Command within [low, high]."""
        self._direction = follow_direction(self._direction, self._last, ref)
        self._last = ref[0]
        way = self._side.update(self._direction) if self._compensates else 0.0
        wanted = self._smooth.update(ref[0], ref[1])
        held = self._view.steady((wanted, ref[1], ref[2]), way)
        measured = y[self._view.signal]
        share, one = self._gains.get("feedforward", 1.0), self._view.unit_command
        asked = self._pid.update(wanted - measured, measured, ref[1], share * held / one, low / one, high / one)
        return min(max(asked * one, low), high)
