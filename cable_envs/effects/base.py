"""What an effect is: physics that a simulator may lack, as data and as scalar kernel pieces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter

SEAMS = ("actuate", "cable", "contact", "load", "sense")

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
    alias      | of an effect on a plant: name of the plant's own parameter that this number is; empty: it has none
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
    alias: str = ""
    probes: tuple[float, ...] | None = None
    signed: bool = False
    search_low: float | None = None
    inverse: bool = False
    complete: bool = False
    lane: str = ""

    def on(self, turning: bool, alias: str = "") -> "EffectParameter":
        """The parameter on a plant: ``turning`` where its motion is an angle; ``alias``: see above."""
        if not turning:
            return replace(self, alias=alias)
        typical = self.typical if self.typical_turning is None else self.typical_turning
        return replace(self, unit=_TURNING.get(self.unit, self.unit), typical=typical, alias=alias)

    def declared(self, effect: str) -> Parameter:
        """As a row of a plant's parameter table, under the dotted name."""
        return Parameter(f"{effect}.{self.name}", self.unit, self.null, self.low, self.high, self.meaning)


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
    plants: tuple[str, ...] = ()
    """of an effect with hooks: the plants that it acts on; empty: every one that asks at its seams"""
    hooks: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    """seam -> plain scalar function that is compiled into the kernels at that seam (`cable_envs.effects.own`)"""

    def __hash__(self) -> int:
        return hash(self.name)

    def __post_init__(self) -> None:
        if self.seam not in SEAMS:
            raise ConfigurationError(f"effect '{self.name}': seam '{self.seam}' is none of {', '.join(SEAMS)}")
        if self.over_time not in ("", CONSTANT, DRIFT):
            known = f"{CONSTANT}, {DRIFT}"
            raise ConfigurationError(f"effect '{self.name}': over_time '{self.over_time}' is none of {known}")

    def row(self, p: EffectParameter) -> str:
        """Name of a parameter in a plant's table: the plant's own, or the dotted one."""
        return p.alias or f"{self.name}.{p.name}"

    def present(self, values: Mapping[str, float]) -> bool:
        """Whether a rig's ``values`` (of the whole table, by name) have the effect; of an effect on a plant."""
        return any(values[self.row(p)] != p.null for p in self.parameters if not p.shape)


def lane_of(effect: Effect, parameter: EffectParameter) -> str:
    """Name of the row of an effect's parameter in a kernel."""
    return f"{effect.name}_{parameter.lane or parameter.name}"


@dataclass(frozen=True)
class Acting:
    """What of the library acts on a plant.

    Attributes
    ----------
    effects : mapping of str to tuple of str
        Effect -> its parameters there, in their order. Those of sensors act on every sensor.
    sensors : mapping of str to str
        Signals that a sensor may measure wrongly, with their units.
    aliases : mapping of str to str
        "effect.parameter" -> the plant's own parameter that this number is. The null of the effect then is the value
        that leaves the physics out.
    turning : bool
        Whether its motion is an angle: units become rad and N m.
    seams : tuple of str
        Where its kernel asks for effects that bring a function of their own (`Effect.hooks`).
    forms : tuple of Effect
        Effects that have a law, parameters or sizes of their own on this plant, whole, under their canonical names.
    """

    effects: Mapping[str, tuple[str, ...]]
    sensors: Mapping[str, str]
    aliases: Mapping[str, str] = field(default_factory=dict)
    turning: bool = False
    seams: tuple[str, ...] = ("actuate", "cable", "load")
    forms: tuple[Effect, ...] = ()

    def bound(self, effect: Effect, plant: str) -> Effect:
        """The effect as it is on the plant; without parameters where it does not act."""
        if effect in self.forms:
            return effect
        if effect.each_sensor:
            one = effect.parameters[0]
            own = tuple(replace(one, name=signal, unit=one.unit or unit) for signal, unit in self.sensors.items())
            return replace(effect, parameters=own)
        names = self.effects.get(effect.name, ())
        if effect.hooks and set(effect.hooks) <= set(self.seams) and plant in (effect.plants or (plant,)):
            names = tuple(p.name for p in effect.parameters)
        found = {p.name: p for p in effect.parameters}
        own = tuple(found[n].on(self.turning, self.aliases.get(f"{effect.name}.{n}", "")) for n in names)
        return replace(effect, parameters=own)
