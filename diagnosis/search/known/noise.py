"""The noise of a question's channels, as far as it is known before anything is fitted to what a model leaves.

From a record at rest (`model.rest`), and from the recorded position that drives the simulator (`model.driven`).
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import cast

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.readings import resolution
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.model.driven import (
    DENSITIES,
    Driven,
    drives_of,
    error_density,
    noise_of_samples,
    passed_on,
    with_input,
)
from cable_envs.diagnosis.model.model import white_noise
from cable_envs.diagnosis.model.noise import bridged
from cable_envs.diagnosis.model.rest import RestNoise, noise_at_rest
from cable_envs.diagnosis.systems.common import resample
from cable_envs.diagnosis.systems.question import Question

NOISE_IS_LEARNT = (
    "the noise is estimated from the residual, so that a slow or small mismatch may be taken for noise; two minutes in "
    "which nothing moves, as a record with 'use: rest', or a stated noise_std show more"
)
STATED_IS_NOT_ALL = (
    "the stated noise is that of the sensors, and a recorded signal, noise and all, drives the simulator: what noise "
    "makes of the predictions is estimated from the residual"
)


def told_at_rest(recording: Recording, question: Question) -> Question:
    """The question with the noise of its channels that a record at rest tells (`model.rest`), and a note of it."""
    record = next(iter(recording.used_for("rest")), None)
    if record is None:
        learnt = question.at_rest and not any(b.channel in recording.noise for b in question.fit.blocks)
        return replace(question, notes=(*question.notes, NOISE_IS_LEARNT)) if learnt else question
    if not question.at_rest and not drives_of(question.fit):
        why = "a recorded signal drives the simulator, so that its noise is in all predictions"
        return replace(question, notes=(*question.notes, f"{record.name}, at rest, is not used: {why}"))
    longest = max(len(b.time) for b in question.fit.blocks)
    found = of_record(record, sample_period(recording.records), {b.channel for b in question.fit.blocks}, longest)
    for model in (question.fit, question.heldout):
        model.blocks[:] = [replace(b, noise=found.get(b.channel)) for b in model.blocks]
    known, still = ([c for c, n in found.items() if (n is None) is none] for none in (False, True))
    said = f"the noise of {', '.join(known)} is known from {record.name}" if known else f"{record.name} shows no noise"
    if still:
        said += f"; {', '.join(still)} shows no noise above its resolution, and there it is estimated from the residual"
    return replace(question, notes=(*question.notes, said))


def of_record(record: Record, period: float, channels: Iterable[str], longest: int) -> dict[str, RestNoise | None]:
    """The noise of every channel of a record at rest, for records of ``longest`` samples; None where it shows none."""
    _, seen = resample(record, period, sorted(channels))
    steps = {name: resolution(record.data[name][record.usable(name)]) for name in seen}
    return {name: noise_at_rest(bridged(s.values, s.good), steps[name], longest) for name, s in seen.items()}


def with_noise_of_drive(recording: Recording, question: Question) -> Question:
    """The question with the noise that a recorded drive's position makes of every channel (`model.driven`), and a note.

    Of the channels whose own noise is stated or known from rest; what is learnt from what a model leaves has it anyway.
    The response is that of the refitted nominals.
    """
    drives = drives_of(question.fit)
    own = {b.channel: recording.noise.get(b.channel, b.noise) for b in question.fit.blocks}
    if all(noise is None for noise in own.values()):
        return question
    if not drives:
        return question if question.at_rest else replace(question, notes=(*question.notes, STATED_IS_NOT_ALL))
    channel = drives[0].channel
    rest = next(iter(recording.used_for("rest")), None)
    size: float | np.ndarray = noise_of_samples([d.values for d in drives], recording.noise.get(channel))
    if rest is not None and channel not in recording.noise:
        longest = max(len(d.values) for d in drives)
        still = of_record(rest, sample_period(recording.records), {channel}, longest)[channel]
        size = size if still is None else still.density(DENSITIES)
    density = error_density(drives, size)
    refitted = refit_and_learn(question.fit, [Start("as claimed", question.nominals, {})], rounds=1).fit.values
    passed = passed_on(cast(Driven, question.fit), refitted, density, np.random.default_rng(0))
    told = {
        c: with_input(n if isinstance(n, RestNoise) else white_noise(question.fit.blocks, c, n).std, passed[c])
        for c, n in own.items()
        if n is not None
    }
    for model in (question.fit, question.heldout):
        model.blocks[:] = [replace(b, noise=told.get(b.channel)) for b in model.blocks]
    size_of = {c: float(np.sqrt(passed[c][0])) for c in told}
    parts = ", ".join(
        f"{size_of[c]:.2g} {b.unit} of {c}" for c, b in {b.channel: b for b in question.fit.blocks}.items() if c in told
    )
    said = (
        f"the recorded {channel.replace('_', ' ')} drives the simulator: its noise, and what smoothing it over "
        f"{drives[0].width} samples takes away, make {parts}, and count as noise there"
    )
    return replace(question, notes=(*question.notes, said))
