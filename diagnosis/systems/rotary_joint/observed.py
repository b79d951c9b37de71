"""Recordings of a rotary joint whose motor's torque, current or voltage was recorded, its controller unknown.

The joint is given the recorded effort and is held to the recorded angle by a soft servo of our own, as a linear drive
is (`cable_envs.diagnosis.systems.drive.model`): a spring and a damper to the recorded motion, which the model of the
joint has to move little where it is right. A torque acts as it is; a current through ``torque_constant``; a voltage
through the winding's resistance, against the back-EMF. Angle and speed are predicted.

Friction that nobody states is absent, and is found. Gravity is not: what a pendulum of unknown weight pulls is
refitted. Inertia and weight that nobody states begin where the balance of torque in the records puts them, and the
inertia is held near it: a torque that a model lacks and a wrong inertia look alike.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import KNOWN, Candidates, hypotheses_for
from cable_envs.diagnosis.model.hypotheses import REFITTED as FREE
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.systems import starts
from cable_envs.diagnosis.systems.common import (
    at_first,
    augmented_rig,
    free_parameters,
    motion_coordinates,
    plant_values,
    recorded_drive,
    travel_of,
)
from cable_envs.diagnosis.systems.conditions import usual
from cable_envs.diagnosis.systems.drive.model import (
    DriveModel,
    Driven,
    Seen,
    recorded,
)
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.starts import UNSURE
from cable_envs.diagnosis.systems.stated.limits import limits_of, stated_in
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects
from cable_envs.sim.together import Asked

EFFORTS = ("torque", "current", "voltage")
"""Channels that drive it; of several the first."""
REFITTED = ("inertia", "load_mass", "hanging_angle")
"""Refitted unless known."""
_UNITS = {"position": "rad", "velocity": "rad/s"}
_OF_SUPPLY = ("dead_band", "quantised_command", "supply_sag", "command_delay", "actuator_lag")
"""What lies between a command and the motor's effort, which was recorded."""
_OF_WINDING = ("winding_heating",)
_SCALES = ("torque_constant", "load_mass", "inertia")
"""A current tells ratios only: one of these must be stated."""


def effort_of(recording: Recording) -> str:
    """Channel of the motor's effort; empty where none was recorded."""
    return next((name for name in EFFORTS if name in recording.channels), "")


