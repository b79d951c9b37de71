"""Rig files: the numbers of one test rig, each with its unit and source.

```yaml
schema: cable-rig/1
name: gu-inferred
plant: cable_hole            # a family of plants
variant: chain               # pulley_circuit only: which of its simulators the numbers are of
extends: other-rig           # a preset whose parameters hold where this file gives none
holes: 1                     # cable_hole only
contacts: 20                 # tendon_sheath only: at how many places the tendon rubs; without it all together
drive: motor                 # a real drive: motor, gear, encoder, servo; "ideal" unless it is said
description: ...
parameters:
  load_mass: {value: 5.0, unit: kg, source: "..."}
valid:                       # where the parameters hold, by signal of the plant; beyond, info says out_of_range
  load_velocity: {low: -11, high: 11, unit: mm/s, source: "..."}
effects:                     # physics that the plant leaves out unless it is said here (`cable_envs.effects`)
  backlash: {gap: {value: 0.2, unit: mm, source: "..."}}
```
"""  # noqa: D405, D406, D407, D411 - "parameters:" is a key of the file

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.config import config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import Parameter
from cable_envs.effects import Effect, dotted
from cable_envs.plants import VERSIONS, family, plant_for
from cable_envs.plants.base import OUT_OF_RANGE, Plant
from cable_envs.plants.own_effects import with_own_effects

SCHEMA = "cable-rig/1"
_KEYS = (
    "schema",
    "name",
    "plant",
    "variant",
    "extends",
    "holes",
    "contacts",
    "drive",
    "description",
    "parameters",
    "valid",
    "effects",
)


@dataclass(frozen=True)
class Rig:
    """The validated parameters of one test rig.

    Attributes
    ----------
    name : str
        Name of the rig.
    plant : str
        Family of plants that simulates it, as "cable_hole".
    holes : int
        Holes in series; 1 where the family has no such series.
    values : mapping of str to float
        Every parameter of the plant, SI.
    sources : mapping of str to str
        Where the given parameters are from, by name.
    description : str
        For people.
    effects : mapping of str to float
        The given parameters of effects under dotted names ("backlash.gap"), SI. All others are at null. A parameter
        that the plant itself has under another name ("viscous_friction.coefficient") is among ``values``.
    own : tuple of Effect
        A user's own effects, which ``effects`` may name too.
    drive : str
        What moves the cable: "ideal" or "motor" (`cable_envs.plants.servo`).
    contacts : int
        At how many places a sheath rubs; 0: its friction is taken all together.
    variant : str
        Which simulator of its family the numbers are of, as "chain"; "": nobody says.
    valid : mapping of str to (float, float)
        Range of a signal of the plant, SI, that the parameters are from, where that is known. Beyond it a simulation
        goes on, and the info of an environment says ``out_of_range``. The sources are among ``sources``.

    Examples
    --------
    >>> rig = load_rig("gu-inferred").replace({"load_mass": {"value": 4000.0, "unit": "g"}, "backlash.gap": 5e-4})
    >>> rig.values["load_mass"], rig.effects
    (4.0, {'backlash.gap': 0.0005})
    """

    name: str
    plant: str
    holes: int
    values: Mapping[str, float]
    sources: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    effects: Mapping[str, float] = field(default_factory=dict)
    own: tuple[Effect, ...] = ()
    valid: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    drive: str = "ideal"
    contacts: int = 0
    variant: str = ""

    def content(self) -> dict[str, Any]:
        """The rig as the content of a rig file.

        Returns
        -------
        dict
            Of names, numbers and text: what `load_rig` takes. A user's own effects are in their own files.
        """
        table = self.simulated_by().table
        parameters = {
            name: {"value": value, "unit": table[name].unit}
            | ({"source": self.sources[name]} if name in self.sources else {})
            for name, value in self.values.items()
        }
        signals = {s.name: s for s in self.simulated_by().signals}
        valid = {
            name: {"low": low, "high": high, "unit": signals[name].unit}
            | ({"source": self.sources[name]} if name in self.sources else {})
            for name, (low, high) in self.valid.items()
        }
        effects: dict[str, dict[str, float]] = {}
        for name, value in self.effects.items():
            effect, parameter = name.split(".", 1)
            effects.setdefault(effect, {})[parameter] = value
        spread = {"contacts": self.contacts} if self.contacts else {}
        form = {"variant": self.variant} if self.variant else {}
        return {
            "schema": SCHEMA, "name": self.name, "plant": self.plant, **form, "holes": self.holes, **spread,
            "drive": self.drive, "description": self.description, "parameters": parameters, "valid": valid,
            "effects": effects,
        }  # fmt: skip

    def holds(self, plant: Plant) -> dict[str, tuple[float, float]]:
        """Ranges of signals in which the rig's parameters and the plant's laws hold.

        Parameters
        ----------
        plant : Plant
            A simulator of the rig.

        Returns
        -------
        dict of str to (float, float)
            Signal -> (low, high), SI: `valid`, and for other signals where the plant's laws were identified.

        Examples
        --------
        >>> rig = load_rig({"plant": "cable_hole"})
        >>> rig.holds(rig.simulated_by())
        {'load_velocity': (-0.0108, 0.0108)}
        """
        laws = {one.signal: (one.low, one.high) for one in plant.ranges if self.values.get(one.law, 0.0) != 0.0}
        return {**laws, **self.valid}

    def column(self, plant: Plant) -> np.ndarray:
        """The rig as a column of parameters.

        Parameters
        ----------
        plant : Plant
            A simulator of the rig.

        Returns
        -------
        ndarray, shape (len(plant.table), 1)
            Values in the order of the plant's table, SI; effects that were not given are at null.

        Raises
        ------
        ConfigurationError
            Where an effect of the rig does not act on the plant.
        """
        for name, value in self.effects.items():
            if name not in plant.table and value != self.simulated_by().table[name].default:
                plant.effects.check(name)
        given = {name: value for name, value in self.effects.items() if name in plant.table}
        return plant.table.pack({**self.values, **given})[:, None]

    def simulated_by(self, variant: str = "", version: str = VERSIONS[-1]) -> Plant:
        """The plant that simulates this rig.

        Parameters
        ----------
        variant : str
            "analytic", or "chain" for the pulley circuit as a chain of spans and contacts; "": the rig's own, and where
            it says none the first of its family.
        version : str
            Version of the ids whose numbers it gives (`cable_envs.plants.plant_for`).

        Returns
        -------
        Plant
            With the user's own effects, where the rig has some.

        Raises
        ------
        ConfigurationError
            For an unknown variant or version, and for own effects that do not act on the plant.
        """
        form = variant or self.variant or family(self.plant).variants[0]
        plant = plant_for(self.plant, form, self.holes, version, self.drive, self.contacts)
        return with_own_effects(plant, self.own)

    def replace(self, changes: Mapping[str, Any]) -> "Rig":
        """The same rig with some parameters changed.

        Parameters
        ----------
        changes : mapping
            Name to value: a number in SI or ``{value, unit}``. A name is that of a parameter of the plant, a dotted one
            of an effect ("backlash.gap"), or an effect with a mapping of its parameters.

        Returns
        -------
        Rig
            A new one, validated.

        Raises
        ------
        ConfigurationError
            For unknown names, units that do not fit, values out of bounds, and what an effect cannot have together.
        """
        plant = self.simulated_by()
        own, effects = _sorted(changes, plant)
        values = plant.parameters.unpack(plant.parameters.pack({**self.values, **own}))
        plant.effects.require_possible({**self.effects, **effects})
        return replace(self, values=values, effects={**self.effects, **effects})


