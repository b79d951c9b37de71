"""da Vinci jaw on a bench: the ``.TXT`` files of O'Neill, Stephens and Kowalewski, RA-L 3(4) 3027-3034, 2018.

Columns, counts and scales: the set's README and MATLAB files. What a file's header says of tool and levels is not
trusted: load and frequency are taken from the columns. An index.csv (file, load_percent, pitch_deg, ...) beside the
files is compared with them, and gives the wrist's pitch, which nothing in a file does.

Signs. The plant's two angles grow together, and a positive torque works in the direction of the angle. On the bench
the jaw's encoder counts down while the motor's counts up, so it is turned; the motor's torque and current sensors read
what the tool does to the motor, so they are turned. As then both torques times their speeds are the power into and out
of the tool, the power lost is positive in both directions. Closing is where the angles fall.
"""

import csv
import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import (
    ChannelSpec,
    DataSet,
    Fault,
    Log,
    RecordSpec,
    Request,
    files_at,
    measured_frequency,
)
from cable_envs.diagnosis.readers.text import Layout, read_text

SUMMARY = "da Vinci jaw on a bench (.TXT, RA-L 2018): a file, or a folder of them"
OPTIONS = ("offset",)
DRIVE, OUTPUT = 2 * math.pi / 8192, 2 * math.pi / 4000  # rad for one count
TORQUE = 3.9811e-5  # N m for one count, both sensors
CHANNELS = (
    ChannelSpec("time", "s", note="the header says ms, the values step by 0.001: s"),
    ChannelSpec("drive_angle", "rad", DRIVE, offset_free="series", column="backend_encoder",
                note="CUI encoder, 8192 counts a turn, incremental; grows as the jaw opens"),
    ChannelSpec("drive_torque", "N m", -TORQUE, column="backend_torque",
                note="sign turned: the sensor reads what the tool does to the motor; its zero is not given"),
    ChannelSpec("drive_current", "A", -1.0, column="backend_current", note="sign turned, as the torque's"),
    ChannelSpec("output_angle", "rad", -OUTPUT, offset_free="series", column="frontend_encoder",
                note="sign turned: counts fall as the motor's grow; 4000 counts a turn, incremental"),
    ChannelSpec("output_torque", "N m", TORQUE, column="frontend_torque",
                note="negative: the jaw pushes the brake towards closing; the sensor's zero is not given"),
)  # fmt: skip
COLUMNS = {"time": 1, "drive_angle": 2, "drive_torque": 3, "drive_current": 4, "output_angle": 5, "output_torque": 6}
LAYOUT = Layout(header_line=0, comment="%")
_CELLS = 10
_NUMBERED = re.compile(r"(.+)_(\d+)")
_RECORD = re.compile(r"(.+_)?\d+")


@dataclass(frozen=True)
class _Look:
    """What the columns of a file say: load in per cent, Hz, raw middle of the travel and the jaw there, jaw torque."""

    load: float
    frequency: float
    middle: float
    jaw: float
    torque: float
    tool: str


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every ``.TXT`` file at ``path``. Option ``offset``: encoders' zeros by ``series`` (default) or ``record``."""
    require_known("option of da-vinci-jaw", asked.options, OPTIONS)
    scope = str(asked.options.get("offset", "series"))
    require_known("offset of da-vinci-jaw", [scope], ("series", "record"))
    files, others = _records_at(path)
    index = _index(files[0].parent / "index.csv")
    beside = _beside(files) if scope == "series" else files
    series = {file: _series(file) for file in beside}
    looks = {file: _look(file) for file in beside}
    doubts = {file: _labels(file, looks[file], index.get(file.name, {})) for file in files}
    for name in set(series.values()):
        members = [f for f in beside if series[f] == name]
        for file, fault in (*_tools(members, looks, name), *_loads(members, looks, name)):
            if file in doubts:
                doubts[file].append(fault)
    records = []
    for file in files:
        peers = [looks[f] for f in beside if series[f] == series[file]] if scope == "series" else [looks[file]]
        records.append(_record(file, series[file], looks[file], peers, index.get(file.name, {}), doubts[file]))
    channels = tuple(c if c.offset_free is None else _freed(c, scope) for c in CHANNELS)
    return DataSet(
        system="pulley_circuit",
        description="Jaw of a da Vinci tool on a bench: angle and torque at motor and jaw, sine of +-30 deg, 1 kHz. "
        "Closing: the angles fall.",
        channels=channels,
        records=tuple(records),
        source={
            "cite": "O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4) 3027-3034, 2018, doi 10.1109/LRA.2018.2849862",
            "url": "https://github.com/MRDLab/mis-tool-characterization", "licence": "ODbL 1.0, DbCL 1.0",
        },
        heldout=("load_percent=30", "load_percent=70"),
        group="series",
        remarks=(
            *(() if index else (f"no index.csv beside {files[0].name}: the wrist's pitch is not known",)),
            *(f"{file.name} is left out: records of this set are called by a number" for file in others),
        ),
    )  # fmt: skip


def _records_at(path: Path) -> tuple[list[Path], list[Path]]:
    """(the records at ``path``, other text files there, as the log of the serial port that some folders hold)."""
    found = files_at(path, ".txt", skip=("SOURCE.txt", "README.txt"))
    files = [file for file in found if _RECORD.fullmatch(file.stem)]
    if not files:
        raise ConfigurationError(
            f"{path} holds no record of this set: they are called <number>.TXT or <series>_<number>.TXT, "
            f"and here is {found[0].name}"
        )
    return files, [file for file in found if file not in files]


