"""What a check of units asks of any recording: channels on one clock, what the recording claims, a hint in words."""

from typing import NamedTuple

import numpy as np

from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.systems.common import smooth_speed
from cable_envs.diagnosis.systems.conditions import given
from cable_envs.plants import plant_for

OFF = 20.0
"""Factor from which numbers that should be alike are not."""
_SMALLER = {
    "m": "mm", "m/s": "mm/s", "N": "mN", "N m": "mN m", "s": "ms", "rad": "deg", "rad/s": "deg/s", "A": "mA", "V": "mV"
}  # fmt: skip
_LARGER = {"mm": "m", "mm/s": "m/s", "mN": "N", "mN m": "N m", "ms": "s", "N": "kN", "N m": "kN m", "deg": "rad"}


class Suspect(NamedTuple):
    """A channel whose unit cannot be right, and why, in words."""

    channel: str
    text: str


def hint(recording: Recording, channel: str, factor: float) -> str:
    """``factor``: how many times the channel's numbers are too large."""
    unit = recording.channels[channel].unit
    other = _SMALLER.get(unit) if factor > 1.0 else _LARGER.get(unit)
    return f"is its unit '{unit}' right? '{other}' would fit better" if other else f"is its unit '{unit}' right?"


def series_of(record: Record, channel: str) -> np.ndarray:
    """A channel's usable samples, by straight lines at every time of the record [T], SI."""
    usable = record.usable(channel)
    return np.interp(record.time, record.time[usable], record.data[channel][usable])


def speed_of(record: Record, channel: str) -> np.ndarray:
    """Slope of a channel over time [T], SI."""
    return smooth_speed(series_of(record, channel), float(np.median(np.diff(record.time))))


def value_of(recording: Recording, name: str, record: Record) -> float:
    """A parameter as a record states it, or else as the recording claims it, or else the plant's default, SI."""
    plant = plant_for(recording.system)
    stated, found = given(record, plant), recording.value(name)
    return stated.get(name, plant.table[name].default if found is None else found)
