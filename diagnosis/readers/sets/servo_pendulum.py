"""A servo that lifts a pendulum: recordings of Better Actuator Models (Duclusaud, Passault and others, Rhoban).

JSON files, one a run: mass, arm length, gain and trajectory, and under ``entries`` time, angle, goal and whether the
torque is on. The servo's own speed, duty and supply voltage are not read. Its duty is that of the firmware's law, kp
(4096 / 2 pi) / (256 885) (goal - angle) within 1, to three of its 885 steps, and the voltage is that of one moment of
the bridge's period: its mean is 7.3 V at any duty. Rows come every 5.3 ms, and every 3.5 ms where the torque is off;
they are laid on an even clock of 200 Hz by straight lines, as the publication does.
"""

import json
import math
from pathlib import Path

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.readers.base import ChannelSpec, DataSet, RecordSpec, Request, files_at, whole

SUMMARY = "servo with a pendulum (JSON, Better Actuator Models): a file, or a folder of them"
OPTIONS = ()
RATE = 200.0  # Hz
COUNTS, GAIN_UNIT, DUTIES = 4096, 256.0, 885.0
"""Steps of a turn; what a gain of the firmware counts; steps of its duty up to all of it."""
STALL = 0.52, 1.47, 5.0
"""N m, A and V at which the servo is held, by its data sheet."""
CHANNELS = (
    ChannelSpec("time", "s"),
    ChannelSpec("position", "rad", note="4096 steps a turn; 0 hangs down"),
    ChannelSpec("position_reference", "rad"),
    ChannelSpec("release_reference", "1", note="1 where the torque is off"),
)
_ENTRY = {
    "timestamp": "time", "position": "position", "goal_position": "position_reference",
    "torque_enable": "release_reference",
}  # fmt: skip


def position_gain(kp: float) -> float:
    """Duty for a radian of error, 1/rad, of a gain of the firmware.

    Examples
    --------
    >>> round(position_gain(400.0), 4)
    1.151
    """
    return kp * COUNTS / (2.0 * math.pi) / (GAIN_UNIT * DUTIES)


def open_dataset(path: Path, asked: Request) -> DataSet:
    """Every JSON file at ``path``; runs with a gain of 100 are held out where there are others."""
    require_known("option of servo-pendulum", asked.options, OPTIONS)
    read = [(file, _content(file)) for file in files_at(path, ".json")]
    said = {(c["mass"], c["length"], c["vin"]) for _, c in read}
    if len(said) > 1:
        raise ConfigurationError(f"{path}: runs with several masses, arms or supplies: read each rig by itself")
    mass, length, volts = said.pop()
    gains = {c["kp"] for _, c in read}
    return DataSet(
        system="rotary_joint",
        description="Servo XL330 that lifts a point mass on an arm, under its own controller; some runs switch its "
        "torque off half-way.",
        channels=CHANNELS,
        records=tuple(_record(file, content) for file, content in read),
        source={
            "cite": "Duclusaud, Passault and others: Better Actuator Models (Rhoban)",
            "url": "https://github.com/Rhoban/bam", "licence": "Apache-2.0",
        },
        known={
            "load_mass": {"value": mass, "unit": "kg"},
            "arm_length": {"value": length, "unit": "m", "note": "the arm's own mass is not recorded"},
            "supply_voltage": {"value": volts, "unit": "V"},
        },
        nominal={
            "torque_constant": {"value": STALL[0] / STALL[1], "unit": "N m/A", "note": "data sheet of the XL330-M288"},
            "resistance": {"value": STALL[2] / STALL[1], "unit": "ohm", "note": "data sheet of the XL330-M288"},
        },
        heldout=("kp=100",) if 100.0 in gains and len(gains) > 1 else (),
    )  # fmt: skip


def _content(file: Path) -> dict:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{file.name} is not whole, or no JSON: {error}") from error
    if not isinstance(content, dict) or not isinstance(content.get("entries"), list) or len(content["entries"]) < 2:
        raise ConfigurationError(f"{file.name}: expected an object with rows under 'entries'")
    for name in ("mass", "length", "kp", "vin"):
        if not isinstance(content.get(name), int | float) or isinstance(content[name], bool):
            raise ConfigurationError(f"{file.name}: '{name}' is {content.get(name)!r}, expected a number")
        content[name] = float(content[name])
    return content


def _record(file: Path, content: dict) -> RecordSpec:
    for k, entry in enumerate(content["entries"], 1):
        for name in _ENTRY:
            if not isinstance(entry, dict) or not isinstance(entry.get(name), bool | int | float):
                raise ConfigurationError(f"{file.name}, entry {k}: '{name}' is missing or no number")
    columns = {
        channel: np.array([float(entry[name]) for entry in content["entries"]]) for name, channel in _ENTRY.items()
    }
    columns["release_reference"] = 1.0 - columns["release_reference"]
    columns = _even(columns)
    conditions = {
        "kp": content["kp"],
        "trajectory": str(content.get("trajectory", file.stem)),
        "position_gain": position_gain(content["kp"]),
    }
    return RecordSpec(file.stem, file.name, whole(columns), conditions)


def _even(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Rows on an even clock: by straight lines, of what is on or off the row before."""
    stamps = columns["time"]
    time = np.arange(math.ceil(stamps[0] * RATE), math.floor(stamps[-1] * RATE) + 1) / RATE
    found = {name: np.interp(time, stamps, values) for name, values in columns.items()}
    before = np.searchsorted(stamps, time, side="right") - 1
    step = 2.0 * math.pi / COUNTS  # of the encoder: values between its steps are none that it shows
    place = np.round(found["position"] / step) * step
    return found | {"time": time, "position": place, "release_reference": columns["release_reference"][before]}