def _sorted(changes: Mapping[str, Any], plant: Plant) -> tuple[dict[str, Any], dict[str, float]]:
    """(the plant's own parameters as given, the effects' in SI under dotted names)."""
    own: dict[str, Any] = {}
    effects: dict[str, float] = {}
    for name, given in changes.items():
        if "." not in str(name) and name not in plant.effects.effects:
            own[name] = given
            continue
        for full, value in dotted({name: given}):
            plant.effects.check(full)
            if full in plant.effects.aliases:
                own[plant.effects.aliases[full]] = value
            else:
                effects[full] = plant.table[full].check(value)
    return own, effects


def rig_from_mapping(data: Mapping[str, Any], origin: str = "rig", own: tuple[Effect, ...] = ()) -> Rig:
    """A `Rig` from the content of a rig file.

    Parameters
    ----------
    data : mapping
        Keys of a rig file, as the text at the head of this module shows them. Only "plant" is required.
    origin : str
        What errors call the source; also the name of a rig without one.
    own : tuple of Effect
        A user's own effects, which the mapping may name.

    Returns
    -------
    Rig
        Validated; parameters that are not given have the default of the plant.

    Raises
    ------
    ConfigurationError
        Names ``origin`` and the key.

    Examples
    --------
    >>> rig_from_mapping({"plant": "pulley_circuit", "name": "bench"}).name
    'bench'
    """
    require_known(f"key in {origin}", data, _KEYS)
    if data.get("schema", SCHEMA) != SCHEMA:
        raise ConfigurationError(f"{origin}: schema '{data['schema']}' is not '{SCHEMA}'")
    data = _extended(data, origin)
    holes, contacts = _number("holes", data, 1, origin), _number("contacts", data, 0, origin)
    drive = str(data.get("drive", "ideal"))
    told = family(str(data.get("plant")))
    variant = "" if data.get("variant") is None else str(data["variant"])
    if variant:
        require_known(f"variant of {told.name} in {origin}", [variant], told.variants)
    plant = plant_for(told.name, variant or told.variants[0], holes, drive=drive, contacts=contacts)
    given = data.get("parameters") or {}
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{origin}: 'parameters' must be a mapping of name: {{value, unit, source}}")
    try:
        values = plant.parameters.unpack(plant.parameters.pack(given))
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from error
    sources = {n: str(item["source"]) for n, item in given.items() if isinstance(item, Mapping) and "source" in item}
    name, description = str(data.get("name", origin)), str(data.get("description", ""))
    valid = _valid(data.get("valid") or {}, plant, origin)
    sources |= {n: str(item["source"]) for n, item in (data.get("valid") or {}).items() if "source" in item}
    rig = Rig(name, told.name, holes, values, sources, description, {}, own, valid, drive, contacts, variant)
    effects = data.get("effects") or {}
    if not isinstance(effects, Mapping):
        raise ConfigurationError(f"{origin}: 'effects' must be a mapping of effect: {{parameter: value}}")
    try:
        return rig.replace(dict(dotted(effects)))
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from error


