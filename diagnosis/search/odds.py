"""Log odds of a further effect: those of the evidence, less that one of many would do and that laws are formulated.

Friction begins, and what stretches does so, a little otherwise in every formulation. An effect beside others that
explains no more than such a difference may be nothing but that (`FORMULATION`).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.evidence.candidates import Candidate, agreement, log_odds, prior_width
from cable_envs.diagnosis.evidence.joint import Joint, sizes_of
from cable_envs.diagnosis.evidence.marginal import Frame
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.verdict import SURE
from cable_envs.diagnosis.search.refits import Refits
from cable_envs.diagnosis.search.selection import FORMULATION

TWICE = 2.0
"""Times `FORMULATION` by which no formulation differs."""
CLEAR = 100.0
"""Log odds from which no formulation is asked for: on recordings of generator A no effect that had more was wrong, of
51 (see `SUREST`)."""


class Odds:
    """The odds of one search.

    Parameters
    ----------
    refits : Refits
        Its refits.
    joint : Joint
        All records.
    bare : sequence of ndarray
        What the nominal refit leaves of them [T], by block.
    hypotheses : sequence of Hypothesis
        What may be missing.
    sure : float
        Log odds from which one model is preferred, where noise counts.
    lacking : mapping of str to float
        Channel -> RMS of what models leave without the effects that they have already (of a rig), SI.
    """

    def __init__(
        self, refits: Refits, joint: Joint, bare: Sequence[np.ndarray], hypotheses: Sequence[Hypothesis], sure: float,
        lacking: Mapping[str, float],
    ):  # fmt: skip
        self._refits, self._joint, self._bare, self._sure, self._lacking = refits, joint, bare, sure, lacking
        self.prior = -float(np.log(max(sum(1 + len(h.parts) for h in hypotheses), 1)))

    def sure(self, candidate: Candidate) -> float:
        """Log odds from which one model is preferred: no noise is learnt where the size of all that is left counts."""
        return float(np.log(SURE)) if candidate.by_size else self._sure

    def told_from_logger(self, best: Candidate) -> float:
        """Log odds from which a model is told from what a logger may have made: more than filters are formulated by."""
        least = self.sure(best)
        return least if best.by_size else max(least, min(FORMULATION**2 * self.explained(best, laws=False), CLEAR))

    def of(self, fuller: Candidate, rest: Candidate) -> float:
        """Log odds of a further effect: one of many would do, and laws may be formulated otherwise."""
        return log_odds(fuller, rest) + self.prior - self._formulation(fuller, rest)

    def over_formulation(self, fuller: Candidate, rest: Candidate) -> float:
        """Log odds that what an effect explains is more than how the others are formulated: normal, of that share."""
        most = self._formulation(fuller, rest)
        return 0.5 * max(log_odds(fuller, rest), 0.0) / most if most > 0.0 else np.inf

    def explained(self, candidate: Candidate, laws: bool = True) -> float:
        """What effects explain, the rig's too: half the fall of the whitened sum of squares; ``laws``: no logger's."""
        frame, bare = candidate.frame, self._bare
        loggers = tuple(h for h in candidate.effects if h.of_logger)
        if laws and loggers:
            bare = self._joint.raw(self._refits.only(loggers, candidate))
        rest = frame.whitener.flat(frame.blocks, bare)
        return max(candidate.plain.fit + 0.5 * float(rest @ rest), 0.0) + self.of_the_rig(frame)

    def of_the_rig(self, frame: Frame) -> float:
        """The same of the effects that a rig has already; floors stand for noise that these would have had."""
        left, found = sizes_of(self._joint.blocks, self._bare), 0.0
        for channel, size in self._lacking.items():
            if channel in left:
                count = sum(int(b.good.sum()) for b in frame.blocks if b.channel == channel)
                found += 0.5 * count * max(size**2 - left[channel] ** 2, 0.0) / frame.whitener.noise[channel].floor ** 2
        return found

    def _formulation(self, fuller: Candidate, rest: Candidate) -> float:
        """Log odds that an effect may have and be how those beside it are formulated; less if it gains more."""
        if rest.by_size:
            return 0.0
        laws = not any(h.of_logger for h in fuller.effects if h not in rest.effects)
        gain = max(fuller.plain.fit - rest.plain.fit, 0.0)
        return min(max(FORMULATION**2 * self.explained(rest, laws) - gain / TWICE**2, 0.0), CLEAR)


def alike(h: Hypothesis, one: Candidate, other: Candidate, odds: float) -> float:
    """Log odds of a hypothesis; that all channels ask for one size of it, where these could be sure and are not."""
    if not h.alike or one.by_size:
        return odds
    (p,) = h.free
    size = abs(one.peak.values[p.name] - h.nulls[p.name])
    found, most = agreement(one, other, prior_width(p, size) / max(size, 1e-300))
    return min(odds, found) if found < np.log(SURE) < most else odds
