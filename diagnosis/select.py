"""From scores to an answer: what is missing, one effect after the other, and whether anything is left.

1. Refit the nominals; learn the noise.
2. Score all hypotheses (`diagnosis.screen`), refit the best of them (`diagnosis.race`), rank by deviance.
3. Accept the best where it gains more than noise would give to any of them, the held-out records do not speak against
   it, none of its parameters ends on a bound, its interval leaves the null out, and parts of the record agree.
4. Again on top of it. A further effect must also gain a share of what the first ones did: every formulation of physics
   is a little wrong, and what a first effect leaves for that reason is no second effect.
5. Each accepted effect is exchanged for every other hypothesis, given the others: the best stays.
6. `diagnosis.adequacy` asks whether what is left is noise. Where it is not, nothing is named. Under a noise that is
   known from rest the held-out records are asked too: slow noise hides much, and another motion may show it. Not in
   white noise: there two formulations differ by what friction holds after a stop, in one of 20 quiet recordings.
7. Where that names nothing, spectra are compared instead of residuals (`diagnosis.hunting`): of a loop that hunts no
   simulation has the phase. A simulator that hunts by itself, and has the spectrum, is left as it is from the start.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from diagnosis import hunting
from diagnosis.adequacy import Adequacy, adequacy
from diagnosis.bands import Bands, Spectra
from diagnosis.hypotheses import Hypothesis
from diagnosis.likelihood import Judged, refit_and_learn, refit_nominals, settled
from diagnosis.model import Model, Whitener
from diagnosis.objections import bounded, held_cost, momentary, objection, unstable
from diagnosis.race import Candidate, race
from diagnosis.refit import Start
from diagnosis.screen import Screening, screen
from diagnosis.verdict import Step

DRIFTS = ("friction_drift",)
"""Effects that change with the elapsed time alone. Under a noise whose colour is learnt, a leaking load, a warm cable
and a sagging supply gained 41 to 74 as such (recordings that no proof uses)."""
CONSTANT = ("sensor_scale", "sensor_bias")
"""Effects that are none where they change with the elapsed time: a warming sensor is no scale."""
ENDING = 20
"""Iterations, at most, with which a candidate's refit ends: a load that sticks and slips is long on its way (a Stribeck
curve that was there gained 2868 after a race, 11500 after two more iterations, and 15400 in the end)."""
NOTHING = 1.0
"""Fall of the deviance that a number brings by chance in one recording of three."""
LIKE_ANY = "something drifts with the elapsed time"


@dataclass(frozen=True)
class Rules:
    """What is asked of an answer; found on recordings that are spent for proofs (docs/diagnosis.md).

    gain      | least fall of the deviance for an effect to be accepted, and for each further parameter that it has
    coloured  | the same where the noise has a colour: it takes what lasts, learnt of a bias all but some 40
    rest      | the same where a record at rest tells the colour: nothing of the mismatch is in it
    drifts    | least gain from which what changes with the elapsed time alone (`DRIFTS`) is named; below that: unknown
    alone_p   | the same where nothing is named
    hidden_p  | ``left_p`` and ``alone_p`` where the noise has a colour, known from rest or learnt: it hides much
    further   | the same for a further effect
    share     | least gain of a further effect over that of all before it
    races     | times that what was behind a refused hypothesis may race again
    margin    | fall of the deviance by which an effect must beat another to be told from it
    alike     | the same as a share of its gain: the formulation of either is a little wrong
    declared  | the same of effects that are declared to look alike: what tells them apart is smaller than a formulation
    left_p    | familywise p-value below which what is left is not noise
    alone     | least excess of what is left for "unknown" where nothing is named: two formulations differ a little;
              | where a record at rest tells the noise the p-value by itself decides
    left      | share of all that was to be explained, which may be left when something is named
    drifted   | the same when what changes with the elapsed time alone is, or a constant is that still drifts: either
              | explains much of a drift of another kind
    swinging  | the same of a simulator that oscillates by itself: nothing has adapted it to the recording's oscillation
    over      | RMS over the stated noise up to which a model may be right
    beside    | what a model with an effect in it may have more: impacts in a gap are no two times the same
    clean     | p-value above which, with an RMS over the stated noise below ``white``, no further effect is looked for
    most      | effects at the most
    """

    gain: float = 40.0
    coloured: float = 30.0
    rest: float = 21.0
    drifts: float = 80.0
    further: float = 60.0
    each: float = 4.0
    share: float = 0.15
    margin: float = 10.0
    alike: float = 0.01
    declared: float = 0.1
    left_p: float = 1e-6
    alone_p: float = 1e-6
    hidden_p: float = 1e-3
    alone: float = 35.0
    left: float = 0.22
    drifted: float = 0.05
    swinging: float = 0.35
    over: float = 1.08
    beside: float = 0.1
    clean: float = 0.05
    white: float = 1.04
    most: int = 2
    races: int = 3


@dataclass(frozen=True)
class Accepted:
    """An effect that was found, with what it was chosen from."""

    hypothesis: Hypothesis
    gain: float
    heldout_gain: float
    alternatives: tuple[str, ...]
    margin: float
    """deviance of the best other hypothesis less its own; of those that are no alternatives"""


@dataclass(frozen=True)
class Selection:
    """The steps from the nominal refit to the last model, and the reasons."""

    null: Judged
    final: Judged
    accepted: tuple[Accepted, ...]
    screenings: tuple[Screening, ...]
    tried: tuple[tuple[Candidate, ...], ...]
    before: Adequacy
    after: Adequacy
    adequate: bool
    refused: Mapping[str, str] = field(default_factory=dict)
    rules: Rules = field(default_factory=Rules)
    steps: tuple[Step, ...] = ()
    """of the ladder, where the held-out records judge (`diagnosis.unseen`)"""
    explained: float = 0.0
    """what the effects gain on all records that are asked whether what is left is noise"""
    bands: Bands | None = None
    """spectra of the last model, where it was judged by these; ``after`` is then of them"""

    @property
    def verdict(self) -> str:
        """As in the specification."""
        if not self.adequate:
            return "unknown"
        if not self.accepted:
            return "no_detectable_mismatch"
        return "equivalence_class" if any(a.alternatives for a in self.accepted) else "named"


def select(
    fit: Model,
    heldout: Model,
    nominals: tuple[str, ...],
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    *,
    rules: Rules | None = None,
    stated: Mapping[str, float] | None = None,
    tell: Callable[[str], None] = lambda text: None,
    keep: Callable[[str, Callable[[], Any]], Any] = lambda name, make: make(),
) -> Selection:
    """The best model with at most ``rules.most`` of the hypotheses over the refit of ``nominals``.

    stated: channel -> standard deviation of its noise, where the recording says it; a record at rest counts for as much
    (`diagnosis.model.Block.noise`). keep(name, make) gives ``make()``,
    or what it gave before an interruption (`diagnosis.steps`).
    """
    rules, stated = rules or Rules(), dict(stated or {})
    at_rest = any(b.noise is not None for b in fit.blocks)
    known = at_rest or bool(stated)
    if at_rest or not stated:
        hidden, gain = max(rules.hidden_p, rules.left_p), min(rules.gain, rules.rest if at_rest else rules.coloured)
        rules = replace(rules, gain=gain, left_p=hidden, alone_p=max(hidden, rules.alone_p))
    if known:
        rules = replace(rules, drifts=rules.gain)
    if at_rest:
        rules = replace(rules, alone=0.0)
    tell("refitting the nominal parameters")
    spectra = Spectra(fit, stated)
    by_itself = hunting.oscillates(spectra, rules.gain)
    if by_itself:
        alone = _as_it_swings(*keep("averaged", partial(hunting.refitted, spectra, nominals, rng)), rules)
        if alone is not None:
            return alone
    null = keep("null", partial(refit_nominals, fit, nominals))
    chosen: list[tuple[Hypothesis, Judged]] = []
    screenings, tried, refused = [], [], {}
    best = null
    while len(chosen) < rules.most:
        left = [h for h in hypotheses if h.name not in {c.name for c, _ in chosen}]
        if not left:
            break
        tell(f"scoring {len(left)} hypotheses")
        screening = keep("screen", partial(screen, fit, best, left, rng))
        screenings.append(screening)
        tell("refitting the best of them")
        so_far = null.deviance - best.deviance
        found, races = _raced(fit, heldout, best, screening, rules, so_far, refused, keep)
        tried += races
        if found is None:
            break
        chosen.append((found.hypothesis, found.judged))
        best = found.judged
        if known and _clean(adequacy(fit, best, stated), rules):
            break  # nothing is left that a further effect could gain by; a learnt colour may hide one
    if len(chosen) > 1:
        tell("exchanging each effect for every other")
        chosen, best, swapped = _exchanged(fit, heldout, null, chosen, hypotheses, rng, rules, keep)
        tried += swapped
    tell("looking at what is left")
    also = heldout if at_rest else None
    after = adequacy(fit, best, stated, also)
    before = adequacy(fit, null, stated, also) if chosen else after
    explained = null.deviance - best.deviance
    if chosen and at_rest:
        explained += max(_held_gain(heldout, best.whitener, null, best), 0.0)
    accepted = _described(fit, heldout, null, best, chosen, tried, rules)
    drifting = not chosen and any(why.startswith(LIKE_ANY) for why in refused.values())
    share = rules.drifted if _tells_of_drift([h for h, _ in chosen], after) else rules.left
    adequate = _adequate(after, explained, rules, share) and not drifting
    if not by_itself and not (adequate and accepted):
        tell("comparing spectra")
        swung = (spectra, Spectra(heldout, stated), null.fit, hypotheses, rules.gain, rng)
        found = keep("spectra", partial(hunting.oscillations, *swung))
        swinging = _swings(spectra, null, found, rules)
        if swinging is not None:
            return replace(swinging, screenings=tuple(screenings), tried=tuple(tried), refused=refused, before=before)
    return Selection(
        null, best, accepted, tuple(screenings), tuple(tried), before, after, adequate, refused, rules,
        explained=explained,
    )  # fmt: skip


def _as_it_swings(null: Judged, bands: Bands, rules: Rules) -> Selection | None:
    """The answer where the simulator hunts without any effect, and the recording as it does."""
    after, explained = hunting.left_by(bands), bands.still.cost - bands.cost
    if explained <= 0.0 or not _adequate(after, explained, rules, rules.swinging):
        return None
    return Selection(null, null, (), (), (), after, after, True, rules=rules, explained=explained, bands=bands)


def _swings(spectra: Spectra, null: Judged, found: Sequence[hunting.Oscillation], rules: Rules) -> Selection | None:
    """The answer of the best of what makes the simulator hunt as the recording does, if that explains it."""
    best = next(iter(found), None)
    if best is None or best.gain < _least(best.hypothesis, rules, 0.0):
        return None
    after, apart = hunting.left_by(best.bands), best.bands.dispersion
    if not _adequate(after, best.gain, rules, rules.left):
        return None
    behind = {o.hypothesis.name: (best.gain - o.gain) / apart for o in found[1:]}
    equal = tuple(name for name, by in behind.items() if by < rules.margin)
    margin = min((by for by in behind.values() if by >= rules.margin), default=best.gain / apart)
    accepted = Accepted(best.hypothesis, best.gain, best.heldout, equal, margin)
    final = hunting.judged(spectra, null, best)
    return Selection(
        null, final, (accepted,), (), (), after, after, True, rules=rules, explained=best.gain, bands=best.bands
    )  # fmt: skip


def _held_gain(heldout: Model, whitener: Whitener, one: Judged, other: Judged) -> float:
    """How much better the other is on the held-out records."""
    return held_cost(heldout, whitener, one.fit) - held_cost(heldout, whitener, other.fit)


def _clean(left: Adequacy, rules: Rules) -> bool:
    """Whether nothing at all is left."""
    return left.p_value > rules.clean and left.over_noise < rules.white


def _adequate(after: Adequacy, explained: float, rules: Rules, share: float) -> bool:
    """Whether what is left may stay: noise, or no more than a ``share`` of what was explained."""
    named = explained > 0.0
    if after.over_noise > rules.over + (rules.beside if named else 0.0):
        return False
    least = rules.left_p if named else rules.alone_p
    return after.p_value >= least or after.excess < (share * explained if named else rules.alone)


def _least(hypothesis: Hypothesis | None, rules: Rules, so_far: float) -> float:
    """Least gain of a hypothesis (of any, for None) on top of effects that gained ``so_far``."""
    numbers = 0 if hypothesis is None else len(hypothesis.free) - 1
    return max((rules.further if so_far > 0.0 else rules.gain) + rules.each * numbers, rules.share * so_far)


def _raced(fit, heldout, base, screening, rules, so_far, refused, keep):
    """(the best candidate to which nothing is to be objected or None, all races).

    A hypothesis that gains most and is refused must not hide the others, which were given up because of its gain: they
    race again without it.
    """
    races, out = [], set()
    least = _least(None, rules, so_far)
    while len(races) < rules.races:
        candidates = keep("race", partial(race, fit, base, screening, least, frozenset(out)))
        races.append(tuple(candidates))
        found = _first(fit, heldout, base, screening, candidates, rules, so_far, refused)
        if found is not None and _like_any(found, rules):
            gains = f"it gains {found.gain:.1f}, less than the {rules.drifts:g} that would tell what"
            refused[found.hypothesis.name] = f"{LIKE_ANY}: {gains}"
            return None, races
        if found is not None or not any(c.gain >= least for c in candidates):
            return found, races
        out |= {c.hypothesis.name for c in candidates}
    return None, races


def _like_any(candidate: Candidate, rules: Rules) -> bool:
    """Whether what was found is a drift too small to be told from others; nothing that gains less is it either."""
    return _drifts(candidate.hypothesis) and candidate.gain < rules.drifts


def _tells_of_drift(chosen: Sequence[Hypothesis], after: Adequacy) -> bool:
    """Whether what is left is measured by how much of a drift it is: one was named, or a constant is, that drifts."""
    still = any(h.name.split(".")[0] in CONSTANT for h in chosen)
    return any(_drifts(h) for h in chosen) or (still and "elapsed time" in after.leftovers[0].coordinate)


def _drifts(hypothesis: Hypothesis) -> bool:
    return hypothesis.name.split(".")[0] in DRIFTS


def _first(fit, heldout, base, screening, candidates, rules, so_far, refused) -> Candidate | None:
    """The best candidate to which nothing is to be objected."""
    base_held = held_cost(heldout, screening.whitener, base.fit)
    for candidate in candidates:
        h, mine = candidate.hypothesis, candidate.judged
        least = _least(h, rules, so_far)
        if candidate.gain < least:
            refused.setdefault(h.name, f"it gains {candidate.gain:.1f}, less than the {least:.1f} that is asked")
            continue
        mine = settled(fit, mine, ENDING)
        candidate = replace(candidate, judged=mine, gain=base.deviance - mine.deviance)
        held = base_held - held_cost(heldout, screening.whitener, mine.fit)
        reason = objection(h, mine.fit, held, candidate.gain) or unstable(mine.fit, h) or momentary(fit, base, mine)
        if not reason:
            return candidate
        refused[h.name] = reason
    return None


def _exchanged(fit, heldout, null, chosen, hypotheses, rng, rules, keep):
    """Each chosen effect against every other hypothesis, given the rest; what the rest has made needless goes.

    An effect that was exchanged puts all others in doubt again.
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
        screening = keep("screen", partial(screen, fit, base, left, rng))
        found, races = _raced(fit, heldout, base, screening, rules, null.deviance - base.deviance, {}, keep)
        tried += races
        if found is None:
            chosen, sure = [(h, base) for h, _ in rest], {h.name for h, _ in rest[1:]}
        elif found.hypothesis is doubtful[0] or found.judged.deviance >= last.deviance:
            sure.add(doubtful[0].name)
        else:
            chosen, sure = [*rest, (found.hypothesis, found.judged)], {found.hypothesis.name}
    return chosen, min((judged for _, judged in chosen), key=lambda j: j.deviance), tried


