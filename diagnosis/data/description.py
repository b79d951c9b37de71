"""What a recording says of all its records: the system, channels with units, parameters that are known or believed.

The same entries stand in a YAML file and are given in memory; numbers become SI here.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import ParameterTable, is_number, si_of, to_si
from cable_envs.sim.rigs import Rig, load_rig

OWN = "own"
"""System of a recording that a user's own simulator is held against: channels are called as that declares them."""
HOLDS = ("line", "step")
"""Of a command between its samples."""
_CHANNEL_KEYS = ("column", "unit", "scale", "offset", "noise_std", "offset_free", "hold", "note", "every")
_VALUE_KEYS = ("value", "unit", "std", "source", "note")


def channels_of(system: str) -> Mapping[str, str]:
    """SI unit of every channel of a system. Positive signs as in the plants: hauling in, lifting, counter-clockwise.

    Raises ConfigurationError for an unknown system, naming the nearest, and for one that has no recordings.
    """
    from cable_envs.plants import families, family

    if system == OWN:
        return _AnyChannel(time="s")
    if system not in families():
        raise ConfigurationError(f"unknown system '{system}'; {nearest(system, families())}")
    return family(system).records()


def require_channels(kind: str, names: Iterable[str], system: str) -> None:
    """ConfigurationError for the first of the names that is no channel of a system; one of one's own may have any."""
    if system != OWN:
        require_known(kind, names, channels_of(system))


def si_unit(system: str, channel: str, unit: str) -> str:
    """SI unit of a channel of a system; of a simulator of one's own the one to which its ``unit`` converts.

    Examples
    --------
    >>> si_unit("own", "tip", "deg"), si_unit("linear_drive", "position", "deg")
    ('rad', 'm')
    """
    return si_of(unit) if system == OWN and channel != "time" else channels_of(system)[channel]


class _AnyChannel(dict[str, str]):
    """Channels of a user's own simulator, of which nothing is known here but the time."""

    def __contains__(self, name: object) -> bool:
        return True

    def __missing__(self, name: str) -> str:
        raise ConfigurationError(f"channel {name}: its unit must be stated, as '{OWN}' has no channels of its own")


@cache
def parameters_of(system: str) -> ParameterTable:
    """Parameters that ``known`` and ``nominal`` of a recording may name: those of the plant and measured radii."""
    from cable_envs.plants import family, plant_for

    return ParameterTable(*plant_for(system).parameters, *family(system).beside)


@dataclass(frozen=True)
class Quantity:
    """A parameter's value and standard deviation.

    Parameters
    ----------
    value : float
        SI.
    std : float, optional
        SI; None where none was given.
    """

    value: float
    std: float | None = None

    def as_entry(self) -> dict[str, float]:
        """What stands under ``known`` or ``nominal`` of a recording."""
        return {"value": self.value} if self.std is None else {"value": self.value, "std": self.std}


@dataclass(frozen=True)
class Channel:
    """How a channel is read; ``noise_std`` in SI, None where not given.

    hold: between its samples a command goes on a "line", or is held in a "step": a row's acts until the next row.
    every: of the time, the period in s of the one clock to which records are brought; None: that of the slowest.
    """

    name: str
    column: str
    unit: str
    si_unit: str
    scale: float = 1.0
    offset: float = 0.0
    noise_std: float | None = None
    offset_free: str | None = None
    note: str = ""
    hold: str = "line"
    every: float | None = None

    def to_si(self, raw: np.ndarray) -> np.ndarray:
        """Raw numbers of the column as SI."""
        return (raw * self.scale + self.offset) * to_si(1.0, self.unit, self.si_unit, self.name)

    def as_entry(self) -> dict[str, Any]:
        """What stands under ``channels`` of a recording whose tables hold SI, by the channels' names."""
        more = (("noise_std", self.noise_std), ("offset_free", self.offset_free), ("note", self.note),
                ("hold", "" if self.hold == HOLDS[0] else self.hold), ("every", self.every))  # fmt: skip
        return {"column": self.name, "unit": self.si_unit} | {key: value for key, value in more if value}


def read_rig(entry: Any, system: str, path: Path) -> Rig | None:
    """The rig that a recording names, or holds as a `Rig` or the content of a rig's file; files lie beside ``path``.

    Raises ConfigurationError, for a rig of another plant too.
    """
    if entry is None:
        return None
    if isinstance(entry, (str, Path)):
        beside, here = path.parent / entry, Path(entry)
        rig = load_rig(beside if beside.is_file() else here if here.is_file() else here.stem)
    elif isinstance(entry, (Rig, Mapping)):
        rig = load_rig(entry)
    else:
        raise ConfigurationError(f"{path.name}: 'rig' must be a preset's name or a file, got {entry!r}")
    if system == OWN:
        raise ConfigurationError(f"{path.name}: a simulator of your own has no rig; leave 'rig' out")
    if rig.plant != system:
        name = entry if isinstance(entry, (str, Path)) else rig.name
        raise ConfigurationError(f"{path.name}: rig '{name}' belongs to {rig.plant}, the recording to {system}")
    return rig


