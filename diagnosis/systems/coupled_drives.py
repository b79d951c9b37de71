"""Two motors that turn a sprung pulley through a belt, seen only by a speed sensor of unknown scale, as a `Model`.

    carriage (motors and belt)  m v' = force_per_volt u + k (x_p - x) + c (v_p - v) - viscous v - dry friction
    pulley                      m_p v_p' = -k (x_p - x) - c (v_p - v)
    reading                     z(t) = sense(speed_scale v_p(t - delay)) + zero

That is the linear drive's kernel used from its other end: the voltage acts as the disturbance on the carriage, which
has all the kernel's friction, and the kernel's motor, that nothing drives, is the pulley. The whole record is simulated
from rest with the voltage alone (a free run); what is held out lies at its end, and its readings are never used.

Neither a force nor a speed is measured: the carriage is taken as 10 kg and the reading as 10 V for 1 m/s, which fixes
two scales that nothing here can show. Nonlinear least squares of a free run has many minima (a rectified vibration
shows twice its frequency), so the nominal model and every hypothesis are refitted from the same few dynamics first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from cable_envs.effects import EFFECTS
from cable_envs.effects.sensor_delay import delayed
from cable_envs.plants.drive.plant import PLANT
from cable_envs.sim.replay import replay
from diagnosis.data.recording import Record, Recording
from diagnosis.fit.refit import Fit, Start, refit
from diagnosis.model.hypotheses import Hypothesis, hypotheses_for
from diagnosis.model.model import Block, Coordinate, Free, Whitener, residuals
from diagnosis.model.noise import Noise
from diagnosis.systems.common import augmented_rig, plant_values, resample, sample_period
from diagnosis.systems.question import Question, Request

SCALE = {"mass": 10.0, "speed_scale": 10.0}
SUBSTEPS = 10
"""2 ms at 50 Hz, against a pulley that swings at 4 Hz."""
RECTIFIED, POWER, DELAY, ZERO = (
    "sensor_rectification.speed_reading", "detector_power.speed_reading", "sensor_delay.speed_reading", "reading_zero",
)  # fmt: skip
SENSE = (
    Free(RECTIFIED, 0.0, 0.0, 3.0, 1.0),
    Free(POWER, 1.0, 0.5, 4.0, 1.0),
    Free(DELAY, 0.0, 0.0, 0.5, 0.03),
    Free(ZERO, 0.0, -10.0, 10.0, 0.1),
)
"""Share of negative values that is lost, 2 turns them round; the reading goes with this power of the speed; s; V.

A detector made of diodes is square for small signals and straight for large ones; the power stands for its law between.
"""
DYNAMICS = ("motor_mass", "belt_stiffness", "belt_damping", "viscous", "force_per_volt")
_BOUNDS = {
    "motor_mass": (1e-3, 1e3), "belt_stiffness": (1.0, 1e6), "belt_damping": (0.0, 1e4), "viscous": (0.0, 1e4),
    "force_per_volt": (1e-3, 1e4),
}  # fmt: skip
_GRID = {"frequency": (12.0, 17.0, 24.0), "time": (0.1, 0.25, 0.6), "ratio": (0.05,), "damping": (0.15,)}
"""Starts: rad/s of the pulley on the belt, s of the carriage, pulley over carriage, damping ratio of the pulley."""
_MOTION = ("mass", "motor_mass")
_FAR = 1e4
"""V that stand for a simulation that ran away."""
_TRIED = 2
"""Starts of each hypothesis, the best of all, that are refitted before it is scored."""


class CoupledDrives:
    """See `model.Model`; ``series``: voltage of each whole record with how many samples come before it."""

    def __init__(
        self, values: Mapping[str, float], parameters: Sequence[Free], period: float,
        series: Sequence[tuple[np.ndarray, int]], blocks: Sequence[Block],
    ):  # fmt: skip
        self.parameters, self.period, self.blocks = tuple(parameters), period, list(blocks)
        self._series, self._base = list(series), PLANT.table.pack(values)
        names = [p.name for p in self.parameters]
        self._rows = [(PLANT.table.index(n), k) for k, n in enumerate(names) if n in PLANT.table]
        self._sense = {p.name: names.index(p.name) if p.name in names else None for p in SENSE}

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Readings [T, n] of every record for parameter columns [len(parameters), n]."""
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        for row, k in self._rows:
            columns[row] = values[k]
        per_volt = columns[PLANT.table.index("force_per_volt")]
        lag = columns[PLANT.table.index("actuator_lag.time")].copy()
        columns[PLANT.table.index("actuator_lag.time")] = 0.0  # the kernel's is before its motor, which is idle here
        return [self._read(values, columns, per_volt, lag, *series) for series in self._series]

    def _read(self, values, columns, per_volt, lag, voltage, skip) -> np.ndarray:
        force = _lagged(voltage, lag, self.period) * per_volt
        idle = np.zeros(len(voltage))
        speed = replay(
            PLANT, columns, idle, self.period, drive="force", signals=["motor_velocity"], disturbance=force,
            substeps=SUBSTEPS, sensors=False,
        )[:, 0]  # fmt: skip
        # a sample is taken when its voltage is set: it shows what the voltages before it have done
        speed = np.concatenate([np.zeros((1, speed.shape[1])), speed[:-1]])
        get = {p.name: p.start if (k := self._sense[p.name]) is None else values[k] for p in SENSE}
        late = _late(speed * SCALE["speed_scale"], get[DELAY] / self.period)
        shown = late - get[RECTIFIED] * np.minimum(late, 0.0)
        power = np.broadcast_to(get[POWER], shown.shape[1:])
        if np.any(power != 1.0):
            shown = np.where(power == 1.0, shown, np.sign(shown) * (np.abs(shown) + 1e-12) ** power)
        return np.clip(np.nan_to_num(shown + get[ZERO], nan=_FAR), -_FAR, _FAR)[skip:]


