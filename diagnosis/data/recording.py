"""Recordings of one rig: a YAML file that names its records, channels, known and nominal parameters.

```yaml
schema: cable-recording/1
system: cable_hole              # cable_hole | pulley_circuit | linear_drive
rig: gu-inferred                # optional: a preset, or a rig file relative to this one
known:   {wrap_angle: {value: 60, unit: deg}}                      # measured and trusted
nominal: {friction_coefficient: {value: 0.43, std: 0.05}}          # believed, to be refitted
records:
  - {data: run_01.csv, use: fit}                                   # CSV with a header row, or Parquet
  - data: run_02.csv
    use: heldout
    conditions: {load: {value: 5, unit: N}, tool: A}               # optional: numbers with units, or text
    offsets: {drive_position: -3.2}                                # optional, in the channel's unit: added to it
    quality: [{channel: drive_tension, kind: saturated, from_s: 1, to_s: 1.2, note: "flat at 50 N"}]
  - {data: rest.csv, use: rest}                                    # optional: nothing moves, sensors show their noise
channels:
  time:           {column: t, unit: s}
  drive_tension:  {column: F, unit: N, noise_std: 0.05, scale: 1, offset: 0, note: "positive pulls"}
  drive_position: {column: n, unit: mm, scale: 0.01, offset_free: record}
```

A channel's quantity in its ``unit`` is ``scale`` times the column plus ``offset`` plus the record's own offset;
``noise_std`` is in that unit too. ``offset_free`` marks a channel whose zero means nothing, such as an incremental
encoder's: it may be another one in every record (``record``), is one for all (``recording``), or one for the records
that share a condition (its name). ``quality`` says where a record is in doubt (`diagnosis.data.entries`).
A record at rest tells the noise of all channels with its colour (`diagnosis.model.rest`).
Everything returned is in SI. Errors name the file, and where it applies the channel, its column and the data row.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import ParameterTable, to_si
from cable_envs.sim.rigs import Rig, load_rig
from diagnosis.data.entries import UNUSABLE, Doubt, read_conditions, read_doubts, read_offsets
from diagnosis.data.tables import read_columns

SCHEMA = "cable-recording/1"
USES = ("fit", "heldout", "rest")
HOLDS = ("line", "step")
"""Of a command between its samples."""
_KEYS = ("schema", "system", "rig", "known", "nominal", "records", "channels", "description", "source")
_CHANNEL_KEYS = ("column", "unit", "scale", "offset", "noise_std", "offset_free", "hold", "note")
_RECORD_KEYS = ("data", "use", "conditions", "offsets", "quality")
_VALUE_KEYS = ("value", "unit", "std", "source", "note")


def channels_of(system: str) -> Mapping[str, str]:
    """SI unit of every channel of a system. Positive signs as in the plants: hauling in, lifting, counter-clockwise.

    Raises ConfigurationError for an unknown system, naming the nearest, and for one that has no recordings.
    """
    from cable_envs.plants import families, family

    if system not in families():
        raise ConfigurationError(f"unknown system '{system}'; {nearest(system, families())}")
    return family(system).records()


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


@dataclass(frozen=True)
class Channel:
    """How a channel is read; ``noise_std`` in SI, None where not given.

    hold: between its samples a command goes on a "line", or is held in a "step": a row's acts until the next row.
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

    def to_si(self, raw: np.ndarray) -> np.ndarray:
        """Raw numbers of the column as SI."""
        return (raw * self.scale + self.offset) * to_si(1.0, self.unit, self.si_unit, self.name)


@dataclass(frozen=True)
class Record:
    """One data file: arrays [samples] in SI by channel. Gaps (empty cells) are NaN, except in time.

    Parameters
    ----------
    name : str
        Its file's name.
    use : str
        "fit", "heldout" or "rest".
    data : Mapping of str to ndarray
        [samples] by channel.
    conditions, offsets : Mapping
        In SI too; the offsets are in the data already.
    quality : tuple of Doubt
        Spans of time that are no measurements.
    """

    name: str
    use: str
    data: Mapping[str, np.ndarray]
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    quality: tuple[Doubt, ...] = ()

    @property
    def time(self) -> np.ndarray:
        """s, strictly increasing [samples]."""
        return self.data["time"]

    def usable(self, channel: str) -> np.ndarray:
        """Whether each sample of a channel is a measurement: neither empty nor stuck nor saturated [samples]."""
        good = ~np.isnan(self.data[channel])
        for doubt in self.quality:
            if doubt.kind in UNUSABLE and doubt.channel in (channel, None):
                good &= (self.time < doubt.start) | (self.time > doubt.end)
        return good


