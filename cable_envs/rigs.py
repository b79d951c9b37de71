"""Rig files: the numbers of one test rig, each with its unit and source.

```yaml
schema: cable-rig/1
name: gu-inferred
plant: cable_hole            # or pulley_circuit (serves the chain too)
holes: 1                     # cable_hole only
description: ...
parameters:
  load_mass: {value: 5.0, unit: kg, source: "..."}
```
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.config import config_path, read_yaml
from cable_envs.errors import ConfigurationError, require_known
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant

SCHEMA = "cable-rig/1"
_KEYS = ("schema", "name", "plant", "holes", "description", "parameters")


@dataclass(frozen=True)
class Rig:
    """A validated rig: ``values`` holds every parameter of its plant in SI, ``sources`` where given ones are from."""

    name: str
    plant: str
    holes: int
    values: Mapping[str, float]
    sources: Mapping[str, str] = field(default_factory=dict)
    description: str = ""

    def simulated_by(self, variant: str = "analytic") -> Plant:
        """The plant that simulates this rig; ``variant`` "analytic" or "chain" for the pulley circuit."""
        return plant_for(self.plant, variant, self.holes)

    def replace(self, changes: Mapping[str, Any]) -> "Rig":
        """The same rig with some parameters changed (numbers in SI or ``{value, unit}``), validated."""
        table = self.simulated_by().parameters
        values = table.unpack(table.pack({**self.values, **dict(changes)}))
        return Rig(self.name, self.plant, self.holes, values, self.sources, self.description)


def rig_from_mapping(data: Mapping[str, Any], origin: str = "rig") -> Rig:
    """A `Rig` from the content of a rig file. Raises ConfigurationError that names ``origin`` and the key."""
    require_known(f"key in {origin}", data, _KEYS)
    if data.get("schema", SCHEMA) != SCHEMA:
        raise ConfigurationError(f"{origin}: schema '{data['schema']}' is not '{SCHEMA}'")
    holes = data.get("holes", 1)
    if not isinstance(holes, int) or isinstance(holes, bool):
        raise ConfigurationError(f"{origin}: holes must be a whole number, got {holes!r}")
    plant = plant_for(str(data.get("plant")), "analytic", holes)
    given = data.get("parameters") or {}
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{origin}: 'parameters' must be a mapping of name: {{value, unit, source}}")
    try:
        values = plant.parameters.unpack(plant.parameters.pack(given))
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from error
    sources = {n: str(item["source"]) for n, item in given.items() if isinstance(item, Mapping) and "source" in item}
    return Rig(str(data.get("name", origin)), plant.name, holes, values, sources, str(data.get("description", "")))


def load_rig(rig: str | Path | Mapping[str, Any] | Rig) -> Rig:
    """A rig by preset name (configs/rigs), by path of a YAML file, or from a mapping.

    Raises ConfigurationError with the nearest preset when the name is unknown.
    """
    if isinstance(rig, Rig):
        return rig
    if isinstance(rig, Mapping):
        return rig_from_mapping(rig)
    path = Path(rig)
    if path.suffix not in (".yaml", ".yml"):
        path = config_path("rigs", f"{rig}.yaml")
    return rig_from_mapping(read_yaml(path), str(path.name))
