"""Recordings of one rig: a YAML file that names its records, channels, known and nominal parameters.

```yaml
schema: cable-recording/1
system: cable_hole              # cable_hole | pulley_circuit | linear_drive
rig: gu-inferred                # optional: a preset, a rig file relative to this one, or what would stand in it
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
that share a condition (its name). ``quality`` says where a record is in doubt (`cable_envs.diagnosis.data.entries`).
A record at rest tells the noise of all channels with its colour (`cable_envs.diagnosis.model.rest`).
Everything returned is in SI. Errors name the file, and where it applies the channel, its column and the data row.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import jsonable
from cable_envs.core.params import is_number
from cable_envs.diagnosis.data.description import (
    Channel,
    Quantity,
    channels_of,
    read_channels,
    read_quantities,
    read_rig,
)
from cable_envs.diagnosis.data.memory import channel_entries, frames_of, record_entries, tables_of
from cable_envs.diagnosis.data.record import Read, Record, cut, read_record
from cable_envs.diagnosis.data.tables import read_columns
from cable_envs.diagnosis.data.writing import SCHEMA, check_table, rig_entry, table_name, write_folder
from cable_envs.sim.rigs import Rig

_KEYS = ("schema", "system", "rig", "known", "nominal", "records", "channels", "description", "source")


@dataclass(frozen=True)
class Recording:
    """A validated recording of one rig: what is known of it, and its tables.

    Parameters
    ----------
    path : Path
        Its YAML file; of a recording in memory its name.
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

    @classmethod
    def from_arrays(
        cls,
        system: str,
        records: Mapping[str, Any] | Sequence[Mapping[str, Any]],
        *,
        time: Any = None,
        units: Mapping[str, str] | None = None,
        noise: Mapping[str, float] | None = None,
        channels: Mapping[str, Mapping[str, Any]] | None = None,
        known: Mapping[str, Any] | None = None,
        nominal: Mapping[str, Any] | None = None,
        rig: Rig | Mapping[str, Any] | Path | str | None = None,
        heldout: Sequence[str] | str = (),
        after: float | None = None,
        rest: str | None = None,
        about: Mapping[str, Mapping[str, Any]] | None = None,
        description: str = "",
        source: Mapping[str, Any] | None = None,
        name: str = "memory",
    ) -> "Recording":
        """A recording of arrays in memory, checked as `load_recording` checks files.

        Parameters
        ----------
        system : str
            The plant, as "linear_drive".
        records : Mapping, or sequence of Mapping
            One record as {channel: array [samples]}, several as {name: {channel: array}}, or a sequence of records,
            which are called record_1, record_2 and so on. Arrays are copied; NaN is a gap, except in time.
        time : array_like [samples], optional
            Times of records that have no channel "time" of their own.
        units : Mapping of str to str, optional
            Channel -> unit of its numbers; where none is given, the SI unit.
        noise : Mapping of str to float, optional
            Channel -> standard deviation of its noise, in the channel's unit.
        channels : Mapping of str to Mapping, optional
            What else is said of a channel: scale, offset, offset_free, hold, note, as in recording.yaml.
        known, nominal : Mapping, optional
            Parameters that were measured, and that are believed and may be refitted: {name: number in SI}, or
            {name: {value, unit, std}}.
        rig : Rig, Mapping, Path or str, optional
            What gives the other numbers: a rig, the content of its file, its file, or a preset's name.
        heldout : sequence of str, or str
            Names of the records that no fit sees.
        after : float, optional
            s behind each record's start from which on the rest is held out, as a record of its own.
        rest : str, optional
            Name of the record in which nothing moves.
        about : Mapping of str to Mapping, optional
            Record -> its conditions, offsets, quality, as in recording.yaml.
        description, source
            For people.
        name : str
            What errors and answers call the recording.

        Returns
        -------
        Recording
            All numbers in SI.

        Raises
        ------
        ConfigurationError
            For what `load_recording` refuses, arrays that are no numbers or of different lengths, and unknown names,
            with the nearest valid one.

        Examples
        --------
        >>> import numpy as np
        >>> t = np.linspace(0.0, 2.0, 401)
        >>> runs = {"slow": {"position": 10 * np.sin(t), "force": np.cos(t)},
        ...         "fast": {"position": 10 * np.sin(5 * t), "force": np.cos(5 * t)}}
        >>> recording = Recording.from_arrays(
        ...     "linear_drive", runs, time=t, units={"position": "mm"}, noise={"position": 0.01},
        ...     nominal={"mass": {"value": 2.3, "std": 0.4}}, heldout="fast",
        ... )
        >>> recording.noise, [record.use for record in recording.records]
        ({'position': 1e-05}, ['fit', 'heldout'])
        """  # fmt: skip
        path = Path(name)
        channels_of(str(system))
        tables = tables_of(records, time, system, path.name)
        content = {
            "system": system, "rig": rig, "known": known, "nominal": nominal, "description": description,
            "source": source, "channels": channel_entries(tables, system, units, noise, channels, path.name),
            "records": record_entries(list(tables), heldout, rest, about, path.name),
        }  # fmt: skip
        found = _checked(content, path, lambda record, _: tables[record])
        return found if after is None else _with_ends_held_out(found, after)

    @classmethod
    def from_dataframe(
        cls, system: str, frames: Any, columns: Mapping[str, Any] | None = None, **told: Any
    ) -> "Recording":
        """A recording of pandas DataFrames, checked as `load_recording` checks files.

        Parameters
        ----------
        system : str
            The plant, as "linear_drive".
        frames : DataFrame, Mapping of str to DataFrame, or sequence of DataFrame
            One record, several by name, or several that are called record_1, record_2 and so on.
        columns : Mapping of str, optional
            Channel -> column; others are left out. Where it is not given, every column is called as its channel.
            Times are the column of "time", or else the index. Dates count from a record's first row.
        **told
            As of `from_arrays`: units, noise, known and so on.

        Returns
        -------
        Recording
            All numbers in SI.

        Raises
        ------
        ConfigurationError
            As `from_arrays`, and for missing columns.

        Examples
        --------
        ::

            log = pandas.read_csv("run.csv")
            Recording.from_dataframe(
                "linear_drive", log, {"time": "t", "position": "x", "force": "F"}, units={"position": "mm"}, after=8.0
            )
        """
        channels_of(str(system))
        units = told.get("units")
        clock = units.get("time", "s") if isinstance(units, Mapping) else "s"
        tables = frames_of(frames, columns, clock, system, str(told.get("name", "memory")))
        return cls.from_arrays(system, tables, **told)

    def write(self, folder: Path | str, table: str = "csv") -> Path:
        """The recording as a folder that `load_recording` reads: recording.yaml, a table for each record, its rig.

        Numbers are written in SI, with the offsets of records in them, and read back as they are to the last bit.

        Parameters
        ----------
        folder : Path or str
            Made where it is missing.
        table : str
            "csv", or "parquet", which suits long records.

        Returns
        -------
        Path
            The YAML file.

        Raises
        ------
        ConfigurationError
            Where the folder holds a YAML file or a table of that name; then nothing is written.
        """
        check_table(table)
        names = {record.name: table_name(record.name, table) for record in self.records}
        if len(set(names.values())) < len(names):
            raise ConfigurationError(f"{self.path}: two records would be written to one file: {', '.join(names)}")
        entry, file = (None, None) if self.rig is None else rig_entry(self.rig)
        content: dict[str, Any] = {"schema": SCHEMA, "description": self.description, "system": self.system}
        content["rig"] = entry
        for key, quantities in (("known", self.known), ("nominal", self.nominal)):
            content[key] = {name: quantity.as_entry() for name, quantity in quantities.items()}
        content["records"] = [{"data": names[r.name], **r.as_entry()} for r in self.records]
        content["channels"] = {name: channel.as_entry() for name, channel in self.channels.items()}
        content["source"] = jsonable(self.source)
        tables = {names[record.name]: record.data for record in self.records}
        return write_folder(Path(folder), {k: v for k, v in content.items() if v}, tables, file)

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

    def read(file: str, channels: Mapping[str, Channel]) -> Mapping[str, np.ndarray]:
        return read_columns(_beside(path, file), {name: channel.column for name, channel in channels.items()})

    return _checked(data, path, read)


