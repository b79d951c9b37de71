"""The criterion "unseen": effects are accepted by their error on held-out records (`search.stepwise`).

For rigs whose sensors are better than any model of them. What is left is then never noise, so nothing is asked of it;
where no effect helps, the same test as of the criterion "noise" says whether something is left at all.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from cable_envs.diagnosis.adequacy.tests import adequacy
from cable_envs.diagnosis.fit.confidence import confidence
from cable_envs.diagnosis.fit.likelihood import Judged, judge, settled
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.model.verdict import EffectGain, Estimate
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.search.rules import Rules
from cable_envs.diagnosis.search.selection import Selection
from cable_envs.diagnosis.search.stepwise import MARGIN, MOST, Step, heldout_error, inside, stepwise

RULES = Rules(gain=MARGIN, each=0.0, share=0.0, margin=MARGIN, most=MOST)
"""`Rules` in held-out gain (`cable_envs.diagnosis.search.stepwise.HeldoutError`)."""


def select_heldout(
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
    """The stepwise selection as a `Selection`; arguments as of `diagnosis.search.select.select`, units by parameter."""
    steps = stepwise(fit, heldout, nominals, hypotheses, tell=tell, keep=keep)
    tell(stages.LEFT)
    null, final = (_judged(fit, step.refit, steps[0].refit) for step in (steps[0], steps[-1]))
    before = adequacy(fit, null, dict(stated or {}))
    after = adequacy(fit, final, dict(stated or {})) if len(steps) > 1 else before
    there = inside(steps)
    accepted = tuple(plain(step) for step in steps[1:] if step.hypothesis.name in there)
    noise = after.p_value >= RULES.left_p and after.over_noise <= RULES.over
    return Selection(
        null, final, accepted, tuple(s.score_tests for s in steps if s.score_tests is not None), (), before, after,
        bool(accepted) or noise, dict(steps[-1].refused), RULES, tuple(in_numbers(step, units) for step in steps),
        further=dict(steps[-1].further),
    )  # fmt: skip


def confidence_of(step: EffectGain) -> float:
    """Confidence in a step, by the margin over its rivals and its gain on the held-out records."""
    return confidence(step.margin, step.gain, MARGIN, 0.0) if step.name else 1.0


def plain(step: Step) -> EffectGain:
    """A step without its refit."""
    return EffectGain(**{f.name: getattr(step, f.name) for f in fields(EffectGain)})


def in_numbers(step: Step, units: Mapping[str, str]) -> EffectGain:
    """A step with its confidence and its parameters."""
    fit = step.refit
    parameters = {n: Estimate(fit.values[n], *fit.interval(n), units.get(n, "")) for n in fit.free}
    return replace(plain(step), confidence=confidence_of(step), parameters=parameters)


def _judged(model: Model, fit: Fit, null: Fit) -> Judged:
    """A fit with the noise that it would leave were that noise, its own covariance, and the held-out gain."""
    judged = settled(model, judge(model, fit), 0)
    return replace(
        judged, fit=replace(judged.fit, covariance=fit.covariance),
        deviance=-heldout_error(model, null).gain(heldout_error(model, fit)),
    )  # fmt: skip
