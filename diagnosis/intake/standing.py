"""What stands still: a sensor that is stuck or at its limit, and a rig that rests or turns, which is no fault."""

import numpy as np

from cable_envs.diagnosis.data.recording import Record
from cable_envs.diagnosis.intake.repeats import moves
from cable_envs.diagnosis.intake.tracks import POSITIONS, RATES, Fault, track_of

FEWEST_HELDOUT = 50
"""Samples of a record that is only predicted, at least."""
_FINER = 10.0
"""Least noise over the resolution where most samples are at a channel's two ends: an encoder rests there, too."""
_STILL = 8
"""Equal samples in a row that noise above the resolution does not give: below 1e-6 for noise of one step and more."""
_RESUMES = 0.5
"""Of the greatest way in a sample, within which a rig starts again: from rest, mass takes more than one sample."""
_STEADY = 0.2
"""Of its way, that a position may be off a steady speed: it has gone a few counts only."""


def standing(record: Record, channel: str, good: np.ndarray) -> list[Fault]:
    """Where a measured channel stands still although the rig moves; good: samples that are measurements [T]."""
    values = record.data[channel]
    still = [fault for fault in stuck(record.name, channel, values, good) if not _counted(record, channel, fault)]
    stopped = np.zeros(len(values), dtype=bool)
    while still and (length := _stop(record, channel, still[0], stopped)):  # the next run may be a sensor's
        stopped[still[0].row - 1 : still[0].row - 1 + length] = True
        good = good & ~stopped
        still = stuck(record.name, channel, values, good) if good.sum() > FEWEST_HELDOUT else []
    return still


def _stop(record: Record, channel: str, fault: Fault, stopped: np.ndarray) -> int:
    """Samples for which a position stands still because the rig does; 0 where a sensor was held.

    stopped: those that are known to be such [T]. What stands still beside them, or when a record begins, is how a
    motion turns or starts, count by count.

    At a stop no other channel moves, and the motion goes on from there. Where it turns round, friction holds it while
    efforts go on, and one end of a rig while the other stretches what is between them: then no other place moves. A
    sensor that was held takes it up where it has gone meanwhile, farther than the rig starts in one sample.
    """
    if channel not in POSITIONS:
        return 0
    track = track_of(record)
    values, first = track.channels[channel], fault.row - 1
    length = int(np.argmax(np.r_[values[first:] != values[first], True]))
    fastest = float(np.max(np.abs(np.gradient(track.even(channel)))))
    behind = values[first + length : first + length + 1] - values[first]
    if np.any(np.abs(behind) > _RESUMES * fastest):
        return 0
    turns = len(behind) > 0 and first > 0 and (values[first - 1] - values[first]) * behind[0] > 0.0
    turns |= first == 0 or bool(np.any(stopped[first - 1 : first + length + 1]))
    ends = any(name in POSITIONS for name in track.channels if name != channel)
    kinematic = POSITIONS if ends else (*POSITIONS, *RATES.values()) if turns else None
    return 0 if moves(track, channel, first, length, kinematic) else length


def _counted(record: Record, channel: str, fault: Fault) -> bool:
    """Whether a speed stands still because its position goes on at that speed, from count to count."""
    place = next((p for p, rate in RATES.items() if rate == channel and p in record.data), None)
    if place is None:
        return False
    values, way = record.data[channel], record.data[place]
    first = max(fault.row - 1, 0)
    length = int(np.argmax(np.r_[values[first:] != values[first], True]))
    seconds = float(record.time[first + length - 1] - record.time[first])
    gone = float(way[first + length - 1] - way[first])
    return abs(gone - values[first] * seconds) < _STEADY * abs(values[first]) * seconds


def flat_voltage(record: str, values: np.ndarray, good: np.ndarray) -> list[Fault]:
    """A voltage may be held by its author, and may lie at the drive's limit; elsewhere noise that stops is a fault."""
    held = values[good]
    if np.ptp(held) == 0.0:
        return [Fault(record, "voltage", 1, f"constant at {held[0]:g}: nothing drives the rig, or the wrong column")]
    limits = (values == held.max()) | (values == held.min())
    inner = np.where(limits, np.nan, values)
    return stuck(record, "voltage", inner, good & ~limits) if np.isfinite(inner).sum() > FEWEST_HELDOUT else []


def stuck(record: str, channel: str, values: np.ndarray, good: np.ndarray) -> list[Fault]:
    """Values that stand still although the noise elsewhere exceeds the resolution: saturated, or stuck."""
    held = values[good]
    levels = np.unique(held)
    step = float(np.min(np.diff(levels)))
    noise = float(np.median(np.abs(np.diff(held, 3)))) / 0.6745 / np.sqrt(20.0)
    if ((held == held.max()) | (held == held.min())).mean() > 0.5:  # the median then is of what stands still
        noise, step = _noise_in_motion(held), _FINER * step
    if noise < step or noise < 1e-9 * float(np.ptp(held)):
        return []
    for level, what in ((held.max(), "highest"), (held.min(), "lowest")):
        start, longest = longest_run((values == level) & good)
        if longest >= _STILL:
            text = f"{longest} samples in a row at its {what} value {level:g}: saturated; mark them under 'quality'"
            return [Fault(record, channel, start + 1, text)]
    start, longest = longest_run(np.r_[False, np.diff(values) == 0.0] & good)
    if longest >= 3 * _STILL and values[start] != 0.0:  # a speed from an encoder's counts is 0 at rest
        text = f"{longest + 1} equal samples in a row, {values[start]:g}: stuck; mark them under 'quality'"
        return [Fault(record, channel, max(start, 1), text)]
    return []


def _noise_in_motion(values: np.ndarray) -> float:
    """Standard deviation of the noise where no value equals the next; 0 where third differences are of the motion.

    Those of white noise alternate, with a correlation of -0.75 from each to the next; those of a motion do not.
    """
    thirds, moves = np.diff(values, 3), np.diff(values) != 0.0
    apart = moves[:-2] & moves[1:-1] & moves[2:]
    both = apart[:-1] & apart[1:]
    if both.sum() < FEWEST_HELDOUT:
        return 0.0
    one, next_ = thirds[:-1][both], thirds[1:][both]
    alternates = float(one @ next_) < -0.3 * float(np.sqrt((one @ one) * (next_ @ next_)))
    return float(np.median(np.abs(thirds[apart]))) / 0.6745 / np.sqrt(20.0) if alternates else 0.0


def longest_run(mask: np.ndarray) -> tuple[int, int]:
    """(start, length) of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int)))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    k = int(np.argmax(lengths))
    return int(edges[2 * k]), int(lengths[k])
