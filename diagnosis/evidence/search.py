"""Which effects a recording has evidence of: models with more and fewer effects, compared by their evidence.

1. The nominal parameters are refitted.
2. Every effect is scored against what is left (`fit.score_tests`), the best are refitted on top (`search.comparison`),
   and compared under one noise (`candidates`). The best is taken if its odds are above `SURE` to one.
3. Again on top of it, up to `MOST` effects.
4. Each effect of the last model is left out, and exchanged for every other, given the rest. The best model stays.
   Exchanges that are not behind by `SURE` to one are alternatives.
5. A discrepancy beyond the laws' own says what is left: its odds, and its share of what was to be explained.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cable_envs.diagnosis.evidence.candidates import Candidate, Joint, log_odds, under_one_noise
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals, refit_nominals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.search.comparison import compare
from cable_envs.diagnosis.search.objections import bounded

SURE = 20.0
"""Odds from which one model is preferred to another."""
MOST = 4
"""Effects at the most."""
RIVALS = 6
"""Best hypotheses that are compared under one noise."""
LAW = 0.2
"""Share of what was to be explained that may be left unexplained when something is named."""


@dataclass
class Found:
    """The last model, with the odds that an answer needs.

    null, best | without effects, and with those that are found
    without    | name of an effect -> log odds of the best model over the same without it
    rivals     | name of an effect -> {other hypothesis: log odds of the best model over it in its place}
    left       | log odds that something is left, share of what was to be explained, families in which it is
    """

    null: Candidate
    best: Candidate
    without: dict[str, float] = field(default_factory=dict)
    rivals: dict[str, dict[str, float]] = field(default_factory=dict)
    left: float = -np.inf
    share: float = 0.0
    families: tuple[int, ...] | None = None
    smooth: float = np.inf
    steps: list = field(default_factory=list)

    @property
    def verdict(self) -> str:
        something = self.left > np.log(SURE)
        if not self.best.effects:
            return "unknown" if something else "no_detectable_mismatch"
        if (something and self.share > LAW) or self.smooth < 0.0:
            return "unknown"
        return "equivalence_class" if any(self.alternatives(h.name) for h in self.best.effects) else "named"

    def alternatives(self, name: str) -> tuple[str, ...]:
        return tuple(n for n, odds in self.rivals.get(name, {}).items() if odds < np.log(SURE))

    def confidence(self, name: str) -> float:
        against = [self.without[name], self.smooth, *(o for o in self.rivals.get(name, {}).values() if o >= np.log(SURE))]
        return float(1.0 / (1.0 + sum(np.exp(-min(max(o, 0.0), 50.0)) for o in against)))


class Search:
    """See the module; parameters as of `cable_envs.diagnosis.search.select.select`."""

    def __init__(
        self, fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis],
        rng: np.random.Generator, stated: Mapping[str, float], tell: Callable[[str], None] = lambda text: None,
    ):  # fmt: skip
        self.fit, self.joint, self.nominals = fit, Joint(fit, heldout), nominals
        self.hypotheses, self.rng, self.stated, self.tell = tuple(hypotheses), rng, dict(stated), tell
        self.prior = -float(np.log(max(len(self.hypotheses), 1)))

    def run(self) -> Found:
        self.tell("refitting the nominal parameters")
        self.null = refit_nominals(self.fit, self.nominals)
        effects: tuple[Hypothesis, ...] = ()
        base, steps = self.null, []
        while len(effects) < MOST:
            compared = self.compared(effects, base)
            current, others = compared[0], compared[1:]
            steps.append([(c.name, round(log_odds(c, current) + self.prior, 1)) for c in others])
            best = max(others, key=lambda c: log_odds(c, current), default=None)
            if best is None or log_odds(best, current) + self.prior < np.log(SURE):
                break
            effects, base = best.effects, self.judged(best)
        found = self.settled(effects, compared if not effects else None, base)
        found.steps = steps
        return found

    def judged(self, c: Candidate) -> Judged:
        raw = raw_residuals(self.fit, c.fit)
        return Judged(c.fit, tuple(raw), c.frame.whitener, 0.0)

    def compared(self, effects: tuple[Hypothesis, ...], base: Judged, without: Sequence[str] = ()) -> list[Candidate]:
        """The model with some effects, and the best with one more, under one noise."""
        have = {h.name for h in effects} | set(without)
        left = [h for h in self.hypotheses if h.name not in have]
        fits: list[tuple[tuple[Hypothesis, ...], Fit]] = [(effects, base.fit)]
        if left:
            self.tell(f"scoring {len(left)} hypotheses")
            tests = score_tests(self.fit, base, left, self.rng)
            self.tell("refitting the best of them")
            ranked = [c for c in compare(self.fit, base, tests) if not bounded(c.hypothesis, c.judged.fit)]
            fits += [((*effects, c.hypothesis), c.judged.fit) for c in ranked[:RIVALS]]
        return under_one_noise(self.fit, self.joint, fits, min(1, len(fits) - 1), self.stated)

    def settled(self, effects: tuple[Hypothesis, ...], compared: list[Candidate] | None, base: Judged) -> Found:
        """Each effect left out and exchanged, given the rest, until the best model stays."""
        for _ in range(2 * MOST):
            fits: list[tuple[tuple[Hypothesis, ...], Fit]] = [(effects, base.fit)]
            tags: list[tuple[str, str]] = [("", "")]
            null = self.null.fit
            for h in effects:
                rest = tuple(e for e in effects if e is not h)
                free = (*null.free, *(n for e in rest for n in e.names))
                start = {n: v for n, v in (base.fit if rest else null).values.items() if n in free}
                alone = refit(self.fit, base.whitener, [Start("", free, start)])[0]
                judged = Judged(alone, tuple(raw_residuals(self.fit, alone)), base.whitener, 0.0)
                fits.append((rest, alone))
                tags.append((h.name, ""))
                have = {e.name for e in effects}
                left = [e for e in self.hypotheses if e.name not in have]
                tests = score_tests(self.fit, judged, [*left, h], self.rng)
                ranked = [c for c in compare(self.fit, judged, tests) if not bounded(c.hypothesis, c.judged.fit)]
                for c in [c for c in ranked if c.hypothesis is not h][:RIVALS]:
                    fits.append(((*rest, c.hypothesis), c.judged.fit))
                    tags.append((h.name, c.hypothesis.name))
            fits.append(((), null))
            tags.append(("", "null"))
            models = compared or under_one_noise(self.fit, self.joint, fits, 0, self.stated)
            best = models[0]
            if compared is not None:
                found = Found(best, best)
                break
            found = Found(models[-1], best)
            worse = None
            for (name, other), model in zip(tags[1:-1], models[1:-1], strict=True):
                odds = log_odds(best, model)
                if other:
                    found.rivals.setdefault(name, {})[other] = odds
                    if odds < -1.0 and (worse is None or odds < worse[0]):
                        worse = (odds, model)
                else:
                    odds -= self.prior
                    odds = log_odds(best, model) + self.prior
                    found.without[name] = odds
                    if odds < 0.0 and (worse is None or odds < worse[0]):
                        worse = (odds, model)
            if worse is None:
                alone = [m for (n, o), m in zip(tags[1:-1], models[1:-1], strict=True) if not o]
                smooth = [log_odds(best, m) + self.prior - max(m.far[0], 0.0) for m in alone]
                found.smooth = min(smooth, default=np.inf)
                break
            effects, base = worse[1].effects, self.judged(worse[1])
            if not effects:
                found = Found(worse[1], worse[1])
                break
        gain, far, chosen = found.best.far
        found.left, found.families = gain, chosen
        bare = found.null.near
        explained = max(found.best.near.fit - bare.fit, 1e-9)
        found.share = max(far.fit - found.best.near.fit, 0.0) / explained
        return found
