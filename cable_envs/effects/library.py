"""The library of effects: every file of this folder that has an ``EFFECT``."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.effects.base import Effect

SHOWN = (
    "coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "presliding_hysteresis",
    "lugre_friction", "elastoplastic_friction", "load_dependent_friction", "gear_friction", "lateral_extrusion",
    "bending_stiffness", "cable_elongation", "stiffness_hardening",
    "viscoelastic_creep", "slow_creep", "friction_drift", "backlash", "slack", "partial_slip", "position_ripple",
    "position_dependent_load", "unilateral_contact", "actuator_lag", "command_delay", "dead_band", "quantised_command",
    "supply_sag", "torque_saturation", "winding_heating", "sensor_delay", "sensor_bias", "sensor_scale",
    "sensor_rectification",
)  # fmt: skip
"""The order in which effects are listed to people, friction first; what is not named here comes behind, by name."""


def _found() -> dict[str, Effect]:
    names = [module.name for module in iter_modules([str(Path(__file__).parent)])]
    modules = [import_module(f"{__package__}.{name}") for name in names if name not in ("library", "layout")]
    effects = {module.EFFECT.name: module.EFFECT for module in modules if hasattr(module, "EFFECT")}
    return {name: effects[name] for name in sorted(effects, key=lambda n: (SHOWN.index(n) if n in SHOWN else 99, n))}


EFFECTS: Mapping[str, Effect] = MappingProxyType(_found())
"""The canonical effects by name."""


def dotted(effects: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """("backlash.gap", value) pairs of ``{"backlash": {"gap": value}}``; dotted names are taken as they are.

    Raises ConfigurationError where an effect's entry is no mapping, or an empty one.
    """
    for name, given in effects.items():
        if "." in str(name):
            yield str(name), given
        elif isinstance(given, Mapping) and not given:
            raise ConfigurationError(f"effect '{name}': no parameter is given; leave it out, or name what it has")
        elif isinstance(given, Mapping):
            yield from ((f"{name}.{parameter}", value) for parameter, value in given.items())
        else:
            raise ConfigurationError(f"effect '{name}': expected a mapping of parameters, got {given!r}")
