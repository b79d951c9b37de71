"""Comparison of models: refits of many hypotheses on top of one model, all in one batch.

Hypotheses are ranked by the fall of the deviance less a charge for every further parameter, an information criterion
(Burnham, Anderson, Model Selection and Multimodel Inference, 2002); those that fall behind are given up early.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from cable_envs.diagnosis.fit.likelihood import Judged, judge, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Look, Start, look, nearest, refit
from cable_envs.diagnosis.fit.score_tests import Score, ScoreTests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener, learn_whitener
from cable_envs.diagnosis.model.verdict import EffectGain

RIVALS = 8
"""Best-scored hypotheses that are refitted."""
STARTS = 2
"""Starts of each, from its best-scored probes."""
BEHIND = 0.5
"""Share of the leader's gain below which a hypothesis is given up after the first iterations."""
PARTS, WORTH = 2, 12.0
"""Parts of a hypothesis that are refitted, and gain of all of it without which none is: no part gains more, and odds of
20 to 1 of one effect among twenty take that."""
CHARGE = 4.0
"""For every number of a hypothesis beyond its first: what chance gives it in 5 % of recordings."""
OF_BEST, LEAST = 0.05, 6.0
"""Share of the best score, and score, that a hypothesis must have to be refitted. Scores are of first order: a refit
may double them; odds of 20 to 1 of one effect among twenty take a gain of 12."""
FAR = 1.5
"""Standard deviations from its prior at which a nominal parameter counts as moved to imitate what is missing."""
RESOLVED = 0.4
"""Share of a step of integration from which a time is more than discretisation: a drive that is told jumps of its speed
reaches them within a step in one formulation and at its end in another, 0.38 of a step apart."""
EQUAL = 1e-3
"""Difference of penalised gains that is rounding: two effects that are one on a recording differ by less, and which of
them is ahead would depend on the processor."""
_GLANCE, _FIRST, _LAST = 2, 4, 4
"""Iterations after which the best start of each hypothesis goes on, after which those behind are given up, and further
ones."""
_FROM_CLAIMS = 6
"""Iterations after which starts are given up that begin at the claims of the recording, far from where the
refit without the effect has moved it. Of a hardening cable, whose pretension was 60 % too large without it, the true
model was worse than nothing after 4 and had half of its gain after 6."""
AnyFit = TypeVar("AnyFit", Fit, Look)


@dataclass(frozen=True, kw_only=True)
class Refitted(EffectGain):
    """A hypothesis refitted on top of a model, with its likelihood; ``gain``: fall of the deviance that it brings."""

    judged: Judged

    @property
    def penalised_gain(self) -> float:
        """The gain less a charge for every parameter beyond the first, by which hypotheses are ranked."""
        return self.gain - CHARGE * (len(self.hypothesis.free) - 1)


def compare(
    model: Model, base: Judged, scored: ScoreTests, nominals: Collection[str], weights: Whitener | None = None,
    looks: dict[str, Look] | None = None,
) -> list[Refitted]:  # fmt: skip
    """Refit the best-scored hypotheses on top of a model and rank them.

    Parameters
    ----------
    model : Model
        The records to fit.
    base : Judged
        The model on top of which they are refitted.
    scored : ScoreTests
        Their scores around ``base``, and the noise under which these hold.
    nominals : collection of str
        Parameters of which the recording states a value.
    weights : Whitener, optional
        Of the refits; by default the noise that the best of them leaves.
    looks : dict of str to Look, optional
        Hypothesis -> where its refit has come after the first iterations, of those that were compared by these scores
        before; what is asked now is put in.

    Returns
    -------
    list of Refitted
        By `Refitted.penalised_gain`, the largest first, equals (`EQUAL`) as the library has them; each with the noise
        that it leaves.
    """
    chosen = sorted(scored.best.values(), key=lambda s: -s.gain)[:RIVALS]
    most = chosen[0].gain if chosen else 0.0
    least = LEAST if weights is None else 0.0
    chosen = [s for s in chosen if s.gain >= max(OF_BEST * most, least)]
    if not chosen:
        return []
    looks = {} if looks is None else looks
    new = [s for s in chosen if s.hypothesis.name not in looks]
    starts = [start for score in new for start in _starts(model, base.fit, score, scored)]
    claimed = _at_claims(model, base.fit, starts, nominals)
    if claimed:
        probed = [start for score in new for start in _probes(base.fit, score.hypothesis, scored)]
        claimed += nearest(model, scored.whitener, _at_claims(model, base.fit, probed, nominals))
    looks |= _best_of(
        [*_looked(model, scored.whitener, starts, _FIRST), *_looked(model, scored.whitener, claimed, _FROM_CLAIMS)]
    )
    best = {s.hypothesis.name: looks[s.hypothesis.name] for s in chosen}
    gains = {name: scored.cost - fit.cost for name, fit in best.items()}
    leader = max(gains.values())
    kept = [name for name, gain in gains.items() if gain >= BEHIND * leader or gain >= leader - 40.0]
    top = best[max(kept, key=lambda name: gains[name])]
    whitener = weights or learn_whitener(model.blocks, raw_residuals(model, top))
    again = [Start(name, best[name].free, best[name].values) for name in kept]
    hypotheses = {score.hypothesis.name: score.hypothesis for score in chosen}
    found = [
        Refitted(hypotheses[j.fit.label], base.deviance - j.deviance, judged=j)
        for j in judge(model, *refit(model, whitener, again, _LAST, central=False))
    ]
    return _ranked(found, list(scored.best))


