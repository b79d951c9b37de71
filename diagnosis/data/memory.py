"""Arrays and data frames in the form of a recording's file: tables by record, entries of channels and records."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.data.description import channels_of, require_channels

Tables = dict[str, dict[str, np.ndarray]]
"""Record -> channel -> raw numbers [samples]."""
_ABOUT_KEYS = ("conditions", "offsets", "quality")


def named(records: Any, kind: type, what: str, origin: str) -> dict[str, Any]:
    """Records by name: of a mapping of them, of a sequence (``record_1``, ...), or of a single one.

    ``kind`` is the type of one, ``what`` what that is called. Raises ConfigurationError for anything else.
    """
    if isinstance(records, kind) and not _all(records, kind):
        records = [records]
    if isinstance(records, Mapping):
        found = {str(name): record for name, record in records.items()}
    elif isinstance(records, Sequence) and not isinstance(records, str):
        found = {f"record_{k}": record for k, record in enumerate(records, 1)}
    else:
        raise ConfigurationError(f"{origin}: expected {what}, or several by name, got {type(records).__name__}")
    if not found:
        raise ConfigurationError(f"{origin}: there is no record")
    for name, record in found.items():
        if not isinstance(record, kind):
            raise ConfigurationError(f"{origin}: record '{name}': expected {what}, got {type(record).__name__}")
        if not name.strip() or set(name) & set("/\\\0"):
            raise ConfigurationError(f"{origin}: record '{name}': a name is a text without slashes, as a file's is")
    return found


def _all(records: Any, kind: type) -> bool:
    """Whether this is a mapping of records (or of nothing), no record itself."""
    return isinstance(records, Mapping) and all(isinstance(r, kind) for r in records.values())


def tables_of(records: Any, time: Any, system: str, origin: str) -> Tables:
    """Checked copies of one or several mappings of channel to array; ``time``: of records that have none of their own.

    Raises ConfigurationError that names record and channel.
    """
    tables: Tables = {}
    for name, given in named(
        records, Mapping, "a mapping of channel: array (from_dataframe takes data frames)", origin
    ).items():
        where = f"{origin}, record '{name}'"
        arrays = dict(given) if time is None or "time" in given else {"time": time, **given}
        require_channels(f"channel in {where}", arrays, system)
        if "time" not in arrays:
            raise ConfigurationError(f"{where}: there is no channel 'time'; give it here, or as 'time' for all records")
        table = {channel: numbers(values, f"{where}, channel {channel}") for channel, values in arrays.items()}
        if len({len(values) for values in table.values()}) > 1:
            listed = ", ".join(f"{channel} {len(values)}" for channel, values in table.items())
            raise ConfigurationError(f"{where}: arrays of different lengths: {listed}")
        tables[name] = table
    first, channels = next((name, table.keys()) for name, table in tables.items())
    for name, table in tables.items():
        if table.keys() != channels:
            odd = ", ".join(sorted(table.keys() ^ channels))
            raise ConfigurationError(f"{origin}: records '{first}' and '{name}' must have the same channels: {odd}")
    return tables


def numbers(values: Any, where: str) -> np.ndarray:
    """A copy as float64 [samples]; NaN, or a masked element, is a gap. Raises ConfigurationError."""
    try:
        array = values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
    except ValueError as error:  # a ragged list
        raise ConfigurationError(f"{where}: no array of numbers: {error}") from None
    if array.dtype.kind not in "iuf":
        raise ConfigurationError(f"{where}: expected numbers (NaN for a gap), found {array.dtype}")
    if array.ndim != 1:
        raise ConfigurationError(f"{where}: expected one number a sample, found an array of shape {array.shape}")
    found = np.ma.filled(array.astype(float), np.nan)
    if np.isinf(found).any():
        raise ConfigurationError(f"{where}, row {1 + int(np.argmax(np.isinf(found)))}: not a finite number")
    return found


def frames_of(frames: Any, columns: Mapping[str, Any] | None, clock: str, system: str, origin: str) -> Tables:
    """Arrays of one or several pandas DataFrames; ``columns``: channel -> column, None: they are called the same.

    A frame without a column of times has them in its index; ``clock`` is their unit. Raises ConfigurationError.
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ConfigurationError("data frames need pandas: pip install pandas") from error
    units = channels_of(system)
    _require_mapping(columns, f"{origin}: columns")
    require_channels(f"channel in {origin}: columns", columns or {}, system)
    tables: Tables = {}
    for name, frame in named(frames, pandas.DataFrame, "a pandas DataFrame", origin).items():
        where = f"{origin}, record '{name}'"
        if columns is None:
            choose = "choose by columns={channel: column}"
            unknown = next((c for c in frame.columns if c not in units), None)
            if unknown is not None:
                raise ConfigurationError(f"{where}: column '{unknown}' is no channel ({choose}); "
                                         f"{nearest(str(unknown), units)}")  # fmt: skip
        chosen = {c: c for c in frame.columns} if columns is None else dict(columns)
        series = {channel: _column(frame, column, f"{where}, channel {channel}") for channel, column in chosen.items()}
        if "time" not in series:
            series = {"time": _index(frame, where), **series}
        tables[name] = {
            channel: _plain(values, clock if channel == "time" else "", f"{where}, channel {channel}")
            for channel, values in series.items()
        }
    return tables


