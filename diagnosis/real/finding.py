"""What was found on one recording, as numbers and as curves: the ladder of `diagnosis.real.stepwise` for a page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diagnosis.hypotheses import Hypothesis
from diagnosis.likelihood import raw_residuals
from diagnosis.model import Block, Model
from diagnosis.models.question import Question
from diagnosis.real.stepwise import Rung, judge, ladder, rmse, settle
from diagnosis.refit import Fit, Start, refit


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval, in ``unit``."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Step:
    """One accepted effect; the first step is the refit of the nominal parameters alone, named "".

    gain, confidence | held-out fall of the sum of squares in independent stretches; share of it among all rivals
    alike            | other names that these records do not tell from it
    fit, heldout     | RMS error by channel, SI
    parameters       | those that were free at this step
    rivals           | gain of every hypothesis that was refitted at this step
    """

    name: str
    gain: float
    confidence: float
    alike: tuple[str, ...]
    fit: Mapping[str, float]
    heldout: Mapping[str, float]
    parameters: Mapping[str, Estimate]
    rivals: Mapping[str, float]


@dataclass(frozen=True)
class Alone:
    """One hypothesis by itself on top of the nominals: RMS error by channel, SI, and its held-out gain."""

    name: str
    fit: Mapping[str, float]
    heldout: Mapping[str, float]
    gain: float


@dataclass(frozen=True)
class Trace:
    """One block of one record: time s, measured, and the predictions of the first and the last step, each [T]."""

    record: str
    use: str
    channel: str
    unit: str
    time: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray
    final: np.ndarray
    along: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Finding:
    """The answer for one recording. ``left``: why what is not named was refused."""

    name: str
    steps: tuple[Step, ...]
    alone: tuple[Alone, ...]
    left: Mapping[str, str]
    traces: tuple[Trace, ...]
    notes: tuple[str, ...] = ()

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the accepted effects, in order."""
        return tuple(step.name for step in self.steps[1:])


def find(
    name: str, question: Question, *, most: int = 6, tell: Callable[[str], None] = lambda text: None
) -> Finding:  # fmt: skip
    """Climb the ladder from the question's nominals, and try every hypothesis by itself."""
    rungs = ladder(question.fit, question.heldout, question.nominals, question.hypotheses, most=most, tell=tell)
    steps = tuple(_step(rung, question.units) for rung in rungs)
    alone = _alone(question, rungs[0].fit)
    traces = _traces(question, rungs[0].fit, rungs[-1].fit)
    return Finding(name, steps, alone, dict(rungs[-1].refused), traces, question.notes)


def _step(rung: Rung, units: Mapping[str, str]) -> Step:
    fit = rung.fit
    parameters = {n: Estimate(fit.values[n], *fit.interval(n), units.get(n, "")) for n in fit.free}
    return Step(rung.name, rung.gain, rung.confidence, rung.alike, *rung.rmse, parameters, dict(rung.rivals))


def _alone(question: Question, base: Fit) -> tuple[Alone, ...]:
    """Every hypothesis refitted from its best two probes, all in one batch; best gain first."""
    _, whitener = settle(question.fit, Start("", base.free, base.values))
    starts = []
    for hypothesis in question.hypotheses:
        free = (*base.free, *(n for n in hypothesis.names if n not in base.free))
        for values in _best_probes(question.fit, base, hypothesis):
            starts.append(Start(hypothesis.name, free, values))
    best: dict[str, Fit] = {}
    for fit in refit(question.fit, whitener, starts):
        if fit.label not in best or fit.cost < best[fit.label].cost:
            best[fit.label] = fit
    before = judge(question.heldout, base)
    found = [
        Alone(n, rmse(question.fit, f), rmse(question.heldout, f), before.gain(judge(question.heldout, f)))
        for n, f in best.items()
    ]
    return tuple(sorted(found, key=lambda a: -a.gain))


def _best_probes(model: Model, base: Fit, hypothesis: Hypothesis, most: int = 2) -> list[dict[str, float]]:
    """Values of the probes that leave the least, channels weighed by their size."""
    tried = [{**base.values, **{k: v for d in probe for k, v in d.items()}} for probe in hypothesis.probes]
    predictions = model.predict(np.array([[t[p.name] for t in tried] for p in model.parameters]))
    cost = np.zeros(len(tried))
    for block, prediction in zip(model.blocks, predictions, strict=True):
        left = (block.measured[:, None] - prediction)[block.good]
        cost += np.mean(left**2, axis=0) / max(float(np.var(block.measured[block.good])), 1e-300)
    return [tried[k] for k in np.argsort(cost)[:most]]


def _traces(question: Question, nominal: Fit, final: Fit) -> tuple[Trace, ...]:
    found = []
    for use, model in (("fit", question.fit), ("heldout", question.heldout)):
        left = zip(model.blocks, raw_residuals(model, nominal), raw_residuals(model, final), strict=True)
        for block, before, after in left:
            found.append(_trace(use, block, before, after))
    return tuple(found)


def _trace(use: str, block: Block, before: np.ndarray, after: np.ndarray) -> Trace:
    along = {c.name: c.values for c in block.along}
    return Trace(
        block.record, use, block.channel, block.unit, block.time, block.measured, block.measured - before,
        block.measured - after, along,
    )  # fmt: skip


def pick(traces: Sequence[Trace], channel: str, use: str) -> list[Trace]:
    """The traces of one channel and use."""
    return [t for t in traces if t.channel == channel and t.use == use]