def _beside(files: list[Path]) -> list[Path]:
    """The same, and the other records of their series in their folders.

    An encoder's zero is that of its series, whichever records of it are imported together.
    """
    series = {(file.parent, _series(file)) for file in files}
    folders = list(dict.fromkeys(file.parent for file in files))
    found = [file for folder in folders for file in _records_at(folder)[0]]
    return [file for file in dict.fromkeys(found) if (file.parent, _series(file)) in series]


def _freed(channel: ChannelSpec, scope: str) -> ChannelSpec:
    return ChannelSpec(**{**channel.__dict__, "offset_free": scope})


def _series(file: Path) -> str:
    """<series>_<number>.TXT, or <series>/<number>.TXT as published."""
    numbered = _NUMBERED.fullmatch(file.stem)
    return numbered.group(1) if numbered else file.parent.name


def _index(path: Path) -> dict[str, Mapping[str, str]]:
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {row["file"]: row for row in csv.DictReader(file) if row.get("file")}


def _look(file: Path) -> _Look:
    with file.open(encoding="latin-1") as lines:
        header = [line for line in (next(lines, "") for _ in range(40)) if line.startswith("%")]
    tool = re.search(r"tool number \S+ Lot \S+ \S+", "".join(header))
    chunks = list(read_text(file, LAYOUT, {**COLUMNS, "load": 7, "target": _CELLS}, Log(file.name)))
    column = {name: np.concatenate([c.columns[name] for c in chunks]) for name in chunks[0].columns}
    drive, jaw, time = column["drive_angle"], column["output_angle"], column["time"]
    if len(drive) < 100 or not np.isfinite(drive).any():
        raise ConfigurationError(f"{file.name}: {len(drive)} rows of numbers are too few for a record of this set")
    good = np.isfinite(drive) & np.isfinite(jaw)
    middle = (np.nanmax(drive) + np.nanmin(drive)) / 2
    level = np.polyfit(drive[good] - middle, jaw[good], 1)[1] if np.ptp(drive[good]) else np.nanmedian(jaw)
    return _Look(
        load=100 * float(np.nanmedian(column["load"])),
        frequency=measured_frequency(time, drive),
        middle=float(middle),
        jaw=float(level),
        torque=TORQUE * float(np.nanpercentile(column["output_torque"], 10)),
        tool=tool.group(0) if tool else "",
    )


def _labels(file: Path, look: _Look, row: Mapping[str, str]) -> list[Fault]:
    """Where index.csv contradicts the columns."""
    faults = []
    for key, measured, tolerance, what in (
        ("load_percent", look.load, 1.0, "load by the command column, %"),
        ("frequency_hz", look.frequency, 0.02, "frequency of the motor's angle, Hz"),
    ):
        try:
            said = float(row[key])
        except (KeyError, ValueError):
            continue
        if not abs(said - measured) <= tolerance:
            text = f"index.csv says {key} {said:g}, the {what}, is {measured:.4g}: files swapped or mislabelled?"
            faults.append(Fault(file.name, "label", text))
    return faults


def _tools(members: list[Path], looks: Mapping[Path, _Look], name: str) -> list[tuple[Path, Fault]]:
    """Files whose header names another tool than most of their series: not proof, but the rest agrees."""
    most = Counter(looks[f].tool for f in members if looks[f].tool).most_common(1)
    if not most:
        return []
    return [
        (f, Fault(f.name, "label", f"header names {looks[f].tool or 'no tool'}, those of series {name} {most[0][0]}"))
        for f in members
        if looks[f].tool != most[0][0]
    ]


def _loads(members: list[Path], looks: Mapping[Path, _Look], name: str) -> list[tuple[Path, Fault]]:
    """Files whose jaw torque belongs to another load than the command column's, by the others of the series."""
    if len(members) < 4:
        return []
    found = []
    for file in members:
        rest = [looks[f] for f in members if f != file]
        if len({round(look.load) for look in rest}) < 2:
            continue
        slope, level = np.polyfit([look.torque for look in rest], [look.load for look in rest], 1)
        implied = slope * looks[file].torque + level
        if abs(implied - looks[file].load) > 15.0:
            text = f"jaw torque is that of {implied:.0f} % load in series {name}, the command {looks[file].load:.0f} %"
            found.append((file, Fault(file.name, "label", text, channel="output_torque")))
    return found


def _record(
    file: Path, series: str, look: _Look, peers: list[_Look], row: Mapping[str, str], doubts: list[Fault]
) -> RecordSpec:
    conditions: dict[str, object] = {"series": series, "load_percent": round(look.load, 2)}
    if np.isfinite(look.frequency):
        conditions["frequency"] = {"value": round(look.frequency, 4), "unit": "Hz"}
    for name, key in (("pitch", "pitch_deg"), ("roll", "roll_deg")):
        if row.get(key):
            conditions[name] = {"value": float(row[key]), "unit": "deg"}
    middle = float(np.median([p.middle for p in peers]))
    jaw = float(np.median([p.jaw for p in peers]))
    offsets = {"drive_angle": round(-DRIVE * middle, 9), "output_angle": round(OUTPUT * jaw, 9)}
    stem = file.stem if _NUMBERED.fullmatch(file.stem) else f"{series}_{file.stem}"
    chunks = partial(_chunks, file)
    return RecordSpec(stem, file.name, chunks, conditions, offsets, doubts=tuple(doubts))


def _chunks(file: Path, log: Log):
    for chunk in read_text(file, LAYOUT, {**COLUMNS, "target": _CELLS}, log):
        yield type(chunk)({name: chunk.columns[name] for name in COLUMNS}, chunk.lines)
