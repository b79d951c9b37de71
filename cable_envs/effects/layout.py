"""Which effects a plant has, and where their numbers are in its arrays."""

from collections.abc import Mapping

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.lanes import Field, Lanes
from cable_envs.core.params import ParameterTable
from cable_envs.effects.base import Acting, Effect, lane_of
from cable_envs.effects.lanes import SENSE, STATE_FIELDS, STATES
from cable_envs.effects.library import EFFECTS
from cable_envs.effects.own import memory


class Layout:
    """The effects of one plant: what a rig may say about them, and the rows that they become behind the plant's own.

    Parameters
    ----------
    plant : str
        Its name, for messages.
    parameters : ParameterTable
        The plant's own.
    acting : Acting
        What of the library acts on it.
    own : tuple of Effect
        A user's effects beside the canonical ones.
    worn : tuple of Field
        Rows that the plant adds for itself.

    Attributes
    ----------
    effects : dict of str to Effect
        Every effect as it is on this plant: with its parameters, units and sizes there; without any where it does not
        act.
    table : ParameterTable
        The plant's parameters, then those of the effects under dotted names.
    lanes : Lanes
        Names of the coefficients that kernels know as ``e``.
    count : int
        Rows of coefficients that the effects add, sensors included.
    states : Lanes
        Names of the effects' states, that kernels know as ``s``.
    starts : dict of str to float
        Values with which they begin, where they are not the plant's to say.
    """

    def __init__(
        self, plant: str, parameters: ParameterTable, acting: Acting, own: tuple[Effect, ...] = (),
        worn: tuple[Field, ...] = (),
    ):  # fmt: skip
        self.plant, self.base, self.acting, self.worn = plant, len(parameters), acting, worn
        library = {**EFFECTS, **{effect.name: effect for effect in (*acting.forms, *own)}}
        for name in acting.effects:
            require_known(f"effect that acts on {plant}", [name], EFFECTS)
        self.effects = {name: acting.bound(effect, plant) for name, effect in library.items()}
        self.measured = tuple(acting.sensors)
        known = [(effect, p) for effect in self.effects.values() for p in effect.parameters]
        self.aliases = {f"{effect.name}.{p.name}": p.alias for effect, p in known if p.alias}
        declared = [p.declared(effect.name) for effect, p in known if not p.alias]
        self.table = ParameterTable(*parameters, *declared, aliases=self.aliases, gone=parameters.gone)
        self.null = np.array([p.default for p in declared])
        fields = {
            lane_of(effect, p): p.null
            for effect in library.values()
            for p in effect.parameters
            if not effect.each_sensor and f"{effect.name}.{p.name}" not in self.aliases
        }
        self.lanes = Lanes("Effects", ["on", *fields, *worn])
        self._nulls = {self.lanes.row(name): null for name, null in fields.items()}
        self._places = [(self._row(p.name), k) for k, p in enumerate(declared)]
        self._switches = [
            (self.table.index(f"{effect.name}.{p.name}") - self.base, p.null, 2.0 if effect.apart else 1.0)
            for effect, p in known
            if effect.seam != "sense" and not p.shape and not p.alias
        ]
        """(place among the effects' values, null, kernel that is needed) of what switches the kernel's effects on"""
        self.count = self.lanes.count + SENSE.count * len(self.measured)
        self.starts = memory(self.effects.values())
        self.states = Lanes("States", (*STATE_FIELDS, *self.starts)) if self.starts else STATES

    def _row(self, name: str) -> int:
        effect, parameter = name.split(".", 1)
        if self.effects[effect].each_sensor:
            return self.sense_row(parameter) + SENSE.row(effect)
        declared = next(p for p in self.effects[effect].parameters if p.name == parameter)
        return self.lanes.row(lane_of(self.effects[effect], declared))

    def check(self, name: str) -> None:
        """Raise ConfigurationError with the nearest name where no effect's parameter of this plant is called so."""
        effect, _, parameter = name.partition(".")
        require_known("effect", [effect], self.effects)
        known = [p.name for p in self.effects[effect].parameters]
        if not known:
            acting = ", ".join(name for name, one in self.effects.items() if one.parameters)
            raise ConfigurationError(f"effect '{effect}' does not act on {self.plant}; these do: {acting}")
        if parameter not in known:
            raise ConfigurationError(f"effect '{effect}' has no parameter '{parameter}'; {nearest(parameter, known)}")

    def require_possible(self, given: Mapping[str, float]) -> None:
        """Raise ConfigurationError where a rig cannot have what is given of its effects (dotted names, SI)."""
        for effect in self.effects.values():
            named = {p.name: given.get(f"{effect.name}.{p.name}", p.null) for p in effect.parameters}
            reason = effect.refuse(named) if effect.refuse is not None else ""
            if reason:
                raise ConfigurationError(f"effect '{effect.name}': {reason}")
            if effect.excludes and any(named[p.name] != p.null for p in effect.parameters if not p.shape):
                for other in map(self.effects.__getitem__, effect.excludes):
                    if any(
                        given.get(f"{other.name}.{p.name}", p.null) != p.null for p in other.parameters if not p.shape
                    ):
                        raise ConfigurationError(f"a rig cannot have both {effect.name} and {other.name}")

    def present(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Names of the effects that a rig with these values has."""
        return tuple(name for name, effect in self.effects.items() if effect.present(values))

    def coefficients(self, values: np.ndarray) -> np.ndarray:
        """Rows [count, n] of the effects' values [len(table) - base, n]; the plant's own rows (`worn`) are zero."""
        out = np.zeros((self.count, values.shape[1]))
        for row, null in self._nulls.items():
            out[row] = null
        out[self.lanes.count + SENSE.row("sensor_scale") :: SENSE.count] = 1.0
        for row, k in self._places:
            out[row] = values[k]
        on = self.lanes.row("on")
        for k, null, kernel in self._switches:
            out[on] = np.maximum(out[on], kernel * (values[k] != null))
        return out

    def sense_row(self, signal: str) -> int:
        """First row of a sensor's delay, bias, scale and rectification, among those of the effects."""
        return self.lanes.count + SENSE.count * self.measured.index(signal)

    def distorted(self, p: np.ndarray) -> bool:
        """Whether columns [coefficients, n] have an effect of a sensor."""
        first = len(p) - SENSE.count * len(self.measured)
        null = np.tile([0.0, 0.0, 1.0, 0.0], len(self.measured))
        return bool((p[first:] != null[:, None]).any())
