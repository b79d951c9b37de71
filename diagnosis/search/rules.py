"""What is asked of an answer, in numbers; found on recordings that are spent for proofs (docs/diagnosis.md)."""

from dataclasses import dataclass, replace

from cable_envs.diagnosis.adequacy.tests import Adequacy
from cable_envs.diagnosis.model.hypotheses import Hypothesis


@dataclass(frozen=True)
class Rules:
    """Limits of a selection.

    gain      | least fall of the deviance for an effect to be accepted, and for each further parameter that it has
    coloured  | as ``gain``, where the noise has a colour: it takes what lasts, learnt of a bias all but some 40
    rest      | as ``gain``, where a record at rest tells the colour: nothing of the mismatch is in it
    drifts    | least gain from which what changes with the elapsed time alone is named; below that: unknown. Under a
              | noise whose colour is learnt, a leaking load, a warm cable and a sagging supply gained 41 to 74 as a
              | friction that drifts (recordings that no proof uses)
    further   | as ``gain``, for a further effect
    share     | least gain of a further effect over that of all before it
    again     | comparisons, at the most: what was given up because of a hypothesis that is refused is compared again
    margin    | fall of the deviance by which an effect must beat another to be told from it
    alike     | ``margin`` as a share of its gain: the formulation of either is a little wrong
    declared  | ``alike`` of effects declared to look alike: what tells them apart is smaller than a formulation
    left_p    | familywise p-value below which what is left is not noise
    alone_p   | ``left_p`` where nothing is named
    hidden_p  | ``left_p`` and ``alone_p`` where the noise has a colour, known from rest or learnt: it hides much
    alone     | least excess of what is left for "unknown" where nothing is named: two formulations differ a little;
              | where a record at rest tells the noise the p-value by itself decides
    left      | share of all that was to be explained, which may be left when something is named
    drifted   | ``left`` when what changes with the elapsed time alone is, or a constant is that still drifts: either
              | explains much of a drift of another kind
    limit_cycle | ``left`` of a simulator that oscillates by itself: nothing has adapted it to the recording's cycle
    over      | RMS over the stated noise up to which a model may be right
    beside    | what a model with an effect in it may have more: impacts in a gap are no two times the same
    clean     | p-value above which, with an RMS over the stated noise below ``white``, no further effect is looked for
    most      | effects at the most
    """

    gain: float = 40.0
    coloured: float = 30.0
    rest: float = 21.0
    drifts: float = 80.0
    further: float = 60.0
    each: float = 4.0
    share: float = 0.15
    margin: float = 10.0
    alike: float = 0.01
    declared: float = 0.1
    left_p: float = 1e-6
    alone_p: float = 1e-6
    hidden_p: float = 1e-3
    alone: float = 35.0
    left: float = 0.22
    drifted: float = 0.05
    limit_cycle: float = 0.35
    over: float = 1.08
    beside: float = 0.1
    clean: float = 0.05
    white: float = 1.04
    most: int = 2
    again: int = 3

    def under(self, at_rest: bool, stated: bool) -> "Rules":
        """The same where a record at rest tells the noise, or the recording states it; where neither, it is learnt."""
        rules = self
        if at_rest or not stated:
            hidden, gain = max(self.hidden_p, self.left_p), self.rest if at_rest else self.coloured
            rules = replace(self, gain=min(self.gain, gain), left_p=hidden, alone_p=max(hidden, self.alone_p))
        if at_rest or stated:
            rules = replace(rules, drifts=rules.gain)
        return replace(rules, alone=0.0) if at_rest else rules

    def least(self, hypothesis: Hypothesis | None, so_far: float) -> float:
        """Least gain of a hypothesis (of any, for None) on top of effects that gained ``so_far``."""
        numbers = 0 if hypothesis is None else len(hypothesis.free) - 1
        return max((self.further if so_far > 0.0 else self.gain) + self.each * numbers, self.share * so_far)

    def nothing_left(self, left: Adequacy) -> bool:
        """Whether nothing at all is left."""
        return left.p_value > self.clean and left.over_noise < self.white

    def adequate(self, after: Adequacy, explained: float, share: float) -> bool:
        """Whether what is left may stay: noise, or no more than a ``share`` of what was explained."""
        named = explained > 0.0
        if after.over_noise > self.over + (self.beside if named else 0.0):
            return False
        least = self.left_p if named else self.alone_p
        return after.p_value >= least or after.excess < (share * explained if named else self.alone)
