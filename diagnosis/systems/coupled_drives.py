"""Two motors that turn a sprung pulley through a belt, seen only by a speed sensor of unknown scale, as a `Model`.

The mechanism is the plant ``coupled_drives`` (`cable_envs.plants.coupled_drives.plant` has its equations), replayed
with the voltage alone. The whole record is simulated from rest (a free run); what is held out lies at its end, and its
readings are never used.

Neither a force nor a speed is measured: unless the recording or a rig says so, the motors' side is taken as 10 kg and
the reading as 10 V for 1 m/s, which fixes two scales that nothing here can show. Nonlinear least squares of a free run
has many minima (a rectified vibration shows twice its frequency), so the nominal model and every hypothesis are
refitted from the same few dynamics first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.hypotheses import REFITTED, Candidates, Hypothesis, hypotheses_for
from cable_envs.diagnosis.model.model import Block, Coordinate, Free, Whitener, residuals
from cable_envs.diagnosis.model.noise import Noise
from cable_envs.diagnosis.systems.common import fitted_rig, held_command, plant_values, resample
from cable_envs.diagnosis.systems.conditions import given, with_given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.plants.base import Plant
from cable_envs.plants.coupled_drives.plant import PLANT
from cable_envs.plants.own_effects import with_own_effects
from cable_envs.sim.replay import replay

SIMULATED_BY = PLANT.name
"""Whose rigs such a recording's corrected rig is one of."""
SUBSTEPS = 10
"""2 ms at 50 Hz, against a pulley that swings at 4 Hz."""
RECTIFIED, POWER, DELAY = "sensor_rectification.share", "detector_power.power", "sensor_delay.speed_reading"
ZERO = "reading_zero"
SENSE = {
    RECTIFIED: (0.0, 3.0, 1.0),
    POWER: (0.5, 4.0, 1.0),
    DELAY: (0.0, 0.5, 0.03),
    ZERO: (-10.0, 10.0, 0.1),
}
"""Range and size of the share of negative values that is lost, of the detector's power, of the delay (s), of the zero
(V)."""
DYNAMICS = ("pulley_mass", "belt_stiffness", "belt_damping", "viscous", "force_per_volt")
_BOUNDS = {
    "pulley_mass": (1e-3, 1e3), "belt_stiffness": (1.0, 1e6), "belt_damping": (0.0, 1e4), "viscous": (0.0, 1e4),
    "force_per_volt": (1e-3, 1e4),
}  # fmt: skip
_GRID = {"frequency": (12.0, 17.0, 24.0), "time": (0.1, 0.25, 0.6), "ratio": (0.05,), "damping": (0.15,)}
"""Starts: rad/s of the pulley on the belt, s of the motors, pulley over motors, damping ratio of the pulley."""
_SCALES = "the motors' side counts as {mass:g} kg and {speed_scale:g} V as 1 m/s; only ratios mean something"
_FAR = 1e4
"""V that stand for a simulation that ran away."""
_TRIED = 2
"""Starts of each hypothesis, the best of all, that are refitted before it is scored."""


