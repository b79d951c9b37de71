"""Recordings of a one-axis drive as a model on the project's kernel: the drive runs again under its own controller.

Where the recording has a position reference and a controller of the form

    u = kp (reference - x) + kv reference' - kd x' + ki integral of (reference - x)          u: force, N, or voltage

explains the recorded effort, the whole loop is replayed from the reference: position, speed and effort are all
predicted, and what the loop hides in the position shows in the effort. The gains are no physics: every refit moves
them; a controller that needs no integral has none. Otherwise the drive is given the recorded effort and is held to the
recorded position by a soft servo of our own, and the position that it would rather take is what is predicted
("observed").
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.readings import resolution
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import KNOWN, Candidates, Hypothesis, free_of, hypotheses_for
from cable_envs.diagnosis.model.hypotheses import REFITTED as FREE
from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems import starts
from cable_envs.diagnosis.systems.common import (
    augmented_rig,
    free_parameters,
    plant_values,
    smooth_speed,
    travel_of,
)
from cable_envs.diagnosis.systems.conditions import usual
from cable_envs.diagnosis.systems.drive.loop import EXPLAINED, controller
from cable_envs.diagnosis.systems.drive.model import (
    DAMPING_RATIO,
    FINE,
    GAINS,
    HOLD,
    OFFSET,
    READ,
    SOFT,
    DriveModel,
    effort_of,
    recorded,
)
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.starts import UNSURE
from cable_envs.diagnosis.systems.stated.limits import limits_of
from cable_envs.diagnosis.systems.units import Suspect, hint, series_of, speed_of, value_of
from cable_envs.effects import EFFECTS
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects

DRIVEN_BY = ("position_reference",)
"""Channel that drives the simulator alone; without it the effort does, and the position beside it."""
REFITTED = ("mass",)
"""Refitted unless known."""
LONGEST_HOLD = 7e-4
"""Drives are controlled at 1 kHz or faster, and compute a while; what is later than this is a lag."""
IN_STEP = 0.2, 0.15
"""Samples by which a held effort is read late, and their standard deviation: none of a log in step with its controller,
none to a half of any other."""
DAMPING = "belt_damping"
_DAMPED = 0.2
"""Damping ratio at which a belt is looked for."""
_NO_HYPOTHESIS = ("sensor_bias.position", "sensor_bias.motor_position")
"""A position's zero says nothing."""
_OF_BELT = ("backlash", "stiffness_hardening", "viscoelastic_creep", "slow_creep")
"""What only a drive with a belt can have."""
_OF_LOOP = ("sensor_delay.force", "sensor_rectification.force", "sensor_scale.position")
"""What is asked only where the control loop is replayed."""
_GEARED = 2
"""Steps in each fine one where a drive without a belt may have one, or a gap."""
_TURN = 0.2
"""rad by which the vibration of a gear or a belt that closes a gap turns in a step of integration: what is stiffer
cannot be told from it."""
_SLOW = 4.0
"""1/s: what a record starts with and dies out more slowly is in a good part of it."""


