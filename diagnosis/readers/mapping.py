"""Mapping files: which column of a log is which channel, in which unit and with which sign.

```yaml
schema: cable-mapping/1
system: pulley_circuit
description: jaw rig, June 2026                       # optional, as rig, known, nominal (as in a recording)
layout: {delimiter: ";", decimal: ",", header_line: 3, comment: "#", encoding: latin-1}   # each is detected if absent
channels:
  time:          {column: "Zeit [ms]", unit: ms}      # or {sample_rate: 1000}: no column, Hz
  drive_angle:   {column: enc1, unit: deg, scale: 0.045, sign: -1, offset_free: record}
  output_torque: {column: 7, unit: mN m, noise_std: 2}   # by position, from 1
  tension_top:   {column: F1, clock: t_F1, unit: N}      # on times of its own, in the unit of the time
records:                                              # optional: by file name or pattern
  - {file: "run_1*.csv", conditions: {load: {value: 5, unit: N}, tool: A}}
  - {file: run_20.csv, use: heldout}
group: tool                                           # optional: the condition that tells tools or sessions apart
```

``mat``: ``column`` is a variable, ``data.motor.q`` or ``X(:,2)``. ``mdf``: a channel, ``GROUP:NAME`` where several
groups have it. ``rosbag``, ``mcap``: ``topic`` and ``field`` instead.
"""

import fnmatch
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number, to_si
from cable_envs.diagnosis.data.description import channels_of, every, hold, offset_free, require_channels, si_unit
from cable_envs.diagnosis.data.entries import read_conditions
from cable_envs.diagnosis.data.record import USES
from cable_envs.diagnosis.readers.base import ChannelSpec
from cable_envs.diagnosis.readers.text import DELIMITERS, Layout

SCHEMA = "cable-mapping/1"
_KEYS = ("schema", "system", "description", "rig", "known", "nominal", "layout", "channels", "records", "group",
         "source")  # fmt: skip
_CHANNEL_KEYS = (
    "column",
    "topic",
    "field",
    "unit",
    "scale",
    "offset",
    "sign",
    "noise_std",
    "offset_free",
    "hold",
    "note",
    "every",
    "clock",
)
_RECORD_KEYS = ("file", "use", "conditions", "offsets")
_LAYOUT_KEYS = ("delimiter", "decimal", "header_line", "comment", "encoding", "sheet")


@dataclass(frozen=True)
class Mapped:
    """A mapping file that was checked.

    ``columns``: channel -> column, variable or (topic, field); ``clocks``: channel -> column of the times of its own.
    """

    path: Path
    system: str
    columns: Mapping[str, Any]
    channels: tuple[ChannelSpec, ...]
    sample_rate: float | None
    layout: Layout
    records: tuple[Mapping[str, Any], ...]
    group: str | None
    general: Mapping[str, Any]
    clocks: Mapping[str, str | int] = field(default_factory=dict)

    def entry(self, file: str) -> Mapping[str, Any]:
        """What the mapping says about a file, by the first pattern that fits; empty for none."""
        return next((e for e in self.records if fnmatch.fnmatchcase(file, e["file"])), {})


def load_mapping(path: Path | None, purpose: str, topics: bool = False, clocks: bool = False) -> Mapped:
    """The mapping in a file. Raises ConfigurationError.

    ``topics``: its channels name topic and field; ``clocks``: a channel may name the column of times of its own.
    """
    if path is None:
        raise ConfigurationError(f"{purpose} needs --mapping FILE.yaml: which column is which channel (see "
                                 "docs/your-own-recording.md)")  # fmt: skip
    data = read_yaml(path)
    require_known(f"key in {path.name}", data, _KEYS)
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"{path}: 'schema' must be '{SCHEMA}', found {data.get('schema')!r}")
    system = str(data.get("system"))
    try:
        channels_of(system)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    columns, channels, rate = _channels(data.get("channels"), system, path.name, topics)
    group = data.get("group")
    keys = ("description", "rig", "known", "nominal", "source")
    general: dict[str, Any] = {key: data[key] for key in keys if key in data}
    records = _records(data.get("records"), path.name)
    layout = _layout(data.get("layout"), path.name)
    own = _clocks(data["channels"], path.name, clocks)
    return Mapped(path, system, columns, channels, rate, layout, records, group and str(group), general, own)


def _channels(
    entries: Any, system: str, origin: str, topics: bool
) -> tuple[dict[str, Any], tuple[ChannelSpec, ...], float | None]:
    if not isinstance(entries, Mapping) or "time" not in entries or len(entries) < 2:
        raise ConfigurationError(f"{origin}: 'channels' must map channels to columns and hold 'time'")
    require_channels(f"channel in {origin}", entries, system)
    columns, specs, rate = {}, [], None
    for name, entry in entries.items():
        where = f"{origin}: channel {name}"
        if not isinstance(entry, Mapping):
            raise ConfigurationError(f"{where}: expected {{column, unit}}, got {entry!r}")
        if name == "time" and "sample_rate" in entry:
            require_known(f"key in {where}", entry, ("sample_rate", "note"))
            rate = _number(entry["sample_rate"], f"{where}: sample_rate")
            if rate <= 0:
                raise ConfigurationError(f"{where}: sample_rate must be positive, got {rate:g}")
            specs.append(ChannelSpec("time", "s", note=f"counted: {rate:g} rows a second"))
            continue
        require_known(f"key in {where}", entry, _CHANNEL_KEYS)
        columns[name] = _column(entry, where, topics, name)
        specs.append(_spec(name, {"unit": "s", **entry} if name == "time" and topics else entry, system, where))
    return columns, tuple(specs), rate


