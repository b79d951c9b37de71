"""What a search finds, and the selection made of it: the steps to the last model, the odds, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cable_envs.diagnosis.evidence.bands import Bands
from cable_envs.diagnosis.evidence.candidates import CALIBRATED, Candidate
from cable_envs.diagnosis.evidence.likely import EVEN
from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.fit.score_tests import ScoreTests
from cable_envs.diagnosis.model.hypotheses import Hypothesis, effect_name
from cable_envs.diagnosis.model.leftover import DRIFT, Left
from cable_envs.diagnosis.model.verdict import SURE, EffectGain
from cable_envs.effects import EFFECTS

FORMULATION = 0.1
"""Share of what effects change by which two formulations of one law may differ: how friction begins, what stretches.
A further effect may explain its square of the sum of squares that the others do, and be nothing but that."""
SUREST = 0.98
"""No answer is surer. On recordings of generator A none of 51 effects was wrong that had log odds above 100 where the
noise was learnt (26), or was taken where it was known (25): (n + 1) / (n + 2), Laplace's rule of succession."""
REST = 0.05
"""Share of what was to be explained from which what is left is part of the answer."""
MOST = 0.25
"""Share of it that may be left when something is named."""


@dataclass(frozen=True)
class Round:
    """A step forward: the model on which it stands, and the log odds over it of those with one effect more."""

    base: Candidate
    odds: Mapping[str, float]
    score_tests: ScoreTests | None
    bounded: Mapping[str, str]
    """hypothesis -> what speaks against it"""
    others: Sequence[Candidate] = ()
    """of the first step: those with one effect more; they are compared under the noise of the first"""


@dataclass(frozen=True)
class Found:
    """The last model, with the odds that an answer needs.

    Parameters
    ----------
    null : Judged
        The refit of the nominal parameters.
    bare, best : Candidate
        Without effects, and with those that are found, under one noise.
    rounds : tuple of Round
        Every step forward; the last one is of the step that found nothing.
    without : Mapping of str to float
        Effect -> log odds of the best model over the same without it.
    rivals : Mapping of str to Mapping
        Effect -> other hypotheses -> log odds of the best model over them in its place.
    sure : float
        Log odds from which one model is preferred.
    over_formulation : Mapping of str to float
        Effect beside others -> log odds that what it explains is more than these being formulated otherwise.
    """

    null: Judged
    bare: Candidate
    best: Candidate
    rounds: tuple[Round, ...]
    without: Mapping[str, float] = field(default_factory=dict)
    rivals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sure: float = float(np.log(SURE))
    over_formulation: Mapping[str, float] = field(default_factory=dict)

    @property
    def learnt(self) -> bool:
        """Whether the noise is learnt from what the best model leaves: odds are then less than they say."""
        return self.sure > np.log(SURE)

    def alternatives(self, name: str) -> tuple[str, ...]:
        """Hypotheses that the records do not tell from an effect."""
        return tuple(n for n, odds in self.rivals.get(name, {}).items() if odds < self.excluded)

    def against(self, name: str) -> list[float]:
        """Log odds of the best model over all that have neither an effect nor one of its alternatives."""
        clear = [odds for odds in self.rivals.get(name, {}).values() if odds >= self.excluded]
        return [self.without[name], *clear]

    @property
    def excluded(self) -> float:
        """Log odds from which a rival is excluded: where the noise is learnt, if that is rather right than wrong.

        A name whose rival is closer has a confidence below `EVEN`, while the two of them together may be sure.
        """
        return max(self.sure, even_odds()) if self.learnt else self.sure


