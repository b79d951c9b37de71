"""What rivals predict of motions that were not run: the records' own model, given records that are only planned.

A planned record has the motion in the channel that drives the simulator. Its sensors have been read for the first
moment alone, as in a record that was run, from which a model solves for where it starts. So nothing is fitted to
readings that are not there; constants that every record has for itself take out of the predictions what they can.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.experiment.motions import Limits
from cable_envs.diagnosis.experiment.rivals import Rival
from cable_envs.diagnosis.experiment.worth import Told
from cable_envs.diagnosis.fit.refit import STEP
from cable_envs.diagnosis.model.constants import constants_of, with_constants
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.systems import driven_by, prepare
from cable_envs.diagnosis.systems.common import smoothed
from cable_envs.diagnosis.systems.question import Question, Request

AT_ONCE = 12
"""Motions in one call of the simulator, for the memory that their slopes take."""
FIRST = 0.05
"""s over which what a channel begins with is averaged."""
RESOLVED = 20
"""Samples of a wave of the fastest sine that is planned."""
BEYOND = 0.25
"""Share of the range that a channel has shown by which it may leave it."""


@dataclass(frozen=True)
class Planned:
    """A motion with the record that it is like.

    Parameters
    ----------
    name : str
        Of the record to be.
    place : ndarray
        Of the drive, at every sample [T], in the SI unit of place of the channel that drives.
    like : Record
        Of which it has the conditions, and begins where that began.
    settings : Mapping of str to float
        Parameters of the rig that are set anew for it, SI.
    """

    name: str
    place: np.ndarray
    like: Record
    settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def conditions(self) -> dict[str, Any]:
        """Of the record to be."""
        return {**self.like.conditions, **self.settings}


class Bench:
    """Simulations of planned motions under every rival.

    Parameters
    ----------
    recording : Recording
        The records there are.
    request : Request
        As the recording was asked.
    question : Question
        What it asked, with steps of integration that decide nothing.
    rivals : sequence of Rival
        Refitted to the records.

    Raises
    ------
    ConfigurationError
        Where no command or position drives the simulator alone, so that no other motion can be simulated.
    """

    def __init__(self, recording: Recording, request: Request, question: Question, rivals: Sequence[Rival]):
        self.recording, self.request, self.rivals = recording, request, list(rivals)
        self.channel = driven_by(recording)
        self.unit = recording.channels[self.channel].si_unit
        self.period = sample_period(recording.records)
        self.run = [r for r in recording.records if r.use != "rest"]
        self.is_rate = self.unit.endswith("/s")
        self._substeps = getattr(question.fit, "substeps", None)
        self._read = {b.channel for b in question.fit.blocks}
        self._whitener: Whitener = rivals[0].candidate.frame.whitener
        self._fitted = tuple(replace(r, use="fit") for r in self.run)
        self._reaches: dict[frozenset[tuple[str, float]], dict[str, tuple[float, float]]] = {}

    def place(self, record: Record) -> np.ndarray:
        """Of the drive in a record that was run, on the even clock [T]: a recorded rate is integrated."""
        time = np.arange(record.time[0], record.time[-1] + 0.5 * self.period, self.period)
        good = record.usable(self.channel)
        values = np.interp(time, record.time[good], record.data[self.channel][good])
        if not self.is_rate:
            return values
        return np.concatenate([[0.0], np.cumsum(0.5 * self.period * (values[1:] + values[:-1]))])

    def shown(self) -> Limits:
        """What the drive has done in the records, and how fast a sine their samples resolve."""
        low, high, speed, acceleration = np.inf, -np.inf, 0.0, 0.0
        for record in self.run:
            place = self.place(record)
            rate = smoothed(place, self.period)[1]
            low, high = min(low, float(place.min())), max(high, float(place.max()))
            speed = max(speed, float(np.quantile(np.abs(rate), 0.999)))
            acceleration = max(acceleration, float(np.quantile(np.abs(np.gradient(rate, self.period)), 0.999)))
        return Limits(low, high, speed, acceleration, 1.0 / (RESOLVED * self.period))

    def input(self, place: np.ndarray) -> np.ndarray:
        """The channel that drives, of a place [T]."""
        return np.gradient(place, self.period) if self.is_rate else place

    def told(self, planned: Sequence[Planned]) -> list[list[Told] | None]:
        """What every rival predicts of every motion; None of one in which a channel leaves what it has shown.

        Under settings that no record has, a channel has shown what the best rival predicts of the motions that were
        run, too.
        """
        found: list[list[Told] | None] = []
        for k in range(0, len(planned), AT_ONCE):
            found += self._told(planned[k : k + AT_ONCE])
        return found

    def _told(self, planned: Sequence[Planned]) -> list[list[Told] | None]:
        records = tuple(self._record(one) for one in planned)
        model = self._model(records)
        columns, spans = self._columns(model)
        with np.errstate(over="ignore", invalid="ignore"):
            series = model.predict(np.column_stack(columns))
        found: list[list[Told] | None] = []
        constants, block = {}, 0
        for changes, known in constants_of(model):
            constants[model.blocks[block].record] = (changes, known)
            block += changes.shape[1]
        for one in planned:
            own = [j for j, b in enumerate(model.blocks) if b.record == one.name]
            reach = self._reach(one.settings)
            if not all(self._allowed(series[j][:, [s[0] for s in spans]], model.blocks[j].channel, reach) for j in own):
                found.append(None)
                continue
            blocks = [replace(model.blocks[j], good=np.isfinite(series[j]).all(axis=1)) for j in own]
            flat = self._whitener.flat(blocks, [series[j] for j in own])
            if one.name in constants:
                flat = with_constants(blocks, [constants[one.name]], self._whitener, flat)
            found.append([self._of(rival, flat, span) for rival, span in zip(self.rivals, spans, strict=True)])
        return found

    def rehearsed(self, one: Planned, rival: Rival, rng: np.random.Generator) -> Record:
        """The record of a motion as it would be if a rival were true, with the sensors' noise, to be fitted."""
        record = self._record(one)
        model = self._model((record,))
        base = [rival.candidate.peak.values.get(p.name, p.start) for p in model.parameters]
        data = dict(record.data)
        for block, series in zip(model.blocks, model.predict(np.array(base)[:, None]), strict=True):
            noise = self._whitener.noise[block.channel].simulate(len(block.time), rng)
            data[block.channel] = np.interp(record.time, block.time, series[:, 0] + noise)
        return replace(record, use="fit", data=data)

    def resolve(self, question: Question) -> Question:
        """A question of these records and others, with as many steps of integration."""
        for model in (question.fit, question.heldout):
            self._resolve(model)
        return question

    def _resolve(self, model: Any) -> Any:
        if self._substeps is not None and model.substeps != self._substeps:
            model.resolve(self._substeps)
        return model

    def _model(self, planned: Sequence[Record]) -> Model:
        asked = replace(self.recording, records=(*self._fitted, *planned))
        found: Model = self._resolve(prepare(asked, self.request).heldout)
        return found

    def _record(self, one: Planned) -> Record:
        time = self.period * np.arange(len(one.place))
        first = max(int(FIRST / self.period), 1)
        data = {"time": time}
        for name in self.recording.channels:
            if name != "time":
                seen = one.like.data[name][one.like.usable(name)]
                data[name] = np.full(len(time), float(np.mean(seen[:first])) if len(seen) else 0.0)
                if name in self._read:
                    data[name][first:] = np.nan
        data[self.channel] = self.input(one.place)
        return replace(
            one.like, name=one.name, use="heldout", data=data, quality=(), over=0.0, conditions=one.conditions
        )

    def _columns(self, model: Model) -> tuple[list[np.ndarray], list[tuple[int, dict[str, tuple[int, float]]]]]:
        """(columns of all parameters, for every rival the number of its own and of each free one's, with the step)."""
        columns: list[np.ndarray] = []
        spans = []
        rows = {p.name: j for j, p in enumerate(model.parameters)}
        for rival in self.rivals:
            peak = rival.candidate.peak
            base = np.array([peak.values.get(p.name, p.start) for p in model.parameters])
            own, steps = len(columns), {}
            columns.append(base)
            for name in peak.free:
                if name not in rows:
                    continue
                p = model.parameters[rows[name]]
                step = STEP * max(abs(base[rows[name]]), p.scale)
                step = step if base[rows[name]] + step <= p.high else -step
                moved = base.copy()
                moved[rows[name]] += step
                steps[name] = (len(columns), step)
                columns.append(moved)
            spans.append((own, steps))
        return columns, spans

    def _of(self, rival: Rival, flat: np.ndarray, span: tuple[int, Mapping[str, tuple[int, float]]]) -> Told:
        own, steps = span
        free = rival.candidate.peak.free
        slopes = np.zeros((len(flat), len(free)))
        for k, name in enumerate(free):
            if name in steps:
                column, step = steps[name]
                slopes[:, k] = (flat[:, column] - flat[:, own]) / step
        return Told(flat[:, own], slopes, rival.candidate.covariance)

    def _allowed(self, values: np.ndarray, channel: str, reach: Mapping[str, tuple[float, float]]) -> bool:
        """Whether predictions [T, rivals] of a channel stay where it has been, or nearly so."""
        low, high = reach[channel]
        room = BEYOND * (high - low)
        moved = values - values[:1] if self.recording.channels[channel].offset_free else values
        low, high = (low - high, high - low) if self.recording.channels[channel].offset_free else (low, high)
        return bool(np.isfinite(values).all() and moved.min() >= low - room and moved.max() <= high + room)

    def _reach(self, settings: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Channel -> from where to where it has been; under settings of its own also by the best rival's prediction."""
        key = frozenset(settings.items())
        if key not in self._reaches:
            seen = {name: [r.data[name][r.usable(name)] for r in self.run] for name in self._read}
            if settings:
                again = [Planned(f"{r.name}, set", self.place(r), r, settings) for r in self.run]
                model = self._model(tuple(self._record(one) for one in again))
                peak = self.rivals[0].candidate.peak
                base = np.array([peak.values.get(p.name, p.start) for p in model.parameters])
                for block, series in zip(model.blocks, model.predict(base[:, None]), strict=True):
                    seen[block.channel].append(series[np.isfinite(series[:, 0]), 0])
            self._reaches[key] = {
                name: (min(float(s.min()) for s in parts if s.size), max(float(s.max()) for s in parts if s.size))
                for name, parts in seen.items()
            }
        return self._reaches[key]