def with_some_sizes(model: Model, base: Fit, found: Sequence[Refitted]) -> list[Refitted]:
    """Refits of effects that have several sizes, with some of them only (`Hypothesis.parts`).

    base: on top of which they are; found: their refits with all sizes, with the noise that these leave. Of many parts
    the `PARTS` that are ahead after the first iterations are refitted.
    """
    again = []
    for one in (one for one in found if one.gain >= WORTH):
        whitener, values, parts = one.judged.whitener, one.judged.fit.values, one.hypothesis.parts
        frees = [(*base.free, *(n for n in part.names if n not in base.free)) for part in parts]
        starts = [Start(part.name, free, {n: values[n] for n in free}) for part, free in zip(parts, frees, strict=True)]
        if len(parts) > PARTS:
            looks = look(model, whitener, starts, _FIRST)
            behind = [at.cost + CHARGE * len(at.free) for at in looks]
            kept = sorted(range(len(parts)), key=lambda k: behind[k])[:PARTS]
            parts = tuple(parts[k] for k in kept)
            starts = [Start(looks[k].label, looks[k].free, looks[k].values) for k in kept]
        for part, start in zip(parts, starts, strict=True):
            (fit,) = refit(model, whitener, [start], central=False)
            if not bounded(part, fit):
                judged = Judged(fit, tuple(raw_residuals(model, fit)), whitener, 0.0)
                again.append(replace(one, hypothesis=part, judged=judged))
    return again


def bounded(hypothesis: Hypothesis, fit: Fit) -> list[str]:
    """Parameters of the hypothesis that ended on a bound; a size at its null is on none, nor one that is complete."""
    shape = [name for name in fit.at_bounds if name in hypothesis.shapes]
    sizes = [] if hypothesis.complete else [n for n in fit.at_bounds if n in hypothesis.nulls]
    return shape + [n for n in sizes if fit.values[n] != hypothesis.nulls[n]]


def smaller(h: Hypothesis, fit: Fit) -> str:
    """That an effect is smaller in a refit than the records can tell, in words; "": it is not."""
    if all(abs(fit.values[name] - null) < h.least for name, null in h.nulls.items()):
        return f"it is smaller than {h.least:.2g}, below which nothing is told"
    return ""


def holds(fuller: Hypothesis, simpler: Hypothesis) -> bool:
    """Whether a hypothesis without its own size is the other one, as a belt with a gap is a belt.

    It is then the other one and something more, which must be as sure as any effect, and no alternative to it.
    """
    more = set(fuller.names) - set(simpler.names)
    return set(simpler.names) < set(fuller.names) and more <= fuller.nulls.keys()


def unresolved(hypothesis: Hypothesis, fit: Fit, step: float) -> bool:
    """Whether all that a hypothesis changes is times far shorter than a step of integration, s: no physics by itself.

    A simulator that has made a recording may lag by a part of its own step.
    """
    if hypothesis.effect is None:
        return False
    units = {hypothesis.effect.row(p): p.unit for p in hypothesis.effect.parameters}
    sizes = {name: fit.values[name] - null for name, null in hypothesis.nulls.items()}
    return all(units.get(name) == "s" and abs(size) < RESOLVED * step for name, size in sizes.items())


def _ranked(found: Sequence[Refitted], library: Sequence[str]) -> list[Refitted]:
    """By penalised gain; of those that equal the best one left, the library's first goes before."""
    left, ranked = sorted(found, key=lambda c: library.index(c.hypothesis.name)), []
    while left:
        most = max(c.penalised_gain for c in left)
        first = next(c for c in left if c.penalised_gain > most - EQUAL)
        left.remove(first)
        ranked.append(first)
    return ranked


def refits(model: Model, base: Fit, scored: ScoreTests, nominals: Collection[str]) -> dict[str, Fit]:
    """The best refit of each hypothesis on top of ``base``, by name.

    Starts are those of `compare` and the best-scored probes as they are: a gap behind a spring has its own minimum.
    """
    chosen = sorted(scored.best.values(), key=lambda s: -s.gain)
    starts = [start for score in chosen for start in _starts(model, base, score, scored)]
    starts += _at_claims(model, base, starts, nominals)
    for score in chosen:
        starts += _probes(base, score.hypothesis, scored)[:STARTS]
    return _best_of(refit(model, scored.whitener, starts, _FIRST + _LAST + 2))