def read_quantities(entries: Any, system: str, origin: str) -> dict[str, Quantity]:
    """``{mass: {value: 2.3, unit: kg, std: 0.4}}``, or ``{mass: 2.3}``, in SI. Raises ConfigurationError."""
    if entries is None:
        return {}
    if not isinstance(entries, Mapping):
        raise ConfigurationError(f"{origin}: expected a mapping of name: {{value, unit, std}}")
    if system == OWN and entries:
        raise ConfigurationError(f"{origin}: parameters of a simulator of your own are declared by it; leave this out")
    table, found = parameters_of(system), {}
    require_known(f"parameter in {origin}", entries, table.names)
    for name, entry in entries.items():
        given = dict(entry) if isinstance(entry, Mapping) else {"value": entry}
        require_known(f"key in {origin}: {name}", given, _VALUE_KEYS)
        std, unit = given.pop("std", None), str(given.get("unit", table[name].unit))
        try:
            value = table[name].check(given)
        except ConfigurationError as error:
            raise ConfigurationError(f"{origin}: {error}") from error
        if std is not None:
            std = to_si(_number(std, f"{origin}: std of {name}", positive=True), unit, table[name].unit, name)
        found[name] = Quantity(value, std)
    return found


def read_channels(entries: Any, system: str, origin: str) -> dict[str, Channel]:
    """``{position: {column: x, unit: mm, noise_std: 0.01}}`` by name. Raises ConfigurationError."""
    if not isinstance(entries, Mapping) or "time" not in entries:
        raise ConfigurationError(f"{origin}: 'channels' must be a mapping of name: {{column, unit}} and hold 'time'")
    units, found = dict(channels_of(system)), {}
    require_channels(f"channel in {origin}", entries, system)
    for name, entry in entries.items():
        where = f"{origin}: channel {name}"
        if not isinstance(entry, Mapping) or "column" not in entry or "unit" not in entry:
            raise ConfigurationError(
                f"{where}: expected {{column: NAME, unit: {units.get(name, 'UNIT')}}}, got {entry!r}"
            )
        require_known(f"key in {where}", entry, _CHANNEL_KEYS)
        if system == OWN and name != "time":
            units[name] = si_of(str(entry["unit"]))
        numbers = {k: _number(entry[k], f"{where}: {k}") for k in ("scale", "offset", "noise_std") if k in entry}
        if numbers.get("scale") == 0.0:
            raise ConfigurationError(f"{where}: scale 0 would make every sample equal")
        factor = to_si(1.0, str(entry["unit"]), units[name], where)
        noise = numbers.pop("noise_std", None)
        if noise is not None and noise <= 0:
            raise ConfigurationError(f"{where}: noise_std must be positive, got {noise:g}")
        noise = None if noise is None else noise * factor
        found[name] = Channel(
            name, str(entry["column"]), str(entry["unit"]), units[name], **numbers, noise_std=noise,
            offset_free=offset_free(entry, name, where), note=str(entry.get("note", "")),
            hold=hold(entry, name, where, system), every=every(entry, name, where),
        )  # fmt: skip
    return found


def told(channel: str) -> bool:
    """Whether a channel is what somebody asked for, that no sensor measured."""
    return channel.endswith(("_command", "_reference"))


def offset_free(entry: Mapping[str, Any], name: str, where: str) -> str | None:
    """What says for which records a channel's zero is one; None: it is known. Raises ConfigurationError."""
    free = entry.get("offset_free")
    if free is not None and (not isinstance(free, str) or name == "time"):
        raise ConfigurationError(
            f"{where}: offset_free must be 'record', 'recording' or a condition's name, and not for time"
        )
    return free


def every(entry: Mapping[str, Any], name: str, where: str) -> float | None:
    """The period in s of the clock that the time states for all records. Raises ConfigurationError."""
    if "every" not in entry:
        return None
    if name != "time":
        raise ConfigurationError(f"{where}: 'every' is for time: the period of the clock of all records")
    return to_si(_number(entry["every"], f"{where}: every", positive=True), str(entry.get("unit", "s")), "s", where)


def hold(entry: Mapping[str, Any], name: str, where: str, system: str = "") -> str:
    """How a channel goes on between its samples, of `HOLDS`. Raises ConfigurationError."""
    found = str(entry.get("hold", "line"))
    require_known(f"hold in {where}", [found], HOLDS)
    if found == "step" and not name.endswith("_command") and system != OWN:
        raise ConfigurationError(f"{where}: 'hold: step' is for commands (..._command); a sensor holds nothing")
    return found


def _number(value: Any, where: str, positive: bool = False) -> float:
    if not is_number(value):
        raise ConfigurationError(f"{where}: expected a number, got {value!r}")
    if positive and value <= 0:
        raise ConfigurationError(f"{where}: must be positive, got {value:g}")
    return float(value)
