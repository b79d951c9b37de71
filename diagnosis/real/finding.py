"""What was found on one recording, as numbers and as curves, for a page."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.engine import Examined, examine
from cable_envs.diagnosis.evidence.candidates import log_odds, under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.weights import rmse
from cable_envs.diagnosis.model.verdict import Diagnosis, EffectGain, Trace
from cable_envs.diagnosis.search.comparison import refits


def inside(steps: Sequence[EffectGain]) -> tuple[str, ...]:
    """Hypotheses that are in after the last step, in the order in which they came."""
    found: list[str] = []
    for step in steps[1:]:
        found = [name for name in (*found, step.hypothesis.name) if name not in step.dropped]
    return tuple(found)


@dataclass(frozen=True)
class Finding:
    """The answer for one recording.

    Parameters
    ----------
    name, verdict, notes
        Of the recording and of its `Diagnosis`.
    steps : tuple of EffectGain
        The refit of the nominals, and each effect as it was accepted.
    alone : tuple of EffectGain
        Every hypothesis by itself on top of the nominals, with its RMS errors and log odds; the best first.
    refused : Mapping of str to str
        Why what is not named was refused.
    further : Mapping of str to float
        Log odds of what is not named, on top of what is.
    test : Mapping
        Odds and share of what is left, as of `Diagnosis`.
    again : tuple of str
        What is named when the diagnosis starts from the corrected rig (`named_again`).
    traces : tuple of Trace
        For figures.
    """

    name: str
    verdict: str
    steps: tuple[EffectGain, ...]
    alone: tuple[EffectGain, ...]
    refused: Mapping[str, str]
    further: Mapping[str, float]
    test: Mapping[str, Any]
    again: tuple[str, ...]
    traces: tuple[Trace, ...]
    notes: tuple[str, ...] = ()

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the accepted effects, in order."""
        return inside(self.steps)

    def as_json(self) -> dict[str, Any]:
        """All but the traces."""
        alone = [
            {"name": e.hypothesis.name, "fit": e.fit, "heldout": e.heldout, "log_odds": e.gain} for e in self.alone
        ]  # fmt: skip
        return {
            "name": self.name, "verdict": self.verdict, "steps": [step.as_step() for step in self.steps],
            "alone": alone, "refused": self.refused, "notes": self.notes, "named": list(self.named),
            "again": list(self.again), "left": {key: self.test[key] for key in ("log_odds_left", "share_left")},
        }  # fmt: skip


def find(
    name: str, recording: Recording, *, effects: Sequence[str] | None = None, without: Sequence[str] = (),
    tell: Callable[[str], None] = lambda text: None,
) -> Finding:  # fmt: skip
    """`cablebench diagnose` of a recording, and every hypothesis by itself on top of the nominals."""
    found = examine(recording, effects=effects, without=without, tell=tell)
    answer = found.diagnosis
    return Finding(
        name, answer.verdict, answer.steps, _alone(found), dict(found.selection.refused), dict(found.selection.further),
        answer.test, named_again(recording, answer, effects=effects, without=without), answer.traces, answer.notes,
    )  # fmt: skip


def named_again(
    recording: Recording, answer: Diagnosis, *, effects: Sequence[str] | None = None, without: Sequence[str] = ()
) -> tuple[str, ...]:
    """Effects that `cablebench diagnose --rig augmented.yaml` names, with the rig of an answer.

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
        found = examine(recording, effects=effects, without=without, rig=rig)
    return tuple(effect.hypothesis.name for effect in found.diagnosis.effects)


def _alone(found: Examined) -> tuple[EffectGain, ...]:
    """Every hypothesis refitted on top of the nominals, all in one batch; the largest log odds first."""
    question, selection = found.question, found.selection
    if selection.score_tests is None:
        return ()
    null = selection.null.fit
    known = {h.name: h for h in question.hypotheses}
    joint = Joint(question.fit, question.heldout)
    fits = list(refits(question.fit, null, selection.score_tests, question.nominals).items())
    best = max(range(len(fits)), key=lambda k: -fits[k][1].cost)
    models = [((), null), *(((known[name],), fit) for name, fit in fits)]
    bare, *others = under_one_noise(question.fit, joint, models, best + 1, {}, joint.left_by(null))
    gains = [
        EffectGain(one.effects[0], log_odds(one, bare), fit=rmse(question.fit, one.fit),
                   heldout=rmse(question.heldout, one.fit))
        for one in others
    ]  # fmt: skip
    return tuple(sorted(gains, key=lambda effect: -effect.gain))


def pick(traces: Sequence[Trace], channel: str, use: str) -> list[Trace]:
    """The traces of one channel and use."""
    return [t for t in traces if t.channel == channel and t.use == use]