@dataclass(frozen=True)
class Selection:
    """The selected model, and why.

    Parameters
    ----------
    null, final : Judged
        Without effects and with those that were accepted; covariances are those of the evidence.
    accepted : tuple of EffectGain
        The effects of the last model; gains and margins are log odds.
    faults : tuple of EffectGain
        What it has of the logger (`cable_envs.diagnosis.intake.logged`).
    before, after : Left
        What the two leave.
    score_tests : ScoreTests, optional
        Of all hypotheses on top of the nominal refit.
    tried : Mapping of str to float
        Hypothesis -> log odds of the model with it over the nominal one, or over the last one where it was compared
        only there.
    further : Mapping of str to float
        Hypothesis -> log odds of the last model with it over the last model.
    refused : Mapping of str to str
        Hypothesis -> what speaks against it, whatever it gains.
    steps : tuple of EffectGain
        The refit without effects, and with each that was accepted, in order.
    unpredicted : tuple of str
        Channels that the last model predicts worse than their own mean does.
    worse : bool
        Whether the last model predicts unseen records worse than the model as it was claimed.
    as_claimed : bool
        Whether the refit of the nominals did, so that ``null`` is the claim.
    constants : tuple of EffectGain
        Biases of sensors that the last model has, and that may be how an effect beside them is formulated.
    left_out : tuple of EffectGain
        Faults of channels that an earlier selection has found, and without which this one is made.
    bands : Bands, optional
        Spectra of the last model, where it was compared by these (`cable_envs.diagnosis.search.limit_cycles`).
    """

    null: Judged
    final: Judged
    accepted: tuple[EffectGain, ...]
    faults: tuple[EffectGain, ...]
    before: Left
    after: Left
    score_tests: ScoreTests | None = None
    tried: Mapping[str, float] = field(default_factory=dict)
    further: Mapping[str, float] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)
    steps: tuple[EffectGain, ...] = ()
    unpredicted: tuple[str, ...] = ()
    worse: bool = False
    as_claimed: bool = False
    constants: tuple[EffectGain, ...] = ()
    left_out: tuple[EffectGain, ...] = ()
    bands: Bands | None = None

    @property
    def taken(self) -> tuple[EffectGain, ...]:
        """All that the last model has more than the nominal one."""
        return (*self.accepted, *self.faults, *self.constants)

    @property
    def redundant(self) -> tuple[EffectGain, ...]:
        """Faults of channels that are left out, so that the rest is asked again."""
        return tuple(fault for fault in self.faults if fault.hypothesis.redundant)

    @property
    def more(self) -> bool:
        """Whether something is left beyond noise."""
        return self.after.log_odds > np.log(SURE)

    @property
    def verdict(self) -> str:
        """One of `cable_envs.diagnosis.model.verdict.VERDICTS`."""
        of_rig = self.more and not self.after.cause
        if not self.accepted:
            return self._without_effects(of_rig)
        if self._drifts_more():
            return "data_fault"
        if self.worse or self.unpredicted or self._like_others() or (of_rig and self.after.share > MOST):
            return "unknown"
        if max(a.confidence for a in self.accepted) < EVEN:
            return "unknown"
        if of_rig and self.after.share > REST and self.bands is None:
            return "partly_named"
        return "equivalence_class" if any(a.alternatives for a in self.accepted) else "named"

    def _without_effects(self, of_rig: bool) -> str:
        if of_rig and self.after.share > REST:
            return "unknown"
        faulty = self.faults or self.left_out or (self.more and self.after.cause)
        return "data_fault" if faulty else "no_detectable_mismatch"

    def _drifts_more(self) -> bool:
        """Whether a sensor's drift is surer than every effect: what is slow is then no sure sign of any."""
        drifts = self.more and self.after.cause.endswith(DRIFT)
        return drifts and self.after.log_odds > max(a.gain for a in self.accepted)

    def _like_others(self) -> bool:
        """Whether the effect with the largest odds cannot be distinguished from one that is not declared alike.

        Unlike laws that do as well are signs of another one, that is none of them.
        """
        lead = max(self.accepted, key=lambda a: a.gain)
        mine = lead.hypothesis
        return any(effect_name(n) != mine.canonical and not self._declared(mine, n) for n in lead.alternatives)

    def _declared(self, mine: Hypothesis, other: str) -> bool:
        scored = None if self.score_tests is None else self.score_tests.best.get(other)
        theirs = EFFECTS.get(effect_name(other)) if scored is None else scored.hypothesis
        return effect_name(other) in mine.confusable or (theirs is not None and mine.canonical in theirs.confusable)


def even_odds() -> float:
    """Log odds that give a confidence of `EVEN`, where the noise is learnt."""
    constant, slope = CALIBRATED
    return float(np.exp((np.log(EVEN / (1.0 - EVEN)) - constant) / slope))


def confidence(against: Sequence[float], learnt: bool = False, over_formulation: float = np.inf) -> float:
    """Probability of what has these log odds against all else, `SUREST` at the most.

    learnt: whether the noise was, so that the odds are less than they say (`CALIBRATED`).
    over_formulation: log odds over other effects being formulated otherwise.
    """
    posterior = float(1.0 / (1.0 + np.sum(np.exp(-np.clip([*against, over_formulation], 0.0, 50.0)))))
    if not learnt:
        return min(SUREST, posterior)
    constant, slope = CALIBRATED
    logit = constant + slope * float(np.log(max(min(against), 1.0)))
    return min(SUREST, posterior, 1.0 / (1.0 + float(np.exp(-logit))))
