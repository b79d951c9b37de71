"""What every reference controller is: where it applies, what it knows, what can be tuned, and three calls."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import ParameterTable
from cable_envs.plants import family_of, plant_for, variant_of
from cable_envs.plants.base import Plant
from cable_envs.plants.servo import MOTOR

Reference = tuple[float, float, float]
"""r, r_dot, r_ddot in SI."""

HOLE = "cable_hole"
CIRCUITS = ("pulley_circuit", "pulley_chain")

INFORMATION = ("model-free", "nominal", "identified", "planner", "oracle")
OBSERVE = ("drive", "output", "full")


class Levels(dict[str, str]):
    """Observation level that is needed, by plant.

    Parameters
    ----------
    named : mapping of str to str
        Plant to level: "drive", "output" or "full".
    other : str
        Level of the plants without an entry; empty: what the plant's family says.

    Examples
    --------
    >>> Levels({"cable_hole": "full"})["pulley_circuit"]
    'drive'
    """

    def __init__(self, named: Mapping[str, str], other: str = ""):
        super().__init__(named)
        self.other = other

    def __missing__(self, plant: str) -> str:
        return self.other or family_of(plant).observe


class Controller:
    """Base of all reference controllers.

    `cable_envs.baselines.make_controller` makes one. For every episode call ``set_rig(true_values)``, which only an
    oracle heeds, and `reset`; then call `act` once a control period.

    Parameters
    ----------
    plant : str
        Name of a plant, as "cable_hole", "pulley_circuit", "pulley_chain".
    action_mode : str
        What a command is: for the hole "tension" (N) or "speed" (m/s), for the circuit "position" (rad) or "torque" (N
        m), for others what the plant declares.
    task : str
        What the reference is: "position" (m or rad), "tension" (N, at the load) or "torque" (N m, of the grasp).
    rig : mapping
        Nominal parameters by name, SI. What is missing takes the plant's default.
    dt : float
        Control period, s.
    **gains
        Values for names in `parameters`. What is missing takes the default of the case.

    Attributes
    ----------
    name : str
        Name of the controller on the command line and on boards.
    information : str
        What it was told: "model-free", "nominal", "identified", "planner" or "oracle". Controllers are ranked within
        each.
    plants : tuple of str
        Plants that it is made for.
    tasks : tuple of str
        Kinds of tasks that it does.
    modes : tuple of str
        Action modes that it is made for; empty: all.
    general : bool
        Whether it also works on every plant that has a view (`cable_envs.plants.view`).
    levels : mapping of str to str
        Observation level needed on each plant: "drive", "output" or "full".
    charged : mapping of str to int
        What finding the default gains cost, shown on boards: ``{"tuning_trials": most gain sets tried for one case}``.
    gain_tables : mapping of (str, str, str) to ParameterTable
        (plant family, action mode, task) -> its tunable gains. A case that is missing has none.
    parameters : ParameterTable
        Tunable gains of this case.
    gains : dict of str to float
        Their values.
    rig : dict of str to float
        All parameters of the plant that it computes with, SI.
    low, high : float
        Range of commands, SI.
    observe : str
        Observation level that it needs here.

    Raises
    ------
    ConfigurationError
        For an unknown plant, mode, task, parameter of the rig or gain (naming the nearest), a value out of bounds, and
        where the controller does not apply.
    """

    name: ClassVar[str]
    information: ClassVar[str]
    plants: ClassVar[tuple[str, ...]] = (HOLE, *CIRCUITS)
    tasks: ClassVar[tuple[str, ...]] = ("position", "tension", "torque")
    modes: ClassVar[tuple[str, ...]] = ()
    general: ClassVar[bool] = False
    levels: ClassVar[Mapping[str, str]] = Levels({HOLE: "output", **dict.fromkeys(CIRCUITS, "drive")})
    charged: ClassVar[Mapping[str, int]] = {}
    gain_tables: ClassVar[Mapping[tuple[str, str, str], ParameterTable]] = {}

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
        """Refuse a case that this controller does not work on.

        Parameters
        ----------
        plant, action_mode, task : str
            As of the class.

        Raises
        ------
        ConfigurationError
            For unknown names, and where the controller is not made for the plant, action mode or task.
        """
        require_known(f"action mode of '{plant}'", [action_mode], action_modes(plant))
        require_known(f"task of '{plant}'", [task], tasks(plant))
        if plant not in cls.plants and not (cls.general and cls.sees(plant, action_mode)):
            raise ConfigurationError(f"controller '{cls.name}' is made for {', '.join(cls.plants)}, not for '{plant}'")
        mode = next(m for m in _plant(plant).action_modes if m.name == action_mode)
        if len(mode.commands) > 1:
            raise ConfigurationError(
                f"controller '{cls.name}' gives one command, and action mode '{action_mode}' takes two; give it "
                f"action_mode='{mode.of}', where the second stays at rest"
            )
        if cls.modes and action_mode not in cls.modes:
            raise ConfigurationError(
                f"controller '{cls.name}' gives {', '.join(cls.modes)} commands, not '{action_mode}'"
            )
        if task not in cls.tasks:
            raise ConfigurationError(f"controller '{cls.name}' does {', '.join(cls.tasks)} tasks, not '{task}'")

    @classmethod
    def sees(cls, plant: str, action_mode: str) -> bool:
        """Whether a general controller finds what it needs in the plant's view; a derived class may ask for more."""
        return bool(family_of(plant).view)

    @classmethod
    def applies(cls, plant: str, action_mode: str, task: str) -> bool:
        """Whether `check_case` passes for a plant, action mode and task."""
        try:
            cls.check_case(plant, action_mode, task)
        except ConfigurationError:
            return False
        return True

    @classmethod
    def parameters_for(cls, plant: str, action_mode: str, task: str) -> ParameterTable:
        """The tunable gains of a case: the space that a tuner searches.

        Parameters
        ----------
        plant, action_mode, task : str
            As of the class.

        Returns
        -------
        ParameterTable
            Gains with their units, bounds and defaults; empty where there are none.

        Raises
        ------
        ConfigurationError
            As `check_case`.
        """
        cls.check_case(plant, action_mode, task)
        return cls.gain_tables.get((family(plant), action_mode, task), ParameterTable())

    def set_rig(self, rig: Mapping[str, Any]) -> None:
        """Receive the true parameters (SI) of the coming episode, before `reset`; all but the oracle ignore them."""

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        """Adopt a rig (parameters in SI) as the model to compute with; called once with the nominal values."""
        self.rig = complete_rig(self.plant, rig)
        self.low, self.high = command_range(self.plant, self.action_mode, self.rig)

    def reset(self) -> None:
        """Begin an episode: every internal state is as after construction."""
        raise NotImplementedError

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        """The command for the next control period.

        Parameters
        ----------
        t : float
            Time since the episode began, s.
        y : mapping of str to float
            Measurements by the name of the signal, SI: those of the level `observe`.
        ref : tuple of three float
            Reference with its first two derivatives, SI.

        Returns
        -------
        float
            In the unit of the action mode, SI.
        """
        raise NotImplementedError

    def limit(self, u: float) -> float:
        """The command ``u`` within the range of commands."""
        return self.low if u < self.low else self.high if u > self.high else u


