"""A cable-hole recording as a model: the drive runs as it was told, or as it was seen to run, and pulls the load.

Where the drive's speed command was recorded, it drives the plant, with the plant's own drive (acceleration limit, lag):
a command has no noise, while the noise of a recorded drive position, 10 um, times the cable's stiffness would be a
newton. Positions then follow from the command by integration, from a start that `replayed` solves for. Without a
command the drive follows its recorded position, smoothed; what its noise makes of each channel counts as noise.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import Candidates
from cable_envs.diagnosis.model.model import Coordinate, Free
from cable_envs.diagnosis.systems.common import (
    HELD_STEPS,
    SETTLING,
    at_first,
    augmented_rig,
    blocks_of,
    claimed,
    command_rows,
    free_parameters,
    held_command,
    leave_out,
    missing,
    motion_coordinates,
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

SUBSTEPS = (4, 24)
"""Steps of integration in a control step, at least and at most; between them so many that the load's vibration on the
cable turns by 0.2 rad in each. Measured on records with nothing wrong: finer steps change no residual."""
AS_FRICTION = ("load_dependent_friction.coefficient", "extrusion_delta")
"""Parameters of effects that change nothing but the tension ratio, as the coefficient of friction does."""
STIFF = 1.5e5
"""N/m: a cable claimed to be this stiff is claimed not to stretch, which may be wrong."""
DRIVEN_BY = ("drive_velocity_command", "drive_position")
"""Channels of which the first that was recorded drives the simulator."""
PREDICTED = ("drive_position", "drive_velocity", "drive_tension", "load_position", "load_tension")
SENSORS = {"drive_position": "drive", "drive_velocity": "drive"}
"""Channels of one sensor, where the drive's command is the simulator's input."""
TENSIONS = ("drive_tension", "load_tension")
EXTRUSION = ("extrusion_gain", "extrusion_delta", "extrusion_exponent")
REFITTED = ("friction_coefficient", "cable_stiffness", "cable_damping", "load_mass")
"""Refitted unless known, also where the recording does not name them: no two rigs have them alike. A damping c that is
too large by 100 N s/m would else make a tension late by 100 N s/m over the stiffness, and a sensor's delay be named."""


def prepare(recording: Recording, request: Request) -> Question:
    """What a cable-hole recording asks.

    Raises ConfigurationError where neither the drive's command nor its position, or no answer of the cable or load, was
    recorded.
    """
    channels = recording.channels
    plant = with_own_effects(plant_for("cable_hole"), request.own)
    values = values_of(recording, plant, request)
    nominals = free_parameters(recording, plant, values, REFITTED, request)
    signals = [name for name in PREDICTED if name in channels]
    drive = "speed" if "drive_velocity_command" in channels else "follow"
    if drive == "follow":
        signals = [name for name in signals if name not in ("drive_position", "drive_velocity")]
    candidates = _candidates(recording, plant, values, nominals, signals, request)
    found = {p.name: p for p in (*nominals, *(p for h in candidates.asked for p in h.free))}
    period = sample_period(recording.records)
    models = [
        _model(recording, use, plant, values, list(found.values()), period, signals) for use in ("fit", "heldout")
    ]
    return Question(
        "cable_hole", models[0], models[1], tuple(p.name for p in nominals), (), candidates.asked,
        {name: plant.table[name].unit for name in found},
        lambda fitted, accepted: augmented_rig(plant, {**values, **fitted}, accepted), at_rest=drive == "speed",
        not_asked=candidates.not_asked,
    )  # fmt: skip