def _clocks(entries: Mapping[str, Any], origin: str, allowed: bool) -> dict[str, str | int]:
    found = {name: entry["clock"] for name, entry in entries.items() if "clock" in entry}
    for name, column in found.items():
        where = f"{origin}: channel {name}"
        if not allowed or name == "time" or "sample_rate" in entries["time"]:
            raise ConfigurationError(f"{where}: 'clock' is for a column with times of its own in a table or MATLAB "
                                     "file, beside the column of the time")  # fmt: skip
        if not isinstance(column, (str, int)) or isinstance(column, bool):
            raise ConfigurationError(f"{where}: 'clock' must be a column, got {column!r}")
    return found


def _column(entry: Mapping[str, Any], where: str, topics: bool, name: str) -> Any:
    if topics:
        if "topic" not in entry or ("field" not in entry and name != "time"):
            raise ConfigurationError(f"{where}: messages need {{topic, field, unit}}")
        return str(entry["topic"]), str(entry.get("field", ""))
    column = entry.get("column")
    if not isinstance(column, (str, int)) or isinstance(column, bool):
        raise ConfigurationError(f"{where}: 'column' must be a name, or a position from 1, got {column!r}")
    return column


def _spec(name: str, entry: Mapping[str, Any], system: str, where: str) -> ChannelSpec:
    if "unit" not in entry:
        raise ConfigurationError(f"{where}: 'unit' is missing, {channels_of(system)[name]} or one that converts to it")
    unit = str(entry["unit"])
    to_si(1.0, unit, si_unit(system, name, unit), where)
    sign = entry.get("sign", 1)
    if sign not in (1, -1):
        raise ConfigurationError(f"{where}: sign must be 1 or -1, got {sign!r}")
    numbers = {k: _number(entry[k], f"{where}: {k}") for k in ("scale", "offset", "noise_std") if k in entry}
    scale = numbers.pop("scale", 1.0)
    if scale == 0.0:
        raise ConfigurationError(f"{where}: scale 0 would make every sample equal")
    if numbers.get("noise_std", 1.0) <= 0.0:
        raise ConfigurationError(f"{where}: noise_std must be positive, got {numbers['noise_std']:g}")
    turned = "sign turned" if sign == -1 else ""
    note = "; ".join(part for part in (turned, str(entry.get("note", ""))) if part)
    held = hold(entry, name, where) if "hold" in entry else None
    column = "" if isinstance(entry.get("column"), int) else str(entry.get("column", ""))
    if sign == -1 and "offset" in numbers:
        numbers["offset"] = -numbers["offset"]
    return ChannelSpec(
        name, unit, sign * scale, **numbers, offset_free=offset_free(entry, name, where), hold=held, note=note,
        column=column, every=None if every(entry, name, where) is None else float(entry["every"]),
    )  # fmt: skip


def _number(value: Any, where: str) -> float:
    if not is_number(value):
        raise ConfigurationError(f"{where}: expected a number, got {value!r}")
    return float(value)


def _records(entries: Any, origin: str) -> tuple[Mapping[str, Any], ...]:
    if entries is None:
        return ()
    if not isinstance(entries, list):
        raise ConfigurationError(f"{origin}: 'records' must be a list of {{file, use, conditions}}")
    for k, entry in enumerate(entries, 1):
        where = f"{origin}: record {k}"
        if not isinstance(entry, Mapping) or not isinstance(entry.get("file"), str):
            raise ConfigurationError(f"{where}: expected {{file: NAME or pattern, ...}}, got {entry!r}")
        require_known(f"key in {where}", entry, _RECORD_KEYS)
        require_known(f"use in {where}", [entry.get("use", "fit")], USES)
        read_conditions(entry.get("conditions"), where)
    return tuple(entries)


def _layout(entry: Any, origin: str) -> Layout:
    entry = {} if entry is None else entry
    if not isinstance(entry, Mapping):
        raise ConfigurationError(f"{origin}: 'layout' must be a mapping")
    require_known(f"key in {origin}: layout", entry, _LAYOUT_KEYS)
    given = dict(entry)
    if "delimiter" in given:
        names = {**DELIMITERS, **{c: c for c in DELIMITERS.values()}}
        require_known(f"delimiter in {origin}", [given["delimiter"]], names)
        given["delimiter"] = names[given["delimiter"]]
    if given.get("decimal", ".") not in (",", "."):
        raise ConfigurationError(f"{origin}: layout: decimal must be ',' or '.', got {given['decimal']!r}")
    if not isinstance(given.get("sheet", ""), str):
        raise ConfigurationError(f"{origin}: layout: sheet must be a name, got {given['sheet']!r}")
    line = given.get("header_line", 0)
    if not isinstance(line, int) or isinstance(line, bool) or line < 0:
        raise ConfigurationError(f"{origin}: layout: header_line must be a line from 1, or 0 for none, got {line!r}")
    return Layout(**given)
