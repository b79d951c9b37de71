"""What was found on one recording, as numbers and as curves, for a page: the diagnosis that unseen records judge."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.engine import examine
from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.fit.weights import rmse, weigh
from cable_envs.diagnosis.model.verdict import Diagnosis, EffectGain, Trace
from cable_envs.diagnosis.search.comparison import refits
from cable_envs.diagnosis.search.stepwise import heldout_error
from cable_envs.diagnosis.systems.question import Question


@dataclass(frozen=True)
class Finding:
    """The answer for one recording.

    Parameters
    ----------
    name, verdict, notes
        Of the recording and of its `Diagnosis`.
    steps : tuple of EffectGain
        Of the stepwise selection, the refit of the nominals first.
    alone : tuple of EffectGain
        Every hypothesis by itself on top of the nominals, with its RMS errors and held-out gain; the best first.
    left : Mapping of str to str
        Why what is not named was refused.
    further : Mapping of str to float
        Held-out gain of what is not named, on top of what is.
    again : tuple of str
        What is named when the diagnosis starts from the corrected rig (`named_again`).
    traces : tuple of Trace
        For figures.
    """

    name: str
    verdict: str
    steps: tuple[EffectGain, ...]
    alone: tuple[EffectGain, ...]
    left: Mapping[str, str]
    further: Mapping[str, float]
    again: tuple[str, ...]
    traces: tuple[Trace, ...]
    notes: tuple[str, ...] = ()

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the accepted effects, in order."""
        return tuple(step.hypothesis.name for step in self.steps[1:])

    def as_json(self) -> dict[str, Any]:
        """All but the traces."""
        alone = [
            {"name": e.hypothesis.name, "fit": e.fit, "heldout": e.heldout, "gain": e.gain} for e in self.alone
        ]  # fmt: skip
        return {
            "name": self.name, "verdict": self.verdict, "steps": [step.as_step() for step in self.steps],
            "alone": alone, "left": self.left, "notes": self.notes, "named": list(self.named),
            "again": list(self.again),
        }  # fmt: skip


def find(
    name: str, recording: Recording, *, effects: Sequence[str] | None = None, without: Sequence[str] = (),
    tell: Callable[[str], None] = lambda text: None,
) -> Finding:  # fmt: skip
    """`cablebench diagnose --judge unseen` of a recording, and every hypothesis by itself on top of the nominals."""
    found = examine(recording, effects=effects, without=without, judge="unseen", tell=tell)
    answer = found.diagnosis
    return Finding(
        name, answer.verdict, answer.steps, _alone(found.question, found.selection.null), dict(found.selection.refused),
        dict(found.selection.further), named_again(recording, answer, effects=effects, without=without), answer.traces,
        answer.notes,
    )  # fmt: skip


def named_again(
    recording: Recording, answer: Diagnosis, *, effects: Sequence[str] | None = None, without: Sequence[str] = ()
) -> tuple[str, ...]:
    """Effects that `cablebench diagnose --judge unseen --rig augmented.yaml` names, with the rig of an answer.

    Parameters
    ----------
    recording : Recording
        That was diagnosed.
    answer : Diagnosis
        Its answer, whose corrected rig is written to a file and loaded from it.
    effects, without : sequence of str, optional
        As of that diagnosis.

    Returns
    -------
    tuple of str
        Names; none where the corrected rig has all that the records show of the library.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer.write(Path(folder))
        rig = Path(folder) / answer.augmented_rig
        found = examine(recording, effects=effects, without=without, rig=rig, judge="unseen")
    return tuple(step.hypothesis.name for step in found.diagnosis.steps[1:])


def _alone(question: Question, null: Judged) -> tuple[EffectGain, ...]:
    """Every hypothesis refitted on top of the nominals, all in one batch; best gain first."""
    whitener = weigh(question.fit.blocks, null.raw)
    scored = score_tests(question.fit, null, question.hypotheses, np.random.default_rng(0), whitener)
    before = heldout_error(question.heldout, null.fit)
    known, found = {h.name: h for h in question.hypotheses}, []
    for name, fit in refits(question.fit, null.fit, scored, None).items():
        gain = before.gain(heldout_error(question.heldout, fit))
        of_fit, of_heldout = rmse(question.fit, fit), rmse(question.heldout, fit)
        found.append(EffectGain(known[name], gain, gain, fit=of_fit, heldout=of_heldout))
    return tuple(sorted(found, key=lambda effect: -effect.gain))


def pick(traces: Sequence[Trace], channel: str, use: str) -> list[Trace]:
    """The traces of one channel and use."""
    return [t for t in traces if t.channel == channel and t.use == use]
