"""What the models of all systems share: an even clock, the motion's coordinates, free parameters, the rig found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from cable_envs.diagnosis.data.clocks.even import numbers, zero
from cable_envs.diagnosis.data.description import channels_of, told
from cable_envs.diagnosis.data.readings import FINE, Reading
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.driven import Recorded, best_width, by_cubics, noise_of_samples
from cable_envs.diagnosis.model.hypotheses import KNOWN, REFITTED, Candidates, Hypothesis, Travel, hypotheses_for
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.systems.conditions import usual
from cable_envs.diagnosis.systems.question import Request
from cable_envs.plants import family_of, variant_of
from cable_envs.plants.base import Plant
from cable_envs.sim.rigs import SCHEMA as RIG_SCHEMA

REST = 0.02
"""Speeds below this share of the record's 95 % quantile count as rest: no direction, no reversal."""
SOFTER = (0.05, 0.3, 1.5)
"""Probed compliances beyond the claimed one, over that."""
SMOOTHED = 0.15
"""s over which a speed is taken from a recorded position, for coordinates and checks of the data only."""


@dataclass(frozen=True)
class Sampled:
    """A channel on an even clock: values (SI) and whether they are measurements, each [T]; how they were read."""

    values: np.ndarray
    good: np.ndarray
    reading: Reading = FINE


def resample(record: Record, period: float, channels: Sequence[str]) -> tuple[np.ndarray, dict[str, Sampled]]:
    """(time [T] s, channel -> its samples) on an even clock, by cubics through usable samples; told ones by lines.

    A sample is good where usable ones lie around it no further apart than one and a half periods, or one is just there.
    Others are on straight lines. Where stamps scatter by a fifth of a period, lines would take as much of what a load
    rings as an export does that has gone through another clock (`cable_envs.diagnosis.intake.logged`).

    Raises KeyError for a channel that the record does not have.
    """
    first = zero(record.time, period)
    count = int(np.floor((record.time[-1] - first) / period + 0.5)) + 1
    time = first + period * np.arange(count)
    found = {}
    for channel in channels:
        usable = record.usable(channel)
        stamps, values = record.time[usable], record.data[channel][usable]
        if len(stamps) < 2:
            found[channel] = Sampled(np.zeros(count), np.zeros(count, dtype=bool))
            continue
        after = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
        near = stamps[after] - stamps[after - 1] < 1.5 * period
        near |= np.minimum(np.abs(time - stamps[after - 1]), np.abs(time - stamps[after])) < 0.1 * period
        good = near & (time > stamps[0] - 0.5 * period) & (time < stamps[-1] + 0.5 * period)
        brought = np.interp(time, stamps, values)
        if not told(channel) and len(stamps) > 3 and np.all(np.diff(stamps) > 0.0):
            brought[good] = CubicSpline(stamps, values)(np.clip(time[good], stamps[0], stamps[-1]))
        found[channel] = Sampled(brought, good, record.reading(channel))
    return time, found


HELD_STEPS = 20
"""Steps of integration in a control period with a held command: those of the environments. A command that jumps makes
a simulated drive's way depend on them: with 17, 0.6 um in a sine of 10 mm."""


REPEATS = 0.5
"""Share of samples that are as the last one, from which a command does not move from sample to sample."""


