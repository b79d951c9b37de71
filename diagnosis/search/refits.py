"""Refits of a search, by the effects in them: no model is refitted twice, and the best with one more are kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from cable_envs.diagnosis.evidence.candidates import Candidate
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Look, Start, refit
from cable_envs.diagnosis.fit.score_tests import ScoreTests, score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.search.comparison import Refitted, bounded, compare, smaller, unresolved, with_some_sizes
from cable_envs.diagnosis.search.starts import from_about

Effects = tuple[Hypothesis, ...]
Keep = Callable[[str, Callable[[], Any]], Any]

RIVALS = 5
"""Best hypotheses that are compared under one noise."""
AGAIN = 3
"""Comparisons at the most where all that led are refused: what was given up because of them is compared again."""
SEVERAL = 2
"""Effects from which a model is refitted from several starts before the search goes on."""


class Refits:
    """The refits of one search.

    Parameters
    ----------
    model : Model
        The records to fit.
    nominals : tuple of str
        Parameters that every refit moves.
    hypotheses : sequence of Hypothesis
        What may be missing.
    rng : numpy.random.Generator
        Of the score tests.
    tell, keep : callable
        As of `cable_envs.diagnosis.search.select.select`.

    Attributes
    ----------
    weights : Whitener or None
        Of refits, where what a model may be off by is more than the noise.
    """

    def __init__(
        self, model: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis], rng: np.random.Generator,
        tell: Callable[[str], None], keep: Keep,
    ):  # fmt: skip
        self._model, self._nominals, self._hypotheses, self._rng = model, nominals, tuple(hypotheses), rng
        self._tell, self._keep = tell, keep
        self.weights: Whitener | None = None
        self._done: dict[frozenset[str], tuple[Fit, list[tuple[Effects, Fit]]]] = {}
        """names of effects -> refit with them, and the best refits of one more on top"""
        self._asked: _Asked | None = None
        self._parts: dict[frozenset[str], Fit] = {}
        """names of effects -> refit with them alone, where the search has come by none"""

    def judged(self, fit: Fit, whitener: Whitener) -> Judged:
        """A refit with what it leaves, and the noise that it is weighed by."""
        return Judged(fit, tuple(raw_residuals(self._model, fit)), whitener, 0.0)

    def of(self, best: Candidate, sure: float = np.inf) -> Judged:
        """A model to go on from; refitted from about where it is, too, where it may have come to another valley.

        It may have with several effects, where more is left, and where an effect has a place.

        sure: log odds from which it counts that more is left.
        """
        whitener, fit = best.frame.whitener, best.fit
        if len(best.effects) >= SEVERAL or best.left >= sure or any(h.place for h in best.effects):
            names = [n for h in best.effects for n in h.names]
            fit = self._keep("starts", partial(from_about, self._model, whitener, fit, names))
        return self.judged(fit, whitener)

    def known(self, effects: Effects) -> Fit | None:
        """The refit with these effects, where the search has come by it."""
        done = self._done.get(_names(effects))
        return None if done is None else done[0]

    def only(self, effects: Effects, candidate: Candidate) -> Fit:
        """The refit with some of a candidate's effects."""
        if (done := self.known(effects)) is not None:
            return done
        if _names(effects) not in self._parts:
            gone = {n for h in candidate.effects if h not in effects for n in h.names}
            free = tuple(n for n in candidate.fit.free if n not in gone)
            start = Start("", free, {n: v for n, v in candidate.fit.values.items() if n in free})
            self._parts[_names(effects)] = refit(self._model, candidate.frame.whitener, [start])[0].outline
        return self._parts[_names(effects)]

    def one_more(
        self, effects: Effects, base: Judged, without: Effects
    ) -> tuple[list[tuple[Effects, Fit]], ScoreTests | None, dict[str, str]]:
        """(the best refits of one effect more, the scores, what speaks against others), and keep the first.

        without: effects that are not asked.
        """
        on_top, scored, stuck = self._on_top(effects, base, without)
        self._done[_names(effects)] = (base.fit.outline, on_top)
        return on_top, scored, stuck

    def leader(self, effects: Effects) -> Hypothesis | None:
        """The effect that led on top of these."""
        on_top = self._done[_names(effects)][1]
        return on_top[0][0][-1] if on_top else None

    def without(
        self, rest: Effects, null: Judged, base: Judged, effects: Effects
    ) -> tuple[Fit, list[tuple[Effects, Fit]]]:
        """(the refit without one of the effects, the best refits of another in its place)."""
        known = self._done.get(_names(rest))
        if known is not None:
            return known
        free = (*null.fit.free, *(n for e in rest for n in e.names))
        start = Start("", free, {n: v for n, v in base.fit.values.items() if n in free})
        alone = refit(self._model, base.whitener, [start])[0]
        on_top, _, _ = self.one_more(rest, self.judged(alone, base.whitener), effects)
        return alone, on_top

    def _on_top(
        self, effects: Effects, base: Judged, without: Effects
    ) -> tuple[list[tuple[Effects, Fit]], ScoreTests | None, dict[str, str]]:
        names = {h.name for h in without}
        left = [h for h in self._hypotheses if h.name not in names]
        if not left:
            return [], None, {}
        asked = self._scored(base, left)
        scored = asked.scored.without(names)
        self._tell(stages.COMPARING)
        sound: list[Refitted] = []
        stuck: dict[str, str] = {}
        for _ in range(AGAIN):
            how = (self._model, base, scored.without(stuck), self._nominals, self.weights, asked.looks)
            ranked = self._keep("comparison", partial(compare, *how))
            stuck |= {c.hypothesis.name: why for c in ranked if (why := self.against(c.hypothesis, c.judged.fit))}
            sound = [c for c in ranked if c.hypothesis.name not in stuck]
            if sound or not ranked:
                break
        found = [*sound[:RIVALS], *with_some_sizes(self._model, base.fit, sound[:RIVALS])]
        return [((*effects, c.hypothesis), c.judged.fit.outline) for c in found], scored, stuck

    def _scored(self, base: Judged, left: Sequence[Hypothesis]) -> "_Asked":
        """The scores on top of a model; not again where it was the last to be asked, with as many or more."""
        asked = self._asked
        if asked is None or asked.base is not base or asked.weights is not self.weights or asked.lacks(left):
            self._tell(stages.testing(len(left)))
            how = (self._model, base, left, self._rng, self.weights)
            asked = _Asked(base, self.weights, self._keep("score_tests", partial(score_tests, *how)))
            self._asked = asked
        return asked

    def against(self, hypothesis: Hypothesis, fit: Fit) -> str:
        """What speaks against a refit, whatever it gains."""
        step = float(getattr(self._model, "resolved", 0.0))
        if unresolved(hypothesis, fit, step):
            return f"it is far shorter than a step of integration, {1e3 * step:.2g} ms"
        if why := smaller(hypothesis, fit):
            return why
        ends = bounded(hypothesis, fit)
        return f"{', '.join(ends)} ended on a bound" if ends else ""


@dataclass(frozen=True)
class _Asked:
    """Scores on top of a model, and how far the refits have come that were begun from them."""

    base: Judged
    weights: Whitener | None
    scored: ScoreTests
    looks: dict[str, Look] = field(default_factory=dict)

    def lacks(self, hypotheses: Sequence[Hypothesis]) -> bool:
        """Whether one of these was not scored."""
        return any(h.name not in self.scored.best for h in hypotheses)


def _names(effects: Effects) -> frozenset[str]:
    return frozenset(h.name for h in effects)
