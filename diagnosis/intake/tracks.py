"""What channels of one rig have to do with each other, and a record's channels on one clock."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.systems.common import SMOOTHED, smooth_speed
from cable_envs.diagnosis.systems.units import series_of

WORKS = {
    "force": "position", "voltage": "position", "drive_tension": "drive_position", "drive_torque": "drive_angle",
}  # fmt: skip
"""Effort -> the position on which it works."""
PASSED_ON = {
    ("drive_tension", "drive_position"): ("load_tension", "load_position"),
    ("drive_torque", "drive_angle"): ("output_torque", "output_angle"),
}  # fmt: skip
"""Effort and position of a drive -> those of the end that it drives."""
POSITIONS = ("position", "load_position", "drive_position", "output_angle", "drive_angle")
RATES = {"position": "velocity", "drive_position": "drive_velocity"}
"""Position -> its speed."""
SPEEDS = {
    **RATES, "load_position": "load_velocity", "motor_position": "motor_velocity",
    "drive_angle": "drive_velocity", "output_angle": "output_velocity",
}  # fmt: skip
"""Channel of a place -> channel or signal of its speed."""
DRIVEN = {"drive_position": "load_position", "drive_angle": "output_angle", "motor_position": "position"}
"""Position of a drive -> the position that it moves."""
ASKED = {
    "position_reference": ("position", "load_position"), "drive_angle_command": ("drive_angle",),
    "angle_reference": ("output_angle",), "drive_velocity_command": ("drive_velocity",),
}  # fmt: skip
"""Command -> channels that obey it."""
EFFORTS = (
    "force", "drive_tension", "load_tension", "drive_torque", "output_torque", "drive_current", "tension_top",
    "tension_bottom", "band_tension_1", "band_tension_2",
)  # fmt: skip
"""Channels that sensors of force, torque or current give."""
INPUTS = ("voltage",)
"""Channels that were recorded, and that somebody may have asked for: what is unusual in them is noted."""
LAG = 0.06
"""s, the longest lag of an actuator or sensor that a rig may have: twice what `cable_envs.effects.actuator_lag` calls
typical. What is later than this did not happen in the rig, but in the logger."""


@dataclass(frozen=True)
class Fault:
    """Something wrong with one channel of one record; ``row`` counts data rows from 1.

    ``fatal``: it cannot be used, else it is noted; ``jump``: of an outlier, which a command may have asked for.
    """

    record: str
    channel: str
    row: int
    text: str
    fatal: bool = True
    jump: bool = False

    def __str__(self) -> str:
        return f"{self.record}, channel {self.channel}, row {self.row}: {self.text}"


def is_told(channel: str) -> bool:
    """Whether a channel is what somebody asked for, or the voltage that a drive was given."""
    return told(channel) or channel in INPUTS


LEVELS = 100
"""Different values, from which an input is no sequence of steps."""


def of_steps(values: np.ndarray) -> bool:
    """Whether an input [T] takes so few values that it is a sequence of steps."""
    return len(np.unique(values)) < LEVELS


ANSWERS = 3
"""Rows after its command's step in which a servo is fastest: it begins in the next one, and a sensor may be late."""


def was_told(record: Record, row: int, told: Collection[str], times: float) -> bool:
    """Whether a command steps in the `ANSWERS` rows before a jump at a row, counted from 1: the rig was told to jump.

    In the same row it would be no answer: a record of two pieces jumps in all channels at once. told: channels that are
    commands whatever they are called; times: the step that 99 % stay below, a step is so many of.
    """
    for channel, values in record.data.items():
        if channel != "time" and (is_told(channel) or channel in told):
            steps = np.abs(np.diff(values))
            sudden = (steps > 0.0) & (steps > times * float(np.nanquantile(steps, 0.99)))
            if sudden[max(row - 2 - ANSWERS, 0) : max(row - 2, 0)].any():
                return True
    return False


@dataclass(frozen=True)
class Track:
    """A record's channels [T], SI, without gaps, and the time between its samples, s."""

    name: str
    time: np.ndarray
    period: float
    channels: Mapping[str, np.ndarray]

    def even(self, channel: str) -> np.ndarray:
        """A channel on an even clock from the record's start, by straight lines: lost rows leave no jump."""
        count = round((self.time[-1] - self.time[0]) / self.period) + 1
        return np.interp(self.time[0] + self.period * np.arange(count), self.time, self.channels[channel])

    def row(self, sample: int) -> int:
        """Data row, from 1, of a sample of the even clock."""
        at = self.time[0] + (sample - 0.5) * self.period
        return min(int(np.searchsorted(self.time, at)), len(self.time) - 1) + 1

    def speed(self, place: str, along: str = "") -> np.ndarray:
        """Slope of a position over time [T], smoothed over no more than a part of a closed way.

        A slope over a span W turns the sign of an oscillation of more than 1.43 / W Hz (4.493 = tan 4.493 = pi f W).
        along : str
            Position whose closed ways count, so that two speeds that are compared are smoothed alike; itself if empty.
        """
        ways = closed_ways(self.channels[along or place])
        lasts = self.period * float(np.median([b - a for a, b in ways])) if ways else np.inf
        return smooth_speed(self.channels[place], self.period, min(SMOOTHED, _PART * lasts))


_BAND = 0.1
"""Of a position's range about its middle, that noise does not cross."""
_PART = 0.25
"""Of a closed way, over which its speed is smoothed."""


def closed_ways(place: np.ndarray) -> list[tuple[int, int]]:
    """(first, last) row of every way from the middle of a position [T], crossed upwards, to the next such crossing."""
    middle, band = float(np.median(place)), _BAND * float(np.ptp(place))
    side = np.where(place > middle + band, 1, np.where(place < middle - band, -1, 0))
    rows = np.flatnonzero(side)
    up = np.flatnonzero((side[rows[:-1]] < 0) & (side[rows[1:]] > 0))
    crossed = [int(rows[k] + np.argmax(place[rows[k] : rows[k + 1] + 1] >= middle)) for k in up]
    return list(pairwise(crossed))


def track_of(record: Record) -> Track:
    """All channels of a record, bridged by straight lines where samples are missing."""
    period = float(np.median(np.diff(record.time)))
    return Track(record.name, record.time, period, {n: series_of(record, n) for n in record.data if n != "time"})


def tracks_of(recording: Recording) -> list[Track]:
    """Of all records in which something moves."""
    return [track_of(record) for record in recording.records if record.use != "rest"]
