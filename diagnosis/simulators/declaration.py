"""What a user's simulator says of itself: parameters, commands, outputs, ports and its sample period.

Nothing is taken from elsewhere: a number that is not declared is not known. All units are SI; motion is in m or rad,
and the force at a port is in N where the motion is in m, in N m where it is in rad.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import Parameter, ParameterTable, is_number, si_of

_FORCE_OF = {"m/s": "N", "rad/s": "N m"}
"""Unit of a port's velocity -> unit of the force there."""
_PLACE_OF = {"m/s": "m", "rad/s": "rad"}


@dataclass(frozen=True)
class SimulatorParameter:
    """A number of a simulator.

    Parameters
    ----------
    name, unit : str
        What the simulator calls it, and its SI unit.
    nominal : float
        What is believed, where refits start.
    low, high : float
        Values that it can have, both included.
    std : float, optional
        Standard deviation of the belief. Without one a refit may take any value within the bounds.
    known : bool
        Whether it was measured and is trusted; it is not refitted then.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    std: float | None = None
    known: bool = False

    def __post_init__(self) -> None:
        where = f"parameter '{self.name}'"
        _require_unit(where, self.unit)
        for key in ("nominal", "low", "high"):
            if not is_number(getattr(self, key)):
                raise ConfigurationError(f"{where}: {key} must be a finite number, got {getattr(self, key)!r}")
        if not self.low < self.high or not self.low <= self.nominal <= self.high:
            raise ConfigurationError(
                f"{where}: expected low <= nominal <= high and low < high, got {self.low:g}, {self.nominal:g}, "
                f"{self.high:g}"
            )
        if self.std is not None and not (is_number(self.std) and self.std > 0.0):
            raise ConfigurationError(f"{where}: std must be a positive number or left out, got {self.std!r}")


@dataclass(frozen=True)
class Command:
    """What drives a simulator: a force, torque, voltage, position or any other number.

    Parameters
    ----------
    name, unit : str
        Of the simulator's input and of the recording's channel, and its SI unit.
    full : float, optional
        Size of the command at which the supply is fully used. Only where it is given, a sag of the supply is asked.
    """

    name: str
    unit: str
    full: float | None = None

    def __post_init__(self) -> None:
        _require_unit(f"command '{self.name}'", self.unit)
        if self.full is not None and not (is_number(self.full) and self.full > 0.0):
            raise ConfigurationError(f"command '{self.name}': full must be positive or left out, got {self.full!r}")


@dataclass(frozen=True)
class Output:
    """What a simulator shows.

    Parameters
    ----------
    name, unit : str
        Of the output, and of the recording's channel where a sensor measured it; SI.
    starts : bool
        Whether a run can begin at a given value of it.
    """

    name: str
    unit: str
    starts: bool = False

    def __post_init__(self) -> None:
        _require_unit(f"output '{self.name}'", self.unit)


@dataclass(frozen=True)
class ForcePort:
    """A place where a force, or a torque, can be added to a simulator's motion.

    Parameters
    ----------
    name : str
        Of the port; positive forces push towards positive velocities.
    velocity : str
        Output that is the velocity there, m/s or rad/s. A force must change it within one sample period.
    position : str
        Output that is the position there, m or rad; empty: none, and nothing is asked that depends on the position.
    """

    name: str
    velocity: str
    position: str = ""


@dataclass(frozen=True)
class Declaration:
    """Everything that a simulator says of itself.

    Parameters
    ----------
    name : str
        What answers call it.
    period : float
        s that one step of it takes. A recording's sample period must be a whole number of them.
    parameters : tuple of SimulatorParameter
        At least one.
    commands, outputs : tuple of Command, tuple of Output
        At least one of each.
    ports : tuple of ForcePort
        Where forces can be added; without any, no effect is asked that is a force.

    Raises
    ------
    ConfigurationError
        Naming what is missing, what is declared twice, or what cannot be meant.

    Examples
    --------
    >>> cart = Declaration(
    ...     "cart", 0.005, (SimulatorParameter("mass", "kg", 2.0, 0.1, 10.0, std=0.2),), (Command("force", "N"),),
    ...     (Output("position", "m", starts=True), Output("velocity", "m/s", starts=True)),
    ...     (ForcePort("slide", "velocity", "position"),),
    ... )
    >>> cart.force_unit(cart.ports[0])
    'N'
    """

    name: str
    period: float
    parameters: tuple[SimulatorParameter, ...]
    commands: tuple[Command, ...]
    outputs: tuple[Output, ...]
    ports: tuple[ForcePort, ...] = ()

    def __post_init__(self) -> None:
        if not is_number(self.period) or self.period <= 0.0:
            raise ConfigurationError(f"simulator '{self.name}': period must be positive seconds, got {self.period!r}")
        for what in ("parameters", "commands", "outputs", "ports"):
            object.__setattr__(self, what, tuple(getattr(self, what)))
            if what != "ports" and not getattr(self, what):
                raise ConfigurationError(f"simulator '{self.name}' declares no {what}: at least one is needed")
        channels = named(self.commands, self.outputs)
        for what, names in (
            ("parameter", [p.name for p in self.parameters]),
            ("command or output", channels),
            ("port", [p.name for p in self.ports]),
        ):
            self._require_names(what, names)
        for port in self.ports:
            self._require_port(port)

    def _require_names(self, what: str, names: Iterable[str]) -> None:
        seen: set[str] = set()
        for name in names:
            if not isinstance(name, str) or not name.isidentifier() or name == "time":
                raise ConfigurationError(
                    f"simulator '{self.name}': {what} {name!r}: a name has letters, digits and underscores, and is not "
                    "'time'"
                )
            if name in seen:
                raise ConfigurationError(f"simulator '{self.name}': {what} '{name}' is declared twice")
            seen.add(name)

    def _require_port(self, port: ForcePort) -> None:
        units = {output.name: output.unit for output in self.outputs}
        where = f"port '{port.name}' of simulator '{self.name}'"
        require_known(f"velocity of {where}: output", [port.velocity], units)
        if units[port.velocity] not in _FORCE_OF:
            raise ConfigurationError(f"{where}: its velocity is in m/s or rad/s, not in {units[port.velocity]}")
        if port.position:
            require_known(f"position of {where}: output", [port.position], units)
            if units[port.position] != _PLACE_OF[units[port.velocity]]:
                raise ConfigurationError(
                    f"{where}: a velocity in {units[port.velocity]} goes with a position in "
                    f"{_PLACE_OF[units[port.velocity]]}, not in {units[port.position]}"
                )

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every channel that a recording may have."""
        commands = {command.name: command.unit for command in self.commands}
        return {"time": "s"} | commands | {output.name: output.unit for output in self.outputs}

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of every parameter."""
        return {p.name: p.nominal for p in self.parameters}

    @property
    def table(self) -> ParameterTable:
        """The parameters with their bounds."""
        return ParameterTable(*(Parameter(p.name, p.unit, p.nominal, p.low, p.high, p.name) for p in self.parameters))

    def unit_of(self, output: str) -> str:
        """Unit of an output."""
        return next(one.unit for one in self.outputs if one.name == output)

    def turns(self, port: ForcePort) -> bool:
        """Whether the motion at a port is an angle."""
        return self.unit_of(port.velocity) == "rad/s"

    def force_unit(self, port: ForcePort) -> str:
        """N or N m."""
        return _FORCE_OF[self.unit_of(port.velocity)]


def named(*groups: Iterable[SimulatorParameter | Command | Output | ForcePort]) -> list[str]:
    """Names of what is declared."""
    return [one.name for group in groups for one in group]


def _require_unit(where: str, unit: str) -> None:
    if not isinstance(unit, str) or not unit:
        raise ConfigurationError(f"{where}: its unit is missing; '1' is that of plain numbers")
    if si_of(unit) != unit:
        raise ConfigurationError(f"{where}: expected an SI unit, {si_of(unit)} in the place of {unit}")