def action_modes(plant: str) -> tuple[str, ...]:
    """Names of a plant's action modes.

    Parameters
    ----------
    plant : str
        The plant's own name.

    Returns
    -------
    tuple of str
        In the order in which the plant declares them.

    Raises
    ------
    ConfigurationError
        For an unknown plant, naming the nearest.

    Examples
    --------
    >>> action_modes("cable_hole")
    ('tension', 'speed')
    """
    return tuple(mode.name for mode in _plant(plant).action_modes)


def tasks(plant: str) -> tuple[str, ...]:
    """Kinds of tasks that a plant has.

    Parameters
    ----------
    plant : str
        The plant's own name.

    Returns
    -------
    tuple of str
        Of "position", "tension" and "torque"; empty where no task is made for it.

    Raises
    ------
    ConfigurationError
        For an unknown plant, naming the nearest.

    Examples
    --------
    >>> tasks("pulley_chain")
    ('position', 'torque')
    """
    return tuple(family_of(plant).outputs)


def family(plant: str) -> str:
    """Name under which gain tables know a plant.

    Parameters
    ----------
    plant : str
        The plant's own name.

    Returns
    -------
    str
        "hole", or "circuit" for both circuit plants, which share signals and parameters; else the plant's name.
    """
    return {HOLE: "hole", **dict.fromkeys(CIRCUITS, "circuit")}.get(plant, plant)


def complete_rig(plant: str, rig: Mapping[str, Any]) -> dict[str, float]:
    """All parameters of a plant.

    Parameters
    ----------
    plant : str
        The plant's own name.
    rig : mapping
        Values over the plant's defaults: numbers in SI or ``{value, unit}``. Names such as "wrap_angle_2" make a hole
        plant of several holes, and those of a motor ("motor_constant") a drive that has one.

    Returns
    -------
    dict of str to float
        Every parameter by name, SI, validated.

    Raises
    ------
    ConfigurationError
        For an unknown plant or parameter, naming the nearest, and values out of bounds.
    """
    series = [k.removeprefix("wrap_angle_") for k in rig if k.startswith("wrap_angle_")]
    simulated, with_motor = _plant(plant), family_of(plant).with_motor
    if family_of(plant).series and series:
        if not all(s.isdigit() for s in series):
            raise ConfigurationError(f"unknown parameter 'wrap_angle_{series[0]}'; {nearest('wrap_angle', rig)}")
        simulated = plant_for(plant, holes=max(map(int, series)))
    if with_motor is not None and any(name in rig for name in MOTOR):
        simulated = with_motor(simulated)
    return simulated.parameters.unpack(simulated.parameters.pack(rig))


def command_range(plant: str, action_mode: str, rig: Mapping[str, float]) -> tuple[float, float]:
    """Commands that a controller may give: the drive's own range, and never a tension beyond the safety limit.

    Parameters
    ----------
    plant : str
        The plant's own name.
    action_mode : str
        One of its action modes.
    rig : mapping of str to float
        All parameters of the plant, SI.

    Returns
    -------
    low, high : float
        In the unit of the action mode.

    Examples
    --------
    >>> command_range("cable_hole", "tension", complete_rig("cable_hole", {}))
    (0.0, 100.0)
    """
    mode = next(mode for mode in _plant(plant).action_modes if mode.name == action_mode)
    bound = rig[mode.bound]
    if mode.one_sided:
        return 0.0, min(bound, rig["tension_limit"]) if mode.unit == "N" else bound
    return -bound, bound


def _plant(name: str) -> Plant:
    """A plant by its own name, as "pulley_chain"."""
    one = family_of(name)
    return plant_for(one.name, variant_of(name) or one.variants[0])