def _lagged(voltage: np.ndarray, lag: np.ndarray, period: float) -> np.ndarray:
    """Voltage [T, n] behind a first-order lag, s [n], at the middle of each sample."""
    out = np.repeat(voltage[:, None], len(lag), axis=1)
    left = np.where(lag > 0.0, np.exp(-period / np.where(lag > 0.0, lag, 1.0)), 0.0)
    state = np.zeros(len(lag))
    for t, u in enumerate(voltage):
        after = u + (state - u) * left
        out[t] = np.where(lag > 0.0, 0.5 * (state + after), u)
        state = after
    return out


def _late(series: np.ndarray, steps: Any) -> np.ndarray:
    """Series [T, n] late by ``steps`` ([n] or a number), straight lines between samples."""
    if not np.any(steps):
        return series
    return delayed(series, np.broadcast_to(steps, series.shape[1:]))


def prepare(recording: Recording, request: Request) -> Question:
    """What a recording with ``voltage`` and ``speed_reading`` asks. Raises ConfigurationError where one is missing."""
    recording.require("voltage", "speed_reading", purpose="the model of coupled drives")
    period = sample_period(recording.records)
    values = {**plant_values(recording, PLANT, request.rig), "mass": SCALE["mass"], "force_limit": 1e6}
    values |= {"coulomb": 0.0, "viscous": 50.0, "motor_mass": 0.5}
    nominal = [Free(n, values[n], *_BOUNDS[n], max(values[n], 1e-2)) for n in DYNAMICS]
    found = _hypotheses(values, request)
    freed = {p.name: p for h in found for p in h.free}
    parameters = [*nominal, SENSE[-1], *freed.values()]
    models = {}
    for use in ("fit", "heldout"):
        parts = [_series(recording, record, period) for record in recording.used_for(use)]
        models[use] = CoupledDrives(values, parameters, period, [p[0] for p in parts], [p[1] for p in parts])
    nominals = (*DYNAMICS, ZERO)
    start, found = _searched(models["fit"], nominals, found)
    for model in models.values():
        model.parameters = tuple(_moved(p, start) for p in model.parameters)
    units = {p.name: p.unit for p in PLANT.table} | {RECTIFIED: "1", POWER: "1", DELAY: "s", ZERO: "V"}
    return Question(
        "linear_drive", models["fit"], models["heldout"], nominals, (ZERO,), tuple(found), units,
        lambda found, accepted: _rig({**values, **found}, accepted),
        (
            "neither force nor speed is measured: the carriage counts as 10 kg and 10 V as 1 m/s; only ratios mean "
            "something",
        ),
    )  # fmt: skip


def _rig(values: Mapping[str, float], accepted: Sequence[str]) -> dict[str, Any]:
    """The rig; what its plant has not, the sensor of the speed, is named in it."""
    sense = {p.name: values.get(p.name, p.start) for p in SENSE}
    held = ", ".join(f"{name} {value:.9g}" for name, value in sense.items())
    rig = augmented_rig(PLANT, values, accepted)
    return rig | {"description": f"not of the rig, but of the speed's sensor (10 V for 1 m/s): {held}"}


def _series(recording: Recording, record: Record, period: float) -> tuple[tuple[np.ndarray, int], Block]:
    """((voltage from rest on, samples before the record), its block).

    A record that goes on from another is run from the other's start.
    """
    time, found = resample(record, period, ("voltage", "speed_reading"))
    voltage, reading = found["voltage"], found["speed_reading"]
    before = [
        other
        for other in recording.records
        if other is not record and abs(time[0] - other.time[-1] - period) < 0.5 * period
        and record.name.startswith(other.name.rsplit(".", 1)[0])
    ]  # fmt: skip
    past = resample(before[0], period, ("voltage",))[1]["voltage"].values if before else np.empty(0)
    good = voltage.good & reading.good
    along = (
        Coordinate("voltage", "V", voltage.values),
        Coordinate("reading", "V", reading.values, "speed_reading"),
        Coordinate("time since the voltage stepped", "s", _since_step(voltage.values, period)),
    )
    block = Block(record.name, "speed_reading", time, reading.values, good, "V", along, memory=0)
    return (np.concatenate([past, voltage.values]), len(past)), block


