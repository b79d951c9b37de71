"""From scores to an answer: refit what scored best, rank on records that no refit has seen, accept or refuse.

An effect is accepted only where the best score of all hypotheses beats noise (familywise), it also improves the
held-out records, no parameter of it ends on a bound, its interval leaves the null out, and the sizes found on single
records agree. Two effects: the same again around the model that has the first one. What is left then is tested once
more: where hypotheses still beat noise but none is accepted, or the residual still follows a coordinate, the answer is
"unknown".
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from diagnosis.hypotheses import Hypothesis
from diagnosis.model import Model, Whitener, learn_whitener, residuals
from diagnosis.refit import Fit, Start, refit
from diagnosis.screen import Screening, screen

LEVEL = 0.05
RIVALS = 6
"""Best-scored hypotheses that are refitted."""
MARGIN = 6.0
"""Whitened sum of squares by which a hypothesis must beat another to be told from it: about e^3 to 1."""


@dataclass(frozen=True)
class Accepted:
    """An effect that was found, with what it was chosen from."""

    hypothesis: Hypothesis
    gain: float
    heldout_gain: float
    alternatives: tuple[str, ...]


@dataclass(frozen=True)
class Selection:
    """The steps from the nominal refit to the last model, and the reasons."""

    null: Fit
    final: Fit
    whitener: Whitener
    accepted: tuple[Accepted, ...]
    screenings: tuple[Screening, ...]
    refused: dict[str, str] = field(default_factory=dict)
    """why the refitted hypotheses that were not accepted were not"""

    @property
    def p_value(self) -> float:
        """Familywise p-value of the first screening: that noise alone would score so."""
        return self.screenings[0].p_value if self.screenings else 1.0


def select(
    fit: Model,
    heldout: Model,
    nominals: tuple[str, ...],
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    *,
    most: int = 2,
    tell: Callable[[str], None] = lambda text: None,
) -> Selection:
    """The best model with at most ``most`` of the hypotheses over the refit of ``nominals``."""
    tell("refitting the nominal parameters")
    best, whitener = refit_and_learn(fit, [Start("nominal", nominals, {})])
    null, accepted, screenings = best, [], []
    refused: dict[str, str] = {}
    left = list(hypotheses)
    while left and len(accepted) <= most:
        tell(f"scoring {len(left)} hypotheses")
        screening = screen(fit, whitener, best, left, rng)
        screenings.append(screening)
        if screening.p_value >= LEVEL or len(accepted) == most:
            break
        rivals = sorted(screening.best.values(), key=lambda s: -s.gain)[:RIVALS]
        tell(f"refitting {', '.join(score.hypothesis.name for score in rivals)}")
        fits, noise = _refit_rivals(fit, whitener, best, rivals)
        found = _choose(fit, heldout, best, fits, noise, rivals, refused)
        if found is None:
            break
        accepted.append(found[0])
        best, whitener = found[1], noise
        left = [h for h in left if h.name != found[0].hypothesis.name]
    return Selection(null, best, whitener, tuple(accepted), tuple(screenings), refused)


def refit_and_learn(model: Model, starts: Sequence[Start], rounds: int = 2) -> tuple[Fit, Whitener]:
    """The best refit of ``starts`` with the noise learnt from what it leaves, the two in turns."""
    values = np.array([[s.values.get(p.name, p.start) for s in starts] for p in model.parameters])
    first = [np.asarray(r)[:, 0] for r in residuals(model.blocks, model.predict(values))]
    whitener = learn_whitener(model.blocks, first, 0)
    for _ in range(rounds):
        best = min(refit(model, whitener, starts), key=lambda f: f.cost)
        starts = [Start(best.label, best.free, best.values)]
        whitener = learn_whitener(model.blocks, raw_residuals(model, best))
    return refit(model, whitener, starts)[0], whitener


def raw_residuals(model: Model, fit: Fit) -> list[np.ndarray]:
    """Measured less predicted [T] of every block, in the channels' units."""
    values = np.array([[fit.values[p.name]] for p in model.parameters])
    return [r[:, 0] for r in residuals(model.blocks, model.predict(values))]


