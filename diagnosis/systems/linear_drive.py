"""Recordings of a one-axis drive as a model on the project's kernel: the drive runs again under its own controller.

Where the recording has a position reference and a controller of the form

    u = kp (reference - x) + kv reference' - kd x'          u: force, N, or voltage

explains the recorded effort, the whole loop is replayed from the reference: position, speed and effort are all
predicted, and what the loop hides in the position shows in the effort. The three gains are no physics: every refit
moves them. Otherwise the drive is given the recorded effort and is held to the recorded position by a soft servo of
our own, and the position that it would rather take is what is predicted ("observed").

The loop is `replay(..., drive="observed")`: it feels the carriage, and the amplifier's lag acts on its force. Our
own servo pulls at the carriage, which it feels: then it is stable whatever the belt is (`DriveModel._followed`). The
reference goes between samples as a cubic, since straight lines would change the force by kp x'' dt^2 / 12.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.clock import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import KNOWN, REFITTED, Candidates, Hypothesis, free_of, hypotheses_for
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.common import (
    Sampled,
    at_first,
    augmented_rig,
    free_parameters,
    mean_over_samples,
    motion_coordinates,
    moving_command,
    plant_values,
    resample,
    smooth_speed,
)
from cable_envs.diagnosis.systems.conditions import given, usual, with_given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.diagnosis.systems.replayed import delayed
from cable_envs.diagnosis.systems.units import Suspect, hint, series_of, speed_of, value_of
from cable_envs.effects import EFFECTS
from cable_envs.plants import plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects
from cable_envs.sim.replay import distort, replay

FINE = 10
"""Input steps in each sample, in which the controller's output is held. With 2 (5 ms at 100 Hz) loops of 45 rad/s that
had nothing wrong were answered with a Stribeck curve as wide as the motion (gains of 57 and 74; 2 and 0 with 10)."""
AT_ONCE = 64
"""Columns at a time: the inputs of a fine step are each column's own, 2.5 MB of them for 45 s at 100 Hz, and what is
larger than the processor's cache takes twice as long."""
EXPLAINED = 3.0
"""What a controller may leave of the effort, over what the sensors' noise makes of it, for the loop to be replayed. On
266 drives under such a controller 0.6 to 1.6: of coloured noise, the jitter between samples is the smaller part."""
GAINS = ("control.kp", "control.kv", "control.kd")
HOLD = "control.hold"
"""s: a digital controller holds its output, on average half a period late; that is no physics of the rig."""
LONGEST_HOLD = 7e-4
"""Drives are controlled at 1 kHz or faster, and compute a while; what is later than this is a lag."""
OFFSET = "force_offset"
DAMPING = "belt_damping"
_DAMPED = 0.2
"""Damping ratio at which a belt is looked for."""
_SOFT = 30.0
"""rad/s, the natural frequency of our own servo."""
_NO_HYPOTHESIS = ("sensor_bias.position", "sensor_bias.motor_position")
"""A position's zero says nothing."""
_OF_BELT = ("backlash", "stiffness_hardening", "viscoelastic_creep")
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


@dataclass(frozen=True)
class _Run:
    """One record on the even clock: finely sampled input, and what the drive started from."""

    path: np.ndarray
    """[FINE (T - 1)] m, in the middle of each fine step"""
    rate: np.ndarray
    """the same, m/s"""
    effort: np.ndarray
    """[FINE (T - 1)] of an observed drive; 0 under its own controller"""
    samples: np.ndarray
    """[T] m of the path, at the samples"""
    rates: np.ndarray
    """the same, m/s"""
    start: float
    speed: float
    mean: bool
    """whether samples are means over the period around them"""
    given: Mapping[str, float]
    """parameters that only this record has, SI"""


