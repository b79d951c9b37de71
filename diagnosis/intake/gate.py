"""Faults of the data, found before any physics is asked about: each names record, channel and row.

A fault of the data must never end as a physical effect, so what a simulator cannot be held against is refused: gaps,
a clock that jumps, dead, stuck and saturated sensors (`cable_envs.diagnosis.intake.standing`), outliers, units that are
off by a power of ten (`cable_envs.diagnosis.intake.scales`), what no rig does (`CHECKS`), and more rows than memory
holds. What can be left out of the sums is left out and noted.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.data.thinning import thinning
from cable_envs.diagnosis.intake.energy import against_nature
from cable_envs.diagnosis.intake.factors import wrong_factors
from cable_envs.diagnosis.intake.jumps import jumps, mixed_units, out_of_order, spikes
from cable_envs.diagnosis.intake.repeats import blocks_twice, held, piled
from cable_envs.diagnosis.intake.scales import wrong_units
from cable_envs.diagnosis.intake.standing import FEWEST_HELDOUT, flat_voltage, longest_run, standing
from cable_envs.diagnosis.intake.timing import late_channels
from cable_envs.diagnosis.intake.tracks import POSITIONS, RATES, Fault, is_told, tracks_of, was_told
from cable_envs.diagnosis.model import rest
from cable_envs.diagnosis.systems.common import motion_coordinates
from cable_envs.diagnosis.systems.question import Look

LONGEST_GAP = 5
"""Samples that may be missing in a row; they are left out of every sum."""
FEWEST, MOST = 200, 200_000
"""Samples: of a record to fit, and of all records together as a model uses them. A refit holds some hundred predictions
of every channel at once: 2e5 samples of three channels take about 3 GB."""
_JITTER = 0.25
"""Of the clock's step."""
_MOST_EMPTY = 0.2
_STIRS, _CALM = 0.05, 50
"""Of the range of the records to fit, that a position at rest may wander, as a mean of so many samples."""
_QUIET = 0.2
"""Of the way that a channel goes in other records, below which it does not move: friction may hold a force anywhere."""
_OUTLIER = 30.0
"""Times the step that 99 % of all steps stay below."""
_ALL = Look()
CHECKS = (
    blocks_twice, out_of_order, mixed_units, held, piled, spikes, jumps, wrong_factors, late_channels, against_nature,
)  # fmt: skip
"""What no rig does, of all records together, in the order of asking: what happens once, which may look like a shift,
then units, clocks, signs and columns. Each takes (recording, tracks) of records whose clocks are even but for short
gaps, and yields `Fault`. Where one finds what cannot be used, the next are not asked."""


@dataclass(frozen=True)
class Quality:
    """All faults, and what the recording visited: ranges of its channels, reversals, duration (SI)."""

    faults: tuple[Fault, ...]
    visited: Mapping[str, Any] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """Faults that are left out of all sums, in words."""
        return tuple(str(fault) for fault in self.faults if not fault.fatal)

    def require_usable(self) -> None:
        """ConfigurationError with every fatal fault, one per line."""
        fatal = [str(fault) for fault in self.faults if fault.fatal]
        if fatal:
            raise ConfigurationError("the data cannot be diagnosed:\n  " + "\n  ".join(fatal))


def gate(recording: Recording, look: Look = _ALL) -> Quality:
    """Look through every channel of every record for faults of the data.

    Parameters
    ----------
    recording : Recording
        As it was loaded.
    look : Look
        What the model will use of it: a jump at an end that is left out anyway is noted only.

    Returns
    -------
    Quality
        All faults, and what the recording visited; `Quality.require_usable` raises for the fatal ones.
    """
    too_many = _too_many(recording, look)
    if too_many:
        return Quality((too_many,))
    faults: list[Fault] = []
    for record in recording.records:
        faults += _clock(record)
        for channel in recording.channels:
            if channel == "time":
                continue
            if record.use == "rest":
                faults += _at_rest(recording, record, channel)
            else:
                found = [
                    f for f in _channel(record, channel, look)
                    if not (f.jump and was_told(record, f.row, look.told, _OUTLIER))
                ]  # fmt: skip
                if any(f.fatal for f in found) and channel in (*POSITIONS, *RATES.values()):
                    found = _at_stop(recording, record, channel) or found
                faults += [_at_edge(record, fault, look) for fault in found]
    if not look.told and not any(f.fatal for f in faults):  # how large a simulator of one's own is nobody knows here
        faults += wrong_units(recording)
    faults += _by_physics(recording, look) if not any(f.fatal for f in faults) else []
    fatal = any(f.fatal for f in faults)
    return Quality(tuple(faults), {} if fatal else visited(recording))


