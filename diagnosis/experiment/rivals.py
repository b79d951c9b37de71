"""The models that an answer leaves open: what it names, and what it could not tell apart from that."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.evidence.candidates import Candidate, best_of, log_odds, under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.experiment.plan import GONE
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.fit.refit import Fit, Start, look, refit
from cable_envs.diagnosis.model.hypotheses import LOGGER, Hypothesis, effect_name
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.model.verdict import SURE, Diagnosis, EffectGain
from cable_envs.diagnosis.systems.question import Question

MOST = 4
"""Rivals at the most: the slopes of each are simulated for every motion."""
GLANCE, KEPT = 4, 2
"""Iterations of a refit from every probe of an effect, and how many of them go on."""


@dataclass(frozen=True)
class Rival:
    """A model that may be the true one.

    Parameters
    ----------
    name : str
        Its effects, with plus signs between.
    candidate : Candidate
        Refitted to all records.
    behind : float
        Log odds of the best rival over it, by the records so far.
    """

    name: str
    candidate: Candidate
    behind: float


def names_of(found: Diagnosis) -> list[tuple[str, ...]]:
    """Hypotheses of every model that an answer leaves open, the best first; one model where it leaves none.

    Parameters
    ----------
    found : Diagnosis
        Of the recording.

    Returns
    -------
    list of tuple of str
        An effect that cannot be told from others gives a model with each in its place. Of an unknown, what helps most.

    Raises
    ------
    ConfigurationError
        Where the answer is a fault of the data.
    """
    if found.verdict == "data_fault":
        checks = dict.fromkeys(fault.separating_experiment for fault in found.faults)
        raise ConfigurationError(
            "nothing is left open that a motion settles: the answer is a fault of the data"
            + "".join(f"; {check}" for check in checks)
        )
    named = tuple(e.hypothesis.name for e in found.effects)
    models = [named]
    for effect in found.effects:
        own = effect.hypothesis.name
        models += [tuple(other if n == own else n for n in named) for other in _others(effect) if other not in named]
    if not named:
        suspected = tuple(e.hypothesis.name for e in found.suspected)
        models = [suspected] if suspected else []
        models += [(n,) for n in _most_helpful(found) if (n,) not in models]
    return [m for k, m in enumerate(models) if m and m not in models[:k]][:MOST]


def _others(effect: EffectGain) -> list[str]:
    """Hypotheses of the rig that an effect cannot be told from: in which sensors and places they are the odds say."""
    by_odds = sorted((n for n in effect.rivals if not n.startswith(LOGGER)), key=lambda name: effect.rivals[name])
    close = [name for name in by_odds if effect.rivals[name] < np.log(SURE)]
    for alternative in effect.alternatives:
        if not alternative.startswith(LOGGER) and alternative not in map(effect_name, close):
            close.append(next((name for name in by_odds if effect_name(name) == alternative), alternative))
    return close


def _most_helpful(found: Diagnosis) -> list[str]:
    """Of the rig's effects that were tried alone, what is within `GONE` of the best."""
    tried = [h for h in found.hypotheses if not str(h["name"]).startswith(LOGGER)]
    odds = {str(h["name"]): float(h.get("log_odds") or 0.0) for h in tried}
    best = max(odds.values(), default=0.0)
    return [n for n, o in sorted(odds.items(), key=lambda item: -item[1]) if o > 0.0 and best - o < GONE]


def rivals(
    question: Question,
    models: Sequence[tuple[str, ...]],
    stated: Mapping[str, float],
    tell: Callable[[str], None] = lambda text: None,
) -> list[Rival]:
    """The models, refitted to all records and compared under one noise; of effects in several places the best counts.

    Parameters
    ----------
    question : Question
        Of the records there are.
    models : sequence of tuple of str
        Names of hypotheses of each model.
    stated : Mapping of str to float
        Channel -> standard deviation of its noise where the recording says it, SI.
    tell : callable
        Called with what is being done.

    Returns
    -------
    list of Rival
        The best first.

    Raises
    ------
    ConfigurationError
        For names that are no hypotheses of this recording.
    """
    known: dict[str, list[Hypothesis]] = {}
    for h in question.hypotheses:  # an answer's alternatives have the effect's name alone, whichever sensor they are of
        for name in dict.fromkeys((h.name, h.canonical)):
            known.setdefault(name, []).append(h)
    for names in models:
        require_known("effect", names, sorted(known))
    if not models:
        raise ConfigurationError("nothing is left open: no effect is named, and none that was tried helps")
    null = refit_nominals(question.fit, question.nominals)
    joint = Joint(question.fit, question.heldout)
    fits = []
    for names in models:
        tell(f"refitting {' + '.join(names)}")
        several = product(*([one for h in known[n] for one in (h, *h.parts)] for n in names))
        fits += [(effects, _refitted(question.fit, null.whitener, null.fit, effects)) for effects in several]
    leader = int(np.argmin([fit.cost for _, fit in fits]))
    candidates = under_one_noise(question.fit, joint, fits, leader, stated, joint.left_by(null.fit))
    best = max(candidates, key=lambda c: log_odds(c, candidates[0]))
    named = best_of((" + ".join(h.name for h in c.effects), c) for c in candidates)
    found = [Rival(name, c, log_odds(best, c)) for name, c in named.items()]
    return sorted(found, key=lambda r: r.behind)


def compared(question: Question, open_ones: Sequence[Rival], stated: Mapping[str, float]) -> np.ndarray:
    """Log odds of the best of the rivals over each, refitted to the records of another question [rivals].

    Parameters
    ----------
    question : Question
        With further records.
    open_ones : sequence of Rival
        That begin where they are.
    stated : Mapping of str to float
        As of `rivals`.
    """
    joint = Joint(question.fit, question.heldout)
    known = {p.name for p in question.fit.parameters}
    starts = []
    for rival in open_ones:
        peak = rival.candidate.peak
        free = (*question.nominals, *(n for h in rival.candidate.effects for n in h.names))
        starts.append(
            Start(rival.name, tuple(dict.fromkeys(free)), {n: v for n, v in peak.values.items() if n in known})
        )
    fits = refit(question.fit, open_ones[0].candidate.frame.whitener, starts, GLANCE, central=False)
    leader = int(np.argmin([fit.cost for fit in fits]))
    models = [(r.candidate.effects, fit) for r, fit in zip(open_ones, fits, strict=True)]
    candidates = under_one_noise(question.fit, joint, models, leader, stated, joint.left_by(fits[leader]))
    odds = np.array([log_odds(c, candidates[0]) for c in candidates])
    return odds.max() - odds


def _refitted(model: Model, whitener: Whitener, null: Fit, effects: Sequence[Hypothesis]) -> Fit:
    """A model with effects, one after the other, each from its probes."""
    free, values = null.free, dict(null.values)
    found = null
    for effect in effects:
        free = (*free, *(n for n in effect.names if n not in free))
        starts = [Start(effect.name, free, {**values, **one}) for probe in effect.probes for one in probe]
        looks = sorted(look(model, whitener, starts, GLANCE), key=lambda one: one.cost)[:KEPT]
        goes_on = [Start(effect.name, free, one.values) for one in looks]
        found = min(refit(model, whitener, goes_on, central=False), key=lambda fit: fit.cost)
        values = dict(found.values)
    return found
