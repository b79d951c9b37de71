"""Recordings with angle and torque at both ends of a cable transmission whose geometry is not known, as a model.

Drive angle and drive torque (or current) go in as recorded, output angle and output torque are predicted by the plant
``transmission`` (`cable_envs.plants.transmission`). The circuit is not used here: it needs pulleys, wraps, spans and
pretension, none of which such a bench tells, and it takes the load to find the drive's torque, where this asks for the
opposite.

Signals go through the zero-phase low-pass of O'Neill, Stephens, Kowalewski, RA-L 3 (2018) 3027 (50 Hz), then onto a
clock of 50 Hz; the first and last second do not count.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import butter, filtfilt

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.first_look import FILTER_HZ, since_reversal
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.systems.common import motion_coordinates, plant_values, resample, smooth_speed
from cable_envs.diagnosis.systems.conditions import given, with_given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.transmission_effects import LIMITS, NULLS, candidates, rig_of
from cable_envs.plants.transmission.plant import PLANT
from cable_envs.sim.replay import replay

PERIOD = 0.02
"""s between samples: such a bench moves at a few Hz."""
EDGE = 1.0
"""s at either end of a record that do not count: the filter's ends, and the state at the start is not known."""
SIMULATED_BY = PLANT.name
"""Whose rigs such a recording's corrected rig is one of."""
SIGNALS = {"output_angle": "rad", "output_torque": "N m"}
STILL = 1e-9
"""rad/s that tell the plant the direction of a drive that stands, or whose smoothed speed has not turned round yet."""
_CABLE = ("pretension_top", "pretension_bottom", "tensile_stiffness")
"""What a recording says of a cable that the circuit can run. Two radii alone say the ratio, which the records tell, and
leave 50 numbers of the circuit to be assumed."""


def fits(recording: Recording) -> bool:
    """Whether this is the model for a recording of a circuit: both ends measured, nothing said of what is between."""
    said = {**recording.known, **recording.nominal}
    ends = {"drive_angle", "output_angle", "output_torque"} <= set(recording.channels)
    drive = {"drive_torque", "drive_current"} & set(recording.channels)
    return ends and bool(drive) and recording.rig is None and not set(_CABLE) & set(said)


@dataclass(frozen=True)
class Run:
    """One record on the even clock, each [T] SI: drive angle, torque (or current), speed, direction; what to compare.

    group: key of the records that share the output angle's zero; given: parameters that only this record has, SI.
    """

    x: np.ndarray
    torque: np.ndarray
    speed: np.ndarray
    way: np.ndarray
    group: str
    blocks: tuple[Block, Block]
    given: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate(self) -> np.ndarray:
        """The drive's speed [T] as the plant is told it: nowhere against the direction of the motion."""
        return self.way * np.maximum(self.way * self.speed, STILL)


