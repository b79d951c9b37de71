"""A recording of any plant whose family says how it is replayed (`cable_envs.plants.family.Replayed`).

The drive is told what it was told, where a command was recorded; else it follows its recorded position, smoothed. Every
other channel is predicted. Before each record the mechanism is at rest where its first sample says.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.description import channels_of
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.model import Coordinate, Free
from cable_envs.diagnosis.systems import starts
from cable_envs.diagnosis.systems.common import (
    HELD_STEPS,
    at_first,
    augmented_rig,
    blocks_of,
    claimed,
    free_parameters,
    held_command,
    missing,
    motion_coordinates,
    moving_command,
    plant_values,
    recorded_drive,
    resample,
    smoothed,
)
from cable_envs.diagnosis.systems.conditions import given, usual
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.replayed import ReplayModel, Run
from cable_envs.diagnosis.systems.starts import UNSURE
from cable_envs.plants import family, plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.family import Replayed
from cable_envs.plants.own_effects import with_own_effects

STEP = 5e-4
"""Step of integration, s, where commands are no steps."""
LEAD = 30
"""Control steps at rest before a record, in which the mechanism finds its balance."""


def models(system: str) -> bool:
    """Whether the plant's family says how its recordings are replayed."""
    return family(system).replayed is not None


def driven_by(system: str) -> tuple[str, ...]:
    """Channels of which the first that was recorded drives the simulator."""
    told = family(system)
    return (*told.commands.values(), *((told.replayed.drive,) if told.replayed else ()))


def simulator(recording: Recording, request: Request) -> Plant:
    """The plant that simulates a recording: at how many places it rubs its rig says, or else the family."""
    how, contacts = family(recording.system).replayed, request.contacts
    if contacts is None:
        contacts = recording.rig.contacts if recording.rig is not None else how.contacts if how else 0
    return with_own_effects(plant_for(recording.system, contacts=contacts), request.own)


def prepare(recording: Recording, request: Request) -> Question:
    """What a recording asks.

    Raises ConfigurationError where neither a command nor the drive's position, or no answer to it, was recorded.
    """
    told, channels = family(recording.system), recording.channels
    how = told.replayed
    assert how is not None, "asked for by `models`"
    mode = next((m for m, channel in told.commands.items() if channel in channels), "")
    names = [n for n in how.predicted if n in channels and (mode or n not in how.of_drive)]
    plant = simulator(recording, request)
    begun = _begun(recording, plant, request)
    values = {**plant_values(recording, plant, request.rig), **begun}
    servo = how.servo if mode and how.drive in channels and told.commands[mode] in how.by_servo else ()
    nominals = [
        replace(free, std=UNSURE * abs(free.start)) if free.name in begun else free
        for free in free_parameters(recording, plant, values, (*how.refitted, *servo), request)
    ]
    soft = {name: values[name] >= stiff for name, stiff in how.stiff.items()}
    signals = [told.signals.get(n, n) for n in names]
    candidates = claimed(missing(recording, plant, values, nominals, signals, request, soft, how.places), values)
    found = {p.name: p for p in (*nominals, *(p for h in candidates.asked for p in h.free))}
    period = sample_period(recording.records)
    made = [_model(recording, use, plant, values, list(found.values()), period, names, mode) for use in
            ("fit", "heldout")]  # fmt: skip
    return Question(
        recording.system, made[0], made[1], tuple(p.name for p in nominals), servo, candidates.asked,
        {name: plant.table[name].unit for name in found},
        lambda fitted, accepted: augmented_rig(plant, {**values, **fitted}, accepted), at_rest=bool(mode),
        ways=told.ways, not_asked=candidates.not_asked,
    )  # fmt: skip