def _by_physics(recording: Recording, look: Look) -> list[Fault]:
    """What no rig does, without the ends that the model leaves out: all notes, and the first check's fatal faults."""
    inner, first = _without_ends(_measured(recording, look.told), look.edge)
    tracks, found = tracks_of(inner), []
    for check in CHECKS:
        found += [replace(f, row=f.row + first[f.record]) for f in check(inner, tracks)]
        if any(f.fatal for f in found):
            break
    return found


def _measured(recording: Recording, told: frozenset[str]) -> Recording:
    """The recording without channels that are commands whatever they are called."""
    if not told:
        return recording
    channels = {name: channel for name, channel in recording.channels.items() if name not in told}
    records = tuple(replace(r, data={n: v for n, v in r.data.items() if n not in told}) for r in recording.records)
    return replace(recording, channels=channels, records=records)


def _without_ends(recording: Recording, edge: float) -> tuple[Recording, dict[str, int]]:
    """(the recording less ``edge`` s at either end of each record, rows that are left out before each)."""
    records, first = [], {}
    for record in recording.records:
        kept = (record.time >= record.time[0] + edge) & (record.time <= record.time[-1] - edge)
        kept |= kept.sum() < FEWEST_HELDOUT or record.use == "rest"
        first[record.name] = int(np.argmax(kept))
        records.append(replace(record, data={name: values[kept] for name, values in record.data.items()}))
    return replace(recording, records=tuple(records)), first


def _too_many(recording: Recording, look: Look) -> Fault | None:
    """More samples than a refit can hold, even where rows are averaged (`cable_envs.diagnosis.data.thinning`)."""
    moving = [r for r in recording.records if r.use != "rest"]
    rows = sum(len(r.time) for r in moving)
    if rows <= MOST:
        return None
    every = thinning(recording, POSITIONS).every if look.averages else 1
    used = sum(_used(r, look) for r in moving) // every
    if used <= MOST:
        return None
    last = recording.records[-1]
    text = f"{rows} rows make {used} samples that a model compares; at most {MOST} are diagnosed: cut the records"
    return Fault(last.name, "time", len(last.time), text)


def _used(record: Record, look: Look) -> int:
    """Samples of a record that a model compares."""
    own = float(np.median(np.diff(record.time))) if len(record.time) > 1 else 1.0
    return int(len(record.time) * min(own / look.spacing, 1.0)) if look.spacing else len(record.time)


def _at_edge(record: Record, fault: Fault, look: Look) -> Fault:
    """A jump within what the model leaves out at the ends of each record is noted only."""
    time = record.time[fault.row - 1]
    outside = min(time - record.time[0], record.time[-1] - time) < look.edge
    if not (fault.fatal and fault.jump and outside):
        return fault
    return replace(fault, fatal=False, text=f"{fault.text}; within {look.edge:g} s of the end, which is left out")


def _at_stop(recording: Recording, record: Record, channel: str) -> list[Fault]:
    """A note where a position or speed stands still all the time because the rig does; empty where others move on.

    It moves in another record, and every other channel of this one goes a small part of what it goes elsewhere.
    """
    values = record.data[channel][record.usable(channel)]
    others = [r for r in recording.records if r is not record and r.use != "rest"]
    if not len(values) or np.ptp(values) > 0.0 or not any(_way(r, channel) > 0.0 for r in others):
        return []
    for name in recording.channels:
        if name not in ("time", channel) and _way(record, name) > _QUIET * max(_way(r, name) for r in others):
            return []
    return [Fault(record.name, channel, 1, f"constant at {values[0]:g}: the rig rests in this record", fatal=False)]


def _way(record: Record, channel: str) -> float:
    """Range of a channel's means over `_CALM` samples."""
    values = record.data[channel][record.usable(channel)]
    if len(values) < _CALM:
        return 0.0
    return float(np.ptp(np.convolve(values, np.full(_CALM, 1.0 / _CALM), mode="valid")))


def _clock(record: Record) -> list[Fault]:
    fewest = {"fit": FEWEST, "heldout": FEWEST_HELDOUT, "rest": rest.FEWEST}[record.use]
    if len(record.time) < fewest:
        return [Fault(record.name, "time", len(record.time), f"{len(record.time)} samples; {fewest} are the least")]
    steps = np.diff(record.time)
    period, found = float(np.median(steps)), []
    if record.repeated:
        text = f"rows that repeat the one before are left out ({len(record.repeated)}); row numbers leave them out"
        found.append(Fault(record.name, "time", record.repeated[0], text, fatal=False))
    late = np.flatnonzero(steps > (LONGEST_GAP + 1.5) * period)
    if len(late):
        text = f"a gap of {steps[late[0]]:.3g} s ({len(late)} of them); cut the record there into two"
        found.append(Fault(record.name, "time", int(late[0]) + 2, text))
    short = np.flatnonzero((steps > 1.5 * period) & (steps <= (LONGEST_GAP + 1.5) * period))
    if len(short):
        text = f"{len(short)} short gaps, the first of {steps[short[0]]:.3g} s, are left out"
        found.append(Fault(record.name, "time", int(short[0]) + 2, text, fatal=False))
    regular = steps[steps < 1.5 * period]
    if float(np.std(regular)) > _JITTER * period:
        worst = int(np.argmin(steps))
        text = f"the clock jitters by {np.std(regular) / period:.0%} of its step; stamp where the samples are taken"
        found.append(Fault(record.name, "time", worst + 2, text))
    return found