def driven(run: Run, columns: np.ndarray, period: float, x: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Output angle and torque [T, 2, n] of the plant for columns of its table, driven by x and torque [T] or [T, n]."""
    start = columns[PLANT.table.index("ratio")] * x[0]
    return replay(
        PLANT, columns, x, period, drive="follow", signals=tuple(SIGNALS), rate=run.rate, disturbance=torque,
        start=start, substeps=1,
    )  # fmt: skip


class TransmissionModel:
    """See `model.Model`. ``base``: values of the plant; groups whose zero no fit has seen find it themselves.

    A record of such a group has its zero from the mean of its own angle: an incremental encoder's, a start.
    """

    def __init__(
        self, runs: Sequence[Run], parameters: Sequence[Free], base: Mapping[str, float], period: float,
        seen: Sequence[str],
    ):  # fmt: skip
        self.runs, self.parameters, self.period = tuple(runs), tuple(parameters), period
        self.blocks = [block for run in runs for block in run.blocks]
        self.base, self._seen = dict(base), tuple(seen)
        self._names = [p.name for p in parameters]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Predictions [T, n] of every block for parameter columns [len(parameters), n]."""
        columns = np.repeat(PLANT.table.pack(self.base)[:, None], values.shape[1], axis=1)
        for k, name in enumerate(self._names):
            if name in PLANT.table:
                columns[PLANT.table.index(name)] = values[k]
        found = []
        for run in self.runs:
            out = driven(run, with_given(PLANT, columns, run.given), self.period, run.x, run.torque)
            angle, wrench = out[:, 0], out[:, 1]
            if run.group in self._seen:
                angle = angle + values[self._names.index(zero_of(run.group))]
            else:
                good, measured = run.blocks[0].good, run.blocks[0].measured
                off = (measured[good, None] - angle[good]).mean(axis=0) if good.any() else 0.0
                angle = angle + off
            found += [angle, wrench]
        return found


def zero_of(group: str) -> str:
    """Name of the parameter that is the output angle's zero of a group of records, rad."""
    return f"zero.{group}"


def prepare(recording: Recording, request: Request) -> Question:
    """What such a recording asks. Raises ConfigurationError where a channel is missing."""
    source = "drive_torque" if "drive_torque" in recording.channels else "drive_current"
    fit, heldout = models(recording, source, request.rig)
    missing = candidates(request, fit.base)
    nominals = nominals_of(fit.parameters)
    units = {p.name: "rad" if p.name.startswith("zero.") else LIMITS[p.name].unit for p in fit.parameters}
    notes: tuple[str, ...] = (f"low-pass {FILTER_HZ:g} Hz, zero phase; samples every {1e3 * fit.period:g} ms",)
    zeros = [n for n in nominals if n.startswith("zero.")]
    if len(zeros) > 1:
        notes += (f"the rig does not hold the output angle's zero: each of {len(zeros)} groups of records has its own",)
    return Question(
        "pulley_circuit", fit, heldout, nominals, tuple(n for n in nominals if n != "ratio"), missing.asked, units,
        lambda found, accepted: rig_of({**fit.base, **found}, accepted), notes,
        not_asked=missing.not_asked,
    )  # fmt: skip


def nominals_of(parameters: Sequence[Free]) -> tuple[str, ...]:
    """What the rigid, frictionless transmission has: ratio, angles' zeros, the torque's zero and motor's constant."""
    own = ("ratio", "torque_zero", "torque_constant")
    return tuple(p.name for p in parameters if p.name in own or p.name.startswith("zero."))


def models(
    recording: Recording, source: str = "drive_torque", rig: Mapping[str, float] | None = None
) -> tuple[TransmissionModel, TransmissionModel]:
    """Models of the records to fit and of those held out.

    source: channel that says what the drive does; rig: values of a rig of the plant that the models are to have.
    """
    recording.require("drive_angle", source, *SIGNALS, purpose="the diagnosis of a transmission")
    groups = {m: key for key, members in recording.offset_groups("output_angle").items() for m in members}
    runs = {use: [run_of(r, source, groups.get(r.name, "all")) for r in recording.used_for(use)] for use in _USES}
    own = sample_period(recording.records)
    period = own * max(1, round(PERIOD / own))
    return assemble(runs["fit"], runs["heldout"], period, source, rig and plant_values(recording, PLANT, rig))


_USES = ("fit", "heldout")


def assemble(
    fit: Sequence[Run], heldout: Sequence[Run], period: float, source: str = "drive_torque",
    taken: Mapping[str, float] | None = None,
) -> tuple[TransmissionModel, TransmissionModel]:  # fmt: skip
    """Both models of runs that are there already.

    They start from straight lines through the runs to fit, or from the values ``taken`` (of the plant's whole table).
    """
    seen = tuple(dict.fromkeys(run.group for run in fit))
    base, zero = _started(fit, source) if taken is None else _taken(taken)
    known = ("torque_constant",) if source == "drive_torque" else ("sensor_scale.output_torque",)
    parameters = [LIMITS[name].at(base[name], name) for name in LIMITS if name not in known]
    parameters += [Free(zero_of(group), zero, -1e3, 1e3, 0.1) for group in seen]
    return (
        TransmissionModel(fit, parameters, base, period, seen),
        TransmissionModel(heldout, parameters, base, period, seen),
    )


def _started(fit: Sequence[Run], source: str) -> tuple[dict[str, float], float]:
    """(values of the rigid, frictionless transmission, zero of the angle) by straight lines through the runs."""
    x, y, torque, wrench = (np.concatenate(part) for part in zip(*(_joined(run) for run in fit), strict=True))
    ratio, zero = np.polyfit(x, y, 1)
    ratio = float(np.clip(ratio, LIMITS["ratio"].low, LIMITS["ratio"].high))
    constant = 1.0
    if source == "drive_current":  # as long as the output sensor's scale is trusted, it is what makes current a torque
        constant = abs(float(np.polyfit(torque, wrench, 1)[0])) * ratio
    return {**NULLS, "ratio": ratio, "torque_constant": constant}, float(zero)


def _taken(rig: Mapping[str, float]) -> tuple[dict[str, float], float]:
    """(values of a rig, zero of the angle); the bias of the angle's sensor is the zero that every refit moves."""
    base = dict(rig)
    return base, float(base.pop("sensor_bias.output_angle", 0.0))


def _joined(run: Run) -> tuple[np.ndarray, ...]:
    good = run.blocks[0].good & run.blocks[1].good
    return run.x[good], run.blocks[0].measured[good], run.torque[good], run.blocks[1].measured[good]


def run_of(record: Record, source: str, group: str, spacing: float = PERIOD) -> Run:
    """A record, filtered, on an even clock of about ``spacing`` s (a whole number of its own samples)."""
    period = sample_period([record])
    time, seen = resample(record, period, ("drive_angle", source, *SIGNALS))
    values = {name: sampled.values for name, sampled in seen.items()}
    if 0.5 / period > 1.2 * FILTER_HZ:
        b, a = butter(2, FILTER_HZ * 2 * period)
        values = {name: filtfilt(b, a, v) for name, v in values.items()}
    every = max(1, round(spacing / period))
    speed = smooth_speed(values["drive_angle"], period)[::every]
    values, time = {name: v[::every] for name, v in values.items()}, time[::every]
    x = values["drive_angle"]
    inner = (time >= time[0] + EDGE) & (time <= time[-1] - EDGE)
    good = np.logical_and.reduce([inner, *(s.good[::every] for s in seen.values())])
    since, way = since_reversal(x)
    along = (
        *motion_coordinates(time, x, "rad"), Coordinate("travel since reversal", "rad", since),
        Coordinate("output torque", "N m", values["output_torque"], "output_torque"),
    )  # fmt: skip
    angle, wrench = (Block(record.name, n, time, values[n], good, unit, along) for n, unit in SIGNALS.items())
    return Run(x, values[source], speed, way, group, (angle, wrench), given(record, PLANT))
