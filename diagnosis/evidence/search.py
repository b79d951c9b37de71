"""Which effects a recording has evidence of: models with more and fewer effects, compared by their evidence.

1. The nominal parameters are refitted.
2. Every effect is scored against what is left (`fit.score_tests`), the best are refitted on top (`search.comparison`),
   and compared under one noise (`candidates`). The best is taken if its odds are above `SURE` to one.
3. Again on top of it, up to `MOST` effects.
4. Each effect of the last model is left out, and exchanged for every other, given the rest. The best model stays.
   Exchanges that are not behind by `SURE` to one are alternatives.
5. The discrepancy of the best model is what is left: its odds, and its share of what was to be explained.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cable_envs.diagnosis.evidence.candidates import Candidate, Joint, log_odds, under_one_noise
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals, refit_nominals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.search.comparison import compare
from cable_envs.diagnosis.search.objections import bounded

Effects = tuple[Hypothesis, ...]

SURE = 20.0
"""Odds from which one model is preferred to another."""
MOST = 4
"""Effects at the most."""
RIVALS = 6
"""Best hypotheses that are compared under one noise."""
EXCHANGES = 8
"""Rounds of leaving out and exchanging, at the most."""
MARGIN = 1.0
"""Log odds by which an exchange must be better: equals would be exchanged for ever."""
LAW = 0.2
"""Share of what was to be explained that may be left unexplained when something is named."""


@dataclass(frozen=True)
class Found:
    """The last model, with the odds that an answer needs.

    Parameters
    ----------
    null, best : Candidate
        Without effects, and with those that are found.
    without : Mapping of str to float
        Effect -> log odds of the best model over the same without it.
    rivals : Mapping of str to Mapping
        Effect -> other hypotheses -> log odds of the best model over them in its place.
    """

    null: Candidate
    best: Candidate
    without: Mapping[str, float] = field(default_factory=dict)
    rivals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def left(self) -> float:
        """Log odds that something is left that the best model does not explain."""
        return self.best.left

    @property
    def share(self) -> float:
        """What is left over what the effects explain, as falls of half the sum of squares; infinite without any."""
        explained = self.best.plain.fit - self.null.plain.fit
        return (self.best.best.fit - self.best.plain.fit) / explained if explained > 0.0 else np.inf

    @property
    def verdict(self) -> str:
        """One of `cable_envs.diagnosis.model.verdict.VERDICTS`."""
        something = self.left > np.log(SURE)
        if not self.best.effects:
            return "unknown" if something else "no_detectable_mismatch"
        if something and self.share > LAW:
            return "unknown"
        return "equivalence_class" if any(self.alternatives(h.name) for h in self.best.effects) else "named"

    def alternatives(self, name: str) -> tuple[str, ...]:
        """Hypotheses that the records do not tell from an effect."""
        return tuple(n for n, odds in self.rivals.get(name, {}).items() if odds < np.log(SURE))

    def confidence(self, name: str) -> float:
        """Probability that an effect or one of its alternatives is there; not calibrated."""
        clear = (odds for odds in self.rivals.get(name, {}).values() if odds >= np.log(SURE))
        against = np.array([self.without[name], *clear])
        return float(1.0 / (1.0 + np.sum(np.exp(-np.clip(against, 0.0, 50.0)))))


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
    tell : callable
        Called with what is being done.
    """

    def __init__(
        self, fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis],
        rng: np.random.Generator, stated: Mapping[str, float], tell: Callable[[str], None] = lambda text: None,
    ):  # fmt: skip
        self._fit, self._joint, self._nominals = fit, Joint(fit, heldout), nominals
        self._hypotheses, self._rng, self._stated, self._tell = tuple(hypotheses), rng, dict(stated), tell
        self._sizes: dict[str, float] = {}
        self._prior = -float(np.log(max(len(self._hypotheses), 1)))

    def run(self) -> Found:
        """Search forward, then leave out and exchange until the best model stays."""
        self._tell("refitting the nominal parameters")
        null = refit_nominals(self._fit, self._nominals)
        self._sizes = self._joint.left_by(null.fit)
        base, effects = null, Effects()
        while len(effects) < MOST:
            fits = [(effects, base.fit), *self._on_top(effects, base, effects)]
            current, *others = under_one_noise(
                self._fit, self._joint, fits, min(1, len(fits) - 1), self._stated, self._sizes
            )
            best = max(others, key=lambda c: log_odds(c, current), default=None)
            if best is None or log_odds(best, current) + self._prior < np.log(SURE):
                break
            effects, base = best.effects, self._judged(best.fit, best.frame.whitener)
        if not effects:
            return Found(current, current)
        for _ in range(EXCHANGES):
            found, better = self._settled(null.fit, effects, base)
            if better is None or not better.effects:
                break
            effects, base = better.effects, self._judged(better.fit, better.frame.whitener)
        return found if better is None or better.effects else Found(better, better)

    def _judged(self, fit: Fit, whitener: Whitener) -> Judged:
        return Judged(fit, tuple(raw_residuals(self._fit, fit)), whitener, 0.0)

    def _on_top(self, effects: Effects, base: Judged, without: Effects) -> list[tuple[Effects, Fit]]:
        """The best refits of one effect more on top of a model, but for those that end on a bound."""
        names = {h.name for h in without}
        left = [h for h in self._hypotheses if h.name not in names]
        if not left:
            return []
        self._tell(f"scoring and refitting {len(left)} hypotheses")
        ranked = compare(self._fit, base, score_tests(self._fit, base, left, self._rng))
        sound = [c for c in ranked if not bounded(c.hypothesis, c.judged.fit)]
        return [((*effects, c.hypothesis), c.judged.fit) for c in sound[:RIVALS]]

    def _settled(self, null: Fit, effects: Effects, base: Judged) -> tuple[Found, Candidate | None]:
        """(what the odds of each effect are, given the rest; a model that is better, if there is one)."""
        fits: list[tuple[Effects, Fit]] = [(effects, base.fit), ((), null)]
        of: list[tuple[str, str]] = []
        for h in effects:
            rest = tuple(e for e in effects if e is not h)
            free = (*null.free, *(n for e in rest for n in e.names))
            values = (base.fit if rest else null).values
            start = Start("", free, {n: v for n, v in values.items() if n in free})
            alone = refit(self._fit, base.whitener, [start])[0]
            swapped = self._on_top(rest, self._judged(alone, base.whitener), effects)
            fits += [(rest, alone), *swapped]
            of += [(h.name, ""), *((h.name, other[-1].name) for other, _ in swapped)]
        best, bare, *models = under_one_noise(self._fit, self._joint, fits, 0, self._stated, self._sizes)
        without: dict[str, float] = {}
        rivals: dict[str, dict[str, float]] = {h.name: {} for h in effects}
        behind: list[tuple[float, Candidate]] = []
        for (name, other), model in zip(of, models, strict=True):
            odds = log_odds(best, model)
            if other:
                rivals[name][other] = odds
            else:
                odds += self._prior
                without[name] = odds
            behind.append((odds + (MARGIN if other else 0.0), model))
        odds, better = min(behind, key=lambda pair: pair[0])
        return Found(bare, best, without, rivals), better if odds < 0.0 else None
