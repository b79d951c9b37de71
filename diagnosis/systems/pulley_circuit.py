"""A pulley-circuit recording as a model: the drive's servo, or the path it took, winds the cables.

Where the command of the drive's angle was recorded, it goes through the servo of the plant, whose frequency and damping
are refitted: a command has no noise. Without it the drive follows its recorded angle, smoothed.

The plant is the chain of spans and contacts. The closed form lumps the friction of all idlers at the output, so that it
has no slip fronts. On records with nothing wrong, made by a chain of another kind (`proof`), it leaves 3 to
12 times the noise in the drive's torque, the plant's chain 0.99 to 1.03 times in every channel.

The plant's cables that harden have the tensile stiffness EA without tension; what is claimed and refitted here is that
about the pretension T, which a rig shows:  EA (1 + c L) = EA sqrt(1 + 2 c T),  as T = L (1 + c L / 2)
(`cable_envs.effects.stiffness_hardening`, c: its coefficient). Otherwise a refit has to bend EA, T and c along a narrow
valley: a cable that grew 2.7 times as stiff by its pretension was answered with a scale of the torque.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import Candidates
from cable_envs.diagnosis.model.model import Coordinate, Free
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
from cable_envs.diagnosis.systems.conditions import given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.replayed import ReplayModel, Run
from cable_envs.diagnosis.systems.units import OFF, Suspect, hint, series_of, value_of
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects

VARIANT = "chain"
STEP = 1e-3
"""Largest step of integration, s, with `EASY` or less; shorter with stiffer cables: with longer ones the chain raises
small inertias (`cable_envs.plants.circuit.ends.resolve`), which shows in the torques."""
EASY = 2e4
"""N"""
STIFF = 4e4
"""N: a cable claimed to be this stiff is claimed not to stretch, which may be wrong."""
LEAD = 30
"""Control steps at rest before a record, in which the circuit finds its balance."""
SIGNALS = {
    "drive_angle": "drive_angle", "drive_torque": "drive_torque", "output_angle": "output_angle",
    "output_torque": "output_torque", "tension_top": "tension_drive_top", "tension_bottom": "tension_drive_bottom",
}  # fmt: skip
"""channel -> signal of the plant"""
SENSORS = {"drive_angle": "drive", "drive_torque": "drive"}
"""Channels whose noises may be one: a servo that acts on a noisy angle makes a noisy torque."""
DRIVEN_BY = ("drive_angle_command", "drive_angle")
"""Channels of which the first that was recorded drives the simulator."""
PLACES = ("output_angle", "drive_angle", "drive_angle_command")
"""Channels that say where the circuit is, the best first."""
REFITTED = ("shaft_friction", "tensile_stiffness", "pretension_top", "pretension_bottom", "output_inertia")
"""Refitted unless known. The inertia too: what rides along adds to it, and with it 6 % wrong the ring after each break
away was explained by a payload (a gain of 260 where the friction that was missing gains 35)."""
SERVO = ("servo_frequency", "servo_damping_ratio")
STIFFNESS, HARDENING = "tensile_stiffness", "stiffness_hardening.coefficient"
PRETENSIONS = ("pretension_top", "pretension_bottom")


def simulator(recording: Recording, request: Request) -> Plant:
    """The plant that simulates a recording: what is asked for, else what its rig says, else the chain."""
    told = recording.rig.variant if recording.rig is not None else ""
    return with_own_effects(plant_for("pulley_circuit", request.variant or told or VARIANT), request.own)


def prepare(recording: Recording, request: Request) -> Question:
    """What a pulley-circuit recording asks of the plant's chain, or of its closed form (`simulator`).

    Raises ConfigurationError where neither the drive's angle nor its command, or no answer of it, was recorded.
    """
    channels = recording.channels
    commanded = "drive_angle_command" in channels
    plant = simulator(recording, request)
    values = plant_values(recording, plant, request.rig)
    values[STIFFNESS] *= float(_growth(values))
    servo = SERVO if commanded and "drive_angle" in channels else ()
    nominals = free_parameters(recording, plant, values, (*REFITTED, *servo), request)
    names = [name for name in SIGNALS if name in channels and (commanded or name != "drive_angle")]
    candidates = _candidates(recording, plant, values, nominals, [SIGNALS[name] for name in names], request)
    found = {p.name: p for p in (*nominals, *(p for h in candidates.asked for p in h.free))}
    period = sample_period(recording.records)
    models = [_model(recording, use, plant, values, list(found.values()), period, names) for use in ("fit", "heldout")]
    return Question(
        "pulley_circuit", models[0], models[1], tuple(p.name for p in nominals), servo, candidates.asked,
        {name: plant.table[name].unit for name in found},
        lambda fitted, accepted: augmented_rig(plant, _without_tension({**values, **fitted}), accepted),
        at_rest=commanded, not_asked=candidates.not_asked,
    )  # fmt: skip


class CircuitModel(ReplayModel):
    """The model of the module: its columns have the stiffness about the pretension."""

    def as_plant(self, columns: np.ndarray) -> np.ndarray:
        """Columns [len(table), n] as the plant takes them."""
        table = self.plant.table
        named = {name: columns[table.index(name)] for name in (STIFFNESS, HARDENING, *PRETENSIONS)}
        if np.any(named[HARDENING]):
            columns[table.index(STIFFNESS)] = _without_tension(named)[STIFFNESS]
        return columns


def _growth(values: Mapping[str, Any]) -> Any:
    """Stiffness about the mean pretension over that without tension."""
    tension = 0.5 * sum(values[name] for name in PRETENSIONS)
    return np.sqrt(1.0 + 2.0 * values[HARDENING] * tension)


def _without_tension(values: Mapping[str, Any]) -> dict[str, Any]:
    """The same with the stiffness without tension for that about the pretension."""
    return {**values, STIFFNESS: values[STIFFNESS] / _growth(values)}


def _candidates(recording, plant, values, nominals, signals, request: Request) -> Candidates:
    soft = {"tensile_stiffness": values["tensile_stiffness"] >= STIFF, "output_damping": True}
    places = ("drive_angle", "drive_angle_command")
    return claimed(missing(recording, plant, values, nominals, signals, request, soft, places), values)


def _model(
    recording: Recording, use: str, plant: Plant, values: dict[str, float], parameters: Sequence[Free], period: float,
    names: Sequence[str],
) -> ReplayModel:  # fmt: skip
    steps = period / STEP * float(np.sqrt(max(values["tensile_stiffness"] / EASY, 1.0)))
    substeps = max(int(np.ceil(steps - 1e-3)), 2)
    substeps = HELD_STEPS if recording.holds("drive_angle_command") else substeps
    runs = [_run(recording, record, plant, values, period, names) for record in recording.used_for(use)]
    drive = "position" if "drive_angle_command" in recording.channels else "follow"
    return CircuitModel(plant, runs, values, parameters, period, drive=drive, substeps=substeps, lead=LEAD)


def _run(recording: Recording, record: Record, plant: Plant, values, period: float, names: Sequence[str]) -> Run:
    time, seen = resample(record, period, [name for name in recording.channels if name != "time"])
    early = at_first(time, seen[next(n for n in PLACES if n in seen)].values)
    hold, drive = "step" if recording.holds("drive_angle_command") else "ramp", None
    if hold == "step":
        at_rest = seen["drive_angle" if "drive_angle" in seen else "drive_angle_command"].values[0]
        command, rate = held_command(record, "drive_angle_command", time, period, at_rest), None
    elif "drive_angle_command" in seen:
        command, rate = moving_command(record, "drive_angle_command", time, period), None
    else:
        drive = recorded_drive(recording, "drive_angle", seen["drive_angle"].values)
        command, rate = drive.smoothed(period)
        early = early | drive.sudden()
    own = given(record, plant)
    values = {**values, **own}
    start = float(command[0]) * values["drive_radius"] / values["output_radius"]
    along = _coordinates(time, seen, period)
    sensors = SENSORS if rate is None else dict.fromkeys(names, "")  # a followed drive's noise is in all of them
    blocks = blocks_of(recording, record, time, seen, names, early, along, sensors)
    free = tuple(SIGNALS[name] for name in names if recording.channels[name].offset_free)
    return Run(
        command,
        rate,
        start,
        tuple(SIGNALS[name] for name in names),
        blocks,
        own,
        offset=free,
        hold=hold,
        mean=record.over > 0.0,
        recorded=drive,
    )


def _coordinates(time: np.ndarray, seen, period: float) -> tuple[Coordinate, ...]:
    """Of the output's motion, or else the drive's; and of the torque."""
    place = next(n for n in PLACES if n in seen)
    found = motion_coordinates(time, seen[place].values, "rad", place)
    pull = next((n for n in ("output_torque", "drive_torque") if n in seen), None)
    if pull is None:
        return found
    return (*found, Coordinate("torque", "N m", smoothed(seen[pull].values, period)[0], pull))


def off_balance(recording: Recording, record: Record) -> Iterator[Suspect]:
    """Where tensions or the torque are far from what the pretension makes of them: a wrong unit."""
    said = {**recording.known, **recording.nominal, **record.conditions}
    if "pretension_top" not in said and recording.rig is None:
        return
    pretension = 0.5 * sum(value_of(recording, name, record) for name in PRETENSIONS)
    for channel in ("tension_top", "tension_bottom"):
        if channel in recording.channels:
            ratio = float(np.median(series_of(record, channel))) / pretension
            if not 1.0 / OFF <= ratio <= OFF:
                yield Suspect(channel, f"{ratio:.3g} times the pretension; {hint(recording, channel, ratio)}")
    if "drive_torque" in recording.channels:
        ratio = float(np.quantile(np.abs(series_of(record, "drive_torque")), 0.95))
        ratio /= pretension * value_of(recording, "drive_radius", record)
        if ratio > OFF or ratio < 1e-5:
            yield Suspect(
                "drive_torque",
                f"{ratio:.3g} times pretension and drive_radius; {hint(recording, 'drive_torque', ratio)}",
            )
