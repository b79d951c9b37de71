"""What an effect is: physics that a simulator may lack, as data and as scalar kernel pieces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter

SEAMS = ("actuate", "cable", "contact", "load", "sense")

_TURNING = {
    "m": "rad", "m/s": "rad/s", "N": "N m", "N s/m": "N m s", "N/m": "N m/rad", "kg": "kg m^2", "1/m": "1/rad",
    "N s/m^2": "N m s/rad^2",
}  # fmt: skip


PROBES = (0.1, 1.0)
"""Sizes at which a search first tries an effect, over the typical one, where its parameter names no others."""
CONSTANT, DRIFT = "constant", "drift"
"""What `Effect.over_time` may say."""
PLACE, FORCE = "place", "force"
"""What `Effect.offsets` may say."""


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect. Units are those of straight motion; where the plant turns they become rad and N m.

    Attributes
    ----------
    name : str
        Name of the parameter within the effect.
    unit : str
        SI unit.
    null : float
        Value that leaves the effect out, to the bit.
    low, high : float
        Least and largest value, both included.
    meaning : str
        What it is, for people.
    typical : float
        Size at which the effect is plainly seen where the plant moves straight.
    typical_turning : float, optional
        The same where the plant turns; None: ``typical``.
    null_turning : float, optional
        Null where the plant turns; None: ``null``. A shape that is a length needs one: it is an angle there.
    shape : bool
        Whether it only shapes the effect: ``null`` then is its default, and does not say whether the effect is there.
    alias : str
        Of an effect on a plant: name of the plant's own parameter that this number is; empty: it has none.
    probes : tuple of float, optional
        Values over the typical one at which a search tries it first. None: `PROBES` of a size; a shape is not searched.
    signed : bool
        Whether a search tries it on both sides of its null.
    search_low : float, optional
        Least value that is searched; None: ``low``.
    inverse : bool
        Whether a smaller number is a larger effect, as for a stiffness.
    complete : bool
        Whether ``high`` is all of it and no end of a search: a sensor cannot turn more than all signs round.
    lane : str
        Name of the parameter whose row in kernels it shares: one number in another unit; empty: its own.
    least : float
        Distance from the null below which it is no fault: by so much a rig may differ from what is said of it.

    Notes
    -----
    What a search has to know (``probes`` to ``complete``, ``least``) is read in
    `cable_envs.diagnosis.model.hypotheses`.
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
    null_turning: float | None = None
    least: float = 0.0

    def on(self, turning: bool, alias: str = "") -> "EffectParameter":
        """The parameter as it is on a plant.

        Parameters
        ----------
        turning : bool
            Whether the motion of the plant is an angle.
        alias : str
            Name of the plant's own parameter that this number is; empty: it has none.

        Returns
        -------
        EffectParameter
            With its unit, null and typical size there.

        Examples
        --------
        >>> gap = EffectParameter("gap", "m", 0.0, 0.0, 1.0, "width of the gap", 5e-4, typical_turning=0.03)
        >>> gap.on(turning=True).unit, gap.on(turning=True).typical
        ('rad', 0.03)
        """
        if not turning:
            return replace(self, alias=alias)
        typical = self.typical if self.typical_turning is None else self.typical_turning
        null = self.null if self.null_turning is None else self.null_turning
        return replace(self, unit=_TURNING.get(self.unit, self.unit), null=null, typical=typical, alias=alias)

    def declared(self, effect: str) -> Parameter:
        """The parameter as a row of a plant's parameter table.

        Parameters
        ----------
        effect : str
            Name of the effect.

        Returns
        -------
        Parameter
            Under the dotted name, with its null as default.
        """
        return Parameter(f"{effect}.{self.name}", self.unit, self.null, self.low, self.high, self.meaning)


@dataclass(frozen=True)
class EffectState:
    """Something that an effect with hooks remembers from one integration step to the next.

    Attributes
    ----------
    name : str
        Name of the state within the effect; hooks ask for it by this name.
    unit : str
        SI unit.
    start : float
        Value when an episode or a replay begins.
    meaning : str
        What it is, for people.
    """

    name: str
    unit: str
    start: float = 0.0
    meaning: str = ""


@dataclass(frozen=True)
class Effect:
    """An effect: physics that a simulator may lack. See CONTRIBUTING.md, "Add an effect".

    Attributes
    ----------
    name : str
        Name of the effect.
    seam : str
        Where it acts, one of `SEAMS`.
    equation : str
        Its law, for people.
    source : str
        Where the law is from.
    parameters : tuple of EffectParameter
        Its numbers.
    validity : str
        Where the law holds.
    experiment : str
        What isolates it.
    confusable : tuple of str
        Names of effects that the same data may also fit.
    each_sensor : bool
        Whether its parameters are the names of the plant's measured signals.
    proportional : bool
        Whether twice the size is twice the change of every signal, so that one probe tells all.
    over_time : str
        `CONSTANT`: what changes with the elapsed time is not this effect. `DRIFT`: it changes with nothing else. Empty:
        neither.
    offsets : tuple of str
        Kinds of signal, `PLACE` or `FORCE`, of which other formulations of the law have a constant more: as a bias of
        the sensor has.
    wave : tuple of two str, optional
        Names of its period and its phase, where it is a sine along the position.
    place : str
        Name of its parameter that is a place along the position, where it has one: it is looked for all along the
        travel of the records.
    plants : tuple of str
        Of an effect with hooks: the plants that it acts on; empty: every one that asks at its seams.
    hooks : mapping of str to callable
        Seam -> plain scalar function that is compiled into the kernels there (`cable_envs.effects.own`).
    states : tuple of EffectState
        Of an effect with hooks: what it remembers.
    advance : mapping of str to callable
        State -> plain scalar function that gives its value ``dt`` later.
    excludes : tuple of str
        Names of effects that a rig cannot have along with it.
    apart : bool
        Whether its law is in a kernel that only rigs with such an effect take: the others' do not carry it.
    hypothesis : bool
        Whether a diagnosis looks for it without being told to.
    refuse : callable, optional
        (its parameters as they are on a plant, by name) -> why a rig cannot have them together; empty: it can.

    Raises
    ------
    ConfigurationError
        For an unknown seam, and for other values of ``over_time`` and ``offsets``.
    """

    name: str
    seam: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]
    validity: str
    experiment: str
    confusable: tuple[str, ...] = ()
    each_sensor: bool = False
    proportional: bool = False
    over_time: str = ""
    offsets: tuple[str, ...] = ()
    wave: tuple[str, str] | None = None
    place: str = ""
    plants: tuple[str, ...] = ()
    hooks: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    states: tuple[EffectState, ...] = ()
    advance: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    excludes: tuple[str, ...] = ()
    apart: bool = False
    hypothesis: bool = True
    refuse: Callable[[Mapping[str, float]], str] | None = None

    def __hash__(self) -> int:
        return hash(self.name)

    def __post_init__(self) -> None:
        if self.seam not in SEAMS:
            raise ConfigurationError(f"effect '{self.name}': seam '{self.seam}' is none of {', '.join(SEAMS)}")
        if self.over_time not in ("", CONSTANT, DRIFT):
            known = f"{CONSTANT}, {DRIFT}"
            raise ConfigurationError(f"effect '{self.name}': over_time '{self.over_time}' is none of {known}")
        if wrong := [kind for kind in self.offsets if kind not in (PLACE, FORCE)]:
            raise ConfigurationError(f"effect '{self.name}': offsets '{wrong[0]}' is none of {PLACE}, {FORCE}")

    def row(self, p: EffectParameter) -> str:
        """Name of a parameter in a plant's table: the plant's own where ``alias`` says so, else "effect.parameter"."""
        return p.alias or f"{self.name}.{p.name}"

    def present(self, values: Mapping[str, float]) -> bool:
        """Whether a rig has the effect; of an effect as it is on a plant.

        Parameters
        ----------
        values : mapping of str to float
            Parameters of the rig by name, of the plant's whole table, SI.

        Returns
        -------
        bool
            True where a parameter that is no shape differs from its null.
        """
        return any(values[self.row(p)] != p.null for p in self.parameters if not p.shape)


def lane_of(effect: Effect, parameter: EffectParameter) -> str:
    """Name of the row of an effect's parameter in a kernel.

    Parameters
    ----------
    effect : Effect
        The effect.
    parameter : EffectParameter
        One of its parameters.

    Returns
    -------
    str
        The effect's name and the parameter's, or that of the one whose row it shares.

    Examples
    --------
    >>> from cable_envs.effects import EFFECTS
    >>> lane_of(EFFECTS["backlash"], EFFECTS["backlash"].parameters[0])
    'backlash_gap'
    """
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
    several : tuple of str
        Those of them that it has at several places at once: an effect with states cannot act there.
    forms : tuple of Effect
        Effects that have a law, parameters or sizes of their own on this plant, whole, under their canonical names.
    """

    effects: Mapping[str, tuple[str, ...]]
    sensors: Mapping[str, str]
    aliases: Mapping[str, str] = field(default_factory=dict)
    turning: bool = False
    seams: tuple[str, ...] = ("actuate", "cable", "load")
    several: tuple[str, ...] = ()
    forms: tuple[Effect, ...] = ()

    def bound(self, effect: Effect, plant: str) -> Effect:
        """An effect as it is on the plant.

        Parameters
        ----------
        effect : Effect
            One of the library, or a user's own.
        plant : str
            The plant's name.

        Returns
        -------
        Effect
            With its parameters, units and sizes there; without parameters where it does not act.
        """
        if effect in self.forms:
            return effect
        if effect.each_sensor:
            one = effect.parameters[0]
            own = tuple(replace(one, name=signal, unit=one.unit or unit) for signal, unit in self.sensors.items())
            return replace(effect, parameters=own)
        names = self.effects.get(effect.name, ())
        seams = set(self.seams) - set(self.several if effect.states else ())
        if effect.hooks and set(effect.hooks) <= seams and plant in (effect.plants or (plant,)):
            names = tuple(p.name for p in effect.parameters)
        found = {p.name: p for p in effect.parameters}
        own = tuple(found[n].on(self.turning, self.aliases.get(f"{effect.name}.{n}", "")) for n in names)
        return replace(effect, parameters=own)
