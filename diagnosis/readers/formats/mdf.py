"""ASAM MDF files of measuring systems, versions 2 to 4, by asammdf.

``column`` is a channel's name, or ``GROUP:NAME`` where several groups of channels have it: the group by its number,
from 0, or by the name of its acquisition. ``time`` names a clock, as ``0:time``; its group gives the rows, and channels
of other groups are interpolated onto them by the groups' own clocks (`cable_envs.diagnosis.readers.series`). Values
that the file marks as invalid are gaps. A channel is held whole.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.diagnosis.readers.base import ChannelSpec, Chunk, DataSet, Log, RecordSpec, Request, files_at, whole
from cable_envs.diagnosis.readers.formats.table import data_set, of_entry
from cable_envs.diagnosis.readers.mapping import Mapped, load_mapping
from cable_envs.diagnosis.readers.series import on_one_clock

SUMMARY = "ASAM MDF files (.mf4, .mdf), with --mapping FILE.yaml"
OPTIONS = ()


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every ``.mf4`` and ``.mdf`` file at ``path``, by the mapping."""
    require_known("option of mdf", asked.options, OPTIONS)
    mapped = load_mapping(asked.mapping, "mdf")
    if mapped.sample_rate:
        raise ConfigurationError(f"{mapped.path.name}: channel time: MDF files carry times; name the clock's column")
    for name, column in mapped.columns.items():
        if not isinstance(column, str):
            raise ConfigurationError(f"{mapped.path.name}: channel {name}: 'column' must be a name, got {column!r}")
    return data_set(mapped, [
        RecordSpec(file.stem, file.name, partial(_chunks, file, mapped), **of_entry(mapped, file.name))
        for file in files_at(path, ".mf4", ".mdf")
    ])  # fmt: skip


def _chunks(file: Path, mapped: Mapped, log: Log) -> Iterator[Chunk]:
    try:
        from asammdf import MDF
    except ModuleNotFoundError as error:
        raise ConfigurationError("MDF files need asammdf: pip install 'cable-envs[mdf]'") from error
    try:
        with MDF(file) as content:
            table = _table(content, file, mapped, log)
    except ConfigurationError:
        raise
    except Exception as error:  # asammdf raises whatever a damaged file leads it to
        _leave(error)
        raise ConfigurationError(f"{file.name} is not whole, or no MDF file: {error}") from error
    yield from whole(table)(log)


def _leave(error: BaseException) -> None:
    """Close what asammdf has half opened; it would do that when the object goes, and stumble over what is missing."""
    step = error.__traceback__
    while step is not None:
        half: Any = step.tb_frame.f_locals.get("self")
        if getattr(half, "_closed", True) is False:
            half._closed = True
            half._tempfile.close()
        step = step.tb_next


def _table(content: Any, file: Path, mapped: Mapped, log: Log) -> dict[str, np.ndarray]:
    """Every channel on the rows of the clock's group."""
    specs = {spec.name: spec for spec in mapped.channels}
    series: dict[str, tuple[np.ndarray, dict[str, np.ndarray]]] = {}
    columns: dict[str, tuple[str, str]] = {}
    for name, column in mapped.columns.items():
        where = f"{file.name}, channel {name}"
        group, index = _place(content, column, where)
        signal = content.get(group=group, index=index, ignore_invalidation_bits=True)
        values = _numbers(signal, f"{where}: '{column}'")
        _tell_unit(signal.unit, specs[name], log)
        topic = f"group {group}"
        series.setdefault(topic, (np.asarray(signal.timestamps, float), {}))[1][name] = values
        columns[name] = topic, name
    return on_one_clock(series, columns, log)


def _place(content: Any, column: str, where: str) -> tuple[int, int]:
    """(group, index) of a channel. Raises ConfigurationError for one that is absent or in several groups."""
    found = content.channels_db.get(column, ())
    group, _, name = column.partition(":")
    if not found and name:
        groups = [k for k, _ in enumerate(content.groups) if group in (str(k), _title(content, k))]
        found = [place for place in content.channels_db.get(name, ()) if place[0] in groups]
    if not found:
        known = [f"{k}:{n}" if len(places) > 1 else n for n, places in content.channels_db.items() for k, _ in places]
        raise ConfigurationError(f"{where}: no channel '{column}'; {nearest(column, known)}")
    if len(found) > 1:
        listed = ", ".join(f"{k}:{name or column} {_title(content, k)}".strip() for k, _ in found)
        raise ConfigurationError(f"{where}: '{column}' is there {len(found)} times; name its group: {listed}")
    return found[0]


def _title(content: Any, group: int) -> str:
    """Name of a group's acquisition; version 3 and older have none."""
    return str(getattr(content.groups[group].channel_group, "acq_name", "") or "")


def _numbers(signal: Any, where: str) -> np.ndarray:
    samples = np.asarray(signal.samples)
    if samples.dtype.kind not in "fiub" or samples.ndim != 1:
        raise ConfigurationError(f"{where} holds no numbers, but {samples.dtype} of shape {samples.shape[1:]}"
                                 if samples.ndim != 1 else f"{where} holds {samples.dtype}, no numbers")  # fmt: skip
    values = samples.astype(float)
    values[~np.isfinite(values)] = np.nan
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits, bool)] = np.nan
    return values


def _tell_unit(unit: str, spec: ChannelSpec, log: Log) -> None:
    """A remark where the file says another unit than the mapping; one that is scaled is the mapping's own."""
    if unit and abs(spec.scale) == 1.0 and unit.replace(" ", "") != spec.unit.replace(" ", ""):
        log.say(f"channel {spec.name}: the file says its unit is '{unit}', the mapping '{spec.unit}'")