def _best_of(fits: Sequence[AnyFit]) -> dict[str, AnyFit]:
    best: dict[str, AnyFit] = {}
    for fit in fits:
        if fit.label not in best or fit.cost < best[fit.label].cost:
            best[fit.label] = fit
    return best


def _looked(model: Model, whitener: Whitener, starts: Sequence[Start], iterations: int) -> list[Look]:
    """The best start of each hypothesis after some iterations; the others are left after `_GLANCE` of them."""
    first = _best_of(look(model, whitener, starts, _GLANCE))
    starts = [Start(name, one.free, one.values) for name, one in first.items()]
    return look(model, whitener, starts, iterations - _GLANCE)


def _starts(model: Model, base: Fit, score: Score, scored: ScoreTests) -> list[Start]:
    """Starts of a refit: the best probes of a hypothesis at the size that their scores suggest."""
    hypothesis = score.hypothesis
    free = (*base.free, *(n for n in hypothesis.names if n not in base.free))
    own = sorted((s for s in scored.scores if s.hypothesis is hypothesis), key=lambda s: -s.gain)
    found = [_suggested(model, base, own[0])]
    as_is = max(own, key=lambda s: s.as_is)
    second = dict(as_is.directions[0]) if len(as_is.directions) == 1 and as_is.as_is > 0.0 else None
    for values in (second, *(_suggested(model, base, probe) for probe in own[1:])):
        if values is not None and values not in found and len(found) < STARTS:
            found.append(values)
    return [Start(hypothesis.name, free, {**base.values, **values}) for values in found]


def _probes(base: Fit, hypothesis: Hypothesis, scored: ScoreTests) -> list[Start]:
    """Starts at the probes of a hypothesis as they are, the best-scored first."""
    free = (*base.free, *(n for n in hypothesis.names if n not in base.free))
    own = sorted((s for s in scored.scores if s.hypothesis is hypothesis), key=lambda s: -s.gain)
    probes = [{name: value for direction in one.directions for name, value in direction.items()} for one in own]
    return [Start(hypothesis.name, free, {**base.values, **probe}) for probe in probes]


def _at_claims(model: Model, base: Fit, starts: Sequence[Start], nominals: Collection[str]) -> list[Start]:
    """Starts with nominal parameters as the recording claims them, where the refit has moved one far from it.

    It has moved them to imitate what is missing, and from there the way back is long, and a size that a score suggests
    there is none for the claims: `compare` tries the probes there, too. Of one without a prior a size at which it
    matters is far.
    """
    known = [p for p in model.parameters if p.name in nominals and p.name in base.free]
    if not any(abs(base.values[p.name] - p.start) > (FAR * p.std if p.std else p.scale) for p in known):
        return []
    claims = {p.name: p.start for p in known}
    return [Start(start.label, start.free, {**start.values, **claims}) for start in starts]


def _suggested(model: Model, base: Fit, score: Score) -> Mapping[str, float]:
    bounds = {p.name: p for p in model.parameters}
    suggested = {}
    directions = score.directions
    wave = score.hypothesis.wave
    if wave and len(directions) == 2 and wave[1] in directions[0]:  # sine and cosine parts are a size and a phase
        (sine, cosine), (row,) = score.amount, [n for n in directions[0] if n in score.hypothesis.nulls]
        height = bounds[row].clip(directions[0][row] * float(np.hypot(sine, cosine)))
        return {**directions[0], row: height, wave[1]: float(np.arctan2(cosine, sine))}
    for amount, direction in zip(score.amount, directions, strict=True):
        for name, value in direction.items():
            null = score.hypothesis.nulls.get(name)
            size = min(max(abs(amount), 0.05), 10.0)
            if name in base.free and name not in score.hypothesis.names:  # what hides the effect goes along
                moved = value - base.values[name] + score.absorbed.get(name, 0.0)
                suggested[name] = bounds[name].clip(base.values[name] + size * moved)
                continue
            if amount < 0.0:  # the wrong way: the other side of the null, or close to it where there is none
                one_way = null is not None and null in (bounds[name].low, bounds[name].high)
                size = 0.05 if one_way else -size
            if name in score.hypothesis.inverse:  # the stiffer, the less of it; what adds up is the compliance
                rigid = 1.0 / null if null else 0.0
                suggested[name] = bounds[name].clip(1.0 / max(rigid + abs(size) * (1.0 / value - rigid), 1e-300))
                continue
            suggested[name] = value if null is None else bounds[name].clip(null + size * (value - null))
    return suggested