def _beside(path: Path, file: str) -> Path:
    """The table that a recording names, in its folder or below; ConfigurationError for one that lies elsewhere."""
    try:
        found, folder = (path.parent / file).resolve(), path.parent.resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a zero byte in the name; links that go round
        raise ConfigurationError(f"{path.name}: data {file[:300]!r} is no file's name: {error}") from None
    if not found.is_relative_to(folder):
        raise ConfigurationError(f"{path.name}: data {file!r} lies outside the recording's folder; copy it into it")
    return path.parent / file


def _checked(data: Mapping[str, Any], path: Path, read: Read) -> Recording:
    """The recording that ``data`` describes, with the keys of a YAML file; ``read`` gives its numbers."""
    system = str(data.get("system"))
    try:
        channels_of(system)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    rig = read_rig(data.get("rig"), system, path)
    known = read_quantities(data.get("known"), system, f"{path.name}: known")
    nominal = read_quantities(data.get("nominal"), system, f"{path.name}: nominal")
    for name in nominal:
        if name in known:
            raise ConfigurationError(f"{path.name}: '{name}' is both known and nominal; it can be only one")
    channels = read_channels(data.get("channels"), system, path.name)
    entries = data.get("records")
    if not isinstance(entries, list) or not entries:
        raise ConfigurationError(f"{path.name}: 'records' must be a list of {{data: FILE, use: fit or heldout}}")
    records = tuple(read_record(entry, k, channels, read, path.name) for k, entry in enumerate(entries))
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


def _with_ends_held_out(recording: Recording, after: float) -> Recording:
    """What lies ``after`` seconds behind a record's start is held out. Raises ConfigurationError where nothing does."""
    if not is_number(after) or after <= 0.0:
        raise ConfigurationError(f"{recording.path}: after: expected seconds, more than 0, got {after!r}")
    records = tuple(part for record in recording.records for part in cut(record, after, recording.channels))
    if len(records) == len(recording.records):
        raise ConfigurationError(f"{recording.path}: after: nothing lies {after:g} s behind the start of a record")
    return replace(recording, records=records)


def _yaml_of(path: Path) -> Path:
    if not path.is_dir():
        return path
    found = sorted(p for p in path.iterdir() if p.suffix in (".yaml", ".yml"))
    if len(found) != 1:
        listed = ", ".join(p.name for p in found) or "none"
        raise ConfigurationError(f"{path}: a recording's folder holds exactly one YAML file, found {listed}")
    return found[0]