def prepare(recording: Recording, request: Request) -> Question:
    """What a drive's recording asks. Raises ConfigurationError where position, an effort or the mass is missing.

    A force that a model lacks and a wrong mass look alike: a mass that the records tell has a prior.
    """
    plant = with_own_effects(plant_for("linear_drive"), request.own)
    values = values_of(recording, plant, request)
    # an augmented rig has the constant force as a tilt of its axis
    values[OFFSET] = 0.0 if request.rig else recording.value(OFFSET) or 0.0
    period = sample_period(recording.records)
    told = _told_by(recording, plant, values, period)
    values |= (begun := {} if _said(recording, plant, request) else told)
    nominals = [f for f in free_parameters(recording, plant, values, REFITTED, request) if _acts(f.name, recording)]
    # a refit may not do away with a belt that is there: other effects need it
    nominals = [replace(f, low=1e3) if f.name == "belt_stiffness" and f.start > 1e3 else f for f in nominals]
    if OFFSET in recording.nominal:
        std = None if request.rig else recording.nominal[OFFSET].std
        nominals.append(Free(OFFSET, values[OFFSET], -1e4, 1e4, max(abs(values[OFFSET]), 0.1), std))
    gains, explained = controller(recording, period) if "position_reference" in recording.channels else ({}, np.inf)
    closed = explained < EXPLAINED and gains["control.kp"] > 0.0
    if not closed and not begun and not _said(recording, plant, request):
        raise ConfigurationError(
            f"{recording.path}: no controller explains the effort, and the mass of the drive is neither stated nor "
            "told by the records: a mass that may be anything hides every force. State it, e.g. nominal: {mass: "
            "{value: 2.5, std: 0.5, unit: kg}}"
        )
    unsure = [f for f in nominals if begun and f.name in REFITTED]
    nominals = [replace(f, std=UNSURE * f.start) if f in unsure else f for f in nominals]
    control = [Free(n, g, 0.0, 1e3 * abs(g) + 1.0, max(abs(g), 1e-6)) for n, g in gains.items() if g or n != GAINS[3]]
    control = control if closed else []
    if closed:  # a controller is no slower than its log: what is read is on average half a sample old, at most
        control.append(Free(HOLD, 0.5 * LONGEST_HOLD, 1e-6, LONGEST_HOLD, LONGEST_HOLD))
        control.append(Free(READ, IN_STEP[0] * period, 0.0, 0.5 * period, 0.5 * period, IN_STEP[1] * period))
    elif effort_of(recording) == "force":  # a command, held after it was read; a voltage is what acts
        control.append(Free(HOLD, 0.5 * LONGEST_HOLD, 1e-6, 0.5 * period, 0.5 * period, IN_STEP[1] * period))
    candidates = _candidates(plant, recording, values, nominals, request, closed, period)
    free = {f.name: f for f in (*nominals, *control)} | {f.name: f for h in candidates.asked for f in h.free}
    steps = _substeps(values, period, {h.name for h in candidates.asked})
    made = {
        use: DriveModel(plant, recording, use, values, tuple(free.values()), period, closed, steps, told)
        for use in ("fit", "heldout")
    }
    limits = limits_of(recording, request)
    how = "no controller was found to replay, so the carriage is held to its recorded position by a soft servo"
    if closed:
        how = f"the control loop is replayed; its effort differs by {explained:.2f} times what noise alone would make"
    notes = [how]
    notes += [
        f"{f.name}: nobody states it, and it is held within about {UNSURE:.0%} of {f.start:.4g} kg, which the balance "
        "of force tells"
        for f in unsure
    ]
    if not closed and (rate := _forgets({**values, **told})) < _SLOW:
        early = 3.0 / max(rate, 1e-3)
        notes.append(
            f"what the belt starts with dies out with {rate:.2g} 1/s only where the carriage is held to its recorded "
            f"position: the first {early:.2g} s of each record depend on how it started"
        )
    return Question(
        "linear_drive", made["fit"], made["heldout"], tuple(f.name for f in (*nominals, *control)),
        (*GAINS, HOLD, READ, OFFSET), candidates.asked, {f.name: _unit(plant, f.name) for f in free.values()},
        lambda found, accepted: _rig(plant, {**values, **found, **limits}, accepted), tuple(notes), at_rest=closed,
        not_asked=candidates.not_asked,
    )  # fmt: skip


def asks(recording: Recording, plant: Plant, request: Request) -> tuple[str, ...]:
    """What a drive without a controller to replay must state and does not; a recorded force tells its mass."""
    return () if "force" in recording.channels or _said(recording, plant, request) else ("mass",)


def _said(recording: Recording, plant: Plant, request: Request) -> bool:
    """Whether somebody says what mass is moved."""
    said = {**recording.known, **recording.nominal, **(request.rig or {}), **usual(recording, plant)}
    return recording.rig is not None or "mass" in said


def _told_by(recording: Recording, plant: Plant, values: Mapping[str, float], period: float) -> dict[str, float]:
    """The mass, as the records to fit tell it; empty where they do not."""
    series = [recorded(r, period, ["position", effort_of(recording)])[1] for r in recording.used_for("fit")]
    return starts.begin(plant, series, values, period, {*recording.known, *recording.nominal} - {"mass"})