def _number(key: str, data: Mapping[str, Any], usual: int, origin: str) -> int:
    """What the rig says under a key for how many there are of something."""
    value = data.get(key, usual)
    if not isinstance(value, int) or isinstance(value, bool):
        raise ConfigurationError(f"{origin}: {key} must be a whole number, got {value!r}")
    return value


def _extended(data: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """A rig file's content with what it does not say itself taken from the preset that it extends."""
    if "extends" not in data:
        return data
    path = config_path("rigs", f"{data['extends']}.yaml")
    base = _extended(read_yaml(path), path.name)
    if data.get("plant", base["plant"]) != base["plant"]:
        raise ConfigurationError(f"{origin}: extends {data['extends']}, which is of {base['plant']}")
    joined = {key: {**(base.get(key) or {}), **(data.get(key) or {})} for key in ("parameters", "valid", "effects")}
    return {**base, **{key: value for key, value in data.items() if key != "extends"}, **joined}


def _valid(given: Any, plant: Plant, origin: str) -> dict[str, tuple[float, float]]:
    """Ranges of signals, SI, from the key "valid" of a rig file."""
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{origin}: 'valid' must be a mapping of signal: {{low, high, unit, source}}")
    signals = {s.name: s for s in plant.signals}
    if given and OUT_OF_RANGE.name not in signals:
        raise ConfigurationError(f"{origin}: {plant.name} has no signal {OUT_OF_RANGE.name}, so 'valid' says nothing")
    require_known(f"signal under 'valid' in {origin}", given, signals)
    found = {}
    for name, item in given.items():
        if not isinstance(item, Mapping) or not {"low", "high"} <= set(item) <= {"low", "high", "unit", "source"}:
            raise ConfigurationError(f"{origin}: valid.{name}: expected {{low, high, unit, source}}, got {item!r}")
        unit = item.get("unit", signals[name].unit)
        declared = Parameter(f"valid.{name}", signals[name].unit, 0.0, -np.inf, np.inf, "")
        low, high = (declared.check({"value": item[end], "unit": unit}) for end in ("low", "high"))
        if not low < high:
            raise ConfigurationError(f"{origin}: valid.{name}: low {low:g} is not below high {high:g}")
        found[name] = (low, high)
    return found


def load_rig(rig: str | Path | Mapping[str, Any] | Rig, own: tuple[Effect, ...] = ()) -> Rig:
    """A rig by preset name (configs/rigs), by path of a YAML file, or from a mapping.

    Parameters
    ----------
    rig : str, path, mapping or Rig
        What names or holds it.
    own : tuple of Effect
        A user's own effects (`plants.own_effects`), that the rig may name.

    Returns
    -------
    Rig
        The parameters of one test rig, checked, in SI.

    Raises
    ------
    ConfigurationError
        With the nearest preset when the name is unknown, and for a file that is no rig.

    Examples
    --------
    >>> load_rig("gu-inferred").values["load_mass"]
    5.0
    """
    if isinstance(rig, Rig):
        return replace(rig, own=(*rig.own, *own))
    if isinstance(rig, Mapping):
        return rig_from_mapping(rig, own=own)
    if not isinstance(rig, (str, Path)):
        raise ConfigurationError(f"rig: expected a preset's name, a YAML file or a mapping, got {rig!r}")
    path = Path(rig)
    if path.suffix not in (".yaml", ".yml"):
        path = config_path("rigs", f"{rig}.yaml")
    return rig_from_mapping(read_yaml(path), str(path.name), own)