class CoupledDrives:
    """See `model.Model`; ``series``: voltage of each whole record with how many samples come before it.

    own: parameters that only this record has, SI, of each record.
    """

    def __init__(
        self, plant: Plant, values: Mapping[str, float], parameters: Sequence[Free], period: float,
        series: Sequence[tuple[np.ndarray, int]], blocks: Sequence[Block],
        own: Sequence[Mapping[str, float]],
    ):  # fmt: skip
        self.parameters, self.period, self.blocks = tuple(parameters), period, list(blocks)
        self._series, self._base, self._own = list(series), plant.table.pack(values), list(own)
        self._plant, self._zero = plant, plant.table.index(ZERO)
        self._rows = [plant.table.index(p.name) for p in self.parameters]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Readings [T, n] of every record for parameter columns [len(parameters), n]."""
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        columns[self._rows] = values
        return [
            self._read(with_given(self._plant, columns, own), *series)
            for series, own in zip(self._series, self._own, strict=True)
        ]

    def _read(self, columns: np.ndarray, voltage: np.ndarray, skip: int) -> np.ndarray:
        # a sample is taken when its voltage is set: it shows what the voltages before it have done
        seen = replay(
            self._plant, columns, voltage, self.period, drive="voltage", hold="step", signals=["speed_reading"],
            rate=np.diff(voltage, prepend=0.0) / self.period, substeps=SUBSTEPS,
        )[:-1, 0]  # fmt: skip
        shown = np.concatenate([columns[None, self._zero], seen])
        return np.clip(np.nan_to_num(shown, nan=_FAR), -_FAR, _FAR)[skip:]


def prepare(recording: Recording, request: Request) -> Question:
    """What a recording with ``voltage`` and ``speed_reading`` asks. Raises ConfigurationError where one is missing."""
    recording.require("voltage", "speed_reading", purpose="the model of coupled drives")
    period = sample_period(recording.records)
    plant = with_own_effects(PLANT, request.own)
    values = plant_values(recording, plant, request.rig)
    nominal = [Free(n, values[n], *_BOUNDS[n], max(values[n], 1e-2)) for n in DYNAMICS]
    candidates = _candidates(plant, values, request)
    found = list(candidates.asked)
    freed = {p.name: p for h in found for p in h.free}
    parameters = [*nominal, _sensed(ZERO, values), *freed.values()]
    models = {}
    for use in ("fit", "heldout"):
        parts = [_series(recording, record, period) for record in recording.used_for(use)]
        own = [given(record, plant) for record in recording.used_for(use)]
        series, blocks = [p[0] for p in parts], [p[1] for p in parts]
        models[use] = CoupledDrives(plant, values, parameters, period, series, blocks, own)
    nominals = (*DYNAMICS, ZERO)
    if not request.rig:  # a rig has been fitted: refits begin there
        start, found = _searched(models["fit"], _starts(models["fit"], values), nominals, found)
        for model in models.values():
            model.parameters = tuple(_moved(p, start) for p in model.parameters)
    return Question(
        "linear_drive", models["fit"], models["heldout"], nominals, (ZERO,), tuple(found),
        {p.name: p.unit for p in plant.table},
        lambda found, accepted: fitted_rig(plant, {**values, **found}) | {"description": _SCALES.format(**values)},
        (f"neither force nor speed is measured: {_SCALES.format(**values)}",),
        not_asked=candidates.not_asked,
    )  # fmt: skip


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
    past = np.empty(0)
    if before:
        past = held_command(before[0], "voltage", resample(before[0], period, ())[0] + period, period, 0.0)
    acts = held_command(record, "voltage", time + period, period, 0.0)  # from each sample on
    good = voltage.good & reading.good
    along = (
        Coordinate("voltage", "V", acts),
        Coordinate("reading", "V", reading.values, "speed_reading"),
        Coordinate("time since the voltage stepped", "s", _since_step(acts, period)),
    )
    block = Block(record.name, "speed_reading", time, reading.values, good, "V", along, memory=0)
    return (np.concatenate([past, acts]), len(past)), block


def _since_step(voltage: np.ndarray, period: float) -> np.ndarray:
    """s since the voltage last changed [T]."""
    last = np.where(np.r_[True, np.diff(voltage) != 0.0], np.arange(len(voltage)), 0)
    return period * (np.arange(len(voltage)) - np.maximum.accumulate(last))


def _starts(model: CoupledDrives, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Dynamics from which refits start, each with the gain that gives a rectified reading of the measured size."""
    found = []
    for frequency, time, ratio, damping in product(*_GRID.values()):
        pulley = ratio * values["mass"]
        found.append({
            "pulley_mass": pulley, "belt_stiffness": pulley * frequency**2,
            "belt_damping": 2.0 * damping * pulley * frequency, "viscous": values["mass"] / time,
            "force_per_volt": 10.0,
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


def _candidates(plant: Plant, values: Mapping[str, float], request: Request) -> Candidates:
    """What the drives of ``values`` may lack, and their sensor; its scale and its bias are nominal parameters."""
    without = {*request.without, *_OF_THE_SENSOR}
    only = None if request.only is None else [n for n in request.only if n not in _OF_THE_SENSOR]
    modelled = {"belt_stiffness": REFITTED, "viscous": REFITTED}
    found = hypotheses_for(plant, values, modelled, (), only=only, without=sorted(without))

    def wanted(effect: str) -> bool:
        return effect not in request.without and (request.only is None or effect in request.only)

    sensor = Candidates(tuple(h for h in _sensor(plant, values) if wanted(h.canonical)))
    sensor = sensor.less({
        h.name: "the model has it" for h in sensor.asked if any(values[n] != null for n, null in h.nulls.items())
    })  # fmt: skip
    nominal = {name: why for name, why in _AS_NOMINAL.items() if wanted(name)}
    return found.and_also(sensor).and_also(Candidates((), nominal))


_AS_NOMINAL = {
    "sensor_bias": f"it looks the same as the refitted {ZERO}",
    "sensor_scale": "it looks the same as the refitted force_per_volt",
}
_OF_THE_SENSOR = ("sensor_rectification", "detector_power", "sensor_delay", "sensor_bias", "sensor_scale")


def _sensed(name: str, values: Mapping[str, float]) -> Free:
    return Free(name, values[name], *SENSE[name])


def _sensor(plant: Plant, values: Mapping[str, float]) -> list[Hypothesis]:
    """Faults of the speed sensor; a detector that rectifies is curved as well."""
    share, power, late = (_sensed(name, values) for name in (RECTIFIED, POWER, DELAY))
    probes = {
        RECTIFIED: ((share, power), [{RECTIFIED: v, POWER: p} for v in (1.0, 2.0) for p in (1.0, 2.0)], 0.0),
        POWER: ((power,), [{POWER: v} for v in (1.5, 2.0)], 1.0),
        DELAY: ((late,), [{DELAY: v} for v in (0.01, 0.03)], 0.0),
    }
    found = []
    for name, (free, sizes, null) in probes.items():
        effect = plant.effects.effects[name.split(".")[0]]
        own = name if effect.each_sensor else effect.name
        found.append(Hypothesis(
            own, free, tuple((one,) for one in sizes), effect.equation, effect.experiment, effect.confusable,
            {name: null}, effect,
        ))  # fmt: skip
    return found


def _searched(
    model: CoupledDrives,
    dynamics: Sequence[Mapping[str, float]],
    nominals: Sequence[str],
    hypotheses: Sequence[Hypothesis],
) -> tuple[dict[str, float], list[Hypothesis]]:
    """(best start without any hypothesis, hypotheses with the best of their refits as a further probe)."""
    size = float(np.std(np.concatenate([b.measured for b in model.blocks])))
    white = Whitener({"speed_reading": Noise(np.empty(0), size)})
    wanted = []
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