def values_of(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Start of all numbers of the plant; friction and a motor's own inertia are absent where nobody names them."""
    left_out = {"viscous": 0.0, "coulomb": 0.0, "motor_mass": 0.0}
    values = left_out if recording.rig is None and request.rig is None else {}
    stated = usual(recording, plant)
    return {**plant_values(recording, plant, request.rig), **_absent(recording, values, request), **stated}


def _substeps(values: Mapping[str, float], period: float, hypotheses: set[str]) -> int:
    """Steps in each fine one: a quarter of a radian of the belt's vibration where there is or may be one."""
    stiffness = values["belt_stiffness"]
    if stiffness <= 0.0:
        return _GEARED if {"cable_elongation", "backlash"} & hypotheses else 1
    return int(np.clip(np.ceil(period / FINE * np.sqrt(stiffness / _reduced(values)) / 0.4), 1, 4))


def _absent(recording: Recording, values: Mapping[str, float], request: Request) -> dict[str, float]:
    """Friction, and a motor's inertia apart from the mass, are left out of the model where nobody names them."""
    named = {*recording.known, *recording.nominal, *(request.rig or {})}
    return {name: value for name, value in values.items() if name not in named}


def _acts(name: str, recording: Recording) -> bool:
    return name != "force_per_volt" or effort_of(recording) == "voltage"


def _unit(plant: Plant, name: str) -> str:
    own = {
        "control.kp": "N/m",
        "control.kv": "N s/m",
        "control.kd": "N s/m",
        "control.ki": "N/(m s)",
        HOLD: "s",
        READ: "s",
        OFFSET: "N",
    }
    return own[name] if name in own else plant.table[name].unit


def _candidates(plant, recording, values, nominals, request: Request, closed: bool, period: float) -> Candidates:
    modelled = {n: KNOWN for n in recording.known if values.get(n)} | {f.name: FREE for f in nominals}
    signals = [c for c in ("position", "velocity", "force", "motor_position") if c in recording.channels]
    travel = travel_of(recording, "position")
    found = hypotheses_for(plant, values, modelled, signals, only=request.only, without=request.without, travel=travel)
    found = found.less(_why_not(values, closed))
    unsaid = "belt_damping" not in {*recording.known, *recording.nominal, *(request.rig or {})}
    found = found.each(lambda h: _damped(h, values) if unsaid and h.name == "cable_elongation" else h)
    rigid = values["belt_stiffness"] <= 0.0
    if not closed:
        told = max(_told(recording, c) for c in ("position", "motor_position") if c in recording.channels)
        found = found.each(lambda h: replace(h, least=told) if h.name == "backlash" else h)
    return found.each(lambda h: _geared(h, values, period) if rigid and h.name == "backlash" else h)


def _told(recording: Recording, channel: str) -> float:
    """m that one reading of a place tells: a count of its encoder, where readings repeat, or its noise.

    No gap moves anything by more than it is. A smaller one is in an observed drive a belt's stretch, a little off.
    """
    parts = [r.data[channel][r.usable(channel)] for r in recording.used_for("fit")]
    return max(max(resolution(p), jitter(p)) for p in parts)


def _why_not(values: Mapping[str, float], closed: bool) -> dict[str, str]:
    """Why hypotheses of the plant are not asked of a drive of those ``values``, by name."""
    gone = dict.fromkeys(_NO_HYPOTHESIS, "the zero of a position says nothing")
    if values["belt_stiffness"] <= 0.0:
        gone |= dict.fromkeys(_OF_BELT, "the drive has no belt: state its belt_stiffness where there is one")
        if not closed and values["motor_mass"] > 0.0:
            del gone["backlash"]  # of a gear, behind which the motor moves by itself
        elif not closed:
            gone["backlash"] = "in a gap the motor moves by itself, and its inertia apart from the mass is not stated"
    if values["motor_mass"] <= 0.0:
        gone["cable_elongation"] = "a belt has two ends, and the motor's inertia apart from the mass is not stated"
    if not closed:
        gone |= dict.fromkeys(
            _OF_LOOP, "no controller is replayed: the recorded effort and position drive the simulator"
        )
    return gone


def _reduced(values: Mapping[str, float]) -> float:
    """kg, of motor and carriage against each other."""
    return values["mass"] * values["motor_mass"] / (values["mass"] + values["motor_mass"])


def _geared(gap: Hypothesis, values: Mapping[str, float], period: float) -> Hypothesis:
    """A gap in a drive without a belt: between its edges nothing acts, beyond them a gear, as stiff as can be seen."""
    reduced, step = _reduced(values), period / FINE / _GEARED
    (gear,) = (free_of(p.name, p) for p in EFFECTS["cable_elongation"].parameters if p.name == "belt_stiffness")
    stiff = reduced * (_TURN / step) ** 2
    damping = 2.0 * _DAMPED * float(np.sqrt(stiff * reduced))
    probes = tuple(tuple({**one, "belt_stiffness": stiff, DAMPING: damping} for one in probe) for probe in gap.probes)
    return replace(gap, free=(*gap.free, gear, _belt_damping(values)), probes=probes)


def _belt_damping(values: Mapping[str, float]) -> Free:
    return Free(DAMPING, values[DAMPING], 1.0, 1e6, values[DAMPING])


def _forgets(values: Mapping[str, float]) -> float:
    """1/s with which an observed drive forgets its start at least: the slowest pole under our own servo."""
    mass, motor = values["mass"], values["motor_mass"]
    total, k, c = mass + motor, values["belt_stiffness"], values[DAMPING]
    stiff, damping = total * SOFT**2, 2.0 * DAMPING_RATIO * total * SOFT + values["viscous"]
    if k <= 0.0 or motor <= 0.0:
        return -float(np.max(np.roots([total, damping, stiff]).real))
    system = np.array([
        [0.0, 1.0, 0.0, 0.0], [-(stiff + k) / mass, -(damping + c) / mass, k / mass, c / mass],
        [0.0, 0.0, 0.0, 1.0], [k / motor, c / motor, -k / motor, -c / motor],
    ])  # fmt: skip
    return -float(np.max(np.linalg.eigvals(system).real))


def _damped(belt: Hypothesis, values: Mapping[str, float]) -> Hypothesis:
    """A belt with its damping: with the carriage's position fed back, one that has too little is not stable."""
    reduced = _reduced(values)
    probes = [
        tuple({**one, DAMPING: 2.0 * _DAMPED * float(np.sqrt(one["belt_stiffness"] * reduced))} for one in probe)
        for probe in belt.probes
    ]
    return replace(belt, free=(*belt.free, _belt_damping(values)), probes=tuple(probes))


def _rig(plant: Plant, values: Mapping[str, float], accepted: Sequence[str]) -> dict:
    """The rig; a constant force stands as a tilt of the axis."""
    values = dict(values)
    weight = values["mass"] * values["gravity"]
    said = {}
    if values.get(OFFSET):
        share = values["gravity_share"] + values[OFFSET] / weight
        values["gravity_share"] = min(max(share, -1.0), 1.0)
        if values["gravity_share"] != share:
            left = (share - values["gravity_share"]) * weight
            said = {"description": f"not of the rig: {left:.9g} N of the constant force, more than an axis can tilt"}
    return augmented_rig(plant, values, accepted) | said


def off_balance(recording: Recording, record: Record) -> Iterator[Suspect]:
    """Where the force is far from what mass, acceleration and the claimed friction take: a wrong unit."""
    if not {"position", "force"} <= set(recording.channels):
        return
    if recording.rig is None and "mass" not in {**recording.known, **recording.nominal, **record.conditions}:
        return  # nobody says what mass is moved
    speed = speed_of(record, "position")
    period = float(np.median(np.diff(record.time)))
    mass = value_of(recording, "mass", record) + (recording.value("motor_mass") or 0.0)
    inertia = mass * np.abs(smooth_speed(speed, period))
    friction = (recording.value("coulomb") or 0.0) + (recording.value("viscous") or 0.0) * np.abs(speed)
    tilt = mass * 9.81 * abs(recording.value("gravity_share") or 0.0)
    need = float(np.quantile(inertia + friction + tilt, 0.95))
    have = float(np.quantile(np.abs(series_of(record, "force")), 0.95))
    if need <= 0.0:
        return
    # a force far above the inertia may be friction of which the recording says nothing
    most = 100.0 if float(np.max(friction)) > 0.0 else 3000.0
    ratio = have / need
    if ratio > most or ratio < 1.0 / 30.0:
        text = (
            f"{ratio:.3g} times what mass, acceleration and the claimed friction take: one of the units of force, "
            f"position, time and mass is wrong; {hint(recording, 'force', ratio)}"
        )
        yield Suspect("force", text)