def values_of(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Numbers of the plant's whole table that its simulation of a recording starts from, SI."""
    return {**plant_values(recording, plant, request.rig), **_begun(recording, plant, request)}


def _begun(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Numbers that nobody states, as the records to fit tell them before anything is simulated."""
    if recording.rig is not None or request.rig or not recording.used_for("fit"):
        return {}
    channels, period = [name for name in recording.channels if name != "time"], sample_period(recording.records)
    series = [resample(record, period, channels)[1] for record in recording.used_for("fit")]
    said = {*recording.known, *recording.nominal, *usual(recording, plant)}
    return starts.begin(plant, series, plant_values(recording, plant), period, said)


def _model(
    recording: Recording, use: str, plant: Plant, values: dict[str, float], parameters: Sequence[Free], period: float,
    names: Sequence[str], mode: str,
) -> ReplayModel:  # fmt: skip
    command = family(recording.system).commands.get(mode, "")
    substeps = HELD_STEPS if command and recording.holds(command) else max(int(np.ceil(period / STEP - 1e-3)), 2)
    runs = [_run(recording, record, plant, values, period, names, mode) for record in recording.used_for(use)]
    return ReplayModel(
        plant, runs, values, parameters, period, drive=mode or "follow", substeps=substeps, lead=LEAD
    )  # fmt: skip


def _run(
    recording: Recording, record: Record, plant: Plant, values, period: float, names: Sequence[str], mode: str
) -> Run:
    told = family(recording.system)
    how, channel = told.replayed, told.commands.get(mode, "")
    assert how is not None, "asked for by `models`"
    time, seen = resample(record, period, [name for name in recording.channels if name != "time"])
    place = next((n for n in (*how.places, channel) if n in seen), channel)
    early = at_first(time, seen[place].values)
    far = next((n for n in how.far if n in seen), place)
    if far != place:
        early |= at_first(time, smoothed(seen[far].values, period)[0])
    hold, rate, drive = "ramp", None, None
    if not mode:
        drive = recorded_drive(recording, how.drive, seen[how.drive].values)
        command, rate = drive.smoothed(period)
        early = early | drive.sudden()
        kept = told.signals.get(how.drive, how.drive)
    else:
        kept = next(m for m in plant.action_modes if m.name == mode).rest_signal
        command = moving_command(record, channel, time, period)
        if recording.holds(channel):
            hold = "step"
            first = seen[kept].values if kept in seen else command
            command = held_command(record, channel, time, period, float(first[0]))
    stated = given(record, plant)
    start = _at_rest(plant, {**values, **stated}, kept, float(command[0]))
    along = _coordinates(recording, time, seen, period, place, how)
    sensors = dict.fromkeys(how.of_drive, "drive") if mode else dict.fromkeys(names, "")
    blocks = blocks_of(recording, record, time, seen, names, early, along, sensors)
    free = tuple(told.signals.get(n, n) for n in names if recording.channels[n].offset_free)
    signals = tuple(told.signals.get(n, n) for n in names)
    return Run(
        command, rate, start, signals, blocks, stated, offset=free, hold=hold, mean=record.over > 0.0, recorded=drive
    )  # fmt: skip


def _at_rest(plant: Plant, values, signal: str, wanted: float) -> float:
    """Position of the output at which a signal is ``wanted`` at rest, by secants."""
    if not signal:
        return 0.0
    p, row = plant.prepare(plant.table.pack(values)[:, None]), plant.row(signal)

    def off(position: float) -> float:
        return float(plant.rest(p, np.array([position]))[row, 0]) - wanted

    before, now = 0.0, 1e-3
    for _ in range(30):
        a, b = off(before), off(now)
        if b == a or abs(now - before) < 1e-12:
            break
        before, now = now, now - b * (now - before) / (b - a)
    return now


def _coordinates(
    recording: Recording, time: np.ndarray, seen, period: float, place: str, how: Replayed
) -> tuple[Coordinate, ...]:
    """Of the output's motion, or else the drive's; and of the tension."""
    units = channels_of(recording.system)
    found = motion_coordinates(time, seen[place].values, units[place], place)
    pull = next((n for n in how.pulls if n in seen), None)
    if pull is None:
        return found
    name = "tension" if units[pull] == "N" else "torque"
    return (*found, Coordinate(name, units[pull], smoothed(seen[pull].values, period)[0], pull))