def values_of(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Start of all numbers of the plant; the hole's radius, where measured, makes the radius ratio.

    Extrusion is absent where neither a rig nor any of its numbers is stated: a pulley or an edge has none, and what a
    braided cable in a hole has would be 20 times the friction at 6 cm/s.
    """
    values = plant_values(recording, plant, request.rig)
    named = {plant.effects.aliases.get(name, name) for name in {**recording.known, **recording.nominal}}
    if recording.rig is None and not request.rig and not named & set(EXTRUSION):
        values["extrusion_gain"] = 0.0
    radius = recording.value("hole_radius")
    if radius is not None and "radius_ratio" not in {**recording.known, **recording.nominal}:
        values["radius_ratio"] = radius / values["cable_radius"]
    return values


def _candidates(recording, plant, values, nominals, signals, request: Request) -> Candidates:
    soft = {"cable_stiffness": values["cable_stiffness"] >= STIFF}
    found = missing(recording, plant, values, nominals, signals, request, soft, ("drive_position", "load_position"))
    free = [name for name in signals if recording.channels[name].offset_free]
    found = found.less(
        {f"sensor_bias.{name}": "its zero is said to be free, and is that of each record" for name in free}
    )
    if "friction_coefficient" in {p.name for p in nominals}:
        found = leave_out(found, AS_FRICTION, "it looks the same as the refitted friction_coefficient")
    return claimed(found, values)


def _model(
    recording: Recording, use: str, plant: Plant, values: dict[str, float], parameters: Sequence[Free], period: float,
    signals: Sequence[str],
) -> ReplayModel:  # fmt: skip
    runs = [_run(recording, record, plant, values, period, signals) for record in recording.used_for(use)]
    own = [{**values, **run.given} for run in runs] or [values]
    turn = period * float(np.sqrt(max(v["cable_stiffness"] / v["load_mass"] for v in own)))
    substeps = int(np.clip(np.ceil(turn / 0.07), *SUBSTEPS))
    substeps = HELD_STEPS if recording.holds("drive_velocity_command") else substeps
    drive = "speed" if "drive_velocity_command" in recording.channels else "follow"
    return ReplayModel(plant, runs, values, parameters, period, drive=drive, substeps=substeps, shifted=1e-5)


def _run(
    recording: Recording, record: Record, plant: Plant, values, period: float, signals: Sequence[str]
) -> Run:  # fmt: skip
    names = [name for name in recording.channels if name != "time"]
    time, seen = resample(record, period, names)
    place = next((n for n in ("load_position", "drive_position") if n in seen), None)
    drive = None
    stretch = max((float(np.ptp(seen[n].values[seen[n].good])) for n in TENSIONS if n in seen), default=0.0)
    stretch /= values["cable_stiffness"]  # friction has then gone through all that it may have held
    early = at_first(time, seen[place].values if place else np.cumsum(seen["drive_velocity_command"].values), stretch)
    hold = "step" if recording.holds("drive_velocity_command") else "ramp"
    if hold == "step":
        command, rate = held_command(record, "drive_velocity_command", time, period, 0.0), None
    elif "drive_velocity_command" in seen:
        stamps, told = command_rows(record, "drive_velocity_command", period)
        command = CubicSpline(stamps, told)(np.minimum(time, stamps[-1]))
        # straight lines between samples h apart integrate to h^2 / 12 c' too much
        command[1:-1] -= np.diff(command, 2) / 12.0
        rate = None
    else:
        drive = recorded_drive(recording, "drive_position", seen["drive_position"].values)
        command, rate = drive.smoothed(period)
        early = early | drive.sudden()
    own = {}
    if "wrap_angle" in seen:
        own["wrap_angle"] = float(np.mean(seen["wrap_angle"].values[seen["wrap_angle"].good]))
    own |= given(record, plant)
    values = {**values, **own}
    weight = values["load_mass"] * values["gravity"] * values["load_gravity"]
    settling = time - time[0] <= SETTLING
    free = tuple(name for name in signals if recording.channels[name].offset_free)
    held_at = "drive_position" if rate is not None and "load_position" in free else ""
    if held_at:
        start = float(command[0]) - weight / values["cable_stiffness"]
    elif "load_position" in seen:
        start = float(np.mean(seen["load_position"].values[settling]))
    elif "drive_position" in seen:
        start = float(np.mean(seen["drive_position"].values[settling])) - weight / values["cable_stiffness"]
    else:
        start = 0.0
    along = _coordinates(time, seen, period)
    sensors = SENSORS if rate is None else dict.fromkeys(signals, "")  # a followed drive's noise is in all of them
    blocks = blocks_of(recording, record, time, seen, signals, early, along, sensors)
    return Run(
        command, rate, start, tuple(signals), blocks, own, offset=free, hold=hold, mean=record.over > 0.0,
        held_at=held_at, recorded=drive,
    )  # fmt: skip


def _coordinates(time: np.ndarray, seen, period: float) -> tuple[Coordinate, ...]:
    """Of the load's motion, or else the drive's; and of the tension."""
    place = next((n for n in ("load_position", "drive_position") if n in seen), None)
    if place:
        found = motion_coordinates(time, seen[place].values, "m", place)
    else:
        path = np.cumsum(seen["drive_velocity_command"].values) * period
        found = motion_coordinates(time, path, "m")
    pull = next((n for n in TENSIONS if n in seen), None)
    if pull is None:
        return found
    return (*found, Coordinate("tension", "N", smoothed(seen[pull].values, period)[0], pull))


def off_balance(recording: Recording, record: Record) -> Iterator[Suspect]:
    """Where a tension is far from the load's weight: a wrong unit."""
    weight = float(np.prod([value_of(recording, n, record) for n in ("load_mass", "gravity", "load_gravity")]))
    for channel in TENSIONS:
        if channel in recording.channels and weight > 0.0:
            ratio = float(np.median(np.abs(series_of(record, channel)))) / weight
            if not 1.0 / OFF <= ratio <= OFF:
                text = (
                    f"{ratio:.3g} times the load's weight of {weight:.3g} N: the unit of {channel} or of load_mass "
                    f"is wrong; {hint(recording, channel, ratio)}"
                )
                yield Suspect(channel, text)
