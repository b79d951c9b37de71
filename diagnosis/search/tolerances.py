"""Errors of sensors within their class: never an answer, and what an effect may be instead.

A scale within the class of a transducer is no fault, so that no search takes it (`search.comparison.smaller`). What
imitates it, a bias of the same sensor or friction that differs by direction, is then all that explains what it does.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from cable_envs.diagnosis.evidence.candidates import under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.evidence.rivals import over_rival
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.search.comparison import smaller
from cable_envs.diagnosis.search.selection import Found

SENSE = "sense"
"""Seam of the effects of sensors."""


def with_tolerances(
    found: Found, fit: Model, joint: Joint, hypotheses: Sequence[Hypothesis], stated: Mapping[str, float],
    sizes: Mapping[str, float],
) -> Found:  # fmt: skip
    """What a search has found, with errors of sensors within their class among the rivals of what is declared alike.

    Parameters
    ----------
    found : Found
        The last model and the rivals of its effects.
    fit : Model
        The records to fit.
    joint : Joint
        All records.
    hypotheses : sequence of Hypothesis
        What may be missing.
    stated, sizes : mapping of str to float
        As of `cable_envs.diagnosis.evidence.candidates.under_one_noise`.
    """
    best, free, values = found.best, found.best.fit.free, found.best.fit.values
    exchanged = [
        (own, tuple(h for h in best.effects if h is not own), error) for own, error in _alike(best.effects, hypotheses)
    ]
    if not exchanged:
        return found
    starts = []
    for own, rest, error in exchanged:
        kept = tuple(n for n in free if n not in own.names or any(n in h.names for h in rest))
        starts.append(Start(error.name, (*kept, *error.names), {n: values[n] for n in kept}))
    fits: list[tuple[tuple[Hypothesis, ...], Fit]] = [(best.effects, best.fit)]
    ends = refit(fit, best.frame.whitener, starts, central=False)
    fits += [((*rest, error), end) for (_, rest, error), end in zip(exchanged, ends, strict=True)]
    best, *models = under_one_noise(fit, joint, fits, 0, stated, sizes)
    rivals = {name: dict(others) for name, others in found.rivals.items()}
    for (own, _, error), model in zip(exchanged, models, strict=True):
        if smaller(error, model.fit):
            rivals.setdefault(own.name, {})[error.name] = over_rival(best, model)
    return replace(found, rivals=rivals)


def _alike(effects: Sequence[Hypothesis], hypotheses: Sequence[Hypothesis]) -> Iterator[tuple[Hypothesis, Hypothesis]]:
    """(effect of the model, error of a sensor that it may be) of those that declare to look alike."""
    errors = [h for h in hypotheses if h.least and h.effect is not None and h.effect.seam == SENSE]
    for own in effects:
        for error in errors:
            if error not in effects and (own.canonical in error.confusable or error.canonical in own.confusable):
                yield own, error
