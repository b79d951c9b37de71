"""Coupled electric drives: Wigren and Schoukens, Uppsala University TR 2017-024 (nonlinearbenchmark.org).

Two motors move a belt over a sprung pulley, whose speed sensor gives no sign. Inputs are voltages; nothing is said of
the sensor's scale, so its reading stays in volts. 500 samples a record, 50 Hz; 400 to fit and 100 to test.
"""

from functools import partial
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import ChannelSpec, DataSet, RecordSpec, Request, counted, files_at, whole
from cable_envs.diagnosis.readers.formats.mat import variables
from cable_envs.diagnosis.readers.text import Layout, read_text

SUMMARY = "coupled electric drives (CSV or MATLAB): a file, or a folder of them"
OPTIONS = ()
RATE, FIT_SECONDS, ROWS = 50.0, 8.0, 500
RECORDS = {
    "DATAPRBS": {f"prbs_{k}": (f"u{k}", f"z{k}") for k in (1, 2, 3)},
    "DATAUNIF": {f"uniform_{k}": (f"u1{k}", f"z1{k}") for k in (1, 2)},
}
"""File -> record -> (voltage, reading)"""


def open_dataset(path: Path, asked: Request) -> DataSet:
    """DATAPRBS and DATAUNIF (``.csv`` or ``.mat``) at ``path``."""
    require_known("option of coupled-drives", asked.options, OPTIONS)
    records = [r for file in files_at(path, ".csv", ".mat") for r in _records(file)]
    return DataSet(
        system="linear_drive",
        description="Two electric motors couple through a belt to a sprung pulley; voltage to its speed reading, which "
        "the sensor rectifies. The first 400 samples of each record are to fit, the last 100 to test.",
        channels=(
            ChannelSpec("time", "s", note="counted: 50 rows a second"),
            ChannelSpec("voltage", "V", note="both motors'"),
            ChannelSpec("speed_reading", "V", note="no sign, unknown scale"),
        ),
        records=tuple(records),
        source={"cite": "Wigren, Schoukens: Coupled electric drives data set, TR 2017-024", "licence": "not known"},
        after=FIT_SECONDS,
    )


def _records(file: Path) -> list[RecordSpec]:
    wanted = RECORDS.get(file.stem.upper())
    if wanted is None:
        raise ConfigurationError(f"{file.name}: this set has {' and '.join(RECORDS)}, as .csv or .mat")
    if file.suffix.lower() == ".csv":
        return [RecordSpec(name, file.name, partial(_chunks, file, *pair)) for name, pair in wanted.items()]
    names = {column: column for pair in wanted.values() for column in pair}
    found = variables(file, names)
    records = []
    for name, (u, z) in wanted.items():
        chunks = whole({"voltage": found[u], "speed_reading": found[z]})
        records.append(RecordSpec(name, file.name, partial(_timed, chunks)))
    return records


def _timed(chunks, log):
    return counted(chunks(log), RATE)


def _chunks(file: Path, voltage: str, reading: str, log):
    columns = {"voltage": voltage, "speed_reading": reading}
    rows = 0
    for chunk in counted(read_text(file, Layout(), columns, log), RATE):
        rows += len(chunk.columns["time"])
        yield chunk
    if rows < ROWS:
        log.add("other", f"{rows} rows, {ROWS} are published: cut off?")
