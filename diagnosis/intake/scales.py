"""Units that are off by a power of ten, found by holding the channels against each other and against the rig.

    rates      the slope of a position against the speed beside it
    pairs      a position against its reference or command, both ends of a cable against each other
    balances   force against mass times acceleration and the friction that the recording claims; tension against the
               load's weight; tension and torque of a circuit against its pretension
    sizes      a period, a travel, a speed or a voltage that no such rig has

Physics that a simulator lacks changes such numbers by tens of percent; the bounds here are factors of twenty and more.
"""

from collections.abc import Iterator

import numpy as np

from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.intake.tracks import RATES, Fault
from cable_envs.diagnosis.systems import off_balance
from cable_envs.diagnosis.systems.units import OFF, hint, series_of, speed_of

_PAIRS = (
    ("position", "position_reference"), ("load_position", "position_reference"), ("load_position", "drive_position"),
    ("drive_angle", "drive_angle_command"), ("output_angle", "angle_reference"), ("output_angle", "drive_angle"),
    ("drive_velocity", "drive_velocity_command"), ("position", "motor_position"), ("load_tension", "drive_tension"),
    ("tension_top", "tension_bottom"),
)  # fmt: skip
_LEVELS = (("load_tension", "drive_tension"), ("tension_top", "tension_bottom"))
"""Pairs whose levels are alike even where one hardly moves: a load's weight, while friction swings the drive."""
_SLOWEST, _FASTEST = 0.5, 2e-5
"""s between samples, beyond which the clock's unit is in doubt."""
_FARTHEST, _NEAREST = 20.0, 1e-6
"""m of travel."""
_SWIFTEST = 20.0
"""m/s."""
_HIGHEST = 1000.0
"""V, of a drive of one axis."""
_USUAL = 0.99
"""Share of the samples that stay below what is held against these."""


def wrong_units(recording: Recording) -> list[Fault]:
    """Channels whose unit cannot be right, the first record that shows each."""
    found: dict[str, Fault] = {}
    for record in (r for r in recording.records if r.use != "rest"):
        for channel, text in _suspects(recording, record):
            found.setdefault(channel, Fault(record.name, channel, 1, text))
        if found:
            break  # the others would say the same
    return list(found.values())


def _suspects(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    sizes = [*_clock(recording, record), *_sizes(recording, record)]
    yield from sizes
    if sizes:
        return
    yield from _rates(recording, record)
    yield from _pairs(recording, record)
    yield from off_balance(recording, record)


def _clock(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    period = float(np.median(np.diff(record.time)))
    if not _FASTEST <= period <= _SLOWEST:
        yield "time", f"a sample every {period:.3g} s; {hint(recording, 'time', period / 0.01)}"


def _sizes(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    for channel, c in recording.channels.items():
        values = record.data[channel][record.usable(channel)]
        if c.si_unit == "m":
            travel = float(np.ptp(values))
            speed = float(np.quantile(np.abs(speed_of(record, channel)), _USUAL))
            if travel > _FARTHEST or 0.0 < travel < _NEAREST:
                yield channel, f"a travel of {travel:.3g} m; {hint(recording, channel, travel / 0.1)}"
            elif speed > _SWIFTEST:
                yield channel, f"a speed of {speed:.3g} m/s; {hint(recording, channel, speed / 0.1)}"
        if c.si_unit == "V" and (most := float(np.quantile(np.abs(values), _USUAL))) > _HIGHEST:
            yield channel, f"a voltage of {most:.3g} V; {hint(recording, channel, most / 10.0)}"
        if channel == "wrap_angle" and float(np.nanmax(np.abs(record.data[channel]))) > 40.0 * np.pi:
            yield channel, f"more than twenty turns of wrap; {hint(recording, channel, 57.3)}"


def _rates(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    for place, rate in RATES.items():
        if place not in recording.channels or rate not in recording.channels:
            continue
        slope, seen = speed_of(record, place), series_of(record, rate)
        ratio = _ratio(seen, slope)
        if ratio is not None and not 0.2 <= ratio <= 5.0:
            yield (
                rate,
                (
                    f"{ratio:.3g} times the slope of {place} over time: one of the units of {rate}, {place} and time "
                    f"is wrong; {hint(recording, rate, ratio)}"
                ),
            )


def _pairs(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    for one, other in _PAIRS:
        if one not in recording.channels or other not in recording.channels:
            continue
        ratio = _ratio(series_of(record, one), series_of(record, other))
        if (one, other) in _LEVELS and ratio is not None and 1.0 / OFF <= _level(record, one, other) <= OFF:
            continue
        if ratio is not None and not 1.0 / OFF <= ratio <= OFF:
            yield (
                one,
                (
                    f"{ratio:.3g} times {other}, which it should follow: the unit of one of them is wrong; "
                    f"{hint(recording, one, ratio)}"
                ),
            )


def _ratio(a: np.ndarray, b: np.ndarray) -> float | None:
    """Size of a over that of b where they move together; None where they do not."""
    if np.std(a) == 0.0 or np.std(b) == 0.0 or np.corrcoef(a, b)[0, 1] < 0.5:
        return None
    return float(np.std(a) / np.std(b))


def _level(record: Record, one: str, other: str) -> float:
    """Median size of a channel over another's."""
    return float(np.median(np.abs(series_of(record, one))) / max(np.median(np.abs(series_of(record, other))), 1e-300))