class DriveModel:
    """See `cable_envs.diagnosis.model.model.Model`. ``values``: the rig, SI, by name of the plant's table."""

    def __init__(
        self, plant: Plant, recording: Recording, use: str, values: Mapping[str, float], parameters: Sequence[Free],
        period: float, closed: bool, substeps: int = 2,
    ):  # fmt: skip
        self.plant, self.parameters, self.period, self.closed = plant, tuple(parameters), period, closed
        self.substeps = substeps
        self.effort = _effort(recording)
        table = plant.table
        self._base = np.array([values[p.name] for p in table])
        self._rows = {p.name: k for k, p in enumerate(self.parameters)}
        self._inside = [(k, table.index(p.name)) for k, p in enumerate(self.parameters) if p.name in table]
        self._given = dict(values)
        wanted = [c for c in ("position", "velocity", self.effort, "motor_position") if c in recording.channels]
        self.channels = wanted if closed else [c for c in wanted if c in ("position", "velocity")]
        self.blocks: list[Block] = []
        self._runs: list[_Run] = []
        for record in recording.used_for(use):
            self._add(record)

    def resolve(self, substeps: int) -> None:
        """Take so many steps of integration in every fine step of the input."""
        self.substeps = substeps

    def _add(self, record: Record) -> None:
        needs = {"position", *self.channels, "position_reference" if self.closed else self.effort}
        time, series = _recorded(record, self.period, sorted(needs))
        effort = None if self.closed else self.effort
        own = given(record, self.plant)
        self._runs.append(_run(time, series, self.period, effort, record.over > 0.0, own))
        along = motion_coordinates(time, series["position"].values, "m", "position")
        late = ~at_first(time, series["position"].values)
        for channel in self.channels:
            got = series[channel]
            self.blocks.append(Block(record.name, channel, time, got.values, got.good & late, _UNIT[channel], along))

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Every channel of every record [T, n] for parameter columns [len(parameters), n]."""
        parts = [self._predicted(values[:, k : k + AT_ONCE]) for k in range(0, values.shape[1], AT_ONCE)]
        return [np.concatenate(series, axis=1) for series in zip(*parts, strict=True)] if len(parts) > 1 else parts[0]

    def _predicted(self, values: np.ndarray) -> list[np.ndarray]:
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        for k, row in self._inside:
            columns[row] = values[k]
        gap = self.plant.table.index("backlash.gap")  # a drive that is rigid altogether has none
        columns[gap] = np.where(self._of(columns, "belt_stiffness") > 0.0, columns[gap], 0.0)
        shown = {name: values[k] for name, k in self._rows.items()}
        shown.setdefault(OFFSET, np.full(values.shape[1], self._given.get(OFFSET, 0.0)))
        found: list[np.ndarray] = []
        for run in self._runs:
            own = with_given(self.plant, columns, run.given)
            signals = self._closed(own, shown, run) if self.closed else self._observed(own, shown, run)
            found += [signals[channel] for channel in self.channels]
        return found

    def _of(self, columns: np.ndarray, name: str) -> np.ndarray:
        return columns[self.plant.table.index(name)]

    def _closed(self, columns: np.ndarray, shown: Mapping[str, np.ndarray], run: _Run) -> dict[str, np.ndarray]:
        per_volt = self._of(columns, "force_per_volt") if self.effort == "voltage" else 1.0
        kp, kv, kd = (shown[name] for name in GAINS)
        scale, late = self._of(columns, "sensor_scale.position"), self._of(columns, "sensor_delay.position")
        # the controller feels scale x(t - late): kp (r - scale (x - late x' + late^2 x'' / 2)) + kv r' - kd x'
        stiff, damping = kp * scale, np.maximum(kd - kp * scale * late, 1e-9)
        columns = columns.copy()
        columns[self.plant.table.index("actuator_lag.time")] += shown[HOLD]
        behind = 0.5 * stiff * late**2  # acts as a mass that is not there
        columns[self.plant.table.index("motor_mass")] += behind * per_volt
        path, rate = run.path[:, None] / scale, run.rate[:, None] * (kv / damping)
        y, v, motor, first = self._replay(
            columns, path, rate, stiff * per_volt, damping * per_volt, run, -shown[OFFSET]
        )
        effort = stiff * (run.samples[:, None] / scale - y) + kv * run.rates[:, None] - damping * v
        if np.any(behind):
            effort = effort - behind * np.gradient(v, self.period, axis=0)
        return self._seen(columns, {"position": y, "velocity": v, self.effort: effort, "motor_position": motor}, first)

    def _observed(self, columns: np.ndarray, shown: Mapping[str, np.ndarray], run: _Run) -> dict[str, np.ndarray]:
        per_volt = self._of(columns, "force_per_volt") if self.effort == "voltage" else 1.0
        scale, bias = self._of(columns, "sensor_scale.force"), self._of(columns, "sensor_bias.force")
        total = self._of(columns, "mass") + self._of(columns, "motor_mass")
        force = (run.effort[:, None] * per_volt - bias) / scale - shown[OFFSET]
        y, v, motor, first = self._followed(columns, total * _SOFT**2, 1.4 * total * _SOFT, run, force)
        return self._seen(columns, {"position": y, "velocity": v, "motor_position": motor}, first)

    def _followed(self, columns, stiff, damping, run: _Run, force):
        """As `_replay`, with the recorded force on the motor, and our servo between carriage and recorded place.

        The servo acts where it feels, as a spring and a damper would, so that whatever the belt is it takes energy out:

            m x'' = b - friction + stiff (path - x) + damping (path' - x'),   m_m x_m'' = force - b

        A servo on the motor that feels the carriage adds damping / (2 (m + m_m)) to the real part of the belt's poles,
        -belt_damping (1 / m + 1 / m_m) / 2: 21 1/s with `_SOFT`, more than most belts have.
        """
        neutral = self._of(columns, "position_dependent_load.neutral")
        pushed = stiff * (run.path[:, None] - neutral) + damping * run.rate[:, None]
        state, first, signals = self._begun(columns, run)
        held = columns.copy()
        held[self.plant.table.index("force_limit")] = 1e6
        held[self.plant.table.index("viscous")] += damping
        held[self.plant.table.index("position_dependent_load.stiffness")] += stiff
        out = replay(
            self.plant, held, np.broadcast_to(force, pushed.shape), self.period / FINE, drive="force", hold="step",
            signals=signals, state=state, substeps=self.substeps, disturbance=pushed, sensors=False,
        )  # fmt: skip
        return self._sampled(out, first, run)

    def _begun(self, columns, run: _Run):
        """(state at the start of a record, the signals [3, n] there, their names)."""
        state = self.plant.rest(self.plant.prepare(columns), np.full(columns.shape[1], run.start))
        signals = ["position", "velocity", "motor_position"]
        for name in ("velocity", "motor_velocity"):
            state[self.plant.row(name)] = run.speed
        return state, state[[self.plant.row(name) for name in signals]].copy(), signals

    def _sampled(self, out: np.ndarray, first: np.ndarray, run: _Run):
        if run.mean:
            whole = mean_over_samples(np.concatenate([np.broadcast_to(first, (FINE, *first.shape)), out]), FINE)
        else:
            whole = np.concatenate([first[None], out[FINE - 1 :: FINE]])
        return whole[:, 0], whole[:, 1], whole[:, 2], first

    def _replay(self, columns, path, rate, stiff, damping, run: _Run, force):
        """(position, speed, motor's position [T, n], the three at the start [3, n]) under a servo of those gains."""
        table, n = self.plant.table, columns.shape[1]
        columns, steps = columns.copy(), len(run.path)
        total = columns[table.index("mass")] + columns[table.index("motor_mass")]
        frequency = np.sqrt(np.maximum(stiff, 1e-9) / total)
        columns[table.index("servo_frequency")] = frequency
        columns[table.index("servo_damping_ratio")] = damping / (2.0 * frequency * total)
        columns[table.index("force_limit")] = 1e6
        state, first, signals = self._begun(columns, run)
        out = replay(
            self.plant, columns, np.broadcast_to(path, (steps, n)), self.period / FINE, drive="observed", hold="step",
            signals=signals, rate=np.broadcast_to(rate, (steps, n)), state=state, substeps=self.substeps,
            disturbance=np.broadcast_to(force, (steps, n)), sensors=False,
        )  # fmt: skip
        return self._sampled(out, first, run)

    def _seen(self, columns: np.ndarray, signals: dict[str, np.ndarray], first: np.ndarray) -> dict[str, np.ndarray]:
        """What the sensors show. A voltage is what the amplifier was told: it has no sensor."""
        names = [name for name in self.channels if name != "voltage"]
        out = np.stack([signals[name][1:] for name in names], axis=1)
        start = np.stack([signals[name][0] for name in names])
        late = {name: self._of(columns, f"sensor_delay.{name}") / self.period for name in names}
        prompt = columns.copy()
        for name in names:  # delays below: straight lines between samples would bend the motion
            prompt[self.plant.table.index(f"sensor_delay.{name}")] = 0.0
        shown = distort(self.plant, self.plant.prepare(prompt), names, out, self.period, start)
        seen = {name: np.concatenate([start[None, k], shown[:, k]]) for k, name in enumerate(names)}
        seen = {name: delayed(series, late[name]) if np.any(late[name]) else series for name, series in seen.items()}
        return {**signals, **seen}


_UNIT = {"position": "m", "velocity": "m/s", "force": "N", "voltage": "V", "motor_position": "m"}


def _recorded(record: Record, period: float, channels: Sequence[str]) -> tuple[np.ndarray, dict[str, Sampled]]:
    """As `resample`, with the reference where its rows were lost."""
    time, series = resample(record, period, channels)
    if "position_reference" in series:
        told = moving_command(record, "position_reference", time, period)
        series["position_reference"] = replace(series["position_reference"], values=told)
    return time, series


def _effort(recording: Recording) -> str:
    return "force" if "force" in recording.channels else "voltage"


def _middle(values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(values and slopes in the middle of each fine step, slopes at the samples) of a cubic through samples [T]."""
    curve = CubicSpline(np.arange(len(values)) * period, values)
    at = (np.arange(FINE * (len(values) - 1)) + 0.5) * (period / FINE)
    return curve(at), curve(at, 1), curve(np.arange(len(values)) * period, 1)


def _run(
    time: np.ndarray, series: Mapping[str, Sampled], period: float, effort: str | None, mean: bool,
    own: Mapping[str, float],
) -> _Run:  # fmt: skip
    position = series["position"].values
    samples = series["position_reference"].values if effort is None else position
    path, rate, rates = _middle(samples, period)
    pushed = np.zeros(len(path)) if effort is None else np.repeat(_halfway(series[effort].values), FINE)
    early = max(int(0.3 / period), 1)
    first = position[:early]
    moving = smooth_speed(position, period)[0]
    still = abs(moving) * early * period < 4.0 * max(float(np.std(np.diff(first))) if early > 2 else 0.0, 1e-12)
    start = float(first.mean()) if still else float(position[0])
    if mean:  # what the effort is computed from is averaged as the effort is
        samples, rates = mean_over_samples(samples, 1), mean_over_samples(rates, 1)
    return _Run(path, rate, pushed, samples, rates, start, 0.0 if still else float(moving), mean, own)


def _halfway(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])


def controller(recording: Recording, period: float) -> tuple[dict[str, float], float]:
    """(gains of `GAINS`, what they leave of the effort over what noise makes of it), of the fit records.

    By least squares in two stages, the reference and its derivatives being the instruments (Wooldridge, Econometric
    Analysis, 2010, ch. 5): plain ones take the noise of the measured position and speed for motion, and found half of
    the damping or less.
    """
    effort = _effort(recording)
    rows, told, target, noise = [], [], [], []
    for record in recording.used_for("fit"):
        _, series = _recorded(record, period, ("position", "position_reference", effort))
        reference, position = series["position_reference"].values, series["position"].values
        speed = smooth_speed(position, period, 0.05)
        if "velocity" in recording.channels:
            speed = resample(record, period, ("velocity",))[1]["velocity"].values
        good = series[effort].good & series["position"].good
        rate = _middle(reference, period)[2]
        rows.append(np.column_stack([reference - position, rate, -speed])[good])
        told.append(np.column_stack([reference, *_following(rate, period)])[good])
        target.append(series[effort].values[good])
        noise.append([jitter(series[effort].values), jitter(position), jitter(speed)])
    table, instruments, wanted = np.concatenate(rows), np.concatenate(told), np.concatenate(target)
    instruments = instruments / np.maximum(np.std(instruments, axis=0), 1e-300)
    moved = instruments @ np.linalg.lstsq(instruments, table, rcond=None)[0]
    gains = np.linalg.lstsq(moved, wanted, rcond=None)[0]
    from_noise = np.sqrt(np.mean(noise, axis=0) ** 2 @ np.array([1.0, gains[0] ** 2, gains[2] ** 2]))
    left = float(np.std(wanted - table @ gains))
    return dict(zip(GAINS, gains.tolist(), strict=True)), left / max(float(from_noise), 0.003 * float(np.std(wanted)))


_LAGS = (1, 2, 4, 8)
"""Samples by which a reference's rate tells what a drive does later."""


def _following(rate: np.ndarray, period: float) -> list[np.ndarray]:
    """What a drive may make of a reference's rate [T]: itself, two derivatives, its sign, and it somewhat later."""
    acceleration = np.gradient(rate, period)
    late = [np.r_[np.full(lag, rate[0]), rate[:-lag]] for lag in _LAGS]
    return [rate, acceleration, np.gradient(acceleration, period), np.sign(rate), *late]


def prepare(recording: Recording, request: Request) -> Question:
    """What a drive's recording asks. Raises ConfigurationError where position, an effort or the mass is missing.

    The servo of an observed drive is as stiff as its mass asks, so that its noise is the same whatever the mass is. A
    refit that may take any mass then takes one so large that 3 N of friction are nothing (1e5 kg where 2 were right).
    """
    if not {"force", "voltage"} & set(recording.channels):
        raise ConfigurationError(f"{recording.path}: a linear drive's diagnosis needs the channel force or voltage")
    recording.require("position", purpose="a linear drive's diagnosis")
    plant = with_own_effects(plant_for("linear_drive"), request.own)
    left_out = {"viscous": 0.0, "coulomb": 0.0, "motor_mass": 0.0}
    values = left_out if recording.rig is None and request.rig is None else {}
    stated = usual(recording, plant)
    values = {**plant_values(recording, plant, request.rig), **_absent(recording, values, request), **stated}
    # an augmented rig has the constant force as a tilt of its axis
    values[OFFSET] = 0.0 if request.rig else recording.value(OFFSET) or 0.0
    period = sample_period(recording.records)
    nominals = [f for f in free_parameters(recording, plant, values, ("mass",), request) if _acts(f.name, recording)]
    # a refit may not do away with a belt that is there: other effects need it
    nominals = [replace(f, low=1e3) if f.name == "belt_stiffness" and f.start > 1e3 else f for f in nominals]
    if OFFSET in recording.nominal:
        std = None if request.rig else recording.nominal[OFFSET].std
        nominals.append(Free(OFFSET, values[OFFSET], -1e4, 1e4, max(abs(values[OFFSET]), 0.1), std))
    gains, explained = controller(recording, period) if "position_reference" in recording.channels else ({}, np.inf)
    closed = explained < EXPLAINED and gains["control.kp"] > 0.0
    said = {**recording.known, **recording.nominal, **(request.rig or {}), **stated}
    weighed = recording.rig is not None or "mass" in said
    if not closed and not weighed:
        raise ConfigurationError(
            f"{recording.path}: no controller explains the effort, and the mass of the drive is not stated: a mass "
            "that may be anything hides every force. State it, e.g. nominal: {mass: {value: 2.5, std: 0.5, unit: kg}}"
        )
    control = [Free(n, g, 0.0, 1e3 * abs(g) + 1.0, max(abs(g), 1e-6)) for n, g in gains.items()]
    control = [*control, Free(HOLD, 0.5 * LONGEST_HOLD, 1e-6, LONGEST_HOLD, LONGEST_HOLD)] if closed else []
    candidates = _candidates(plant, recording, values, nominals, request, closed, period)
    free = {f.name: f for f in (*nominals, *control)} | {f.name: f for h in candidates.asked for f in h.free}
    steps = _substeps(values, period, {h.name for h in candidates.asked})
    made = {
        use: DriveModel(plant, recording, use, values, tuple(free.values()), period, closed, steps)
        for use in ("fit", "heldout")
    }
    how = "no controller was found to replay, so the carriage is held to its recorded position by a soft servo"
    if closed:
        how = f"the control loop is replayed; its effort differs by {explained:.2f} times what noise alone would make"
    notes = [how]
    if not closed and (rate := _forgets(values)) < _SLOW:
        early = 3.0 / max(rate, 1e-3)
        notes.append(
            f"what the belt starts with dies out with {rate:.2g} 1/s only where the carriage is held to its recorded "
            f"position: the first {early:.2g} s of each record depend on how it started"
        )
    return Question(
        "linear_drive", made["fit"], made["heldout"], tuple(f.name for f in (*nominals, *control)),
        (*GAINS, HOLD, OFFSET), candidates.asked, {f.name: _unit(plant, f.name) for f in free.values()},
        lambda found, accepted: _rig(plant, {**values, **found}, accepted), tuple(notes), at_rest=closed,
        not_asked=candidates.not_asked,
    )  # fmt: skip


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
    return name != "force_per_volt" or _effort(recording) == "voltage"


def _unit(plant: Plant, name: str) -> str:
    own = {"control.kp": "N/m", "control.kv": "N s/m", "control.kd": "N s/m", HOLD: "s", OFFSET: "N"}
    return own[name] if name in own else plant.table[name].unit


def _candidates(plant, recording, values, nominals, request: Request, closed: bool, period: float) -> Candidates:
    modelled = {n: KNOWN for n in recording.known if values.get(n)} | {f.name: REFITTED for f in nominals}
    signals = [c for c in ("position", "velocity", "force", "motor_position") if c in recording.channels]
    travel = max(float(np.ptp(r.data["position"][r.usable("position")])) for r in recording.used_for("fit"))
    found = hypotheses_for(plant, values, modelled, signals, only=request.only, without=request.without, travel=travel)
    found = found.less(_why_not(values, closed))
    unsaid = "belt_damping" not in {*recording.known, *recording.nominal, *(request.rig or {})}
    found = found.each(lambda h: _damped(h, values) if unsaid and h.name == "cable_elongation" else h)
    rigid = values["belt_stiffness"] <= 0.0
    return found.each(lambda h: _geared(h, values, period) if rigid and h.name == "backlash" else h)


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
    stiff, damping = total * _SOFT**2, 1.4 * total * _SOFT + values["viscous"]
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
