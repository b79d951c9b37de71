"""The next experiment: of the motions that the drive can make, the one whose record settles most of what is open."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.clocks.one_clock import on_one_clock
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.engine import averaged_if_long
from cable_envs.diagnosis.experiment.bench import Bench, Planned
from cable_envs.diagnosis.experiment.motions import FAMILIES, Limits, Motion, draw
from cable_envs.diagnosis.experiment.plan import Plan, least
from cable_envs.diagnosis.experiment.rivals import Rival, compared, names_of, rivals
from cable_envs.diagnosis.experiment.settings import AS_RECORDED, checked, with_units
from cable_envs.diagnosis.experiment.worth import Told, divergences, narrowing
from cable_envs.diagnosis.intake.converged import converged
from cable_envs.diagnosis.model.verdict import Diagnosis
from cable_envs.diagnosis.search.known.noise import told_at_rest
from cable_envs.diagnosis.systems.question import stated_of

DRAWN = 48
"""Motions that are drawn, all families in turn."""
KEPT, NEAR, ROUNDS = 3, 4, 2
"""Of these the best are varied, so many variants of each, in so many rounds; each with half the spread."""
SPREAD = 0.15
"""Of the first variants, in the numbers of a motion that are drawn from [0, 1]."""
LONGEST = 120.0
"""s of a motion at the most, unless asked for."""
FINE = 1e-3
"""s from row to row of a reference, at the most: a drive goes straight between rows, and straight lines of 10 ms change
the force of its controller by more than a sensor's noise."""


@dataclass(frozen=True)
class _Tried:
    """A motion that was simulated, and what it is worth."""

    planned: Planned
    motion: Motion | None
    told: list[Told]
    worth: float


def next_experiment(
    recording: Recording,
    found: Diagnosis,
    *,
    between: Sequence[str] | None = None,
    seconds: float | None = None,
    limits: Mapping[str, float] | None = None,
    settings: Sequence[Mapping[str, float]] = (),
    seed: int = 0,
    tell: Callable[[str], None] = lambda text: None,
) -> Plan:
    """The motion to run next, so that its record settles what an answer leaves open.

    Models that the answer cannot tell apart are refitted to the records; motions within the limits of the drive are
    simulated under each of them; and the motion is chosen by which the true one of them, whichever it is, is expected
    to lead by most (`cable_envs.diagnosis.experiment.worth`). Where one model is left, the motion is chosen that
    narrows the widest interval of its effects by most.

    Parameters
    ----------
    recording : Recording
        That was diagnosed.
    found : Diagnosis
        Its answer.
    between : sequence of str, optional
        Hypotheses to tell apart, instead of those that the answer leaves open.
    seconds : float, optional
        Length of the motion; by default that of the recording's longest record, 120 s at the most.
    limits : Mapping of str to float, optional
        "low", "high", "speed", "acceleration" of the drive, in the SI unit of its place; by default those that the
        records have shown. And "frequency", Hz of the fastest sine; by default 20 samples resolve its wave.
    settings : sequence of Mapping of str to float, optional
        What else of the rig can be set before the motion is run, for example another pretension or weight: each a
        parameter's name and its value, SI, of one or more parameters that are set together. The motion is simulated
        under these, too.
    seed : int
        Of the motions that are drawn.
    tell : callable
        Called with what is being done.

    Returns
    -------
    Plan
        The reference to run, the setting to run it under, and what to expect of its record.

    Raises
    ------
    ConfigurationError
        Where the answer leaves nothing open, for unknown names, limits that no motion can keep to, settings that the
        rig cannot have, and recordings whose simulator is not driven by a command or a position alone.
    """
    require_known("limit", limits or {}, ("low", "high", "speed", "acceleration", "frequency"))
    if seconds is not None and not seconds > 0.0:
        raise ConfigurationError(f"seconds: expected a length above 0 s, got {seconds!r}")
    recording, _ = averaged_if_long(on_one_clock(recording)[0])
    request = request_of(recording)
    states = (AS_RECORDED, *checked(recording, request, settings))
    question = converged(told_at_rest(recording, ask(recording, request)))
    models = [(name,) for name in between] if between else names_of(found)
    channels = {b.channel for b in question.fit.blocks}
    stated = {n: s for n, s in stated_of(recording, question).items() if n in channels}
    open_ones = rivals(question, models, stated, tell)
    bench = Bench(recording, request, question, open_ones)
    allowed = replace(bench.shown(), **(limits or {}))
    tell(f"simulating motions under {len(open_ones)} models")
    run = _again(bench, AS_RECORDED)
    elsewhere = [] if limits or seconds else [t for one in states[1:] for t in _again(bench, one)]
    rng = np.random.default_rng(seed)
    tried = _search(bench, allowed, seconds, states, rng)
    if not tried and (limits or seconds or not run):
        raise ConfigurationError(
            "no motion within the limits could be simulated with all channels where they have been: state limits that "
            "are narrower (low, high, speed, acceleration, frequency)"
        )
    best = max([*tried, *elsewhere, *(() if limits or seconds else run)], key=lambda t: t.worth)
    again = max(run, key=lambda t: t.worth, default=best)
    tell("rehearsing the experiment")
    expected, repeated = (_rehearsed(bench, open_ones, one, stated, rng) for one in (best, again))
    return _plan(bench, open_ones, best, (expected, repeated), allowed, len(tried) + len(run) + len(elsewhere))


