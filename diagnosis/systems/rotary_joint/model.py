"""Recordings of a rotary joint whose own controller is in the loop: the whole run again from its reference.

Each record is simulated from its first angle on, with the controller's gains as its conditions or the recording state
them, and is never reset; where it was recorded that the torque is off (``release_reference``) the bridge is open. The
angle is predicted. What was recorded of duty and speed is not used: it follows from the angle by the controller's law.
"""

from types import ModuleType

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import hypotheses_for
from cable_envs.diagnosis.systems.common import (
    augmented_rig,
    blocks_of,
    free_parameters,
    held_command,
    motion_coordinates,
    moving_command,
    plant_values,
    resample,
)
from cable_envs.diagnosis.systems.conditions import given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.replayed import ReplayModel, Run
from cable_envs.diagnosis.systems.rotary_joint import observed
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects

RATE = 200.0
"""Hz of the even clock on which records are laid."""
SUBSTEPS = 4
"""1.25 ms, against a pendulum that swings at 1.4 Hz and a servo that answers within 50 ms."""
REFITTED = ("inertia", "coulomb", "viscous", "torque_constant", "resistance", "hanging_angle")
"""What every refit moves unless the recording knows it."""


def prepare(recording: Recording, request: Request) -> Question:
    """What a recording of a joint asks; ConfigurationError where angle, reference or gain is missing."""
    recording.require("position", "position_reference", purpose="the diagnosis of a rotary joint")
    plant = with_own_effects(plant_for("rotary_joint"), request.own)
    if not (_states_gain(recording) or "position_gain" in (request.rig or {})):
        raise ConfigurationError(
            f"{recording.path}: no position_gain (1/rad, duty for a radian): state it under known, or as a condition "
            "of every record; or record the motor's torque, current or voltage"
        )
    values = plant_values(recording, plant, request.rig)
    nominals = free_parameters(recording, plant, values, REFITTED, request)
    modelled = dict.fromkeys(recording.known, "said to be known") | {f.name: "refitted" for f in nominals}
    candidates = hypotheses_for(plant, values, modelled, ("position",), only=request.only, without=request.without)
    candidates = candidates.less({"sensor_bias.position": "it looks the same as the refitted hanging_angle"})
    found = {f.name: f for f in (*nominals, *(f for h in candidates.asked for f in h.free))}
    made = {
        use: ReplayModel(
            plant, [_run(recording, r, plant) for r in recording.used_for(use)], values, list(found.values()),
            1.0 / RATE, drive="position", substeps=SUBSTEPS,
        )
        for use in ("fit", "heldout")
    }  # fmt: skip
    return Question(
        "rotary_joint", made["fit"], made["heldout"], tuple(f.name for f in nominals), (), candidates.asked,
        {name: plant.table[name].unit for name in found},
        lambda fitted, accepted: augmented_rig(plant, {**values, **fitted}, accepted), not_asked=candidates.not_asked,
    )  # fmt: skip


def instead(recording: Recording) -> ModuleType | None:
    """The model of a joint that is held to its recorded motion, where its effort was recorded and no gain is stated."""
    return observed if observed.effort_of(recording) and not _states_gain(recording) else None


def _states_gain(recording: Recording) -> bool:
    said = {*recording.known, *recording.nominal, *(recording.rig.values if recording.rig else ())}
    stated = ["position_gain" in record.conditions for record in recording.records]
    return "position_gain" in said or (bool(stated) and all(stated))


def _run(recording: Recording, record: Record, plant: Plant) -> Run:
    period = 1.0 / RATE
    time, seen = resample(record, period, ["position"])
    angle = seen["position"].values
    second = None
    if "release_reference" in recording.channels:
        second = held_command(record, "release_reference", time, period, 0.0)
    command = moving_command(record, "position_reference", time, period)
    along = motion_coordinates(time, angle, "rad", "position")
    early = np.zeros(len(time), dtype=bool)
    blocks = blocks_of(recording, record, time, seen, ["position"], early, along, {"position": ""})
    return Run(command, None, float(angle[0]), ("position",), blocks, given(record, plant), second=second)
