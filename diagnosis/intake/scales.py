"""Units that are off by a power of ten, found by holding the channels against each other and against the rig.

    rates      the slope of a position against the speed beside it
    pairs      a position against its reference or command, both ends of a cable against each other
    balances   force against mass times acceleration and the friction that the recording claims; tension against the
               load's weight; tension and torque of a circuit against its pretension
    clock      a period or travel that no such rig has

Physics that a simulator lacks changes such numbers by tens of percent; the bounds here are factors of twenty and more.
"""

from collections.abc import Iterator

import numpy as np

from cable_envs.plants import plant_for
from diagnosis.data.recording import Record, Recording
from diagnosis.systems.common import smooth_speed

OFF = 20.0
"""Factor from which numbers that should be alike are not."""
_RATES = {"position": "velocity", "drive_position": "drive_velocity"}
_PAIRS = (
    ("position", "position_reference"), ("load_position", "position_reference"), ("load_position", "drive_position"),
    ("drive_angle", "drive_angle_command"), ("output_angle", "angle_reference"), ("output_angle", "drive_angle"),
    ("drive_velocity", "drive_velocity_command"), ("position", "motor_position"), ("load_tension", "drive_tension"),
    ("tension_top", "tension_bottom"),
)  # fmt: skip
_LEVELS = (("load_tension", "drive_tension"), ("tension_top", "tension_bottom"))
"""Pairs whose levels are alike even where one hardly moves: a load's weight, while friction swings the drive."""
_SMALLER = {
    "m": "mm", "m/s": "mm/s", "N": "mN", "N m": "mN m", "s": "ms", "rad": "deg", "rad/s": "deg/s", "A": "mA", "V": "mV"
}  # fmt: skip
_LARGER = {"mm": "m", "mm/s": "m/s", "mN": "N", "mN m": "N m", "ms": "s", "N": "kN", "N m": "kN m", "deg": "rad"}
_SLOWEST, _FASTEST = 0.5, 2e-5
"""s between samples, beyond which the clock's unit is in doubt."""
_FARTHEST, _NEAREST = 20.0, 1e-6
"""m of travel."""

Found = tuple[str, str, int, str]
"""(record, channel, row, text)"""


def wrong_units(recording: Recording) -> list[Found]:
    """Channels whose unit cannot be right, the first record that shows each."""
    found: dict[str, Found] = {}
    for record in (r for r in recording.records if r.use != "rest"):
        for channel, text in _suspects(recording, record):
            found.setdefault(channel, (record.name, channel, 1, text))
        if found:
            break  # the others would say the same
    return list(found.values())