def _described(fit, heldout, null, best, chosen, tried, rules) -> tuple[Accepted, ...]:
    found = []
    for hypothesis, judged in chosen:
        # of the races that had it, the one nearest to the final model
        races = [r for r in tried if any(c.hypothesis is hypothesis for c in r)]
        race_of = min(races, key=lambda r: min(abs(c.judged.deviance - best.deviance) for c in r), default=())
        own = [c for c in race_of if c.hypothesis is hypothesis]
        gain, worth = (own[0].gain, own[0].worth) if own else (null.deviance - judged.deviance, np.inf)
        taken = {h.name for h, _ in chosen}
        rivals = [c for c in race_of if c.hypothesis.name not in taken]
        close = [
            c
            for c in rivals
            if worth - c.worth < _apart(hypothesis, c.hypothesis, gain, rules)
            and not bounded(c.hypothesis, c.judged.fit)
            and not _ends_as(c, hypothesis, gain)
        ]
        equal = tuple(c.hypothesis.name for c in close)
        margin = min((worth - c.worth for c in rivals if c.hypothesis.name not in equal), default=gain)
        held = _held_gain(heldout, best.whitener, null, judged)
        found.append(Accepted(hypothesis, gain, held, equal, margin))
    return tuple(found)


def _apart(one: Hypothesis, other: Hypothesis, gain: float, rules: Rules) -> float:
    """Fall of the deviance by which ``one``, that gains so much, must beat ``other`` to be told from it."""
    share = rules.declared if _declared_alike(one, other) else rules.alike
    return max(rules.margin, share * gain)


def _ends_as(candidate: Candidate, one: Hypothesis, gain: float) -> bool:
    """Whether a refitted hypothesis has become ``one``, which gains so much: it looks like it, and what shapes it more
    brings nothing. A Stribeck curve that does not fall below the fastest speed is Coulomb's friction by another name.
    """
    other = candidate.hypothesis
    fuller = len(other.names) - len(other.nulls) > len(one.names) - len(one.nulls)
    return fuller and _declared_alike(one, other) and candidate.gain < gain + NOTHING


def _declared_alike(one: Hypothesis, other: Hypothesis) -> bool:
    name, rival = one.name.split(".")[0], other.name.split(".")[0]
    return rival in one.confusable or name in other.confusable
