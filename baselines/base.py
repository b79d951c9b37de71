"""What every reference controller is: where it applies, what it knows, what can be tuned, and three calls."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import ParameterTable
from cable_envs.plants import family_of, plant_for
from cable_envs.plants.base import Plant

Reference = tuple[float, float, float]
"""r, r_dot, r_ddot in SI."""

HOLE = "cable_hole"
CIRCUITS = ("pulley_circuit", "pulley_chain")

INFORMATION = ("model-free", "nominal", "identified", "oracle")
OBSERVE = ("drive", "output", "full")


class Levels(dict[str, str]):
    """Observation level by plant; of those without an entry ``other``, or else what the plant's family says."""

    def __init__(self, named: Mapping[str, str], other: str = ""):
        super().__init__(named)
        self.other = other

    def __missing__(self, plant: str) -> str:
        return self.other or family_of(plant).observe


class Controller:
    """Base of all reference controllers.

    Life: ``c = make_controller(...)``; for every episode ``c.set_rig(true_values)`` (only an oracle listens) and
    ``c.reset()``, then ``u = c.act(t, y, ref)`` once a control period.

    ==============  ==========================================================================================
    plant           "cable_hole", "pulley_circuit" or "pulley_chain"
    action_mode     what u commands: "tension" N, "speed" m/s (hole); "position" rad, "torque" N m (circuit)
    task            what the reference is: "position" (m, rad), "tension" (N, load side), "torque" (N m, grasp)
    rig             nominal parameter values by name, SI; what is missing takes the plant's default
    dt              control period, s
    gains           values for names in `parameters`
    ==============  ==========================================================================================

    Raises ConfigurationError for an unknown plant, mode, task, rig key or gain (naming the nearest), a value out of
    bounds, and where the controller does not apply.
    """

    name: ClassVar[str]
    information: ClassVar[str]
    """"model-free" | "nominal" | "identified" | "oracle" (docs: protocol); ranked within"""
    plants: ClassVar[tuple[str, ...]] = (HOLE, *CIRCUITS)
    tasks: ClassVar[tuple[str, ...]] = ("position", "tension", "torque")
    general: ClassVar[bool] = False
    """whether it works on every plant that has a view (`cable_envs.plants.view`), besides ``plants``"""
    levels: ClassVar[Mapping[str, str]] = Levels({HOLE: "output", **dict.fromkeys(CIRCUITS, "drive")})
    """observation level needed on each plant: "drive" | "output" | "full" """
    charged: ClassVar[Mapping[str, int]] = {}
    """what finding the default gains cost, shown on boards: {"tuning_trials": most gain sets tried for one case}"""
    gain_tables: ClassVar[Mapping[tuple[str, str, str], ParameterTable]] = {}
    """(plant family, action mode, task) -> its tunable gains; a case that is missing has none"""

    def __init__(
        self, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float, **gains: Any
    ) -> None:
        self.check_case(plant, action_mode, task)
        if not (math.isfinite(dt) and dt > 0.0):
            raise ConfigurationError(f"dt = {dt!r} s: the control period must be positive")
        self.plant, self.action_mode, self.task, self.dt = plant, action_mode, task, float(dt)
        self.parameters = self.parameters_for(plant, action_mode, task)
        self.observe = self.levels[plant]
        require_known(f"gain of '{self.name}'", gains, self.parameters.names)
        self.gains = self.parameters.unpack(self.parameters.pack(gains))
        self.use_rig(rig)
        self.reset()

    @classmethod
    def check_case(cls, plant: str, action_mode: str, task: str) -> None:
        """Raise ConfigurationError unless this controller works on that plant, action mode and task."""
        require_known(f"action mode of '{plant}'", [action_mode], action_modes(plant))
        require_known(f"task of '{plant}'", [task], tasks(plant))
        if plant not in cls.plants and not (cls.general and cls.sees(plant, action_mode)):
            raise ConfigurationError(f"controller '{cls.name}' is made for {', '.join(cls.plants)}, not for '{plant}'")
        if task not in cls.tasks:
            raise ConfigurationError(f"controller '{cls.name}' does {', '.join(cls.tasks)} tasks, not '{task}'")

    @classmethod
    def sees(cls, plant: str, action_mode: str) -> bool:
        """Whether a general controller finds what it needs in the plant's view."""
        return bool(family_of(plant).view)

    @classmethod
    def applies(cls, plant: str, action_mode: str, task: str) -> bool:
        """Whether `check_case` passes."""
        try:
            cls.check_case(plant, action_mode, task)
        except ConfigurationError:
            return False
        return True

    @classmethod
    def parameters_for(cls, plant: str, action_mode: str, task: str) -> ParameterTable:
        """The tunable gains with their bounds and the defaults of this case: the space a tuner searches."""
        cls.check_case(plant, action_mode, task)
        return cls.gain_tables.get((family(plant), action_mode, task), ParameterTable())

    def set_rig(self, rig: Mapping[str, Any]) -> None:
        """Receive the true parameters of the coming episode, before `reset`. Ignored by everyone but the oracle."""

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        """Adopt ``rig`` as the model this controller computes with; called once with the nominal values."""
        self.rig = complete_rig(self.plant, rig)
        self.low, self.high = command_range(self.plant, self.action_mode, self.rig)

    def reset(self) -> None:
        """Start an episode: every internal state as after construction."""
        raise NotImplementedError

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        """The command (SI) for the next control period.

        t in s; y: measurements by signal name in SI, those of the level `observe`; ref = (r, r_dot, r_ddot) in SI.
        """
        raise NotImplementedError

    def limit(self, u: float) -> float:
        """``u`` within the command range."""
        return self.low if u < self.low else self.high if u > self.high else u


def action_modes(plant: str) -> tuple[str, ...]:
    """Names of a plant's action modes. Raises ConfigurationError for an unknown plant, naming the nearest."""
    return tuple(mode.name for mode in _plant(plant).action_modes)


def tasks(plant: str) -> tuple[str, ...]:
    """Kinds of tasks that a plant has. Raises ConfigurationError for an unknown plant, naming the nearest."""
    return tuple(family_of(plant).outputs)


def family(plant: str) -> str:
    """The two circuit plants share signals and parameters: both are "circuit"; the hole is "hole"."""
    return {HOLE: "hole", **dict.fromkeys(CIRCUITS, "circuit")}.get(plant, plant)


def complete_rig(plant: str, rig: Mapping[str, Any]) -> dict[str, float]:
    """All parameters of the plant in SI: ``rig`` over the plant's defaults, validated."""
    series = [k.removeprefix("wrap_angle_") for k in rig if k.startswith("wrap_angle_")]
    table = _plant(plant).parameters
    if family_of(plant).series and series:
        if not all(s.isdigit() for s in series):
            raise ConfigurationError(f"unknown parameter 'wrap_angle_{series[0]}'; {nearest('wrap_angle', rig)}")
        table = plant_for(plant, holes=max(map(int, series))).parameters
    return table.unpack(table.pack(rig))


def command_range(plant: str, action_mode: str, rig: Mapping[str, float]) -> tuple[float, float]:
    """Commands a controller may give: the drive's own range, and never a tension beyond the safety limit."""
    mode = next(mode for mode in _plant(plant).action_modes if mode.name == action_mode)
    bound = rig[mode.bound]
    if mode.one_sided:
        return 0.0, min(bound, rig["tension_limit"]) if mode.unit == "N" else bound
    return -bound, bound


def _plant(name: str) -> Plant:
    """A plant by its own name, as "pulley_chain"."""
    one = family_of(name)
    return next(made for variant in one.variants if (made := plant_for(one.name, variant)).name == name)