def values_of(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Start of all numbers of the plant; friction is absent where nobody names it, and the amplifier has no limits."""
    values = plant_values(recording, plant, request.rig)
    if recording.rig is not None or request.rig:
        return values
    named = {*recording.known, *recording.nominal}
    named |= {plant.effects.aliases.get(name, name) for name in named}
    for name in ("viscous", "coulomb"):
        if name not in named:
            values[name] = 0.0
    return values


def asks(recording: Recording, plant: Plant, request: Request) -> tuple[str, ...]:
    """What must be stated and is not."""
    if effort_of(recording) == "torque" or recording.rig is not None or request.rig:
        return ()
    said = {*recording.known, *recording.nominal}
    if effort_of(recording) == "voltage":
        return tuple(name for name in ("torque_constant", "resistance") if name not in said)
    return () if said & set(_SCALES) else ("torque_constant",)


def prepare(recording: Recording, request: Request) -> Question:
    """What the recording asks; ConfigurationError where what a current or a voltage does is not stated."""
    recording.require("position", purpose="the diagnosis of a rotary joint")
    plant, effort = with_own_effects(plant_for("rotary_joint"), request.own), effort_of(recording)
    if missing := asks(recording, plant, request):
        raise ConfigurationError(
            f"{recording.path}: {' and '.join(missing)} must be stated: what a {effort} does is told by nothing else, "
            "and any size of friction and inertia would go with it. State it, e.g. known: {torque_constant: {value: "
            "1.2, unit: N m/A}}, at the joint: the motor's times the gear's ratio"
        )
    values = values_of(recording, plant, request)
    if effort == "voltage":  # a bridge with duties up to 1 of what was recorded
        most = max(float(np.max(np.abs(r.data["voltage"][r.usable("voltage")]))) for r in recording.records)
        values["supply_voltage"] = max(values["supply_voltage"], 1.01 * most)
    period = sample_period(recording.records)
    started = _started(recording, plant, values, request, period)
    values |= started
    moved = (*REFITTED, "torque_constant") if "torque_constant" in started else REFITTED
    nominals = free_parameters(recording, plant, values, moved, request)
    nominals = [replace(f, std=UNSURE * f.start) if f.name == "inertia" and f.name in started else f for f in nominals]
    candidates = _candidates(plant, recording, values, nominals, request, effort)
    free = {f.name: f for f in nominals} | {f.name: f for h in candidates.asked for f in h.free}
    made = {
        use: JointModel(plant, recording, use, values, tuple(free.values()), period, effort)
        for use in ("fit", "heldout")
    }
    return Question(
        "rotary_joint", made["fit"], made["heldout"], tuple(f.name for f in nominals), (), candidates.asked,
        {name: plant.table[name].unit for name in free},
        lambda found, accepted: augmented_rig(plant, _limited(recording, request, {**values, **found}), accepted),
        (
            f"no controller is replayed: the recorded {effort} drives the joint, which is held softly to its recorded "
            "angle",
        ),
        not_asked=candidates.not_asked,
    )  # fmt: skip


def _started(
    recording: Recording, plant: Plant, values: Mapping[str, float], request: Request, period: float
) -> dict[str, float]:
    """Inertia, weight and torque constant that nobody states, as the records to fit tell them."""
    if recording.rig is not None or request.rig:
        return {}
    effort, said = effort_of(recording), {*recording.known, *recording.nominal, *usual(recording, plant)}
    series = [recorded(r, period, ["position", effort])[1] for r in recording.used_for("fit")]
    return starts.begin(plant, series, values, period, said)


def _limited(recording: Recording, request: Request, values: dict[str, float]) -> dict[str, float]:
    """The rig with the limits that its records show; of a current or voltage the torque that goes with it, too."""
    found, k = limits_of(recording, request), values["torque_constant"]
    if "current_limit" in found:
        found.setdefault("torque_limit", k * found["current_limit"])
    elif "torque_limit" not in found and effort_of(recording) == "voltage":
        found["torque_limit"] = k * values["supply_voltage"] / values["resistance"]
    stated = stated_in(recording, request)
    return {**values, **{name: value for name, value in found.items() if name not in stated}}


def _candidates(
    plant: Plant, recording: Recording, values: Mapping[str, float], nominals: Sequence[Free], request: Request,
    effort: str,
) -> Candidates:  # fmt: skip
    modelled = {n: KNOWN for n in recording.known if values.get(n)} | {f.name: FREE for f in nominals}
    signals = [c for c in (*_UNITS, "current") if c in recording.channels]
    travel = travel_of(recording, "position")
    found = hypotheses_for(plant, values, modelled, signals, only=request.only, without=request.without, travel=travel)
    gone = dict.fromkeys(_OF_SUPPLY, f"the motor's {effort} was recorded: what comes before it is not asked")
    gone["sensor_bias.position"] = "it looks the same as the refitted hanging_angle"
    gone["sensor_scale.position"] = "no controller is replayed: the recorded effort and angle drive the simulator"
    if effort == "torque":
        gone["torque_saturation"] = "the motor's torque was recorded: how its current makes it does not matter"
    if effort != "voltage":
        gone |= dict.fromkeys(_OF_WINDING, f"the motor's {effort} was recorded: its winding does not matter")
    for what in ("scale", "bias", "delay", "rectification"):
        gone[f"sensor_{what}.current"] = "it is not predicted: the recorded effort drives the simulator"
    return found.less(gone)


class JointModel(DriveModel):
    """See `cable_envs.diagnosis.model.model.Model`. ``values``: the rig, SI; ``effort``: the channel that drives it."""

    _signals = ("position", "velocity", "current")
    _moving = ("velocity",)

    def __init__(
        self, plant: Plant, recording: Recording, use: str, values: Mapping[str, float], parameters: Sequence[Free],
        period: float, effort: str,
    ):  # fmt: skip
        self.plant, self.parameters, self.period, self.closed = plant, tuple(parameters), period, False
        self.substeps, self.effort = 1, effort
        table = plant.table
        self._base = np.array([values[p.name] for p in table])
        self._given, self._moves = dict(values), self._moved(values)
        self._inside = [(k, table.index(p.name)) for k, p in enumerate(self.parameters)]
        self.channels = [name for name in _UNITS if name in recording.channels]
        self.blocks: list[Block] = []
        self._runs: list[Driven] = []
        self._place = partial(recorded_drive, recording, "position")
        for record in recording.used_for(use):
            self._add(record)

    def _add(self, record: Record) -> None:
        time, series = recorded(record, self.period, sorted({"position", *self.channels, self.effort}))
        self._runs.append(self._driven(record, time, series))
        along = motion_coordinates(time, series["position"].values, "rad", "position")
        late = ~at_first(time, series["position"].values)
        for channel in self.channels:
            got, good = series[channel], series[channel].good & late
            unsure = self._unsure(record, series, channel, along)
            self.blocks.append(
                Block(
                    record.name,
                    channel,
                    time,
                    got.values,
                    good,
                    _UNITS[channel],
                    along,
                    reading=got.reading,
                    unsure=unsure,
                )
            )

    def _pushed(self, channel: str) -> float:
        """Speed of the joint that an impulse of one unit of effort sets."""
        return self._told() / self._moved(self._given)

    def _gain(self, of: Callable[[str], Any]) -> Any:
        """Torque for one unit of the effort, by what gives a parameter's values."""
        if self.effort == "torque":
            return np.ones_like(of("inertia"))
        return of("torque_constant") / (of("resistance") if self.effort == "voltage" else 1.0)

    def _told(self) -> float:
        return float(self._gain(self._given.__getitem__))

    def _moved(self, values: Mapping[str, float]) -> float:
        """All that turns, kg m^2."""
        return values["inertia"] + values["load_inertia"] + values["load_mass"] * values["arm_length"] ** 2

    def _predicted(self, values: np.ndarray) -> list[np.ndarray]:
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        for k, row in self._inside:
            columns[row] = values[k]
        asked = []
        for run in self._runs:
            own = columns.copy()
            for name, value in run.given.items():
                own[self.plant.table.index(name)] = value
            asked.append(self._joint(own, run))
        return self._together(asked, "duty")

    def _joint(self, columns: np.ndarray, run: Driven) -> tuple[Asked, Seen]:
        """What drives a joint, the recorded effort and our servo, and what its sensors show."""
        stiff, damping = self._servo(self._gain(partial(self._of, columns)))
        neutral = self._of(columns, "position_dependent_load.neutral")
        pushed = stiff * (run.path[:, None] - neutral) + damping * run.rate[:, None]
        command, released = np.zeros(len(run.path)), np.ones(len(run.path))
        if self.effort == "voltage":
            command, released = run.effort[:, None] / self._of(columns, "supply_voltage"), np.zeros(len(run.path))
        elif self.effort == "current":
            pushed = pushed + run.effort[:, None] * self._of(columns, "torque_constant")
        else:
            pushed = pushed + run.effort[:, None]
        state, first = self._begun(columns, run)
        held = columns.copy()
        held[self.plant.table.index("viscous")] += damping
        held[self.plant.table.index("position_dependent_load.stiffness")] += stiff

        def seen(out: np.ndarray) -> dict[str, np.ndarray]:
            y, v, _ = self._sampled(out, first, run)
            return self._seen(columns, {"position": y, "velocity": v}, first[:2])

        return Asked(held, command, disturbance=pushed, second=released, state=state), seen
