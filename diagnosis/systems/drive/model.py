"""A one-axis drive on the project's kernel, under its own controller or held to its recorded motion.

The loop is `replay(..., drive="observed")`: it feels the carriage, and the amplifier's lag acts on its force. Our own
servo pulls at the carriage, which it feels: then it is stable whatever the belt is (`DriveModel._followed`). The
reference goes between samples as a cubic, since straight lines would change the force by kp x'' dt^2 / 12.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.systems.common import (
    Sampled,
    at_first,
    mean_over_samples,
    motion_coordinates,
    moving_command,
    recorded_drive,
    resample,
    smooth_speed,
)
from cable_envs.diagnosis.systems.conditions import given, with_given
from cable_envs.diagnosis.systems.drive.unsure import unsure
from cable_envs.diagnosis.systems.replayed import delayed
from cable_envs.plants.base import Plant
from cable_envs.sim.replay import distort
from cable_envs.sim.together import Asked, replay_together

FINE = 10
"""Input steps in each sample, in which the controller's output is held. With 2 (5 ms at 100 Hz) loops of 45 rad/s that
had nothing wrong were answered with a Stribeck curve as wide as the motion (gains of 57 and 74; 2 and 0 with 10)."""
AT_ONCE = 24
"""Columns at a time: the inputs of a fine step are each column's own, 2.5 MB a column for 45 s at 100 Hz. A
column takes 7 ms so, and 11 to 14 with 32 or 64 of them."""
GAINS = ("control.kp", "control.kv", "control.kd", "control.ki")
"""Of the position's error, the reference's speed, the drive's speed, and the integral of the error."""
HOLD = "control.hold"
"""s: a digital controller holds its output, on average half a period late; that is no physics of the rig."""
READ = "control.read"
"""s: who logs a held output between two steps of the controller reads it as old as it is; that is no sensor's delay."""
OFFSET = "force_offset"
BEGINS = 0.3
"""s of a record's begin in which a controller's integral shows what it holds."""
SOFT = 30.0
"""rad/s, the natural frequency of our own servo."""
DAMPING_RATIO = 0.7
"""Of our own servo."""


@dataclass(frozen=True)
class Driven:
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
    begun: np.ndarray = field(default_factory=lambda: np.zeros(5))
    """over the first samples the means of the effort, the position's error, the speeds of reference and carriage, and
    the error's integral, of a drive under its own controller: what its integral holds when the record begins"""
    beside: tuple[np.ndarray, Sampled] | None = None
    """recorded places of the carriage and of the motor [T], where an observed drive is asked for the motor's; samples
    count as those of its block do"""


Seen = Callable[[np.ndarray], dict[str, np.ndarray]]
"""What the sensors of a record show, by channel [T, n], of true signals [FINE (T - 1), 3, n]."""


