"""What a logger may do to its records: a clock that is not exact, speeds it has derived or filtered, a change of clock.

A speed that is the difference of two places over the time between two samples is the mean over it, and late by half of
it. That half has no size that could be chosen, and so it explains such a lateness better than a delay of any size.

An export whose samples were taken on one clock and brought to another by straight lines has lost of every frequency f
what a triangle of half the width P takes, the period of the first clock: sinc(f P)^2.

A speed that the logger has derived or filtered holds nothing that the recorded place does not, and the form of a filter
is not known to the last digit: what a model is off by there may hide what is missing of the rig, or be taken for it.
Such a speed is left out, and the rest is asked again (`without_channels`).

They are hypotheses like effects of the rig and compete with them, but they are of the data: no rig file has them.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from cable_envs.diagnosis.data.clocks.beats import OTHERS
from cable_envs.diagnosis.data.clocks.lines import NO_LINES, Lines
from cable_envs.diagnosis.data.clocks.sure_times import SURE
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.intake import tracks
from cable_envs.diagnosis.model.driven import drives_of
from cable_envs.diagnosis.model.hypotheses import LOGGER, Hypothesis
from cable_envs.diagnosis.model.in_lines import InLines
from cable_envs.diagnosis.model.model import Around, Free, Model
from cable_envs.diagnosis.model.spikes import spikes
from cable_envs.diagnosis.systems.question import Question

CLOCK, LINES = f"{LOGGER}clock", f"{LOGGER}lines"
LIKE_CLOCK = ("sensor_scale",)
"""A clock that is off scales all speeds. Where mass, friction and gains are free, the scale of a sensor is the same."""
DIFFERENCE, FILTER = f"{LOGGER}difference", f"{LOGGER}filter"
"""Names of the hypotheses; those of what is done to a speed go on with the channel's."""
STEP, MOST = 1e-4, 1e-2
"""Share by which times are made longer for the slope, and its bound."""
SLOWEST, TYPICAL = 0.2, 0.01
"""s of a filter's time constant: its bound, and what is usual."""
UNFILTERED = 0.1
"""Time constant over the time between samples of a filter that does nothing to them."""
SPEEDS = ("m/s", "rad/s")
SHORTEST, LONGEST = OTHERS
"""Samples' distance of an earlier clock over that of the recording: what is told of it, and the bound."""
UNSEEN = "no prediction changes with the clock, or the records cannot be read with a longer one"
LOST_ALIKE = (
    "a recorded position drives the simulator: it has lost as much as all else, and what takes more away from the "
    "predictions takes its noise away"
)
KNOWN = "the noise of the samples tells that clock: predictions are taken by its straight lines"
EVEN_NOISE = (
    "the noise of the samples is as large everywhere: straight lines between those of another clock would make it "
    "swell and fade as the two clocks beat"
)
SEEN = 1e-9
"""Of a channel's RMS, by which its prediction must change with the clock for that to be asked."""


class Logged(Around):
    """A model with further parameters: the logger's clock, what it does to speeds, and the period of an earlier clock.

    Predictions are linear in the clock; filters are of the first order.

    Parameters
    ----------
    model : Model
        The records as they are read.
    slopes : sequence of ndarray
        By block [T]: change of the prediction less what was measured for times that are longer by a share of
        themselves, over that share; empty where the clock is not asked.
    speeds : sequence of str
        Channels of which differences and filters are asked.
    """

    def __init__(self, model: Model, slopes: Sequence[np.ndarray], speeds: Sequence[str]):
        super().__init__(model)
        self._slopes, self._speeds = list(slopes), list(speeds)
        more = [_clock()] if self._slopes else []
        more += [of(channel) for channel in self._speeds for of in (_difference, _filter)]
        more.append(_lines(self._period(model)))
        self.parameters = [*model.parameters, *more]
        self._own = len(model.parameters)

    @staticmethod
    def _period(model: Model) -> float:
        return float(np.median(np.diff(model.blocks[0].time)))

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        found = self._model.predict(values[: self._own])
        rest = list(values[self._own :])
        if self._slopes:
            share = rest.pop(0)
            if np.any(share):
                found = [p + slope[:, None] * share for p, slope in zip(found, self._slopes, strict=True)]
        earlier = rest.pop()
        if np.any(earlier > 0.0):
            found = [_in_lines(p, b.time, earlier) for p, b in zip(found, self.blocks, strict=True)]
        for channel, behind, seconds in zip(self._speeds, rest[::2], rest[1::2], strict=True):
            for k, block in enumerate(self.blocks):
                if block.channel == channel and np.any(behind > 0.0):
                    found[k] = _derived(found[k], block.time, behind)
                if block.channel == channel and np.any(seconds > 0.0):
                    found[k] = filtered(found[k], block.time, seconds)
        return found


