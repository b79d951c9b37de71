"""What an effect is: physics that a simulator may lack, as data and as scalar kernel pieces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter

SEAMS = ("actuate", "cable", "contact", "load", "sense")
PLANTS = ("cable_hole", "pulley_circuit", "pulley_chain", "linear_drive")
CIRCUITS = ("pulley_circuit", "pulley_chain")
STRAIGHT = ("cable_hole", "linear_drive")

_CIRCUIT_SENSORS = {
    "drive_angle": "rad", "drive_torque": "N m", "output_angle": "rad", "output_torque": "N m",
    "tension_drive_top": "N", "tension_drive_bottom": "N",
}  # fmt: skip
MEASURED: Mapping[str, Mapping[str, str]] = {
    "cable_hole": {
        "drive_position": "m", "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m",
        "load_velocity": "m/s", "load_tension": "N",
    },
    "pulley_circuit": _CIRCUIT_SENSORS,
    "pulley_chain": _CIRCUIT_SENSORS,
    "linear_drive": {"position": "m", "velocity": "m/s", "force": "N", "motor_position": "m"},
}  # fmt: skip
"""Signals of each plant that a sensor may measure wrongly, with their units."""

_TURNING = {
    "m": "rad", "m/s": "rad/s", "N": "N m", "N s/m": "N m s", "N/m": "N m/rad", "kg": "kg m^2", "1/m": "1/rad",
}  # fmt: skip


PROBES = (0.1, 1.0)
"""Sizes at which a search first tries an effect, over the typical one, where its parameter names no others."""
CONSTANT, DRIFT = "constant", "drift"
"""What `Effect.over_time` may say."""


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect. Units are those of straight motion; where the plant turns they become rad and N m.

    null       | value that leaves the effect out, to the bit
    typical    | size at which it is plainly seen, where the plant moves straight and where it turns
    shape      | it only shapes the effect: `null` is its default, and does not say whether the effect is there
    aliases    | plant -> name of the plant's own parameter that this number is
    plants     | plants that have this parameter; empty: all of the effect's
    lane       | name of the parameter whose row in kernels it shares: one number in another unit; empty: its own

    What a search for the effect has to know (`diagnosis.model.hypotheses`):

    probes     | values at which it is tried first, over the typical one; None: `PROBES` of a size, and of a shape that
               | it is not searched: one number more than a recording usually shows
    signed     | it is tried on both sides of its null
    search_low | least value that is searched; None: `low`
    inverse    | the smaller the number, the larger the effect: a stiffness
    complete   | `high` is all of it and no end of a search: a sensor cannot turn more than all signs round
    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    meaning: str
    typical: float
    typical_turning: float | None = None
    shape: bool = False
    aliases: Mapping[str, str] = field(default_factory=dict)
    plants: tuple[str, ...] = ()
    probes: tuple[float, ...] | None = None
    signed: bool = False
    search_low: float | None = None
    inverse: bool = False
    complete: bool = False
    lane: str = ""

    def unit_on(self, plant: str) -> str:
        """The unit on a plant."""
        return _TURNING.get(self.unit, self.unit) if plant in CIRCUITS else self.unit

    def typical_on(self, plant: str) -> float:
        """A typical size on a plant."""
        if plant in CIRCUITS and self.typical_turning is not None:
            return self.typical_turning
        return self.typical

    def declared(self, effect: str, plant: str) -> Parameter:
        """As a row of a plant's parameter table, under the dotted name."""
        return Parameter(f"{effect}.{self.name}", self.unit_on(plant), self.null, self.low, self.high, self.meaning)


@dataclass(frozen=True)
class Effect:
    """A canonical effect; see CONTRIBUTING.md, "Add an effect".

    proportional | twice the size is twice the change of every signal: one probe tells all
    over_time    | `CONSTANT`: what changes with the elapsed time is not this effect; `DRIFT`: it changes with nothing
                 | else; "": neither
    wave         | names of its period and its phase, where it is a sine along the position; else None
    """

    name: str
    seam: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]
    plants: tuple[str, ...]
    validity: str
    experiment: str
    """what isolates it"""
    confusable: tuple[str, ...] = ()
    """names that the same data may also fit"""
    each_sensor: bool = False
    """its parameters are the names of the plant's measured signals"""
    proportional: bool = False
    over_time: str = ""
    wave: tuple[str, str] | None = None
    hooks: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    """of a user's own effect: seam -> plain scalar function, compiled into the kernel on first use"""

    def __hash__(self) -> int:
        return hash(self.name)

    def __post_init__(self) -> None:
        if self.seam not in SEAMS:
            raise ConfigurationError(f"effect '{self.name}': seam '{self.seam}' is none of {', '.join(SEAMS)}")
        if self.over_time not in ("", CONSTANT, DRIFT):
            known = f"{CONSTANT}, {DRIFT}"
            raise ConfigurationError(f"effect '{self.name}': over_time '{self.over_time}' is none of {known}")

    def parameters_on(self, plant: str) -> tuple[EffectParameter, ...]:
        """The parameters it has on a plant; none where it does not act."""
        if plant not in self.plants:
            return ()
        if self.each_sensor:
            one = self.parameters[0]
            return tuple(replace(one, name=signal, unit=one.unit or u) for signal, u in MEASURED[plant].items())
        return tuple(p for p in self.parameters if plant in (p.plants or self.plants))

    def present(self, plant: str, values: Mapping[str, float]) -> bool:
        """Whether a rig's ``values`` (of the whole table, by name) have the effect."""
        return any(
            values[p.aliases.get(plant, f"{self.name}.{p.name}")] != p.null
            for p in self.parameters_on(plant)
            if not p.shape
        )