def _column(frame: Any, column: Any, where: str) -> Any:
    found = [name for name in frame.columns if name == column]
    if not found:
        raise ConfigurationError(f"{where}: no column '{column}'; {nearest(str(column), map(str, frame.columns))}")
    if len(found) > 1:
        raise ConfigurationError(f"{where}: column '{column}' appears twice")
    return frame[column]


def _index(frame: Any, where: str) -> Any:
    """The index as times; rows that are only counted say nothing about them."""
    import pandas

    if isinstance(frame.index, (pandas.RangeIndex, pandas.MultiIndex)):
        choose = "choose one by columns={'time': NAME}"
        raise ConfigurationError(f"{where}: neither a column 'time' nor an index of times; {choose}")
    return frame.index.to_series()


def _plain(series: Any, clock: str, where: str) -> np.ndarray:
    """A column as float64 [rows]; times that are dates count from the first, in s, as do durations."""
    from pandas.api import types

    if clock and types.is_datetime64_any_dtype(series):
        series = series - series.min()
    if clock and types.is_timedelta64_dtype(series):
        if clock != "s":
            raise ConfigurationError(f"{where}: dates and durations are read in s, leave its unit '{clock}' out")
        return series.dt.total_seconds().to_numpy(dtype=float)
    if not types.is_numeric_dtype(series) or types.is_bool_dtype(series) or types.is_complex_dtype(series):
        raise ConfigurationError(f"{where}: expected numbers, found {series.dtype}")
    return series.to_numpy(dtype=float, na_value=np.nan)


def channel_entries(
    tables: Tables, system: str, units: Mapping[str, str] | None, noise: Mapping[str, float] | None,
    more: Mapping[str, Mapping[str, Any]] | None, origin: str,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """What stands under ``channels`` of a recording; a unit that is not named is the SI unit."""
    si, there = channels_of(system), list(next(iter(tables.values())))
    for what, given in (("units", units), ("noise", noise), ("channels", more)):
        _require_mapping(given, f"{origin}: {what}")
        require_known(f"channel in {origin}: {what}", given or {}, there)
    for channel, entry in (more or {}).items():
        _require_mapping(entry, f"{origin}: channels: {channel}")
        twice = {"column", "unit", "noise_std"} & set(entry or {})
        if twice:
            raise ConfigurationError(f"{origin}: channels: {channel}: '{min(twice)}' is said by units and noise")
    entries: dict[str, dict[str, Any]] = {}
    for channel in there:
        entries[channel] = {"column": channel, "unit": (units or {}).get(channel) or si[channel]}
        if noise and channel in noise:
            entries[channel]["noise_std"] = noise[channel]
        entries[channel] |= (more or {}).get(channel) or {}
    return entries


def record_entries(
    names: Sequence[str], heldout: Sequence[str] | str, rest: str | None,
    about: Mapping[str, Mapping[str, Any]] | None, origin: str,
) -> list[dict[str, Any]]:  # fmt: skip
    """What stands under ``records`` of a recording."""
    if not isinstance(heldout, Iterable):
        raise ConfigurationError(f"{origin}: heldout: expected names of records, got {heldout!r}")
    held = [heldout] if isinstance(heldout, str) else list(map(str, heldout))
    still = [] if rest is None else [str(rest)]
    _require_mapping(about, f"{origin}: about")
    about = {str(name): said for name, said in (about or {}).items()}
    for what, given in (("heldout", held), ("rest", still), ("about", about)):
        require_known(f"record in {origin}: {what}", given, names)
    if set(held) & set(still):
        raise ConfigurationError(f"{origin}: record '{rest}' is both held out and at rest; it can be only one")
    entries = []
    for name in names:
        said = about.get(name)
        _require_mapping(said, f"{origin}: about: {name}")
        require_known(f"key in {origin}: about: {name}", said or {}, _ABOUT_KEYS)
        use = "rest" if name in still else "heldout" if name in held else "fit"
        entries.append({"data": name, "use": use, **(said or {})})
    return entries


def _require_mapping(given: Any, where: str) -> None:
    if given is not None and not isinstance(given, Mapping):
        raise ConfigurationError(f"{where}: expected a mapping, got {given!r}")
