"""What a recording says about one record besides its data: conditions, offsets, and where it is in doubt."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number, to_si

DOUBTS = ("stuck", "saturated", "gap", "missing", "dropped", "clock", "label", "outlier", "other")
"""Kinds of doubt. Samples of a channel within a "stuck" or "saturated" span are not measurements of it."""

UNUSABLE = ("stuck", "saturated")
_DOUBT_KEYS = ("channel", "kind", "from_s", "to_s", "note")
_CONDITION_KEYS = ("value", "unit", "note")
_CONDITION_UNITS = (
    "m", "rad", "N", "N m", "m/s", "rad/s", "kg", "s", "Hz", "A", "V", "1", "N/m", "N s/m", "N m/rad", "N m s/rad",
    "kg m^2", "m/s^2", "Pa", "ohm", "K",
)  # fmt: skip
_CELSIUS, _ICE = ("degC", "°C"), 273.15  # K


@dataclass(frozen=True)
class Doubt:
    """A span of a record, s, that is in doubt; ``channel`` is None where all of it is."""

    kind: str
    note: str
    channel: str | None = None
    start: float = float("-inf")
    end: float = float("inf")

    def as_entry(self) -> dict[str, Any]:
        """What stands under ``quality`` of a record."""
        more = (("channel", self.channel, self.channel is not None), ("from_s", self.start, np.isfinite(self.start)),
                ("to_s", self.end, np.isfinite(self.end)), ("note", self.note, bool(self.note)))  # fmt: skip
        return {"kind": self.kind} | {key: value for key, value, said in more if said}


def read_conditions(entry: Any, where: str) -> tuple[dict[str, float | str], dict[str, str]]:
    """Conditions of a record, with the units that they were given in.

    Parameters
    ----------
    entry : mapping or None
        ``{frequency: {value: 0.1, unit: Hz}, tool: A}``: numbers in SI, numbers with a unit, or text.
    where : str
        The record, for errors.

    Returns
    -------
    conditions : dict of str to float or str
        Numbers in SI.
    units : dict of str to str
        The SI unit of every number that was given with one.

    Raises
    ------
    ConfigurationError
        For what is neither number nor text, and for units that are not known.
    """
    if entry is None:
        return {}, {}
    if not isinstance(entry, Mapping):
        raise ConfigurationError(f"{where}: 'conditions' must be a mapping of name: number, text or {{value, unit}}")
    found: dict[str, float | str] = {}
    units: dict[str, str] = {}
    for name, given in entry.items():
        if isinstance(given, Mapping):
            require_known(f"key in {where}: condition {name}", given, _CONDITION_KEYS)
            value = given.get("value")
            if value is None or not is_number(value):
                raise ConfigurationError(f"{where}: condition {name}: expected a number, got {value!r}")
            found[str(name)] = float(value)
            if "unit" in given:
                found[str(name)], units[str(name)] = _in_si(value, str(given["unit"]), f"{where}: condition {name}")
        elif is_number(given):
            found[str(name)] = float(given)
        elif isinstance(given, str):
            found[str(name)] = given
        else:
            raise ConfigurationError(f"{where}: condition {name}: expected a number or a text, got {given!r}")
    return found, units


def _in_si(value: float, unit: str, where: str) -> tuple[float, str]:
    """(the number in SI, its SI unit)."""
    if unit in _CELSIUS:
        return value + _ICE, "K"
    for si_unit in _CONDITION_UNITS:
        try:
            return to_si(value, unit, si_unit, where), si_unit
        except ConfigurationError:
            continue
    raise ConfigurationError(f"{where}: unit '{unit}' is not known; write the number in SI")


def read_offsets(entry: Any, channels: Mapping[str, Any], where: str) -> dict[str, float]:
    """``{output_angle: -71.2}``, in each channel's unit, as SI. Raises ConfigurationError."""
    if entry is None:
        return {}
    if not isinstance(entry, Mapping):
        raise ConfigurationError(f"{where}: 'offsets' must be a mapping of channel: number in the channel's unit")
    require_known(f"channel in {where}: offsets", entry, channels)
    for name, value in entry.items():
        if not is_number(value):
            raise ConfigurationError(f"{where}: offset of {name}: expected a number, got {value!r}")
        if name == "time":
            raise ConfigurationError(f"{where}: time has no offset of its own in a record; use the channel's")
    return {n: to_si(float(v), channels[n].unit, channels[n].si_unit, where) for n, v in entry.items()}


def read_doubts(entry: Any, channels: Mapping[str, Any], where: str) -> tuple[Doubt, ...]:
    """The list under ``quality``. Raises ConfigurationError."""
    if entry is None:
        return ()
    if not isinstance(entry, list) or not all(isinstance(e, Mapping) for e in entry):
        raise ConfigurationError(f"{where}: 'quality' must be a list of {{channel, kind, from_s, to_s, note}}")
    found = []
    for given in entry:
        require_known(f"key in {where}: quality", given, _DOUBT_KEYS)
        kind, channel = str(given.get("kind", "other")), given.get("channel")
        require_known(f"kind in {where}: quality", [kind], DOUBTS)
        if channel is not None:
            require_known(f"channel in {where}: quality", [channel], channels)
        for key in ("from_s", "to_s"):
            if key in given and not is_number(given[key]):
                raise ConfigurationError(f"{where}: quality: {key}: expected a number, got {given[key]!r}")
        start, end = float(given.get("from_s", "-inf")), float(given.get("to_s", "inf"))
        if end < start:
            raise ConfigurationError(f"{where}: quality: from_s {start:g} lies behind to_s {end:g}")
        found.append(Doubt(kind, str(given.get("note", "")), channel, start, end))
    return tuple(found)
