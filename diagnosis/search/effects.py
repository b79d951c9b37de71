"""Which effects a recording has evidence of: models with more and fewer effects, compared by their evidence.

1. The nominal parameters are refitted.
2. Every effect is scored against what is left (`fit.score_tests`), the best are refitted on top (`search.comparison`),
   and compared under one noise (`evidence.candidates`). The best is taken if its odds are above `SURE` to one.
3. Again on top of it, up to `MOST` effects. Where none is sure and something is left, two are asked together.
4. Each effect of the last model is left out, and exchanged for every other, given the rest. The best model stays.
   Exchanges that are not behind by `SURE` to one are alternatives.

An effect that may be in several places (`Hypothesis.parts`) is compared in each alone, and in all; the best counts.
What cannot be told from a fault of a channel that others tell as well is exchanged for the fault.
An effect that ends smaller than the records can tell (`Hypothesis.least`) is not taken. Refits move it, and so every
model is asked that is compared: it is not taken, and one that was taken is given up. Nor is it an alternative, but for
errors of sensors within their class (`search.tolerances`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cable_envs.diagnosis.evidence.candidates import (
    Candidate,
    best_of,
    log_odds,
    under_one_noise,
    with_central_slopes,
)
from cable_envs.diagnosis.evidence.joint import Joint, sizes_of
from cable_envs.diagnosis.evidence.rivals import over_rival
from cable_envs.diagnosis.fit.likelihood import Judged, refit_nominals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.model.verdict import SURE, SURE_WHERE_LEARNT
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.search.comparison import holds, smaller
from cable_envs.diagnosis.search.odds import Odds, alike
from cable_envs.diagnosis.search.refits import Effects, Keep, Refits
from cable_envs.diagnosis.search.selection import Found, Round
from cable_envs.diagnosis.search.starts import BETTER
from cable_envs.diagnosis.search.tolerances import with_tolerances

MOST = 8
"""Effects at the most."""
AHEAD = 2
"""Effects that are not sure alone, on top of which a second one is asked."""
EXCHANGES = 8
"""Rounds of leaving out and exchanging, at the most."""
MARGIN = 1.0
"""Log odds by which an exchange must be better: equals would be exchanged for ever."""
UNLIKE = "channels ask for different sizes of it"
"""What speaks against an effect that should be alike in all of them."""
NOTHING = 1.0
"""Half the fall of the sum of squares that a number brings by chance in one recording of six."""


class Search:
    """The search of the module.

    Parameters
    ----------
    fit, heldout : Model
        The records to fit, and those that are not fitted; both count.
    nominals : tuple of str
        Parameters that every refit moves.
    hypotheses : sequence of Hypothesis
        What may be missing.
    rng : numpy.random.Generator
        Of the score tests.
    stated : mapping of str to float
        Channel -> standard deviation of its noise, where the recording says it, SI.
    without : mapping of str to float, optional
        Channel -> RMS of what models leave without the effects that they have already (of a rig), SI. The scales of a
        discrepancy are counted in that; by default in what the nominal refit leaves.
    most : int
        Effects at the most.
    tell, keep : callable
        As of `cable_envs.diagnosis.search.select.select`.
    """

    def __init__(
        self, fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis],
        rng: np.random.Generator, *, stated: Mapping[str, float] | None = None,
        without: Mapping[str, float] | None = None, most: int = MOST,
        tell: Callable[[str], None] = lambda text: None, keep: Keep = lambda name, make: make(),
    ):  # fmt: skip
        self.fit, self.joint, self._nominals = fit, Joint(fit, heldout), nominals
        self._hypotheses, self._stated = tuple(hypotheses), dict(stated or {})
        self._lacking, self._most, self._tell, self._keep = dict(without or {}), most, tell, keep
        self._sizes: Mapping[str, float] = {}
        self.refits = Refits(fit, nominals, self._hypotheses, rng, tell, keep)
        self._given_up: set[str] = set()
        """effects that a last model had, smaller than the records can tell"""
        known = all(b.channel in self._stated or b.noise is not None for b in fit.blocks)
        self._sure = float(np.log(SURE)) if known else SURE_WHERE_LEARNT
        self.odds: Odds
        """of the search that runs, or has run"""

    def run(self, null: Judged | None = None) -> Found:
        """Search forward, then leave out and exchange until the best model stays; ``null``: the refit to begin with."""
        found = self._found(null)
        found = with_tolerances(found, self.fit, self.joint, self._hypotheses, self._stated, self._sizes)
        best = with_central_slopes(self.joint, found.best)
        return replace(found, best=best, bare=best if found.best is found.bare else found.bare)

    def _found(self, null: Judged | None) -> Found:
        if null is None:
            self._tell(stages.REFITTING)
            null = self._keep("null", partial(refit_nominals, self.fit, self._nominals))
        bare = self.joint.raw(null.fit)
        self._sizes = self._lacking or sizes_of(self.joint.blocks, bare)
        self.odds = Odds(self.refits, self.joint, bare, self._hypotheses, self._sure, self._lacking)
        rounds, effects, base = self._path(null)
        turn = rounds[-1]
        if not effects:
            return Found(null, turn.base, turn.base, tuple(rounds), sure=self.odds.sure(turn.base))
        alone = self._of_one(null, rounds) if self._led(rounds, effects) else None
        if alone is not None and base.fit.cost > alone.best.fit.cost - BETTER:
            return alone
        self._tell(stages.EXCHANGING)
        rest = EXCHANGES
        while True:
            found, better = self._settled(null, effects, base, tuple(rounds))
            small = {h.name for h in effects if smaller(h, found.best.fit)}
            rest -= 1
            if better is None or (rest <= 0 and not small):
                return found
            if not better.effects:
                return alone or Found(null, better, better, tuple(rounds), sure=self.odds.sure(better))
            self._given_up |= small
            effects, base = better.effects, self.refits.of(better, self.odds.sure(better))

    def _led(self, rounds: Sequence[Round], effects: Effects) -> bool:
        """Whether the one effect led from the start, and no logger may have made what it explains."""
        return len(rounds) == 2 and rounds[0].others[0].effects == effects and not self._may_be_made(rounds[0])

    def _path(self, null: Judged) -> tuple[list[Round], Effects, Judged]:
        """(the steps forward, the last one of which found nothing; the effects of the last model, and its refit)."""
        rounds: list[Round] = []
        base, effects = null, Effects()
        while True:
            turn, best = self._forward(base, effects)
            if len(rounds) > 1:  # of those between the first and the last only the odds are asked for
                rounds[-1] = replace(rounds[-1], base=rounds[-1].base.outline)
            rounds.append(turn if not rounds else replace(turn, others=()))
            if best is None and not effects:
                pair, best = self._pair(null, turn)
                rounds += pair
            if best is None:
                return rounds, effects, base
            effects, base = best.effects, self.refits.of(best, self.odds.sure(best))

    def _pair(self, null: Judged, turn: Round) -> tuple[list[Round], Candidate | None]:
        """(the step between, the best model with two effects of which neither is sure alone), if that is sure.

        A mismatch of two effects may be as much beside one of them as without: a function of the motion then explains
        what is left as well as the effect does, until the other one is there, too.
        """
        if turn.base.left < self.odds.sure(turn.base):
            return [], None
        ahead = sorted(turn.others, key=lambda c: -turn.odds[c.effects[-1].name])[:AHEAD]
        for first in ahead:
            between, _ = self._forward(self.refits.of(first), first.effects)
            second = max(between.others, key=lambda c: between.odds[c.effects[-1].name], default=None)
            if second is None:
                continue
            fits = [(second.effects, second.fit), ((), null.fit), (first.effects, first.fit)]
            best, bare, one = under_one_noise(self.fit, self.joint, fits, 0, self._stated, self._sizes)
            sure = self.odds.sure(best)
            if self.odds.of(best, bare) + self.odds.prior >= sure and self.odds.of(best, one) >= sure:
                return [replace(between, others=())], best
        return [], None

    def _forward(self, base: Judged, effects: Effects) -> tuple[Round, Candidate | None]:
        """(the step, the best model with one effect more if its odds are good enough).

        What led, should be alike in all channels and is not, is what they lack by another name: the rest is asked
        again, without what was given up as behind it.
        """
        without = self._hypotheses if len(effects) >= self._most or any(h.redundant for h in effects) else effects
        unlike: dict[str, str] = {}
        while True:
            turn = self._compared(base, effects, without)
            first = self.refits.leader(effects)
            if first is None or not first.alike or turn.odds.get(first.name, 0.0) >= 0.0:
                break
            without, unlike = (*without, first), {**unlike, first.name: UNLIKE}
        turn = replace(turn, bounded={**turn.bounded, **unlike})
        return turn, self._taken(turn.others, turn.odds, self.odds.sure(turn.base))

    def _compared(self, base: Judged, effects: Effects, without: Effects) -> Round:
        """A model beside those with one effect more, of all but some, under one noise."""
        on_top, scored, stuck = self.refits.one_more(effects, base, without)
        while True:
            fits = [(effects, base.fit), *on_top]
            current, *others = under_one_noise(
                self.fit, self.joint, fits, min(1, len(fits) - 1), self._stated, self._sizes
            )  # fmt: skip
            others = list(best_of((c.effects[-1].name, c) for c in others).values())
            stuck |= {h.name: why for c in others if (why := self.refits.against(h := c.effects[-1], c.fit))}
            others = [c for c in others if c.effects[-1].name not in stuck]
            if not on_top or on_top[0][0][-1].name not in stuck:
                break
            on_top = on_top[1:]  # it led: the noise was what it leaves
        self.refits.weights = current.frame.whitener if current.by_size else None
        odds = {c.effects[-1].name: alike(c.effects[-1], c, current, self.odds.of(c, current)) for c in others}
        return Round(current, odds, scored, stuck, others)

    def _taken(self, others: Sequence[Candidate], odds: Mapping[str, float], sure: float) -> Candidate | None:
        """The best with one effect more, if that is sure; what it holds, if what it has beside that is not."""

        def of(c: Candidate) -> float:
            return odds[c.effects[-1].name]

        best = max(others, key=of, default=None)
        if best is None or of(best) < sure:
            return None
        held = (c for c in others if of(c) >= sure and holds(best.effects[-1], c.effects[-1]))
        return max((c for c in held if self.odds.of(best, c) < sure), key=of, default=best)

    def _may_be_made(self, first: Round) -> bool:
        """Whether what led cannot be told from what a logger has made of a channel that others tell as well."""
        best, *others = first.others
        made = (c for c in others if c.effects[-1].redundant)
        return not best.effects[-1].redundant and any(
            log_odds(best, c) < self.odds.told_from_logger(best) for c in made
        )

    def _of_one(self, null: Judged, rounds: Sequence[Round]) -> Found:
        """The answer with one effect that led from the start: its rivals were compared with it under its own noise."""
        first, last = rounds
        best = next(c for c in first.others if c.effects == last.base.effects)
        name = best.effects[0].name
        others = (c for c in first.others if c is not best and not _ends_as(c, best))
        rivals = {c.effects[0].name: over_rival(best, c) for c in others if not holds(c.effects[0], best.effects[0])}
        odds = self.odds.of(best, first.base)
        return Found(null, first.base, best, tuple(rounds), {name: odds}, {name: rivals}, self.odds.sure(best))

    def _settled(
        self, null: Judged, effects: Effects, base: Judged, rounds: tuple[Round, ...]
    ) -> tuple[Found, Candidate | None]:
        """(what the odds of each effect are, given the rest; a model that is better, if there is one)."""
        fits: list[tuple[Effects, Fit]] = [(effects, base.fit), ((), null.fit)]
        of: list[tuple[str, str]] = []
        for h in effects:
            rest = tuple(e for e in effects if e is not h)
            alone, others = self.refits.without(rest, null, base, effects)
            gone = {*(e.name for e in effects), *self._given_up}
            swapped = [((*rest, more[-1]), one) for more, one in others if more[-1].name not in gone]
            fits += [(rest, alone), *swapped]
            of += [(h.name, ""), *((h.name, other[-1].name) for other, _ in swapped)]
        best, bare, *models = under_one_noise(self.fit, self.joint, fits, 0, self._stated, self._sizes)
        without: dict[str, float] = {}
        apart: dict[str, float] = {}
        left_out: dict[str, Candidate] = {}
        rivals: dict[str, dict[str, float]] = {h.name: {} for h in effects}
        behind: list[tuple[bool, float, Candidate]] = []
        sure, told = self.odds.sure(best), self.odds.told_from_logger(best)
        for (name, other), model in best_of(zip(of, models, strict=True)).items():
            odds, own = log_odds(best, model), next(h for h in effects if h.name == name)
            if other:
                new = model.effects[-1]
                more = holds(new, own) and self.odds.of(model, best) < sure
                if more or _ends_as(model, best) or self.refits.against(new, model.fit):
                    continue
                rivals[name][other] = over_rival(best, model)
                odds = self.odds.of(best, model) - sure if holds(own, new) else odds + _margin(own, new, told)
            else:
                odds = without[name] = alike(own, best, model, self.odds.of(best, model))
                apart[name] = self.odds.over_formulation(best, model)
                left_out[name] = model
            behind.append((not smaller(own, best.fit), odds, model))
        found = Found(null, bare, best, rounds, without, rivals, sure, apart)
        kept, odds, better = min(behind, key=lambda one: one[:2])
        if odds < 0.0 or not kept:
            return found, better
        least = min(without, key=lambda name: without[name])
        return found, left_out[least] if without[least] < sure else None  # not sure beside the rest: given up, too


def _margin(own: Hypothesis, new: Hypothesis, told: float) -> float:
    """Log odds by which an exchange must be better.

    What a logger has made of a channel that others tell as well goes before all that cannot be told from it: the
    channel is then left out, and the others are asked.
    """
    if bool(own.redundant) == bool(new.redundant):
        return MARGIN
    return told if own.redundant else -told


def _ends_as(fuller: Candidate, best: Candidate) -> bool:
    """Whether an exchange has become the effect that it was exchanged for, with more numbers and nothing by them.

    A Stribeck curve that does not fall below the fastest speed is Coulomb's friction by another name. A cable that has
    crept before the first sample, in a time as cables take, is no slack by another name.
    """
    (new,), (old,) = (
        [h for h in one.effects if h not in other.effects] for one, other in ((fuller, best), (best, fuller))
    )  # fmt: skip
    declared = old.canonical in new.confusable or new.canonical in old.confusable
    more = len(new.shapes) > len(old.shapes)
    return (
        declared
        and more
        and fuller.remainder.priced.is_unusual(new.shapes)
        and fuller.plain.fit < best.plain.fit + NOTHING
    )
