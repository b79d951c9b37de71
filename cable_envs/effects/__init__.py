"""Physics that a simulator may lack: one file per effect, all of them in one registry.

Every effect has a null value that is bit-equal to its absence, so one compiled kernel holds them all and a batch can
mix rigs with different effects. Switch one on with ``gymnasium.make(..., effects={"backlash": {"gap": 0.02}})``, in a
rig file under ``effects:``, or by its dotted name wherever a rig's parameter may be named ("backlash.gap").
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.lanes import Field, Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import (
    actuator_lag,
    asymmetric_friction,
    backlash,
    bending_stiffness,
    cable_elongation,
    coulomb_friction,
    friction_drift,
    lateral_extrusion,
    load_dependent_friction,
    partial_slip,
    position_dependent_load,
    position_ripple,
    presliding_hysteresis,
    sensor_bias,
    sensor_delay,
    sensor_rectification,
    sensor_scale,
    slack,
    stiffness_hardening,
    stribeck_friction,
    viscoelastic_creep,
    viscous_friction,
)  # fmt: skip
from cable_envs.effects.base import MEASURED, PLANTS, SEAMS, Effect, EffectParameter
from cable_envs.effects.lanes import SENSE

__all__ = ["EFFECTS", "MEASURED", "PLANTS", "SEAMS", "Effect", "EffectParameter", "Layout", "dotted", "lane_of"]

EFFECTS: Mapping[str, Effect] = MappingProxyType({
    module.EFFECT.name: module.EFFECT
    for module in (
        coulomb_friction, viscous_friction, stribeck_friction, asymmetric_friction, presliding_hysteresis,
        load_dependent_friction, lateral_extrusion, bending_stiffness, cable_elongation, stiffness_hardening,
        viscoelastic_creep, friction_drift, backlash, slack, partial_slip, position_ripple, position_dependent_load,
        actuator_lag, sensor_delay, sensor_bias, sensor_scale, sensor_rectification,
    )
})  # fmt: skip
"""The canonical effects by name."""


def dotted(effects: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """("backlash.gap", value) pairs of ``{"backlash": {"gap": value}}``; dotted names are taken as they are.

    Raises ConfigurationError where an effect's entry is no mapping.
    """
    for name, given in effects.items():
        if "." in str(name):
            yield str(name), given
        elif isinstance(given, Mapping):
            yield from ((f"{name}.{parameter}", value) for parameter, value in given.items())
        else:
            raise ConfigurationError(f"effect '{name}': expected a mapping of parameters, got {given!r}")


class Layout:
    """The effects of one plant: what a rig may say about them, and the rows that they become behind the plant's own.

    ``own``: a user's effects, beside the canonical ones. ``worn``: rows that the plant adds for itself.
    """

    def __init__(
        self, plant: str, parameters: ParameterTable, own: tuple[Effect, ...] = (), worn: tuple[Field, ...] = ()
    ):
        self.plant, self.base, self.worn = plant, len(parameters), worn
        self.effects = {**EFFECTS, **{effect.name: effect for effect in own}}
        self.measured = tuple(MEASURED[plant])
        declared, self.aliases = self._declare(parameters)
        self.table = ParameterTable(*parameters, *declared, aliases=self.aliases)
        self.null = np.array([p.default for p in declared])
        self.lanes = Lanes("Effects", ["on", *self._fields(), *worn])
        """names of the coefficients that kernels know as e"""
        self._places = [(self._row(p.name), k) for k, p in enumerate(declared)]
        self._switches = self._find_switches()
        self.count = self.lanes.count + SENSE.count * len(self.measured)
        """Rows of coefficients that the effects add."""

    def _declare(self, parameters: ParameterTable) -> tuple[list[Parameter], dict[str, str]]:
        declared, aliases = [], {}
        for effect in self.effects.values():
            for p in effect.parameters_on(self.plant):
                if self.plant in p.aliases:
                    aliases[f"{effect.name}.{p.name}"] = p.aliases[self.plant]
                else:
                    declared.append(p.declared(effect.name, self.plant))
        return declared, aliases

    def _find_switches(self) -> list[tuple[int, float]]:
        """(place among the effects' values, null) of what switches the kernel's effects on."""
        found: list[tuple[int, float]] = []
        for effect in self.effects.values():
            if effect.seam == "sense":
                continue
            found.extend(
                (self.table.index(f"{effect.name}.{p.name}") - self.base, p.null)
                for p in effect.parameters_on(self.plant)
                if not p.shape and self.plant not in p.aliases
            )
        return found

    def _fields(self) -> list[str]:
        """A row for every parameter of every effect, in use here or not, but those that are parameters of the plant."""
        names = [
            lane_of(effect, p)
            for effect in self.effects.values()
            if not effect.each_sensor
            for p in effect.parameters
            if self.plant not in p.aliases
        ]
        return list(dict.fromkeys(names))

    def _row(self, name: str) -> int:
        effect, parameter = name.split(".", 1)
        if effect in SENSE:
            return self.sense_row(parameter) + SENSE.row(effect)
        declared = next(p for p in self.effects[effect].parameters if p.name == parameter)
        return self.lanes.row(lane_of(self.effects[effect], declared))

    def check(self, name: str) -> None:
        """Raise ConfigurationError with the nearest name where no effect's parameter of this plant is called so."""
        effect, _, parameter = name.partition(".")
        require_known("effect", [effect], self.effects)
        known = [p.name for p in self.effects[effect].parameters_on(self.plant)]
        if not known:
            where = " or ".join(self.effects[effect].plants)
            raise ConfigurationError(f"effect '{effect}' does not act on {self.plant}; it acts on {where}")
        if parameter not in known:
            raise ConfigurationError(f"effect '{effect}' has no parameter '{parameter}'; {nearest(parameter, known)}")

    def present(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Names of the effects that a rig with these values has."""
        return tuple(name for name, e in self.effects.items() if e.present(self.plant, values))

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Rows [count, n] of the effects' values [len(table) - base, n]; the plant's own rows (`worn`) are zero."""
        out = np.zeros((self.count, values.shape[1]))
        for effect in self.effects.values():
            for p in effect.parameters:
                if not effect.each_sensor and lane_of(effect, p) in self.lanes:
                    out[self.lanes.row(lane_of(effect, p))] = p.null
        out[self.lanes.count + SENSE.row("sensor_scale") :: SENSE.count] = 1.0
        for row, k in self._places:
            out[row] = values[k]
        on = self.lanes.row("on")
        for k, null in self._switches:
            out[on] = np.maximum(out[on], values[k] != null)
        return out

    def sense_row(self, signal: str) -> int:
        """First row of a sensor's delay, bias, scale and rectification, among those of the effects."""
        return self.lanes.count + SENSE.count * self.measured.index(signal)

    def distorted(self, p: np.ndarray) -> bool:
        """Whether columns [coefficients, n] have an effect of a sensor."""
        first = len(p) - SENSE.count * len(self.measured)
        null = np.tile([0.0, 0.0, 1.0, 0.0], len(self.measured))
        return bool((p[first:] != null[:, None]).any())


def lane_of(effect: Effect, parameter: EffectParameter) -> str:
    """Name of the row of an effect's parameter in a kernel."""
    return f"{effect.name}_{parameter.lane or parameter.name}"
