"""EMPS, an electro-mechanical positioning system: Janot, Gautier, Brunot 2019 (nonlinearbenchmark.org).

CSV as vendored by R packages: voltage and position, no header, 1 kHz. MATLAB as published: t, qm, vir, and qg.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import ChannelSpec, DataSet, RecordSpec, Request, counted, files_at, whole
from cable_envs.diagnosis.readers.formats.mat import variables
from cable_envs.diagnosis.readers.text import Layout, read_text

SUMMARY = "EMPS ball-screw axis (CSV or MATLAB): a file, or a folder of them"
OPTIONS = ()
RATE = 1000.0  # Hz
ROWS, TRAVEL = 24_841, 1.0
"""Rows as published; m, four times the travel there is."""
FORCE_PER_VOLT = 35.1507  # N/V, gtau of the original file
NOTES = {"voltage": "vir, command of the drive", "position": "qm", "position_reference": "qg"}
UNITS = {"time": "s", "voltage": "V", "position": "m", "position_reference": "m"}
MATLAB = {"time": "t", "voltage": "vir", "position": "qm", "position_reference": "qg"}


def open_dataset(path: Path, asked: Request) -> DataSet:
    """CSV and ``.mat`` files at ``path``; the last quarter (from 18 s on) is held out."""
    require_known("option of emps", asked.options, OPTIONS)
    records: list[RecordSpec] = []
    names: tuple[str, ...] = ()
    for file in files_at(path, ".csv", ".mat"):
        columns: dict[str, Any] = _matlab(file) if _is_matlab(file) else {"voltage": 1, "position": 2}
        channels = ("time", *(n for n in UNITS if n in columns and n != "time"))
        if names not in ((), channels):
            raise ConfigurationError(f"{file.name} has {', '.join(channels)}, the files before {', '.join(names)}")
        names = channels
        chunks = whole(columns) if _is_matlab(file) else partial(_chunks, file, columns)
        records.append(RecordSpec(file.stem, file.name, chunks))
    return DataSet(
        system="linear_drive",
        description="Ball-screw axis, voltage to position. Published estimates: M 95.1 kg, Fv 203.5 N s/m, Fc 20.4 N, "
        "offset -3.16 N, at 35.15 N/V.",
        channels=tuple(ChannelSpec(n, UNITS[n], note=NOTES.get(n, "")) for n in names),
        records=tuple(records),
        source={"cite": "Janot, Gautier, Brunot: Data set and reference models of EMPS, 2019", "licence": "not known"},
        known={
            "force_per_volt": {"value": FORCE_PER_VOLT, "unit": "N/V"},
            "motor_mass": {"value": 0.0, "unit": "kg", "note": "one body: M is all that moves"},
        },
        after=18.0,
    )


def _chunks(file: Path, columns, log):
    rows, low, high = 0, np.full(2, np.inf), np.full(2, -np.inf)
    for chunk in counted(read_text(file, Layout(header_line=0), columns, log), RATE):
        table = np.stack([chunk.columns["voltage"], chunk.columns["position"]])
        rows += table.shape[1]
        low, high = np.fmin(low, table.min(axis=1, initial=np.inf)), np.fmax(high, table.max(axis=1, initial=-np.inf))
        yield chunk
    if rows < ROWS:
        log.add("other", f"{rows} rows, {ROWS} are published: cut off?")
    volts, metres = high - low
    if metres > TRAVEL and volts < TRAVEL:
        text = f"the position moves over {metres:.3g} m and the voltage over {volts:.3g} V: columns swapped?"
        log.add("label", text, channel="position")


def _is_matlab(file: Path) -> bool:
    return file.suffix.lower() == ".mat"


def _matlab(file: Path) -> dict[str, np.ndarray]:
    found = variables(file, MATLAB, optional=("position_reference",))
    return {channel: values.astype(float) for channel, values in found.items()}