@dataclass(frozen=True)
class Recording:
    """A validated recording of one rig: what is known of it, and its tables.

    Parameters
    ----------
    path : Path
        Its YAML file.
    system : str
        The plant: "cable_hole", "pulley_circuit" or "linear_drive".
    rig : Rig, optional
        A preset or file that gives its other numbers.
    known, nominal : Mapping of str to Quantity
        What was measured, and what is believed and may be refitted, SI.
    channels : Mapping of str to Channel
        How each column is read; "time" is one.
    records : tuple of Record
        Tables in SI, each with its use ("fit", "heldout", "rest").
    description, source
        For people.
    """

    path: Path
    system: str
    rig: Rig | None
    known: Mapping[str, Quantity]
    nominal: Mapping[str, Quantity]
    channels: Mapping[str, Channel]
    records: tuple[Record, ...]
    description: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)

    def used_for(self, use: str) -> tuple[Record, ...]:
        """Records for "fit", "heldout" or "rest"."""
        return tuple(record for record in self.records if record.use == use)

    def value(self, name: str) -> float | None:
        """A parameter in SI: known, else nominal, else the rig's, else None."""
        for source in (self.known, self.nominal):
            if name in source:
                return source[name].value
        return self.rig.values.get(name) if self.rig else None

    def holds(self, channel: str) -> bool:
        """Whether a channel is there and acts in steps, each held until the next."""
        return channel in self.channels and self.channels[channel].hold == "step"

    @property
    def noise(self) -> dict[str, float]:
        """Channel -> standard deviation of its noise in SI, where the recording states it."""
        return {name: c.noise_std for name, c in self.channels.items() if c.noise_std is not None}

    def offset_groups(self, channel: str) -> dict[str, tuple[str, ...]]:
        """Names of the records that share a free offset of ``channel``, by a key; empty where its offset is known."""
        free = self.channels[channel].offset_free
        groups: dict[str, list[str]] = {}
        if free is None:
            return {}
        for record in self.records:
            key = {"record": record.name, "recording": "all"}.get(free) or str(record.conditions.get(free, record.name))
            groups.setdefault(key, []).append(record.name)
        return {key: tuple(names) for key, names in groups.items()}

    def require(self, *channels: str, purpose: str) -> None:
        """ConfigurationError that names the channels which ``purpose`` needs and the recording lacks."""
        missing = [name for name in channels if name not in self.channels]
        if missing:
            raise ConfigurationError(
                f"{self.path}: {purpose} needs the channel{'s' if len(missing) > 1 else ''} {', '.join(missing)}; "
                f"the recording has {', '.join(self.channels)}"
            )


def load_recording(path: Path | str) -> Recording:
    """The recording in a YAML file, or in a folder that holds exactly one.

    Parameters
    ----------
    path : Path or str
        File of schema "cable-recording/1", or its folder.

    Returns
    -------
    Recording
        Checked, all numbers in SI, tables read.

    Raises
    ------
    ConfigurationError
        For a key, name, unit or number that cannot be meant, naming file, channel and row, with the nearest valid name.

    Examples
    --------
    ::

        recording = load_recording("jaw/")
        recording.records[0].data["drive_torque"]  # [samples], N m
    """
    path = _yaml_of(Path(path))
    data = read_yaml(path)
    require_known(f"key in {path.name}", data, _KEYS)
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"{path}: 'schema' must be '{SCHEMA}', found {data.get('schema')!r}")
    system = str(data.get("system"))
    try:
        channels_of(system)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    rig = _rig(data.get("rig"), system, path)
    known = _quantities(data.get("known"), system, f"{path.name}: known")
    nominal = _quantities(data.get("nominal"), system, f"{path.name}: nominal")
    for name in nominal:
        if name in known:
            raise ConfigurationError(f"{path.name}: '{name}' is both known and nominal; it can be only one")
    channels = _channels(data.get("channels"), system, path.name)
    entries = data.get("records")
    if not isinstance(entries, list) or not entries:
        raise ConfigurationError(f"{path.name}: 'records' must be a list of {{data: FILE, use: fit or heldout}}")
    records = tuple(_record(entry, k, channels, path) for k, entry in enumerate(entries))
    names = [record.name for record in records]
    if len(set(names)) < len(names):
        raise ConfigurationError(f"{path.name}: a data file is listed twice in 'records'")
    at_rest = [record.name for record in records if record.use == "rest"]
    if len(at_rest) > 1:
        raise ConfigurationError(f"{path.name}: {', '.join(at_rest)} have 'use: rest'; one, the longest, is enough")
    if not any(record.use == "fit" for record in records):
        raise ConfigurationError(f"{path.name}: no record has 'use: fit'")
    description, source = str(data.get("description", "")), data.get("source") or {}
    if not isinstance(source, Mapping):
        raise ConfigurationError(f"{path.name}: 'source' must be a mapping")
    return Recording(path, system, rig, known, nominal, channels, records, description, source)


def _yaml_of(path: Path) -> Path:
    if not path.is_dir():
        return path
    found = sorted(p for p in path.iterdir() if p.suffix in (".yaml", ".yml"))
    if len(found) != 1:
        listed = ", ".join(p.name for p in found) or "none"
        raise ConfigurationError(f"{path}: a recording's folder holds exactly one YAML file, found {listed}")
    return found[0]


