"""Band brake: the JSON files of Coble, Huggins, Cao, Ricles, Downey, Dataset-Friction-Damper-with-Backlash, 2022.

A band around a drum, driven to and fro. Rows: time, displacement, force, velocity, force of either end of the band.
The force has the sign of the velocity: it is what the actuator exerts, as the format has it, and nothing is turned.
Where the brake moves forwards the second end is the tight one.
"""

import json
import re
from pathlib import Path

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import (
    ChannelSpec,
    DataSet,
    Fault,
    RecordSpec,
    Request,
    files_at,
    measured_frequency,
    whole,
)

SUMMARY = "band brake (JSON, Coble 2022): a file, or a folder of them"
OPTIONS = ()
INCH, POUND = 0.0254, 4.44822  # m, N
CHANNELS = (
    ChannelSpec("time", "s"),
    ChannelSpec("position", "m", INCH, column="displacement_in", note="inches"),
    ChannelSpec("force", "N", 1000 * POUND, column="force_kip", note="kips; of the actuator: has the velocity's sign"),
    ChannelSpec("velocity", "m/s", INCH, column="velocity_in_s", note="inches a second"),
    ChannelSpec("band_tension_1", "N", POUND, column="tension_1_lb", note="pounds; slack end where it moves forwards"),
    ChannelSpec("band_tension_2", "N", POUND, column="tension_2_lb", note="pounds; tight end where it moves forwards"),
)
_UNITS = {
    "displacement units": "in", "time units": "s", "friction force units": "kip", "actuator force units": "lb",
}  # fmt: skip
_NAME = re.compile(r"(?P<frequency>[\d.]+)Hz(?P<tension>[\d.]+)lbtension(?P<amplitude>[\d.]+)amplitude")


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every JSON file at ``path``."""
    require_known("option of band-brake", asked.options, OPTIONS)
    records = tuple(_record(file) for file in files_at(path, ".json"))
    return DataSet(
        system="linear_drive",
        description="Band on a drum, driven to and fro: displacement, force, tension of both ends of the band.",
        channels=CHANNELS,
        records=records,
        source={
            "cite": "Coble, Huggins, Cao, Ricles, Downey: Dataset-Friction-Damper-with-Backlash, 2022",
            "url": "https://github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash",
            "licence": "CC BY-SA 4.0",
        },
        heldout=("frequency=1",) if len(records) > 1 and all("frequency" in r.conditions for r in records) else (),
    )


def _record(file: Path) -> RecordSpec:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{file.name} is not whole, or no JSON: {error}") from error
    if not isinstance(content, dict) or not isinstance(content.get("data"), list) or not content["data"]:
        raise ConfigurationError(f"{file.name}: expected an object with rows under 'data'")
    for key, unit in _UNITS.items():
        if content.get(key) != unit:
            raise ConfigurationError(f"{file.name}: '{key}' is {content.get(key)!r}, this reader knows '{unit}'")
    rows = content["data"]
    for k, row in enumerate(rows, 1):
        if not isinstance(row, list) or len(row) != len(CHANNELS) or not all(isinstance(v, (int, float)) for v in row):
            raise ConfigurationError(f"{file.name}, row {k}: expected {len(CHANNELS)} numbers, found {str(row)[:60]}")
    table = np.array(rows, float)
    conditions, doubts = _conditions(file, table)
    doubts += _ends(file, table)
    columns = {c.name: table[:, k] for k, c in enumerate(CHANNELS)}
    return RecordSpec(file.stem, file.name, whole(columns), conditions, doubts=doubts)


def _ends(file: Path, table: np.ndarray) -> tuple[Fault, ...]:
    """The second end of the band is the tight one where the force is positive; else the two are swapped."""
    pull = table[:, 5] - table[:, 4]
    if np.sum((pull - pull.mean()) * (table[:, 2] - table[:, 2].mean())) >= 0.0:
        return ()
    text = "the first end of the band is tight where the force is positive, in the published set the second: swapped?"
    return (Fault(file.name, "label", text, channel="band_tension_1"),)


def _conditions(file: Path, table: np.ndarray) -> tuple[dict[str, object], tuple[Fault, ...]]:
    """From the file's name; the frequency is checked against the displacement."""
    named = _NAME.search(file.name)
    if not named:
        return {}, ()
    said = {key: float(value) for key, value in named.groupdict().items()}
    doubts: tuple[Fault, ...] = ()
    measured = measured_frequency(table[:, 0], table[:, 1])
    if abs(measured - said["frequency"]) > 0.05 * said["frequency"]:
        text = f"the name says {said['frequency']:g} Hz, the displacement has {measured:.3g} Hz: files swapped?"
        doubts = (Fault(file.name, "label", text, channel="position"),)
    return {
        "frequency": {"value": said["frequency"], "unit": "Hz"},
        "band_pretension": {"value": said["tension"] * POUND, "unit": "N"},
        "amplitude": {"value": said["amplitude"] * INCH, "unit": "m"},
    }, doubts
