"""From scores to an answer: what is missing, one effect after the other, and whether anything is left.

1. Refit the nominals; learn the noise.
2. Score all hypotheses (`fit.score_tests`), refit the best of them (`search.comparison`), rank by deviance.
3. Accept the best where it gains more than noise would give to any of them, the held-out records do not speak against
   it, none of its parameters ends on a bound, its interval leaves the null out, and parts of the record agree.
4. Again on top of it. A further effect must also gain a share of what the first ones did: every formulation of physics
   is a little wrong, and what a first effect leaves for that reason is no second effect.
5. Each accepted effect is exchanged for every other hypothesis, given the others: the best stays.
6. `adequacy.tests` asks whether what is left is noise. Where it is not, nothing is named. Under a noise that is
   known from rest the held-out records are asked too: slow noise hides much, and another motion may show it. Not in
   white noise: there two formulations differ by what friction holds after a stop, in one of 20 recordings without a
   mismatch.
7. Where that names nothing, spectra are compared instead of residuals (`search.limit_cycles`): of a limit cycle no
   simulation has the phase. A simulator that oscillates by itself, and has the spectrum, is left as it is from the
   start.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cable_envs.diagnosis.adequacy.bands import Bands, Spectra
from cable_envs.diagnosis.adequacy.tests import Adequacy, adequacy
from cable_envs.diagnosis.fit.likelihood import Judged, refit_and_learn, refit_nominals, settled
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.search import limit_cycles, stages
from cable_envs.diagnosis.search.comparison import Candidate, compare
from cable_envs.diagnosis.search.objections import bounded, held_cost, momentary, objection, unstable
from cable_envs.diagnosis.search.rules import Rules
from cable_envs.diagnosis.search.selection import Selection

ENDING = 20
"""Iterations, at most, with which a candidate's refit ends: a load that sticks and slips is long on its way (a Stribeck
curve that was there gained 2868 when it was compared, 11500 after two more iterations, and 15400 in the end)."""
NOTHING = 1.0
"""Fall of the deviance that a number brings by chance in one recording of three."""
LIKE_ANY = "something drifts with the elapsed time"


def select(
    fit: Model,
    heldout: Model,
    nominals: tuple[str, ...],
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    *,
    rules: Rules | None = None,
    stated: Mapping[str, float] | None = None,
    plain: float | None = None,
    tell: Callable[[str], None] = lambda text: None,
    keep: Callable[[str, Callable[[], Any]], Any] = lambda name, make: make(),
) -> Selection:
    """The best model with at most ``rules.most`` of the hypotheses over the refit of the nominals.

    Parameters
    ----------
    fit, heldout : Model
        The records to fit, and those that may object.
    nominals : tuple of str
        Parameters that every refit moves.
    hypotheses : sequence of Hypothesis
        What may be missing.
    rng : numpy.random.Generator
        Of the draws behind p-values and of the search for limit cycles.
    rules : Rules, optional
        What is asked of an answer.
    stated : Mapping of str to float, optional
        Channel -> standard deviation of its noise, where the recording says it; a record at rest counts for as much
        (`cable_envs.diagnosis.model.model.Block.noise`).
    plain : float, optional
        Deviance of the refit without the effects that the models have already (of an augmented rig); what these explain
        counts as that of effects accepted here: a further one is asked for its share, and as little may be left.
    tell : callable
        Called with what is being done.
    keep : callable
        keep(name, make) gives ``make()``, or what it gave before an interruption (`cable_envs.diagnosis.search.steps`).

    Returns
    -------
    Selection
        The steps from the nominal refit to the last model, and the reasons.
    """
    rules, stated = rules or Rules(), dict(stated or {})
    at_rest = any(b.noise is not None for b in fit.blocks)
    rules = rules.under(at_rest, bool(stated))
    tell(stages.REFITTING)
    spectra = Spectra(fit, stated)
    by_itself = limit_cycles.oscillates(spectra, rules.gain)
    if by_itself:
        alone = limit_cycles.as_it_is(*_averaged(spectra, nominals, rng, keep), rules)
        if alone is not None:
            return alone
    null = keep("null", partial(refit_nominals, fit, nominals))
    bare = null.deviance if plain is None or plain - null.deviance < rules.gain else plain
    chosen: list[tuple[Hypothesis, Judged]] = []
    scored, tried = [], []
    refused: dict[str, str] = {}
    best = null
    while len(chosen) < rules.most:
        left = [h for h in hypotheses if h.name not in {c.name for c, _ in chosen}]
        if not left:
            break
        tell(stages.testing(len(left)))
        tests = keep("score_tests", partial(score_tests, fit, best, left, rng))
        scored.append(tests)
        tell(stages.COMPARING)
        found, compared = _compared(fit, heldout, best, tests, rules, bare - best.deviance, refused, keep)
        tried += compared
        if found is None:
            break
        chosen.append((found.hypothesis, found.judged))
        best = found.judged
        if (at_rest or stated) and rules.nothing_left(adequacy(fit, best, stated)):
            break  # nothing is left that a further effect could gain by; a learnt colour may hide one
    if len(chosen) > 1:
        tell(stages.EXCHANGING)
        chosen, best, swapped = _exchanged(fit, heldout, null, chosen, hypotheses, rng, rules, keep, bare)
        tried += swapped
    tell(stages.LEFT)
    also = heldout if at_rest else None
    after = adequacy(fit, best, stated, also)
    before = adequacy(fit, null, stated, also) if chosen else after
    unseen = max(_held_gain(heldout, best.whitener, null, best), 0.0) if chosen and at_rest else 0.0
    explained = bare - best.deviance + unseen
    accepted = _described(fit, heldout, null, best, chosen, tried, rules)
    share = rules.drifted if _tells_of_drift([h for h, _ in chosen], after) else rules.left
    adequate = rules.adequate(after, explained, share) and (bool(chosen) or not _like_drift(refused))
    smooth = Selection(
        null, best, accepted, tuple(scored), tuple(tried), before, after, adequate, refused, rules,
        explained=explained,
    )  # fmt: skip
    if by_itself or (adequate and accepted):
        return smooth
    tell(stages.SPECTRA)
    asked = (spectra, Spectra(heldout, stated), null.fit, hypotheses, rules.gain, rng)
    cycles = keep("spectra", partial(limit_cycles.search, *asked))
    return _or_limit_cycle(smooth, limit_cycles.explaining(spectra, null, cycles, rules))


def _averaged(spectra: Spectra, nominals: tuple[str, ...], rng: np.random.Generator, keep) -> tuple[Judged, Bands]:
    """The refit of a model that oscillates without any effect, and its bands."""
    return keep("averaged", partial(limit_cycles.refitted, spectra, nominals, rng))


def _or_limit_cycle(smooth: Selection, cycle: Selection | None) -> Selection:
    """The limit cycle that explains the spectra, with what was tried before it; else what was selected without one."""
    if cycle is None:
        return smooth
    return replace(
        cycle, score_tests=smooth.score_tests, tried=smooth.tried, refused=smooth.refused, before=smooth.before
    )


def _like_drift(refused: Mapping[str, str]) -> bool:
    """Whether a hypothesis was refused because it looks like anything that drifts."""
    return any(why.startswith(LIKE_ANY) for why in refused.values())


def _held_gain(heldout: Model, whitener: Whitener, one: Judged, other: Judged) -> float:
    """How much better the other is on the held-out records."""
    return held_cost(heldout, whitener, one.fit) - held_cost(heldout, whitener, other.fit)


def _compared(fit, heldout, base, scored, rules, so_far, refused, keep):
    """(the best candidate to which nothing is to be objected or None, all comparisons).

    A hypothesis that gains most and is refused must not hide the others, which were given up because of its gain: they
    are compared again without it.
    """
    comparisons: list[tuple[Candidate, ...]] = []
    out: set[str] = set()
    least = rules.least(None, so_far)
    while len(comparisons) < rules.again:
        candidates = keep("comparison", partial(compare, fit, base, scored, least, frozenset(out)))
        comparisons.append(tuple(candidates))
        found = _first(fit, heldout, base, scored, candidates, rules, so_far, refused)
        if found is not None and _like_any(found, rules):
            gains = f"it gains {found.gain:.1f}, and {rules.drifts:g} would be needed to say which effect it is"
            refused[found.hypothesis.name] = f"{LIKE_ANY}: {gains}"
            return None, comparisons
        if found is not None or not any(c.gain >= least for c in candidates):
            return found, comparisons
        out |= {c.hypothesis.name for c in candidates}
    return None, comparisons


def _like_any(candidate: Candidate, rules: Rules) -> bool:
    """Whether what was found is a drift too small to be told from others; nothing that gains less is it either."""
    return candidate.hypothesis.drifts and candidate.gain < rules.drifts


def _tells_of_drift(chosen: Sequence[Hypothesis], after: Adequacy) -> bool:
    """Whether what is left is measured by how much of a drift it is: one was named, or a constant is, that drifts."""
    still = any(h.constant for h in chosen)
    return any(h.drifts for h in chosen) or (still and "elapsed time" in after.leftovers[0].coordinate)


def _first(fit, heldout, base, scored, candidates, rules, so_far, refused) -> Candidate | None:
    """The best candidate to which nothing is to be objected."""
    base_held = held_cost(heldout, scored.whitener, base.fit)
    for candidate in candidates:
        h, mine = candidate.hypothesis, candidate.judged
        least = rules.least(h, so_far)
        if candidate.gain < least:
            refused.setdefault(h.name, f"it gains {candidate.gain:.1f}, less than the {least:.1f} that is asked")
            continue
        mine = settled(fit, mine, ENDING)
        candidate = replace(candidate, judged=mine, gain=base.deviance - mine.deviance)
        held = base_held - held_cost(heldout, scored.whitener, mine.fit)
        reason = objection(h, mine.fit, held, candidate.gain) or unstable(mine.fit, h) or momentary(fit, base, mine)
        if not reason:
            return candidate
        refused[h.name] = reason
    return None


def _exchanged(fit, heldout, null, chosen, hypotheses, rng, rules, keep, bare):
    """Each chosen effect against every other hypothesis, given the rest; what the rest has made needless goes.

    bare: deviance without any effect. An effect that was exchanged puts all others in doubt again.
    """
    tried, sure = [], {chosen[-1][0].name}  # the last one was chosen given all others
    for _ in range(3 * len(chosen)):
        doubtful = next((pair for pair in chosen if pair[0].name not in sure), None)
        if doubtful is None or len(chosen) == 1:
            break
        last = min((judged for _, judged in chosen), key=lambda j: j.deviance)
        rest = [pair for pair in chosen if pair is not doubtful]
        free = (*null.fit.free, *(n for h, _ in rest for n in h.names))
        start = Start("", free, {n: v for n, v in last.fit.values.items() if n in free})
        base = keep("rest", partial(refit_and_learn, fit, [start], 1))
        left = [h for h in hypotheses if h is doubtful[0] or h.name not in {h.name for h, _ in chosen}]
        tests = keep("score_tests", partial(score_tests, fit, base, left, rng))
        found, compared = _compared(fit, heldout, base, tests, rules, bare - base.deviance, {}, keep)
        tried += compared
        if found is None:
            chosen, sure = [(h, base) for h, _ in rest], {h.name for h, _ in rest[1:]}
        elif found.hypothesis is doubtful[0] or found.judged.deviance >= last.deviance:
            sure.add(doubtful[0].name)
        else:
            chosen, sure = [*rest, (found.hypothesis, found.judged)], {found.hypothesis.name}
    return chosen, min((judged for _, judged in chosen), key=lambda j: j.deviance), tried


def _described(fit, heldout, null, best, chosen, tried, rules) -> tuple[EffectGain, ...]:
    """Each chosen effect with gain, margin and alternatives, by the comparison that is nearest to the final model."""
    found = []
    taken = {h.name for h, _ in chosen}
    for hypothesis, judged in chosen:
        had = [c for c in tried if any(candidate.hypothesis is hypothesis for candidate in c)]
        nearest = min(had, key=lambda c: min(abs(one.judged.deviance - best.deviance) for one in c), default=())
        own = next((c for c in nearest if c.hypothesis is hypothesis), None)
        gain = own.gain if own else null.deviance - judged.deviance
        penalised = own.penalised_gain if own else np.inf
        rivals = [c for c in nearest if c.hypothesis.name not in taken]
        equal = tuple(
            c.hypothesis.name
            for c in rivals
            if penalised - c.penalised_gain < _apart(hypothesis, c.hypothesis, gain, rules)
            and not bounded(c.hypothesis, c.judged.fit)
            and not _ends_as(c, hypothesis, gain)
        )
        behind = [penalised - c.penalised_gain for c in rivals if c.hypothesis.name not in equal]
        held = _held_gain(heldout, best.whitener, null, judged)
        found.append(EffectGain(hypothesis, gain, held, min(behind, default=gain), equal))
    return tuple(found)


def _apart(one: Hypothesis, other: Hypothesis, gain: float, rules: Rules) -> float:
    """Fall of the deviance by which ``one``, that gains so much, must beat ``other`` to be told from it."""
    share = rules.declared if _declared_alike(one, other) else rules.alike
    return max(rules.margin, share * gain)


def _ends_as(candidate: Candidate, one: Hypothesis, gain: float) -> bool:
    """Whether a refitted hypothesis has become ``one``, which gains so much.

    It looks like it, and what shapes it more brings nothing: a Stribeck curve that does not fall below the fastest
    speed is Coulomb's friction by another name.
    """
    other = candidate.hypothesis
    fuller = len(other.names) - len(other.nulls) > len(one.names) - len(one.nulls)
    return fuller and _declared_alike(one, other) and candidate.gain < gain + NOTHING


def _declared_alike(one: Hypothesis, other: Hypothesis) -> bool:
    return other.canonical in one.confusable or one.canonical in other.confusable