class DriveModel:
    """See `cable_envs.diagnosis.model.model.Model`. ``values``: the rig, SI, by name of the plant's table.

    told: numbers that the records tell better than ``values``, for our servo.
    """

    _signals: tuple[str, ...] = ("position", "velocity", "motor_position")
    _moving: tuple[str, ...] = ("velocity", "motor_velocity")
    """what has the speed with which a record begins"""

    def __init__(
        self, plant: Plant, recording: Recording, use: str, values: Mapping[str, float], parameters: Sequence[Free],
        period: float, closed: bool, substeps: int = 2, told: Mapping[str, float] | None = None,
    ):  # fmt: skip
        self.plant, self.parameters, self.period, self.closed = plant, tuple(parameters), period, closed
        self.substeps = substeps
        self.effort = effort_of(recording)
        table = plant.table
        self._base = np.array([values[p.name] for p in table])
        self._rows = {p.name: k for k, p in enumerate(self.parameters)}
        self._inside = [(k, table.index(p.name)) for k, p in enumerate(self.parameters) if p.name in table]
        self._given, self._moves = dict(values), self._moved({**values, **(told or {})})
        wanted = [c for c in ("position", "velocity", self.effort, "motor_position") if c in recording.channels]
        ahead = ("motor_position",) if values["motor_mass"] > 0.0 else ()
        self.channels = wanted if closed else [c for c in wanted if c in ("position", "velocity", *ahead)]
        self.blocks: list[Block] = []
        self._runs: list[Driven] = []
        self._place = partial(recorded_drive, recording, "position")
        for record in recording.used_for(use):
            self._add(record)

    def resolve(self, substeps: int) -> None:
        """Take so many steps of integration in every fine step of the input."""
        self.substeps = substeps

    def _add(self, record: Record) -> None:
        needs = {"position", *self.channels, "position_reference" if self.closed else self.effort}
        time, series = recorded(record, self.period, sorted(needs))
        self._runs.append(self._driven(record, time, series))
        along = motion_coordinates(time, series["position"].values, "m", "position")
        late = ~at_first(time, series["position"].values)
        for channel in self.channels:
            got, good = series[channel], series[channel].good & late
            if channel == "motor_position" and not self.closed:
                good = good & series["position"].good
                beside = (series["position"].values, replace(got, good=good))
                self._runs[-1] = replace(self._runs[-1], beside=beside)
            unsure = None if self.closed else self._unsure(record, series, channel, along)
            self.blocks.append(
                Block(
                    record.name,
                    channel,
                    time,
                    got.values,
                    good,
                    _UNIT[channel],
                    along,
                    reading=got.reading,
                    unsure=unsure,
                )
            )

    def _driven(self, record: Record, time: np.ndarray, series: Mapping[str, Sampled]) -> Driven:
        """A record's input. Our servo follows the recorded place without its noise, whose rate would shake friction."""
        own, mean = given(record, self.plant), record.over > 0.0
        if self.closed:
            run = driven(time, series, self.period, None, mean, own)
            return replace(run, begun=_begun(series, self.effort, run.rates, self.period))
        followed = self._place(series["position"].values).smoothed(self.period)[0]
        return driven(time, series, self.period, self.effort, mean, own, followed)

    def _unsure(
        self, record: Record, series: Mapping[str, Sampled], channel: str, along: Sequence[Coordinate]
    ) -> np.ndarray | None:
        """Samples [T] that steps of the effort make unsure; means have the whole impulse."""
        if record.over > 0.0:
            return None
        moving = next(c.values for c in along if c.name == "direction") != 0.0
        own = answer(channel, self._pushed(channel))
        return unsure(series[self.effort], series[channel], moving, self.period, own)

    def _pushed(self, channel: str) -> float:
        """Speed that an impulse of one unit of effort sets; a motor runs from its carriage as if it were alone."""
        return self._told() / (self._given["motor_mass"] if channel == "motor_position" else self._moves)

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
        through = self._closed if self.closed else self._observed
        asked = [through(with_given(self.plant, columns, run.given), shown, run) for run in self._runs]
        return self._together(asked, "observed" if self.closed else "force")

    def _together(self, asked: Sequence[tuple[Asked, Seen]], drive: str) -> list[np.ndarray]:
        """Every channel of every record [T, n] from what drives it, and what its sensors make of true signals."""
        outs = replay_together(
            self.plant, [one for one, _ in asked], self.period / FINE, drive=drive, hold="step", signals=self._signals,
            substeps=self.substeps,
        )  # fmt: skip
        shown = [seen(out) for (_, seen), out in zip(asked, outs, strict=True)]
        return [signals[channel] for signals in shown for channel in self.channels]

    def _of(self, columns: np.ndarray, name: str) -> np.ndarray:
        return columns[self.plant.table.index(name)]

    def _closed(self, columns: np.ndarray, shown: Mapping[str, np.ndarray], run: Driven) -> tuple[Asked, Seen]:
        per_volt = self._of(columns, "force_per_volt") if self.effort == "voltage" else 1.0
        kp, kv, kd, ki = (shown.get(name, np.zeros(columns.shape[1])) for name in GAINS)
        scale, late = self._of(columns, "sensor_scale.position"), self._of(columns, "sensor_delay.position")
        # the controller feels scale x(t - late): kp (r - scale (x - late x' + late^2 x'' / 2)) + kv r' - kd x'
        stiff, damping = kp * scale, np.maximum(kd - kp * scale * late, 1e-9)
        columns = columns.copy()
        columns[self.plant.table.index("actuator_lag.time")] += shown[HOLD]
        behind = 0.5 * stiff * late**2  # acts as a mass that is not there
        columns[self.plant.table.index("motor_mass")] += behind * per_volt
        path, rate = run.path[:, None] / scale, run.rate[:, None] * (kv / damping)
        summing = ki * scale
        held = run.begun @ np.stack([np.ones(len(ki)), -kp, -kv, kd, -ki]) * (ki > 0.0)
        force = held * per_volt - shown[OFFSET]
        asked, first = self._served(columns, path, rate, stiff * per_volt, damping * per_volt, run, force)
        if np.any(ki):
            asked = replace(asked, second=np.broadcast_to(summing * per_volt, (len(run.path), len(ki))))

        def seen(out: np.ndarray) -> dict[str, np.ndarray]:
            y, v, motor = self._sampled(out, first, run)
            effort = stiff * (run.samples[:, None] / scale - y) + kv * run.rates[:, None] - damping * v
            if np.any(ki):
                effort = effort + held + summing * self._summed(path, out, first, run)
            if np.any(behind):
                with np.errstate(invalid="ignore"):  # of a trial that has run away
                    effort = effort - behind * np.gradient(v, self.period, axis=0)
            effort = delayed(effort, shown[READ] / self.period)
            signals = {"position": y, "velocity": v, self.effort: effort, "motor_position": motor}
            return self._seen(columns, signals, first)

        return asked, seen

    def _summed(self, path: np.ndarray, out: np.ndarray, first: np.ndarray, run: Driven) -> np.ndarray:
        """Integral of the path less the drive's place [T, n] at the samples, m s."""
        place = np.concatenate([first[None, 0], out[:, 0]])
        total = np.cumsum(path - 0.5 * (place[1:] + place[:-1]), axis=0) * (self.period / FINE)
        whole = np.concatenate([np.zeros((FINE, place.shape[1])), total])
        return mean_over_samples(whole, FINE) if run.mean else whole[FINE - 1 :: FINE]

    def _observed(self, columns: np.ndarray, shown: Mapping[str, np.ndarray], run: Driven) -> tuple[Asked, Seen]:
        per_volt = self._of(columns, "force_per_volt") if self.effort == "voltage" else 1.0
        scale, bias = self._of(columns, "sensor_scale.force"), self._of(columns, "sensor_bias.force")
        columns = columns.copy()
        columns[self.plant.table.index("actuator_lag.time")] += shown.get(HOLD, 0.0)
        force = (run.effort[:, None] * per_volt - bias) / scale - shown[OFFSET]
        asked, first = self._followed(columns, *self._servo(per_volt / scale), run, force)

        def seen(out: np.ndarray) -> dict[str, np.ndarray]:
            y, v, motor = self._sampled(out, first, run)
            signals = self._seen(columns, {"position": y, "velocity": v, "motor_position": motor}, first)
            if run.beside is not None:
                signals["motor_position"] = _beside(signals, *run.beside)
            return signals

        return asked, seen

    def _servo(self, gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(stiffness, damping) [n] of our servo; ``gain`` [n]: force for one unit of the recorded effort.

        What a model lacks moves the simulator by as much as it is of the recorded effort, whatever is tried: the servo
        is made for the mass that the records tell, or that is stated, and is as much stiffer as an effort is tried to
        make more. With one as stiff as the mass that is tried a larger mass would hide a force, and with the same one
        for every gain an effort that makes next to nothing would.
        """
        total = self._moves * np.abs(gain) / self._told()
        return total * SOFT**2, 2.0 * DAMPING_RATIO * total * SOFT

    def _told(self) -> float:
        """Force that one unit of the effort makes as it was told."""
        return self._given["force_per_volt"] if self.effort == "voltage" else 1.0

    def _moved(self, values: Mapping[str, float]) -> float:
        """All that moves, kg."""
        return values["mass"] + values["motor_mass"]

    def _followed(self, columns, stiff, damping, run: Driven, force) -> tuple[Asked, np.ndarray]:
        """As `_served`, with the recorded force on the motor, and our servo between carriage and recorded place.

        The servo acts where it feels, as a spring and a damper would, so that whatever the belt is it takes energy out:

            m x'' = b - friction + stiff (path - x) + damping (path' - x'),   m_m x_m'' = force - b

        A servo on the motor that feels the carriage adds damping / (2 (m + m_m)) to the real part of the belt's poles,
        -belt_damping (1 / m + 1 / m_m) / 2: 21 1/s with `SOFT`, more than most belts have.
        """
        neutral = self._of(columns, "position_dependent_load.neutral")
        pushed = stiff * (run.path[:, None] - neutral) + damping * run.rate[:, None]
        state, first = self._begun(columns, run)
        held = columns.copy()
        held[self.plant.table.index("force_limit")] = 1e6
        held[self.plant.table.index("viscous")] += damping
        held[self.plant.table.index("position_dependent_load.stiffness")] += stiff
        return Asked(held, np.broadcast_to(force, pushed.shape), disturbance=pushed, state=state), first

    def _begun(self, columns: np.ndarray, run: Driven) -> tuple[np.ndarray, np.ndarray]:
        """(state at the start of a record, the three signals [3, n] there)."""
        state = self.plant.rest(self.plant.prepare(columns), np.full(columns.shape[1], run.start))
        for name in self._moving:
            state[self.plant.row(name)] = run.speed
        return state, state[[self.plant.row(name) for name in self._signals]].copy()

    def _sampled(self, out: np.ndarray, first: np.ndarray, run: Driven) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The three signals [T, n] at the samples."""
        if run.mean:
            whole = mean_over_samples(np.concatenate([np.broadcast_to(first, (FINE, *first.shape)), out]), FINE)
        else:
            whole = np.concatenate([first[None], out[FINE - 1 :: FINE]])
        return whole[:, 0], whole[:, 1], whole[:, 2]

    def _served(self, columns, path, rate, stiff, damping, run: Driven, force) -> tuple[Asked, np.ndarray]:
        """(what drives it under a servo of those gains, the three signals [3, n] at the start)."""
        table, n = self.plant.table, columns.shape[1]
        columns, steps = columns.copy(), len(run.path)
        total = columns[table.index("mass")] + columns[table.index("motor_mass")]
        frequency = np.sqrt(np.maximum(stiff, 1e-9) / total)
        columns[table.index("servo_frequency")] = frequency
        columns[table.index("servo_damping_ratio")] = damping / (2.0 * frequency * total)
        columns[table.index("force_limit")] = 1e6
        state, first = self._begun(columns, run)
        path, rate, force = (np.broadcast_to(series, (steps, n)) for series in (path, rate, force))
        return Asked(columns, path, rate, disturbance=force, state=state), first

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


def _begun(series: Mapping[str, Sampled], effort: str, rates: np.ndarray, period: float) -> np.ndarray:
    """As `Driven.begun`; rates: of the reference [T]."""
    position = series["position"].values
    off, first = series["position_reference"].values - position, slice(max(int(BEGINS / period), 2))
    means = [np.mean(one[first]) for one in (series[effort].values, off, rates)]
    speed = np.polyfit(period * np.arange(len(position[first])), position[first], 1)[0]
    return np.array([*means, speed, period * np.mean(np.cumsum(off[first]) - 0.5 * off[first])])


def _beside(signals: Mapping[str, np.ndarray], carriage: np.ndarray, motor: Sampled) -> np.ndarray:
    """The motor's place [T, n] by the carriage's recorded one [T], and by how far the belt lets it run ahead of that.

    What noise of the effort moves, it moves both: their difference knows nothing of it, and together they say as much
    as both places do. A motor's encoder counts from where it was switched on: its zero is each record's own.
    """
    found = carriage[:, None] + signals["motor_position"] - signals["position"]
    good = motor.good
    return found + np.mean(motor.values[good, None] - found[good], axis=0) if good.any() else found


def answer(channel: str, push: float) -> tuple[complex, complex]:
    """(a, p): to an impulse that sets a speed of ``push``, a channel does Re(a exp(p t)) under our servo."""
    pole = SOFT * complex(-DAMPING_RATIO, np.sqrt(1.0 - DAMPING_RATIO**2))
    place = push / (1j * pole.imag)
    return (place * pole if channel == "velocity" else place), pole


_UNIT = {"position": "m", "velocity": "m/s", "force": "N", "voltage": "V", "motor_position": "m"}


def recorded(record: Record, period: float, channels: Sequence[str]) -> tuple[np.ndarray, dict[str, Sampled]]:
    """As `resample`, with the reference where its rows were lost."""
    time, series = resample(record, period, channels)
    if "position_reference" in series:
        told = moving_command(record, "position_reference", time, period)
        series["position_reference"] = replace(series["position_reference"], values=told)
    return time, series


def effort_of(recording: Recording) -> str:
    """Channel of the motor's effort."""
    return "force" if "force" in recording.channels else "voltage"


def middle(values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(values and slopes in the middle of each fine step, slopes at the samples) of a cubic through samples [T]."""
    curve = CubicSpline(np.arange(len(values)) * period, values)
    at = (np.arange(FINE * (len(values) - 1)) + 0.5) * (period / FINE)
    return curve(at), curve(at, 1), curve(np.arange(len(values)) * period, 1)


def driven(
    time: np.ndarray, series: Mapping[str, Sampled], period: float, effort: str | None, mean: bool,
    own: Mapping[str, float], followed: np.ndarray | None = None,
) -> Driven:  # fmt: skip
    """One record's input; effort: channel that drives, None: the position reference; own: its parameters.

    followed: positions [T] that our servo follows beside the effort.
    """
    position = series["position"].values
    samples = series["position_reference"].values if followed is None else followed
    path, rate, rates = middle(samples, period)
    pushed = np.zeros(len(path)) if effort is None else np.repeat(_halfway(series[effort].values), FINE)
    early = max(int(BEGINS / period), 1)
    first = position[:early]
    moving = smooth_speed(position, period)[0]
    still = abs(moving) * early * period < 4.0 * max(float(np.std(np.diff(first))) if early > 2 else 0.0, 1e-12)
    start = float(first.mean()) if still else float(position[0])
    if mean:  # what the effort is computed from is averaged as the effort is
        samples, rates = mean_over_samples(samples, 1), mean_over_samples(rates, 1)
    return Driven(path, rate, pushed, samples, rates, start, 0.0 if still else float(moving), mean, own)


def _halfway(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