def _rig(entry: Any, system: str, path: Path) -> Rig | None:
    if entry is None:
        return None
    if not isinstance(entry, str):
        raise ConfigurationError(f"{path.name}: 'rig' must be a preset's name or a file, got {entry!r}")
    beside = path.parent / entry
    rig = load_rig(beside if beside.is_file() else Path(entry) if Path(entry).is_file() else Path(entry).stem)
    if rig.plant != system:
        raise ConfigurationError(f"{path.name}: rig '{entry}' belongs to {rig.plant}, the recording to {system}")
    return rig


def _quantities(entries: Any, system: str, origin: str) -> dict[str, Quantity]:
    if entries is None:
        return {}
    if not isinstance(entries, Mapping):
        raise ConfigurationError(f"{origin}: expected a mapping of name: {{value, unit, std}}")
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


def _channels(entries: Any, system: str, origin: str) -> dict[str, Channel]:
    if not isinstance(entries, Mapping) or "time" not in entries:
        raise ConfigurationError(f"{origin}: 'channels' must be a mapping of name: {{column, unit}} and hold 'time'")
    units, found = channels_of(system), {}
    require_known(f"channel in {origin}", entries, units)
    for name, entry in entries.items():
        where = f"{origin}: channel {name}"
        if not isinstance(entry, Mapping) or "column" not in entry or "unit" not in entry:
            raise ConfigurationError(f"{where}: expected {{column: NAME, unit: {units[name]}}}, got {entry!r}")
        require_known(f"key in {where}", entry, _CHANNEL_KEYS)
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
            offset_free=offset_free(entry, name, where), note=str(entry.get("note", "")), hold=hold(entry, name, where),
        )  # fmt: skip
    return found


def offset_free(entry: Mapping[str, Any], name: str, where: str) -> str | None:
    """What says for which records a channel's zero is one; None: it is known. Raises ConfigurationError."""
    free = entry.get("offset_free")
    if free is not None and (not isinstance(free, str) or name == "time"):
        raise ConfigurationError(
            f"{where}: offset_free must be 'record', 'recording' or a condition's name, and not for time"
        )
    return free


def hold(entry: Mapping[str, Any], name: str, where: str) -> str:
    """How a channel goes on between its samples, of `HOLDS`. Raises ConfigurationError."""
    found = str(entry.get("hold", "line"))
    require_known(f"hold in {where}", [found], HOLDS)
    if found == "step" and not name.endswith("_command"):
        raise ConfigurationError(f"{where}: 'hold: step' is for commands (..._command); a sensor holds nothing")
    return found


def _number(value: Any, where: str, positive: bool = False) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise ConfigurationError(f"{where}: expected a number, got {value!r}")
    if positive and value <= 0:
        raise ConfigurationError(f"{where}: must be positive, got {value:g}")
    return float(value)


def _record(entry: Any, index: int, channels: Mapping[str, Channel], path: Path) -> Record:
    where = f"{path.name}: record {index + 1}"
    if not isinstance(entry, Mapping) or "data" not in entry:
        raise ConfigurationError(f"{where}: expected {{data: FILE, use: fit or heldout}}, got {entry!r}")
    require_known(f"key in {where}", entry, _RECORD_KEYS)
    use = str(entry.get("use", "fit"))
    if use not in USES:
        raise ConfigurationError(f"{where}: use '{use}' is unknown; {nearest(use, USES)}")
    file = path.parent / str(entry["data"])
    raw = read_columns(file, {name: channel.column for name, channel in channels.items()})
    data = {name: channel.to_si(raw[name]) for name, channel in channels.items()}
    _check_time(data["time"], file.name, channels["time"].column)
    for name, values in data.items():
        if np.isnan(values).all():
            raise ConfigurationError(f"{file.name}, channel {name} (column '{channels[name].column}'): no values")
    offsets = read_offsets(entry.get("offsets"), channels, where)
    for name, offset in offsets.items():
        data[name] = data[name] + offset
    conditions, quality = read_conditions(entry.get("conditions"), where), entry.get("quality")
    return Record(str(entry["data"]), use, data, conditions, offsets, read_doubts(quality, channels, where))


def _check_time(time: np.ndarray, file: str, column: str) -> None:
    where = f"{file}, channel time (column '{column}')"
    if len(time) < 2:
        raise ConfigurationError(f"{where}: a record needs at least two samples, found {len(time)}")
    if np.isnan(time).any():
        raise ConfigurationError(f"{where}, row {1 + int(np.argmax(np.isnan(time)))}: no time")
    falling = np.diff(time) <= 0
    if falling.any():
        row = 2 + int(np.argmax(falling))
        raise ConfigurationError(
            f"{where}, row {row}: time must increase, {time[row - 2]:g} s is followed by {time[row - 1]:g} s"
        )