def _rehearsed(
    bench: Bench, open_ones: Sequence[Rival], one: _Tried, stated: Mapping[str, float], rng: np.random.Generator
) -> np.ndarray:
    """Log odds of every rival over the others by all records and one that is simulated with it [rivals, rivals].

    The divergence is of models that are linear in their parameters, and of nothing but noise. Here all are refitted,
    and a part that nothing explains may take what it can.
    """
    found = np.zeros((len(open_ones), len(open_ones)))
    for k, rival in enumerate(open_ones if len(open_ones) > 1 else ()):
        record = bench.rehearsed(one.planned, rival, rng)
        both = replace(bench.recording, records=(*bench.recording.records, record))
        question = bench.resolve(told_at_rest(both, ask(both, bench.request)))
        behind = compared(question, open_ones, stated)
        found[k] = behind - behind[k]
    return found


def _again(bench: Bench, setting: Mapping[str, float]) -> list[_Tried]:
    """The motions that were run, once more."""
    planned = [Planned(f"{r.name}, again", bench.place(r), r, setting) for r in bench.run]
    return _worth(bench, planned, [None] * len(planned))


def _search(
    bench: Bench, limits: Limits, seconds: float | None, states: Sequence[Mapping[str, float]],
    rng: np.random.Generator,
) -> list[_Tried]:  # fmt: skip
    """Motions that were drawn, and variants of the best."""
    longest = max(r.time[-1] - r.time[0] for r in bench.run)
    length = min(longest, LONGEST) if seconds is None else seconds
    count = max(int(length / bench.period) + 1, 2)

    def simulated(
        motions: Sequence[Motion], like: Sequence[tuple[Record, Mapping[str, float]]], turn: int
    ) -> list[_Tried]:
        planned = []
        for k, (motion, (record, setting)) in enumerate(zip(motions, like, strict=True)):
            start = float(np.clip(bench.place(record)[0], limits.low, limits.high))
            place = motion.samples(limits, start, bench.period, count)
            planned.append(Planned(f"planned {turn}.{k}", place, record, setting))
        return _worth(bench, planned, motions)

    kinds = list(product(_kinds(bench), states))
    found = simulated(draw(rng, DRAWN), [kinds[k // len(FAMILIES) % len(kinds)] for k in range(DRAWN)], 0)
    for turn in range(1, ROUNDS + 1):
        best = sorted(found, key=lambda t: -t.worth)[:KEPT]
        near = [(t.motion.near(rng, SPREAD / 2 ** (turn - 1)), t) for t in best for _ in range(NEAR) if t.motion]
        found += simulated([m for m, _ in near], [(t.planned.like, t.planned.settings) for _, t in near], turn)
    return found


def _kinds(bench: Bench) -> list[Record]:
    """One record of every set of conditions."""
    seen: dict[str, Record] = {}
    for record in bench.run:
        seen.setdefault(repr(sorted(record.conditions.items())), record)
    return list(seen.values())


def _worth(bench: Bench, planned: Sequence[Planned], motions: Sequence[Motion | None]) -> list[_Tried]:
    found = []
    for one, motion, told in zip(planned, motions, bench.told(planned), strict=False):
        if told is not None:
            found.append(_Tried(one, motion, told, _value(bench.rivals, told)))
    return found


def _value(open_ones: Sequence[Rival], told: Sequence[Told]) -> float:
    """The least log odds to be expected of all records; of one model, how far its widest interval narrows.

    A rival that is behind so far has less than the new record brings.
    """
    if len(open_ones) > 1:
        behind = np.array([r.behind for r in open_ones])
        return least(divergences(told) + behind[None, :] - behind[:, None], behind)
    own = _of_effects(open_ones[0])
    return -float(np.log(max(narrowing(told[0])[own].max(), 1e-300)))


def _of_effects(rival: Rival) -> list[int]:
    """Which of a rival's free parameters are of its effects."""
    names = {n for h in rival.candidate.effects for n in h.names}
    return [k for k, n in enumerate(rival.candidate.peak.free) if n in names]


def _plan(
    bench: Bench, open_ones: Sequence[Rival], best: _Tried, odds: tuple[np.ndarray, np.ndarray], limits: Limits,
    count: int,
) -> Plan:  # fmt: skip
    lead, told = open_ones[0].candidate, best.told[0]
    before = np.sqrt(np.maximum(np.diag(told.covariance), 0.0))
    narrowed = {
        lead.peak.free[k]: (float(before[k]), float(before[k] * narrowing(told)[k])) for k in _of_effects(open_ones[0])
    }
    channel = bench.recording.channels[bench.channel]
    time, values = _rows(bench.input(best.planned.place), bench.period, bench.is_rate or channel.hold == "step")
    return Plan(
        "tell apart" if len(open_ones) > 1 else "narrow", tuple(r.name for r in open_ones),
        tuple(r.behind for r in open_ones), *odds,
        narrowed, best.motion.family if best.motion else best.planned.name,
        channel, time, values, limits,
        best.planned.like.conditions, best.planned.like.name, count,
        with_units(bench.recording, bench.request, best.planned.settings),
    )  # fmt: skip


def _rows(values: np.ndarray, period: float, as_sampled: bool) -> tuple[np.ndarray, np.ndarray]:
    """(s, the reference) at every row: a place is smooth between samples; a rate may go straight, or be held."""
    at = period * np.arange(len(values))
    parts = int(np.ceil(period / FINE - 1e-9))
    if as_sampled or parts == 1:
        return at, values
    time = period / parts * np.arange(parts * (len(values) - 1) + 1)
    return time, CubicSpline(at, values)(time)