def _clock() -> Free:
    return Free(CLOCK, 0.0, -MOST, MOST, 1e-3)


def _difference(channel: str) -> Free:
    """Time constant of the filter behind a difference: far shorter than a sample it is none, at 0 no difference."""
    return Free(f"{DIFFERENCE}.{channel}", 0.0, 0.0, SLOWEST, TYPICAL)


def _filter(channel: str) -> Free:
    return Free(f"{FILTER}.{channel}", 0.0, 0.0, SLOWEST, TYPICAL)


def _lines(period: float) -> Free:
    return Free(LINES, 0.0, 0.0, LONGEST * period, period)


def _derived(series: np.ndarray, time: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Series [T, n] as the differences of a logger that filters them with time constants [n], where these are not 0.

    A difference is the mean since the sample before, here of cubics through four samples; the first sample is as it is.
    The filter knows the samples alone, as in software, y_k = y_(k-1) + (1 - exp(-P/tau)) (x_k - y_(k-1)).
    """
    period, found = float(np.median(np.diff(time))), series.copy()
    for k in np.flatnonzero(seconds > 0.0):
        padded = np.concatenate([series[:1, k], series[:1, k], series[:, k], series[-1:, k]])
        mean = (13.0 * (padded[1:-2] + padded[2:-1]) - padded[:-3] - padded[3:]) / 24.0
        mean[0] = series[0, k]
        keep = float(np.exp(-period / seconds[k]))
        found[:, k], _ = lfilter([1.0 - keep], [1.0, -keep], mean, zi=[keep * mean[0]])
    return found


def _in_lines(series: np.ndarray, time: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Series [T, n] of which each column has lost what straight lines between samples ``period`` [n] s apart take."""
    count, step = len(series), float(np.median(np.diff(time)))
    more = int(np.ceil(LONGEST)) + 1
    padded = np.concatenate([np.repeat(series[:1], more, axis=0), series, np.repeat(series[-1:], more, axis=0)])
    # a straight slope through the ends is unchanged, and without it nothing jumps from the end to the start
    slope = np.linspace(0.0, 1.0, len(padded))[:, None] * (padded[-1] - padded[0])
    kept = np.sinc(np.fft.rfftfreq(len(padded), step)[:, None] * period) ** 2
    smooth = np.fft.irfft(np.fft.rfft(padded - slope, axis=0) * kept, len(padded), axis=0) + slope
    return np.where(period > 0.0, smooth[more : more + count], series)


def filtered(series: np.ndarray, time: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Series [T, n] through filters of the first order with time constants [n], settled at the start.

    Exact for signals that go from sample to sample in straight lines.
    """
    found, period = series.copy(), float(np.median(np.diff(time)))
    for k in np.flatnonzero(seconds > 0.0):
        keep = float(np.exp(-period / seconds[k]))
        mean = (1.0 - keep) * seconds[k] / period
        now, before = 1.0 - mean, mean - keep
        start = [(keep + before) * series[0, k]]
        found[:, k], _ = lfilter([now, before], [1.0, -keep], series[:, k], zi=start)
    return found


def longer(recording: Recording) -> Recording:
    """The same recording with all times longer by `STEP` of themselves, from each record's start."""

    def stretched(record: Record) -> Record:
        time = record.time[0] + (record.time - record.time[0]) * (1.0 + STEP)
        return replace(record, data={**record.data, "time": time})

    return replace(recording, records=tuple(stretched(r) for r in recording.records))


def redundant_speeds(recording: Recording) -> frozenset[str]:
    """Speeds of which the places are recorded, too."""
    return frozenset(speed for place, speed in tracks.SPEEDS.items() if {place, speed} <= recording.channels.keys())


def without_channels(recording: Recording, channels: Collection[str]) -> Recording:
    """The recording as if these channels had not been recorded."""

    def rest(of: Mapping[str, Any]) -> dict[str, Any]:
        return {name: one for name, one in of.items() if name not in channels}

    records = tuple(replace(record, data=rest(record.data)) for record in recording.records)
    return replace(recording, channels=rest(recording.channels), records=records)


def with_logger(
    question: Question, stretched: Question | None, lines: Lines = NO_LINES, redundant: Collection[str] = ()
) -> Question:
    """The question with a logger's faults among its hypotheses.

    Parameters
    ----------
    question : Question
        Of the recording as it is.
    stretched : Question, optional
        Of the recording that `longer` gives; None: the clock is not asked.
    lines : Lines
        Whether, by their noise, samples came from another clock by straight lines.
    redundant : collection of str
        Channels that are left out where they turn out to be derived or filtered.
    """
    slopes = [] if stretched is None else _slopes(question, stretched)
    speeds = dict.fromkeys(b.channel for b in question.fit.blocks if b.unit in SPEEDS)
    period = float(np.median(np.diff(question.fit.blocks[0].time)))
    hypotheses, units = [], {}
    if slopes:
        clock = _hypothesis(CLOCK, _clock(), (1e-3, -1e-3), "t -> (1 + c) t", "time a minute by a good clock")
        hypotheses.append(replace(clock, alike=True, confusable=LIKE_CLOCK))
        units[CLOCK] = "1"
    for channel in speeds:
        for one in _of_speed(channel, period):
            hypotheses.append(replace(one, redundant=channel if channel in redundant else ""))
            units[one.name] = "s"
    free = _lines(period)
    law = "x(f) -> sinc(f P)^2 x(f)"
    earlier = _hypothesis(LINES, free, (free.scale, 2.0 * free.scale), law, "export the samples as taken")
    refused = {} if slopes else {CLOCK: UNSEEN}
    if drives_of(question.fit):
        refused[LINES] = LOST_ALIKE
    elif isinstance(question.fit, InLines) or lines.odds < -SURE:
        refused[LINES] = EVEN_NOISE if lines.odds < -SURE else KNOWN
    else:
        hypotheses.append(replace(earlier, least=SHORTEST * free.scale, alike=lines.odds < SURE))
        units[LINES] = "s"
    models = [
        Logged(m, own, list(speeds))
        for m, own in zip((question.fit, question.heldout), slopes or ([], []), strict=True)
    ]
    return replace(
        question, fit=models[0], heldout=models[1], hypotheses=(*question.hypotheses, *hypotheses),
        units={**question.units, **units}, rig=lambda values, accepted: question.rig(_of_rig(values), accepted),
        not_asked={**question.not_asked, **refused},
    )  # fmt: skip


def without_spikes(question: Question) -> Question:
    """The question with single samples left out that no motion makes (`cable_envs.diagnosis.model.spikes`)."""
    counts: dict[str, int] = {}
    for block in (*question.fit.blocks, *question.heldout.blocks):
        found = spikes(block.measured, block.good, block.reading.as_one)
        block.good[found] = False
        counts[block.channel] = counts.get(block.channel, 0) + int(found.sum())
    said = ", ".join(f"{count} of {channel.replace('_', ' ')}" for channel, count in counts.items() if count)
    if not said:
        return question
    return replace(question, notes=(*question.notes, f"samples that stand alone are left out: {said}"))


def _of_rig(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if not name.startswith(LOGGER)}


def _hypothesis(name: str, free: Free, sizes: Sequence[float], law: str, experiment: str) -> Hypothesis:
    return Hypothesis(name, (free,), tuple(({free.name: s},) for s in sizes), law, experiment, nulls={free.name: 0.0})


def _of_speed(channel: str, period: float) -> list[Hypothesis]:
    """That a speed is a difference of places ``period`` apart, or was filtered."""
    experiment, usual = "log the position and derive it", (0.5 * TYPICAL, 2.0 * TYPICAL)
    difference, slow = _difference(channel), _filter(channel)
    law = "v'_k = (x_k - x_(k-1)) / T, y_k = y_(k-1) + (1 - exp(-T/tau)) (v'_k - y_(k-1))"
    return [
        _hypothesis(difference.name, difference, (UNFILTERED * period, *usual), law, experiment),
        _hypothesis(slow.name, slow, usual, "tau dv'/dt = v - v'", experiment),
    ]


def _slopes(question: Question, stretched: Question) -> list[list[np.ndarray]]:
    """Of both models by block; empty where the samples differ or nothing changes."""
    found, seen = [], False
    for model, other in ((question.fit, stretched.fit), (question.heldout, stretched.heldout)):
        if [len(b.time) for b in model.blocks] != [len(b.time) for b in other.blocks]:
            return []
        now, then = (m.predict(np.array([[p.start] for p in m.parameters])) for m in (model, other))
        own = []
        for block, late, p, q in zip(model.blocks, other.blocks, now, then, strict=True):
            change = (block.measured - p[:, 0]) - (late.measured - q[:, 0])
            own.append(np.where(block.good & late.good, change, 0.0) / STEP)
            scale = float(np.std(block.measured[block.good])) if block.good.any() else 0.0
            seen = seen or float(np.sqrt(np.mean(own[-1] ** 2))) * STEP > SEEN * scale
        found.append(own)
    return found if seen else []
