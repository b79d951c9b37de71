"""What was found on one recording, as numbers and as curves, for a page: the diagnosis that unseen records judge."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.data.recording import Recording
from diagnosis.engine import examine
from diagnosis.fit.likelihood import Judged
from diagnosis.fit.score_tests import screen
from diagnosis.fit.weights import rmse, weigh
from diagnosis.model.verdict import Step, Trace
from diagnosis.search.comparison import refits
from diagnosis.search.stepwise import held
from diagnosis.systems.question import Question


@dataclass(frozen=True)
class Alone:
    """One hypothesis by itself on top of the nominals: RMS error by channel, SI, and its held-out gain."""

    name: str
    fit: Mapping[str, float]
    heldout: Mapping[str, float]
    gain: float


@dataclass(frozen=True)
class Finding:
    """The answer for one recording. ``left``: why what is not named was refused."""

    name: str
    verdict: str
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
    name: str, recording: Recording, *, effects: Sequence[str] | None = None, without: Sequence[str] = (),
    tell: Callable[[str], None] = lambda text: None,
) -> Finding:  # fmt: skip
    """`cablebench diagnose --judge unseen` of a recording, and every hypothesis by itself on top of the nominals."""
    found = examine(recording, effects=effects, without=without, judge="unseen", tell=tell)
    answer = found.diagnosis
    return Finding(
        name, answer.verdict, answer.steps, _alone(found.question, found.selection.null), dict(found.selection.refused),
        answer.traces, answer.notes,
    )  # fmt: skip


def _alone(question: Question, null: Judged) -> tuple[Alone, ...]:
    """Every hypothesis refitted on top of the nominals, all in one batch; best gain first."""
    whitener = weigh(question.fit.blocks, null.raw)
    screening = screen(question.fit, null, question.hypotheses, np.random.default_rng(0), whitener)
    before = held(question.heldout, null.fit)
    found = [
        Alone(n, rmse(question.fit, f), rmse(question.heldout, f), before.gain(held(question.heldout, f)))
        for n, f in refits(question.fit, null.fit, screening, None).items()
    ]
    return tuple(sorted(found, key=lambda a: -a.gain))


def pick(traces: Sequence[Trace], channel: str, use: str) -> list[Trace]:
    """The traces of one channel and use."""
    return [t for t in traces if t.channel == channel and t.use == use]
