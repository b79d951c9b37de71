"""The criterion "unseen": effects are accepted by the error of records that no refit has seen (`search.stepwise`).

For rigs whose sensors are better than any model of them. What is left is then never noise, so nothing is asked of it;
where no effect helps, the same test as of the criterion "noise" says whether something is left at all.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from diagnosis.adequacy.tests import adequacy
from diagnosis.fit.confidence import confidence
from diagnosis.fit.likelihood import Judged, judge, settled
from diagnosis.fit.refit import Fit
from diagnosis.model.hypotheses import Hypothesis
from diagnosis.model.model import Model
from diagnosis.model.verdict import Estimate, Step
from diagnosis.search.rules import Rules
from diagnosis.search.selection import Accepted, Selection
from diagnosis.search.stepwise import MARGIN, MOST, Rung, held, inside, ladder

RULES = Rules(gain=MARGIN, each=0.0, share=0.0, margin=MARGIN, most=MOST)
"""`Rules` in held-out gain, independent stretches."""


def select_unseen(
    fit: Model,
    heldout: Model,
    nominals: tuple[str, ...],
    hypotheses: Sequence[Hypothesis],
    *,
    units: Mapping[str, str],
    stated: Mapping[str, float] | None = None,
    tell: Callable[[str], None] = lambda text: None,
    keep: Callable[[str, Callable[[], Any]], Any] = lambda name, make: make(),
) -> Selection:
    """The ladder as a selection; arguments as of `diagnosis.search.select.select`, units by parameter."""
    rungs = ladder(fit, heldout, nominals, hypotheses, tell=tell, keep=keep)
    tell("looking at what is left")
    null, final = _noted(fit, rungs[0].fit, rungs[0].fit), _noted(fit, rungs[-1].fit, rungs[0].fit)
    before = adequacy(fit, null, dict(stated or {}))
    after = adequacy(fit, final, dict(stated or {})) if len(rungs) > 1 else before
    by_name = {h.name: h for h in hypotheses}
    accepted = tuple(
        Accepted(by_name[r.name], r.gain, r.gain, r.alike, r.margin) for r in rungs[1:] if r.name in inside(rungs)
    )
    noise = after.p_value >= RULES.left_p and after.over_noise <= RULES.over
    return Selection(
        null, final, accepted, tuple(r.screening for r in rungs if r.screening is not None), (), before, after,
        bool(accepted) or noise, dict(rungs[-1].refused), RULES, tuple(step(rung, units) for rung in rungs),
    )  # fmt: skip


def sure(rung: Rung) -> float:
    """Confidence in a step, by the margin over its rivals and its gain on the held-out records."""
    return 1.0 if not rung.name else confidence(rung.margin, rung.gain, MARGIN, 0.0)


def step(rung: Rung, units: Mapping[str, str]) -> Step:
    """A rung in numbers."""
    fit = rung.fit
    parameters = {n: Estimate(fit.values[n], *fit.interval(n), units.get(n, "")) for n in fit.free}
    return Step(rung.name, rung.gain, sure(rung), rung.alike, *rung.rmse, parameters, dict(rung.rivals), rung.dropped)


def _noted(model: Model, fit: Fit, null: Fit) -> Judged:
    """A fit with the noise that it would leave were that noise, its own covariance, and its deviance in stretches."""
    judged = settled(model, judge(model, fit), 0)
    return replace(
        judged, fit=replace(judged.fit, covariance=fit.covariance),
        deviance=-held(model, null).gain(held(model, fit)),
    )  # fmt: skip