def _refit_rivals(model, whitener, best, rivals) -> tuple[dict[str, Fit], Whitener]:
    """Refits of all rivals with the noise that the best of them leaves, by name; "" is the model without any."""
    starts = []
    for score in rivals:
        free = (*best.free, *(n for n in score.hypothesis.names if n not in best.free))
        for probe in _best_probes(score, model):
            starts.append(Start(score.hypothesis.name, free, {**best.values, **probe}))
    fits = refit(model, whitener, starts)
    top = min(fits, key=lambda f: f.cost)
    noise = learn_whitener(model.blocks, raw_residuals(model, top))
    again = [Start("", best.free, best.values)]
    for name in dict.fromkeys(f.label for f in fits):
        found = min((f for f in fits if f.label == name), key=lambda f: f.cost)
        again.append(Start(name, found.free, found.values))
    return {f.label: f for f in refit(model, noise, again)}, noise


def _best_probes(score, model) -> list[dict[str, float]]:
    """Start of a refit: the probe that scored best, as it is and at the size that its score suggests."""
    bounds = {p.name: p for p in model.parameters}
    found, suggested = {}, {}
    for amount, direction in zip(score.amount, score.hypothesis.probes[score.probe], strict=True):
        for name, value in direction.items():
            null = score.hypothesis.nulls.get(name)
            found[name] = value
            size = min(max(abs(amount), 0.02), 20.0)
            suggested[name] = value if null is None else bounds[name].clip(null + size * (value - null))
    return [found] if found == suggested else [suggested, found]


def _choose(fit, heldout, best, fits, noise, rivals, refused) -> tuple[Accepted, Fit] | None:
    """The best rival that meets all conditions, with those that cannot be told from it."""
    base_held = held_cost(heldout, noise, fits[""])
    ranked = sorted((s.hypothesis for s in rivals), key=lambda h: fits[h.name].cost)
    for hypothesis in ranked:
        mine = fits[hypothesis.name]
        held = base_held - held_cost(heldout, noise, mine)
        reason = objection(hypothesis, mine, held) or _unstable(fit, noise, mine, hypothesis)
        if reason:
            refused[hypothesis.name] = reason
            continue
        equal = tuple(
            h.name
            for h in ranked
            if h is not hypothesis
            and fits[h.name].cost - mine.cost < MARGIN
            and len(h.free) <= len(hypothesis.free) + 1
        )
        return Accepted(hypothesis, fits[""].cost - mine.cost, held, equal), mine
    return None


def held_cost(model: Model, whitener: Whitener, fit: Fit) -> float:
    """Whitened sum of squares on another model's records."""
    white = whitener.flat(model.blocks, raw_residuals(model, fit))
    return float(white @ white)


def objection(hypothesis: Hypothesis, fit: Fit, heldout_gain: float) -> str:
    """Why a refitted hypothesis is not accepted; empty if nothing speaks against it."""
    if not heldout_gain > 0.0:
        return f"it does not improve the held-out records (change of the sum of squares {-heldout_gain:+.1f})"
    bound = [name for name in fit.at_bounds if name in hypothesis.names and name not in hypothesis.nulls]
    away = [n for n in fit.at_bounds if n in hypothesis.nulls and fit.values[n] != hypothesis.nulls[n]]
    if bound or away:
        return f"{', '.join(bound + away)} ended on a bound"
    for name, null in hypothesis.nulls.items():
        low, high = fit.interval(name)
        if not low <= null <= high:
            return ""
    return "its 95 % interval holds the null"


def _unstable(model: Model, noise: Whitener, fit: Fit, hypothesis: Hypothesis) -> str:
    """Block resampling to first order: the effect's size from each quarter of the samples may not change its sign."""
    sizes = [fit.free.index(n) for n in hypothesis.nulls]
    agree = 0
    for rows in np.array_split(np.arange(len(fit.residual)), 4):
        j, r = fit.jacobian[rows], fit.residual[rows]
        change = np.linalg.lstsq(j[:, sizes], r, rcond=None)[0]
        moved = [fit.values[fit.free[k]] + c for k, c in zip(sizes, change, strict=True)]
        nulls = list(hypothesis.nulls.values())
        now = [fit.values[fit.free[k]] for k in sizes]
        lead = int(np.argmax([abs(v - n) for v, n in zip(now, nulls, strict=True)]))
        agree += (moved[lead] - nulls[lead]) * (now[lead] - nulls[lead]) > 0.0
    return "" if agree >= 3 else "single parts of the record do not agree on its size"