def _channel(record: Record, channel: str, look: Look) -> list[Fault]:
    command = is_told(channel) or channel in look.told
    values, good = record.data[channel], record.usable(channel)
    empty = ~good
    row = int(np.argmax(empty)) + 1
    if empty.mean() > _MOST_EMPTY:
        return [Fault(record.name, channel, row, f"{empty.mean():.0%} of the samples are empty or marked in doubt")]
    found = []
    if empty.any():
        start, longest = longest_run(np.isnan(values))
        if command and longest > LONGEST_GAP:
            text = f"{longest} samples in a row are empty, so what drove the rig there is not known; cut the record"
            found.append(Fault(record.name, channel, start + 1, text))
        text = f"{int(empty.sum())} samples that are empty or marked in doubt are left out"
        found.append(Fault(record.name, channel, row, text, fatal=False))
    held = values[good]
    if channel == "voltage" and channel not in look.told:
        return found + flat_voltage(record.name, values, good)
    if command or channel == "wrap_angle":
        return found
    if np.ptp(held) == 0.0:
        return [Fault(record.name, channel, 1, f"constant at {held[0]:g}: a dead sensor, or the wrong column")]
    return found + standing(record, channel, good) + _outlier(record.name, channel, values, record.usable(channel))


def _at_rest(recording: Recording, record: Record, channel: str) -> list[Fault]:
    """A record at rest may not move: what it shows would count as noise. A channel that never changes has none."""
    values, good = record.data[channel], record.usable(channel)
    row = int(np.argmax(~good)) + 1
    if (~good).mean() > _MOST_EMPTY:
        return [Fault(record.name, channel, row, f"{(~good).mean():.0%} of the samples are empty or marked in doubt")]
    found = _outlier(record.name, channel, values, good) if np.ptp(values[good]) > 0.0 else []
    if channel not in POSITIONS:
        return found
    moving = [r.data[channel][r.usable(channel)] for r in recording.used_for("fit")]
    least = _STIRS * max((float(np.ptp(v)) for v in moving if len(v)), default=0.0)
    smooth = np.convolve(values[good], np.full(_CALM, 1.0 / _CALM), mode="valid")
    if np.ptp(smooth) <= least:
        return found
    away = int(np.argmax(np.abs(smooth - np.median(smooth))))
    text = f"it moves by {np.ptp(smooth):.3g}; a record with 'use: rest' is one in which nothing moves"
    return [*found, Fault(record.name, channel, int(np.flatnonzero(good)[away]) + 1, text)]


def _outlier(record: str, channel: str, values: np.ndarray, good: np.ndarray) -> list[Fault]:
    steps = np.abs(np.diff(values[good]))
    usual = float(np.quantile(steps, 0.99))
    if usual <= 0.0 or np.max(steps) <= _OUTLIER * usual:
        return []
    jump = int(np.argmax(steps > _OUTLIER * usual))  # the way there, not the way back
    row = int(np.flatnonzero(good)[jump + 1]) + 1
    text = f"a jump by {steps[jump]:.3g}, {steps[jump] / usual:.0f} times what 99 % of its steps stay below"
    return [Fault(record, channel, row, text, jump=True)]


def visited(recording: Recording) -> dict[str, Any]:
    """Ranges of all channels [low, high], speeds, reversals and seconds of the records to fit, SI."""
    records = recording.used_for("fit")
    ranges = {}
    for channel in recording.channels:
        if channel != "time":
            values = np.concatenate([r.data[channel][r.usable(channel)] for r in records])
            ranges[channel] = {"low": float(values.min()), "high": float(values.max()),
                               "unit": recording.channels[channel].si_unit}  # fmt: skip
    found: dict[str, Any] = {"ranges": ranges, "seconds": float(sum(r.time[-1] - r.time[0] for r in records))}
    place = next((p for p in POSITIONS if p in recording.channels), None)
    if place is None:
        return found
    fastest, turns = 0.0, 0
    for record in records:
        usable = record.usable(place)
        unit = recording.channels[place].si_unit
        along = {c.name: c.values for c in motion_coordinates(record.time[usable], record.data[place][usable], unit)}
        fastest = max(fastest, float(along["size of speed"].max()))
        ways = along["direction"][along["direction"] != 0.0]
        turns += int(np.sum(np.diff(ways) != 0.0))
    return {**found, "motion": place, "fastest": fastest, "reversals": turns}