def command_rows(record: Record, channel: str, period: float, held: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """(times, values) of a command's rows, with the rows that were lost.

    A command goes on where nothing is recorded, and the rig with it. What it was in lost rows is a cubic through the
    others. Of one that mostly repeats itself it is the value before them where it is ``held``, else a straight line.
    """
    usable = record.usable(channel)
    stamps, values = record.time[usable], record.data[channel][usable]
    count = np.diff(numbers(stamps, period)).astype(int)
    if len(stamps) < 4 or np.all(count <= 1):
        return stamps, values
    share = np.concatenate([np.arange(1, n) / n for n in count if n > 1])
    after = np.repeat(np.arange(len(count)), count - 1)
    lost = stamps[after] + share * (stamps[after + 1] - stamps[after])
    if np.mean(np.diff(values) == 0.0) > REPEATS:
        filled = values[after] if held else np.interp(lost, stamps, values)
    else:
        first = np.r_[True, np.diff(stamps) > 0.0]
        filled = CubicSpline(stamps[first], values[first])(lost)
    order = np.argsort(np.r_[stamps, lost], kind="stable")
    return np.r_[stamps, lost][order], np.r_[values, filled][order]


def moving_command(record: Record, channel: str, time: np.ndarray, period: float) -> np.ndarray:
    """A command that goes from row to row in straight lines, at ``time`` [T]."""
    return np.interp(time, *command_rows(record, channel, period))


def held_command(record: Record, channel: str, time: np.ndarray, period: float, before: float) -> np.ndarray:
    """A command that acts in steps, at ``time`` [T]: what acted over the ``period`` that ends there.

    A row's command acts until the next row; ``before``: what acted before the first one.
    """
    stamps, values = command_rows(record, channel, period, held=True)
    return np.r_[before, values][np.searchsorted(stamps, time - 0.5 * period)]


def mean_over_samples(series: np.ndarray, fine: int) -> np.ndarray:
    """What a sensor shows [T, n] whose samples are means over a period, from a signal [T fine, n] within the periods.

    The last of each ``fine`` values is of the sample's moment, in the middle of its mean. With one value for each the
    signal is taken for a parabola through three of them.
    """
    if fine == 1:
        bend = np.zeros_like(series)
        bend[1:-1] = series[2:] - 2.0 * series[1:-1] + series[:-2]
        return series + bend / 24.0
    half = fine // 2
    weights = np.ones(2 * half + 1)
    if fine % 2 == 0:
        weights[[0, -1]] = 0.5
    beyond = series[-1] + (series[-1] - series[-2]) * np.arange(1, half + 1).reshape(-1, *[1] * (series.ndim - 1))
    whole = np.concatenate([series, beyond])
    found = np.zeros_like(series[fine - 1 :: fine])
    for k, weight in enumerate(weights):
        found += weight / fine * whole[fine - 1 - half + k :: fine][: len(found)]
    return found


SETTLING = 0.5
"""s at the start of a record that do not count."""
LEFT = 0.03
"""Share of a record's range of positions by which it must have left its first place."""


def smooth_speed(position: np.ndarray, period: float, seconds: float = SMOOTHED) -> np.ndarray:
    """Speed [T] from positions [T], by quadratics over ``seconds`` (Savitzky and Golay, Anal. Chem. 36 (1964) 1627)."""
    width = min(2 * max(round(0.5 * seconds / period), 2) + 1, 2 * ((len(position) - 1) // 2) + 1)
    if width < 5:
        return np.gradient(position, period) if len(position) > 1 else np.zeros_like(position)
    return savgol_filter(position, width, 2, deriv=1, delta=period)


def smoothed(values: np.ndarray, period: float, seconds: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """(values, their rate), each [T], by cubics over ``seconds``."""
    return by_cubics(values, 2 * max(round(0.5 * seconds / period), 2) + 1, period)


def recorded_drive(recording: Recording, channel: str, values: np.ndarray) -> Recorded:
    """The recorded positions [T] of a drive, on an even clock, that a simulator is to follow."""
    parts = [r.data[channel][r.usable(channel)] for r in recording.records if r.use != "rest"]
    noise = noise_of_samples(parts, recording.noise.get(channel))
    return Recorded(channel, values, noise, best_width(parts, noise))


def motion_coordinates(
    time: np.ndarray, position: np.ndarray, unit: str = "m", channel: str = ""
) -> tuple[Coordinate, ...]:
    """Speed, direction, size of speed, position and time since the last reversal [T] of a recorded position [T].

    ``unit`` of the position: "m" or "rad"; ``channel``: the one that recorded it. Direction is -1, 0 (rest) or 1.
    """
    period = float(np.median(np.diff(time)))
    speed = smooth_speed(position, period)
    rest = REST * float(np.quantile(np.abs(speed), 0.95))
    direction = np.where(np.abs(speed) > rest, np.sign(speed), 0.0)
    return (
        Coordinate("speed", f"{unit}/s", speed),
        Coordinate("direction", "1", direction),
        Coordinate("size of speed", f"{unit}/s", np.abs(speed)),
        Coordinate("position", unit, position, channel),
        Coordinate("time since reversal", "s", time_since_reversal(time, direction)),
    )


def at_first(time: np.ndarray, position: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Samples [T] at a record's start that do not count: `SETTLING`, and until the position [T] has left its place.

    What friction holds at rest (a torque, a tension, a stretch) was left there by what happened before the record.
    ``least``: the way after which that is forgotten but for a vibration that it leaves, where it is known.
    """
    found = time - time[0] <= SETTLING
    away = np.abs(position - np.median(position[found])) > max(LEFT * float(np.ptp(position)), least)
    if np.any(away):
        found |= time <= time[int(np.argmax(away & ~found))] + (SETTLING if least else 0.0)
    return found


def time_since_reversal(time: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """s since the motion last went the other way [T], through rests; before the first reversal, since the start."""
    moving = np.flatnonzero(direction)
    turned = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
    last = np.zeros(len(time), dtype=int)
    last[turned] = turned
    return time - time[np.maximum.accumulate(last)]


def plant_values(recording: Recording, plant: Plant, rig: Mapping[str, float] | None = None) -> dict[str, float]:
    """Every number of the plant's whole table: defaults, under the recording's rig, nominals, knowns, under ``rig``.

    What only the conditions of the records to fit state is their mean (`cable_envs.diagnosis.systems.conditions`). What
    a recording may name and the plant does not have (a measured radius) is left out.
    """
    values = {p.name: p.default for p in plant.table}
    given: dict[str, float] = {}
    if recording.rig is not None:
        given.update(recording.rig.values)
        given.update(recording.rig.effects)
    given.update({n: q.value for n, q in {**recording.nominal, **recording.known}.items()})
    given.update(rig or {})
    names = {name: plant.effects.aliases.get(name, name) for name in given}
    values.update({names[name]: value for name, value in given.items() if names[name] in values})
    return values | usual(recording, plant, rig)


def free_parameters(
    recording: Recording, plant: Plant, values: Mapping[str, float], refitted: Sequence[str] = (),
    request: Request | None = None,
) -> list[Free]:  # fmt: skip
    """What every refit moves: the recording's nominals, and those of ``refitted`` that it does not know.

    values: all of the plant (`plant_values`), where refits start. A nominal with a std has a prior there, unless an
    augmented rig (``request.rig``) replaced its value, of which the std says nothing.
    """
    names = [name for name in recording.nominal if name in plant.table]
    names += [name for name in refitted if name in plant.table and name not in names]
    found = []
    for name in names:
        if name in recording.known:
            continue
        p, given = plant.table[name], recording.nominal.get(name)
        start = values[name]
        scale = max(abs(start), 1e-3 * abs(p.default), 1e-9)
        std = given.std if given is not None and (request is None or not request.rig) else None
        found.append(Free(name, start, p.low, p.high, scale, std))
    return found


def travel_of(recording: Recording, place: str) -> Travel:
    """Where the records to fit go, by a channel of a position."""
    return Travel.of([r.data[place][r.usable(place)] for r in recording.used_for("fit")])


def missing(
    recording: Recording, plant: Plant, values: Mapping[str, float], nominals: Sequence[Free], signals: Sequence[str],
    request: Request, soft: Mapping[str, bool], places: Sequence[str],
) -> Candidates:  # fmt: skip
    """What a replayed plant may lack; what a recording claims to know as (nearly) absent may be there after all.

    soft: parameters that say how stiff or how damped the plant is -> whether they count as absent at ``values``; of all
    others those at their null do. places: channels that tell the travel, the best first.
    """
    effects = plant.effects.effects.values()
    rows = {p.alias: p for e in effects for p in e.parameters if p.alias}
    absent = dict(soft) | {name: values[name] == p.null for name, p in rows.items() if name not in soft}
    modelled = {name: KNOWN for name in recording.known if not absent.get(name, False)}
    modelled |= {p.name: REFITTED for p in nominals}
    as_null = {name: rows[name].null for name in recording.known if absent.get(name, False)}
    place = next((n for n in places if n in recording.channels), None)
    travel = travel_of(recording, place) if place else None
    found = hypotheses_for(
        plant, {**values, **as_null}, modelled, signals, only=request.only, without=request.without, travel=travel
    )
    wanted = [e for e in effects if e.each_sensor and e.name not in request.without]
    wanted = [e for e in wanted if request.only is None or e.name in request.only]
    inputs = {
        f"{e.name}.{p.name}": f"the recorded {p.name} drives the simulator or is not used, and is not predicted"
        for e in wanted for p in e.parameters if p.name in recording.channels and p.name not in signals
    }  # fmt: skip
    return replace(found, not_asked={**found.not_asked, **inputs})


def blocks_of(
    recording: Recording, record: Record, time: np.ndarray, seen: Mapping[str, Sampled], names: Sequence[str],
    early: np.ndarray, along: tuple[Coordinate, ...], sensors: Mapping[str, str],
) -> tuple[Block, ...]:  # fmt: skip
    """Blocks of the channels ``names``, without the ``early`` samples [T].

    sensors: channel -> whose noise it shows, where that is not the channel's own alone
    (`cable_envs.diagnosis.model.model.Block`).
    """
    units = channels_of(recording.system)
    return tuple(
        Block(
            record.name, name, time, seen[name].values, seen[name].good & ~early, units[name], along,
            sensor=sensors.get(name, name), reading=seen[name].reading,
        )
        for name in names
    )  # fmt: skip


def claimed(candidates: Candidates, values: Mapping[str, float]) -> Candidates:
    """The candidates with what the recording claims to know in the place of the effects' nulls.

    A cable said to have 2e5 N may be softer, a bearing said to have next to no friction may have more.
    """

    def of(h: Hypothesis) -> Hypothesis:
        probes = h.probes
        for name in h.nulls:
            if name in h.inverse and values[name] > 0.0:
                probes = tuple(({name: values[name] / (1.0 + more)},) for more in SOFTER)
        free = tuple(replace(p, start=p.clip(values[p.name])) if p.name in h.nulls else p for p in h.free)
        return replace(h, free=free, probes=probes, nulls={name: values[name] for name in h.nulls})

    return candidates.each(of)


def leave_out(candidates: Candidates, names: Sequence[str], why: str) -> Candidates:
    """The candidates without some of their parameters, where they have others: what the nominals can do as well."""
    found = candidates.each(lambda h: _without(h, names))
    freed = [{n for h in c.asked for n in h.names} for c in (candidates, found)]
    return replace(found, not_asked={**found.not_asked, **{name: why for name in names if name in freed[0] - freed[1]}})


def _without(hypothesis: Hypothesis, names: Sequence[str]) -> Hypothesis:
    nulls = {name: null for name, null in hypothesis.nulls.items() if name not in names}
    if not nulls:
        return hypothesis
    return replace(
        hypothesis,
        free=tuple(p for p in hypothesis.free if p.name not in names),
        probes=tuple(probe for probe in hypothesis.probes if not any(set(d) & set(names) for d in probe)),
        nulls=nulls,
    )


def augmented_rig(
    plant: Plant, values: Mapping[str, float], accepted: Sequence[str], name: str = "augmented"
) -> dict[str, Any]:
    """Content of augmented.yaml: a rig (schema of `cable_envs.sim.rigs`) with refitted values and the accepted effects.

    values: SI, by name of the plant's table, aliases allowed; parameters of the diagnosis that are no part of the rig
    are left out. accepted: names of hypotheses, "backlash" or "sensor_bias.drive_tension".
    """
    table, aliases = plant.table, plant.effects.aliases
    named = {aliases.get(k, k): float(v) for k, v in values.items()}
    own = {p.name for p in plant.parameters}
    parameters = {
        key: {"value": min(max(value, table[key].low), table[key].high), "unit": table[key].unit, "source": "diagnosis"}
        for key, value in named.items()
        if key in own
    }
    effects: dict[str, dict[str, Any]] = {}
    for key, value in named.items():
        if key not in table or key in own or "." not in key:
            continue
        effect, parameter = key.split(".", 1)
        there = effect in accepted or key in accepted
        if there and (value != table[key].default or not effect.startswith("sensor_")):
            p = table[key]
            effects.setdefault(effect, {})[parameter] = {"value": min(max(value, p.low), p.high), "unit": p.unit}
    found: dict[str, Any] = {
        "schema": RIG_SCHEMA, "name": name, "plant": family_of(plant.name).name, "parameters": parameters,
    }  # fmt: skip
    if variant := variant_of(plant.name):
        found["variant"] = variant
    if plant.contacts:
        found["contacts"] = plant.contacts
    return found | ({"effects": effects} if effects else {})


def fitted_rig(plant: Plant, values: Mapping[str, float], name: str = "augmented") -> dict[str, Any]:
    """Content of augmented.yaml with exactly these numbers: no effect that has a value is left out.

    Parameters
    ----------
    plant : Plant
        Whose rig it is.
    values : mapping of str to float
        By name of the plant's table, SI; what it has beside that is no part of the rig.
    name : str
        Of the rig.

    Returns
    -------
    dict
        As `augmented_rig` gives it, with every effect that is not at its null.
    """
    given = {key: value for key, value in values.items() if key in plant.table}
    there = plant.effects.present({p.name: p.default for p in plant.table} | given)
    return augmented_rig(plant, given, there, name)
