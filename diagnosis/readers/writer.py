"""A data set into a folder in the recording format. It is complete, or the folder is as it was.

Everything is written to a folder inside the target and takes its place at the end, the YAML file last. Tables hold the
numbers as they were published; scales and turned signs are in the YAML file, with a note.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.data.description import require_channels
from cable_envs.diagnosis.data.record import behind
from cable_envs.diagnosis.data.tables import MOST_ROWS
from cable_envs.diagnosis.data.writing import FILE, SCHEMA, TABLES, Table, move, staging, undo, yaml_text
from cable_envs.diagnosis.readers.base import ChannelSpec, Chunk, DataSet, Fault, Log, RecordSpec, guarded
from cable_envs.diagnosis.readers.checks import Clock, RecordCheck, Summary
from cable_envs.diagnosis.readers.compare import outliers
from cable_envs.diagnosis.readers.split import select


@dataclass(frozen=True)
class Imported:
    """What was written: the YAML file, rows and use by data file, faults and remarks in words."""

    path: Path
    rows: Mapping[str, int]
    uses: Mapping[str, str]
    faults: tuple[str, ...]
    remarks: tuple[str, ...]


def write_data_set(
    data: DataSet,
    out: Path,
    *,
    table: str = "csv",
    strict: bool = True,
    chosen: Sequence[str] = (),
    heldout: Sequence[str] | None = None,
    after: float | None = None,
    command: str = "",
) -> Imported:
    """Write ``data`` to the folder ``out``.

    ``chosen``: only records for which one of these rules holds; ``heldout``: rules of what is held out (default: the
    set's own), ``after``: s after a record's first row from which on the rest is held out, as a file of its own.
    Raises ConfigurationError for input that cannot be used; then nothing is left in ``out``.
    """
    require_known("table format", [table], TABLES)
    require_channels(f"channel of {data.system}", [c.name for c in data.channels], data.system)
    records = select(data.records, chosen, "--select") if chosen else list(data.records)
    after = data.after if after is None and heldout is None else after
    held = _heldout(data, records, heldout)
    _check_folder(out, records, table)
    with staging(out) as stage:
        logs, summaries, files = {}, {}, {}
        for record in records:
            logs[record.name] = log = Log(record.file)
            log.faults.extend(record.doubts)
            use = "rest" if record.use == "rest" else "heldout" if record.name in held else "fit"
            cut = None if use == "rest" else after
            files[record.name], summaries[record.name] = _stream(data, record, stage, table, log, strict, use, cut)
        resets = any(c.offset_free == "record" for c in data.channels)
        moving = [r for r in records if r.use != "rest"]
        for name, found in outliers(moving, summaries, data.group, resets).items():
            logs[name].faults.extend(found)
        content = _content(data, records, files, logs, command)
        (stage / FILE).write_text(yaml_text(content), encoding="utf-8")
        move(stage, out)
    rows = {name: count for parts in files.values() for name, (count, _) in parts.items()}
    uses = {name: use for parts in files.values() for name, (_, use) in parts.items()}
    faults = [line for name in logs for line in _lines(logs[name])]
    remarks = dict.fromkeys([*data.remarks, *(f"{log.file}: {r}" for log in logs.values() for r in log.remarks)])
    return Imported(out / FILE, rows, uses, tuple(faults), tuple(remarks))


def _lines(log: Log) -> list[str]:
    listed = {kind: sum(f.kind == kind for f in log.faults) for kind in log.counts}
    more = [f"{log.file}: {n - listed[k]} more of kind {k}" for k, n in log.counts.items() if n > listed[k]]
    return [*map(str, log.faults), *more]


def _heldout(data: DataSet, records: Sequence[RecordSpec], rules: Sequence[str] | None) -> set[str]:
    records = [r for r in records if r.use != "rest"]
    if rules is not None:
        held = {r.name for r in select(records, rules, "--heldout")} if rules else set()
    else:
        held = {r.name for r in records if r.use == "heldout"}
        for rule in data.heldout:
            with contextlib.suppress(ConfigurationError):  # the set's own rule may fit none of a selection
                held |= {r.name for r in select(records, [rule], "heldout")}
        held = held if len(held) < len(records) else set()
    if len(held) == len(records):
        raise ConfigurationError("every record is held out: at least one must be left to fit")
    return held


def _check_folder(out: Path, records: Sequence[RecordSpec], table: str) -> None:
    if out.exists() and not out.is_dir():
        raise ConfigurationError(f"--out {out} is a file; name a folder")
    if out.is_dir():
        undo(out)
        names = {f"{r.name}{part}.{table}" for r in records for part in ("", "_after")}
        found = sorted(p.name for p in out.iterdir() if p.suffix in (".yaml", ".yml") or p.name in names)
        if found:
            raise ConfigurationError(f"{out} holds {found[0]}: choose another folder, nothing is overwritten")
    counted = [r.name for r in records]
    if twice := next((n for n in counted if counted.count(n) > 1), None):
        raise ConfigurationError(f"two records would be named {twice}")


def _stream(
    data: DataSet, record: RecordSpec, stage: Path, table: str, log: Log, strict: bool, use: str, after: float | None
) -> tuple[dict[str, tuple[int, str]], Summary]:
    """Write one record; ({file: (rows, use)}, what is known of it)."""
    by_name = {c.name: c for c in data.channels}
    factors = {n: c.factor(data.system) for n, c in by_name.items() if n != "time"}
    clock, check = Clock(log), RecordCheck(log, factors)
    time_of = by_name["time"]
    unit = time_of.factor(data.system)
    shift = time_of.offset * unit / time_of.scale
    headers = {n: c.header for n, c in by_name.items()}
    first = Table(stage / f"{record.name}.{table}", headers)
    rest = Table(stage / f"{record.name}_after.{table}", headers) if after is not None else None
    with first, rest or contextlib.nullcontext():
        for chunk in guarded(iter(record.chunks(log)), record.file):
            time = chunk.columns["time"] * unit + shift
            keep = clock.filter(time, chunk.lines)
            log.stop_if_strict(strict)
            time = time[keep]
            if not len(time):
                continue
            lines = None if chunk.lines is None else [chunk.lines[int(k)] for k in np.flatnonzero(keep)]
            chunk = Chunk({n: v[keep] for n, v in chunk.columns.items()}, lines)
            check.feed(chunk, time)
            later = np.zeros(len(time), bool) if after is None else behind(time, clock.first, after)
            first.write({n: v[~later] for n, v in chunk.columns.items()})
            if rest and later.any():
                rest.write({n: v[later] for n, v in chunk.columns.items()})
            if first.rows > MOST_ROWS:
                raise ConfigurationError(f"{record.file}: more than {MOST_ROWS} rows; cut it, or average to fewer")
    log.stop_if_strict(strict)
    if first.rows < 2:
        raise ConfigurationError(f"{record.file}: {first.rows} usable rows, a record needs two at least")
    files = {first.path.name: (first.rows, use)}
    if rest and rest.rows >= 2:
        files[rest.path.name] = (rest.rows, "heldout")
    elif rest:
        rest.path.unlink(missing_ok=True)
        log.say(f"nothing lies {after:g} s after the start: nothing of it is held out")
    summary = check.finish(clock)
    for name, (low, _) in summary.ranges.items():
        if not np.isfinite(low):
            raise ConfigurationError(f"{record.file}, channel {name}: no values")
    return files, summary


def _content(
    data: DataSet, records: Sequence[RecordSpec], files: Mapping[str, Mapping[str, tuple[int, str]]],
    logs: Mapping[str, Log], command: str,
) -> dict[str, Any]:  # fmt: skip
    content: dict[str, Any] = {"schema": SCHEMA, "description": data.description, "system": data.system}
    if data.rig:
        content["rig"] = data.rig
    content |= {key: dict(value) for key, value in (("known", data.known), ("nominal", data.nominal)) if value}
    entries = []
    for record in records:
        names = list(files[record.name])
        for name, (_, use) in files[record.name].items():
            entry: dict[str, Any] = {"data": name, "use": use}
            conditions = dict(record.conditions) | ({"continues": names[0]} if name != names[0] else {})
            entry |= {k: v for k, v in (("conditions", conditions), ("offsets", dict(record.offsets))) if v}
            if quality := [_quality(fault, data) for fault in logs[record.name].faults]:
                entry["quality"] = quality
            entries.append(entry)
    content["records"] = entries
    content["channels"] = {c.name: _channel(c) for c in data.channels}
    source = dict(data.source) | ({"command": command} if command else {})
    source["files"] = {r.name: r.file for r in records}
    return content | {"source": source}


def _channel(spec: ChannelSpec) -> dict[str, Any]:
    entry: dict[str, Any] = {"column": spec.header, "unit": spec.unit}
    if spec.scale != 1.0:
        entry["scale"] = float(spec.scale)
    if spec.offset != 0.0:
        entry["offset"] = float(spec.offset)
    more = (
        ("noise_std", spec.noise_std),
        ("offset_free", spec.offset_free),
        ("hold", spec.hold),
        ("note", spec.note),
        ("every", spec.every),
    )
    return entry | {key: value for key, value in more if value}


def _quality(fault: Fault, data: DataSet) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": fault.kind}
    if fault.channel in {c.name for c in data.channels}:
        entry["channel"] = fault.channel
    if fault.start is not None and fault.end is not None:
        entry |= {"from_s": float(fault.start), "to_s": float(fault.end)}
    return entry | {"note": str(fault)}