def _suspects(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    clock = list(_clock(recording, record))
    yield from clock
    if clock:
        return
    yield from _rates(recording, record)
    yield from _pairs(recording, record)
    balance = {"linear_drive": _drive, "cable_hole": _hole, "pulley_circuit": _circuit}[recording.system]
    yield from balance(recording, record)


def _hint(recording: Recording, channel: str, factor: float) -> str:
    """``factor``: how many times the channel's numbers are too large."""
    unit = recording.channels[channel].unit
    other = _SMALLER.get(unit) if factor > 1.0 else _LARGER.get(unit)
    return f"is its unit '{unit}' right? '{other}' would fit better" if other else f"is its unit '{unit}' right?"


def _clock(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    period = float(np.median(np.diff(record.time)))
    if not _FASTEST <= period <= _SLOWEST:
        yield "time", f"a sample every {period:.3g} s; {_hint(recording, 'time', period / 0.01)}"
    for channel, c in recording.channels.items():
        if c.si_unit == "m":
            travel = float(np.ptp(record.data[channel][record.usable(channel)]))
            if travel > _FARTHEST or 0.0 < travel < _NEAREST:
                yield channel, f"a travel of {travel:.3g} m; {_hint(recording, channel, travel / 0.1)}"
        if channel == "wrap_angle" and float(np.nanmax(np.abs(record.data[channel]))) > 40.0 * np.pi:
            yield channel, f"more than twenty turns of wrap; {_hint(recording, channel, 57.3)}"


def _series(record: Record, channel: str) -> np.ndarray:
    usable = record.usable(channel)
    return np.interp(record.time, record.time[usable], record.data[channel][usable])


def _speed(record: Record, channel: str) -> np.ndarray:
    return smooth_speed(_series(record, channel), float(np.median(np.diff(record.time))))


def _rates(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    for place, rate in _RATES.items():
        if place not in recording.channels or rate not in recording.channels:
            continue
        slope, seen = _speed(record, place), _series(record, rate)
        ratio = _ratio(seen, slope)
        if ratio is not None and not 0.2 <= ratio <= 5.0:
            yield (
                rate,
                (
                    f"{ratio:.3g} times the slope of {place} over time: one of the units of {rate}, {place} and time "
                    f"is wrong; {_hint(recording, rate, ratio)}"
                ),
            )


def _pairs(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    for one, other in _PAIRS:
        if one not in recording.channels or other not in recording.channels:
            continue
        ratio = _ratio(_series(record, one), _series(record, other))
        if (one, other) in _LEVELS and ratio is not None and 1.0 / OFF <= _level(record, one, other) <= OFF:
            continue
        if ratio is not None and not 1.0 / OFF <= ratio <= OFF:
            yield (
                one,
                (
                    f"{ratio:.3g} times {other}, which it should follow: the unit of one of them is wrong; "
                    f"{_hint(recording, one, ratio)}"
                ),
            )


def _ratio(a: np.ndarray, b: np.ndarray) -> float | None:
    """Size of a over that of b where they move together; None where they do not."""
    if np.std(a) == 0.0 or np.std(b) == 0.0 or np.corrcoef(a, b)[0, 1] < 0.5:
        return None
    return float(np.std(a) / np.std(b))


def _level(record: Record, one: str, other: str) -> float:
    """Median size of a channel over another's."""
    return float(np.median(np.abs(_series(record, one))) / max(np.median(np.abs(_series(record, other))), 1e-300))


def _value(recording: Recording, name: str) -> float:
    found = recording.value(name)
    return plant_for(recording.system).table[name].default if found is None else found


def _drive(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    if not {"position", "force"} <= set(recording.channels):
        return
    if recording.rig is None and "mass" not in {**recording.known, **recording.nominal}:
        return  # nobody says what mass is moved
    speed = _speed(record, "position")
    period = float(np.median(np.diff(record.time)))
    mass = _value(recording, "mass") + (recording.value("motor_mass") or 0.0)
    inertia = mass * np.abs(smooth_speed(speed, period))
    friction = (recording.value("coulomb") or 0.0) + (recording.value("viscous") or 0.0) * np.abs(speed)
    tilt = mass * 9.81 * abs(recording.value("gravity_share") or 0.0)
    need = float(np.quantile(inertia + friction + tilt, 0.95))
    have = float(np.quantile(np.abs(_series(record, "force")), 0.95))
    if need <= 0.0:
        return
    # a force far above the inertia may be friction of which the recording says nothing
    most = 100.0 if float(np.max(friction)) > 0.0 else 3000.0
    ratio = have / need
    if ratio > most or ratio < 1.0 / 30.0:
        yield (
            "force",
            (
                f"{ratio:.3g} times what mass, acceleration and the claimed friction take: one of the units of force, "
                f"position, time and mass is wrong; {_hint(recording, 'force', ratio)}"
            ),
        )


def _hole(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    weight = _value(recording, "load_mass") * _value(recording, "gravity") * _value(recording, "load_gravity")
    for channel in ("drive_tension", "load_tension"):
        if channel in recording.channels and weight > 0.0:
            ratio = float(np.median(np.abs(_series(record, channel)))) / weight
            if not 1.0 / OFF <= ratio <= OFF:
                yield (
                    channel,
                    (
                        f"{ratio:.3g} times the load's weight of {weight:.3g} N: the unit of {channel} or of load_mass "
                        f"is wrong; {_hint(recording, channel, ratio)}"
                    ),
                )


def _circuit(recording: Recording, record: Record) -> Iterator[tuple[str, str]]:
    said = {**recording.known, **recording.nominal}
    if "pretension_top" not in said and recording.rig is None:
        return
    pretension = 0.5 * (_value(recording, "pretension_top") + _value(recording, "pretension_bottom"))
    for channel in ("tension_top", "tension_bottom"):
        if channel in recording.channels:
            ratio = float(np.median(_series(record, channel))) / pretension
            if not 1.0 / OFF <= ratio <= OFF:
                yield channel, f"{ratio:.3g} times the pretension; {_hint(recording, channel, ratio)}"
    if "drive_torque" in recording.channels:
        ratio = float(np.quantile(np.abs(_series(record, "drive_torque")), 0.95))
        ratio /= pretension * _value(recording, "drive_radius")
        if ratio > OFF or ratio < 1e-5:
            yield (
                "drive_torque",
                (f"{ratio:.3g} times pretension and drive_radius; {_hint(recording, 'drive_torque', ratio)}"),
            )