def _since_step(voltage: np.ndarray, period: float) -> np.ndarray:
    """s since the voltage last changed [T]."""
    last = np.where(np.r_[True, np.diff(voltage) != 0.0], np.arange(len(voltage)), 0)
    return period * (np.arange(len(voltage)) - np.maximum.accumulate(last))


def _starts(model: CoupledDrives) -> list[dict[str, float]]:
    """Dynamics from which refits start, each with the gain that gives a rectified reading of the measured size."""
    found = []
    for frequency, time, ratio, damping in product(*_GRID.values()):
        pulley = ratio * SCALE["mass"]
        found.append({
            "motor_mass": pulley, "belt_stiffness": pulley * frequency**2,
            "belt_damping": 2.0 * damping * pulley * frequency, "viscous": SCALE["mass"] / time, "force_per_volt": 10.0,
        })  # fmt: skip
    columns = np.array([[s.get(p.name, p.start) for s in found] for p in model.parameters])
    shown = np.concatenate(model.predict(columns))
    wanted = float(np.sqrt(np.mean(np.concatenate([b.measured for b in model.blocks]) ** 2)))
    for start, size in zip(found, np.sqrt(np.mean(shown**2, axis=0)), strict=True):
        start["force_per_volt"] *= wanted / max(float(size), 1e-9)
    return found


def _moved(free: Free, start: Mapping[str, float]) -> Free:
    value = start.get(free.name, free.start)
    return Free(free.name, value, free.low, free.high, max(abs(value), free.scale), free.std)


def _hypotheses(values: Mapping[str, float], request: Request) -> list[Hypothesis]:
    """The kernel's effects, that all act on the carriage here, and the sensor's."""
    modelled = ("belt_stiffness", "viscous", *_MOTION)
    sensor = [h for h in _sensor() if _wanted(h.name, request)]
    kernel = set(PLANT.effects.effects)
    only = None if request.only is None else [n for n in request.only if n in kernel]
    plant = hypotheses_for(PLANT, values, modelled, (), only=only, without=[n for n in request.without if n in kernel])
    return [*plant, *sensor]


def _wanted(name: str, request: Request) -> bool:
    names = (name, name.split(".")[0])
    return not any(n in request.without for n in names) and (
        request.only is None or any(n in request.only for n in names)
    )


def _sensor() -> list[Hypothesis]:
    """Faults of the speed sensor."""
    rectified, delay = EFFECTS["sensor_rectification"], EFFECTS["sensor_delay"]
    share, power, late, _ = SENSE
    return [
        Hypothesis(
            RECTIFIED, (share, power), tuple(({RECTIFIED: v, POWER: p},) for v in (1.0, 2.0) for p in (1.0, 2.0)),
            f"{rectified.equation}; then sign(y) |y|^power", rectified.experiment, rectified.confusable,
            {RECTIFIED: 0.0},
        ),
        Hypothesis(
            POWER, (power,), tuple(({POWER: v},) for v in (1.5, 2.0)), "y = sign(x) |x|^power",
            "six constant speeds: the reading over the speed is no straight line", ("stribeck_friction",), {POWER: 1.0},
        ),
        Hypothesis(
            DELAY, (late,), tuple(({DELAY: v},) for v in (0.01, 0.03)), delay.equation, delay.experiment,
            delay.confusable, {DELAY: 0.0},
        ),
    ]  # fmt: skip


def _searched(
    model: CoupledDrives, nominals: Sequence[str], hypotheses: Sequence[Hypothesis]
) -> tuple[dict[str, float], list[Hypothesis]]:
    """(best start without any hypothesis, hypotheses with the best of their refits as a further probe)."""
    size = float(np.std(np.concatenate([b.measured for b in model.blocks])))
    white = Whitener({"speed_reading": Noise(np.empty(0), size)})
    dynamics, wanted = _starts(model), []
    asked: list[tuple[str, tuple[str, ...], list[Mapping[str, float]]]] = [("", (), [{}])]
    asked += [(h.name, h.names, [p[0] for p in h.probes]) for h in hypotheses]
    for name, names, probes in asked:
        tried = [{**start, **probe} for start in dynamics for probe in probes]
        columns = np.array([[t.get(p.name, p.start) for t in tried] for p in model.parameters])
        cost = np.sum(white.flat(model.blocks, residuals(model.blocks, model.predict(columns))) ** 2, axis=0)
        free = tuple(dict.fromkeys((*nominals, *names)))
        wanted += [Start(name, free, tried[k]) for k in np.argsort(cost)[:_TRIED]]
    fits: dict[str, Fit] = {}
    for fit in refit(model, white, wanted, iterations=15):
        if fit.label not in fits or fit.cost < fits[fit.label].cost:
            fits[fit.label] = fit
    return {n: fits[""].values[n] for n in nominals}, [_probed(h, fits[h.name]) for h in hypotheses]


def _probed(hypothesis: Hypothesis, fit: Fit) -> Hypothesis:
    """With the probes that it has, and the end of a refit."""
    best = {name: fit.values[name] for name in fit.free}
    return replace(hypothesis, probes=(*hypothesis.probes, (best,)))
