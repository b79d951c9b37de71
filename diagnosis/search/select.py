"""From a question to a selection: the search for effects, what they leave, and limit cycles.

The evidence of models with more and fewer effects decides (`search.effects`). What the last model leaves is asked for
whatever is not noise (`evidence.left`). Where something is left that nothing explains, spectra are compared instead of
residuals (`search.limit_cycles`): of a limit cycle no simulation has the phase. A simulator that oscillates by itself,
and has the spectrum, is left as it is from the start.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cable_envs.diagnosis.evidence.bands import Spectra
from cable_envs.diagnosis.evidence.candidates import Candidate
from cable_envs.diagnosis.evidence.left import left_by
from cable_envs.diagnosis.fit.likelihood import Judged, judge, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.weights import rms_by_channel
from cable_envs.diagnosis.model.features import ELAPSED
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.model.verdict import NAMED, NOMINAL, SURE, EffectGain, Estimate
from cable_envs.diagnosis.search import limit_cycles, stages
from cable_envs.diagnosis.search.effects import Search
from cable_envs.diagnosis.search.elsewhere import Group, asked_elsewhere, worse_than_claim
from cable_envs.diagnosis.search.selection import Found, Round, Selection, confidence
from cable_envs.effects.base import FORCE, PLACE

BIAS = "sensor_bias"
"""Effect that is no constant, and nothing of the rig, where the sensor's zero drifts."""
KINDS = {"m": PLACE, "rad": PLACE, "N": FORCE, "N m": FORCE}
"""Unit of a channel -> what it is of."""
WORSE = 1.05
"""RMS of a channel's error over its standard deviation from which its own mean would have predicted it better."""


def select(
    fit: Model,
    heldout: Model,
    nominals: tuple[str, ...],
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    *,
    stated: Mapping[str, float] | None = None,
    without: Mapping[str, float] | None = None,
    groups: Sequence[Group] = (),
    tell: Callable[[str], None] = lambda text: None,
    keep: Callable[[str, Callable[[], Any]], Any] = lambda name, make: make(),
) -> Selection:  # fmt: skip
    """The model of a recording that has the largest evidence, over the refit of the nominals.

    Parameters
    ----------
    fit, heldout : Model
        The records to fit, and those that no refit sees; both count as evidence.
    nominals : tuple of str
        Parameters that every refit moves.
    hypotheses : sequence of Hypothesis
        What may be missing.
    rng : numpy.random.Generator
        Of the draws behind p-values and of the search for limit cycles.
    stated : Mapping of str to float, optional
        Channel -> standard deviation of its noise, where the recording says it; a record at rest counts for as much
        (`cable_envs.diagnosis.model.model.Block.noise`).
    without : Mapping of str to float, optional
        Channel -> RMS of what the models leave without the effects that they have already (of an augmented rig), SI.
        What a formulation may be off by is counted in that.
    groups : sequence of Group, optional
        Of the records: on each, every effect is asked given all others (`cable_envs.diagnosis.search.elsewhere`).
    tell : callable
        Called with what is being done.
    keep : callable
        keep(name, make) gives ``make()``, or what it gave before an interruption (`cable_envs.diagnosis.search.steps`).

    Returns
    -------
    Selection
        The steps from the nominal refit to the last model, and the reasons.
    """
    stated = dict(stated or {})
    spectra = Spectra(fit, stated)
    by_itself = limit_cycles.oscillates(spectra)
    if by_itself:
        tell(stages.REFITTING)
        alone = limit_cycles.as_it_is(*keep("averaged", partial(limit_cycles.refitted, spectra, nominals, rng)))
        if alone is not None:
            return alone
    search = Search(
        fit, heldout, nominals, hypotheses, rng, stated=stated, without=without, tell=tell, keep=keep
    )  # fmt: skip
    found = search.run()
    tell(stages.LEFT)
    smooth = _unseen(_selection(found, search, heldout, stated), found, search)
    if smooth.accepted and groups:
        tell(stages.ELSEWHERE)
        told = keep("elsewhere", partial(asked_elsewhere, search.joint, found.best, groups, search.refits.known))
        smooth = replace(
            smooth, accepted=tuple(replace(a, elsewhere=told.get(a.hypothesis.name, {})) for a in smooth.accepted)
        )
    if by_itself or smooth.redundant or (smooth.accepted and smooth.verdict != "unknown"):
        return smooth
    tell(stages.SPECTRA)
    asked = (spectra, Spectra(heldout, stated), found.null.fit, hypotheses, rng)
    cycles = keep("spectra", partial(limit_cycles.search, *asked))
    cycle = limit_cycles.explaining(spectra, found.null, cycles)
    if cycle is None:
        return smooth
    return replace(
        cycle, score_tests=smooth.score_tests, tried=smooth.tried, refused=smooth.refused, before=smooth.before
    )  # fmt: skip


def _selection(found: Found, search: Search, heldout: Model, stated: Mapping[str, float]) -> Selection:
    bare, best, first, last = found.bare, found.best, found.rounds[0], found.rounds[-1]
    of_the_rig = search.odds.of_the_rig(bare.frame)
    after = left_by(search.joint, best, bare, of_the_rig, stated)
    before = left_by(search.joint, bare, bare, of_the_rig, stated) if best is not bare else after

    drifting = {
        f"sensor_bias.{k.channel}" for k in after.kinds if k.coordinate == ELAPSED and k.log_odds > np.log(SURE)
    }

    constants = _constants(found, {b.channel: b.unit for b in search.fit.blocks}) - drifting

    def gains(of_data: bool) -> tuple[EffectGain, ...]:
        there = (h for h in best.effects if h.name not in constants)
        return tuple(_gain(h, found) for h in there if (h.of_logger or h.name in drifting) is of_data)

    return Selection(
        _judged(search.fit, bare, found.null), _judged(search.fit, best, found.null),
        gains(False), gains(True), before, after, first.score_tests,
        {**last.odds, **first.odds}, dict(last.odds), {**last.bounded, **first.bounded},
        tuple(_steps(found, search.fit, heldout)),
        tuple(_unpredicted(heldout, best.fit)) if best.effects else (),
        constants=tuple(_gain(h, found) for h in best.effects if h.name in constants),
    )  # fmt: skip


def _constants(found: Found, units: Mapping[str, str]) -> set[str]:
    """Names of biases of sensors beside a law to which other formulations add such a constant.

    And of what the records cannot distinguish from such a bias; units: of the channels.
    """
    laws = {h.name for h in found.best.effects if h.effect is not None and h.effect.offsets}
    beside = {kind for h in found.best.effects if h.name in laws and h.effect is not None for kind in h.effect.offsets}
    biases = {f"{BIAS}.{channel}" for channel, unit in units.items() if KINDS.get(unit) in beside}
    others = [h.name for h in found.best.effects if h.name not in laws]
    return {name for name in others if biases & {name, *found.alternatives(name)}}


def _unseen(selection: Selection, found: Found, search: Search) -> Selection:
    """The selection, with nothing kept that predicts unseen records worse than the model as it was claimed."""
    claim = {p.name: p.start for p in search.fit.parameters}
    seen = len(search.fit.blocks)
    if selection.accepted:
        selection = replace(selection, worse=worse_than_claim(search.joint, found.best, seen, claim))
    if selection.verdict in NAMED or not worse_than_claim(search.joint, found.bare, seen, claim):
        return selection
    start = Start("as claimed", found.null.fit.free, {})
    fit = refit(search.fit, found.bare.frame.whitener, [start], 0)[0]
    null = replace(judge(search.fit, fit)[0], whitener=found.bare.frame.whitener)
    final = selection.final if found.best.effects else null
    return replace(selection, null=null, final=final, as_claimed=True)


def _judged(model: Model, candidate: Candidate, null: Judged) -> Judged:
    """A candidate with the covariance of its posterior, wide enough for the discrepancy beside it."""
    fit = replace(candidate.fit, covariance=candidate.covariance)
    raw = tuple(raw_residuals(model, fit))
    return Judged(fit, raw, candidate.frame.whitener, null.deviance - 2.0 * candidate.plain.fit)


def _gain(h: Hypothesis, found: Found) -> EffectGain:
    """An accepted effect with its odds."""
    against = found.against(h.name)
    rivals = found.rivals.get(h.name, {})
    margin = min(against)
    return EffectGain(
        h, float(found.without[h.name]), 0.0, float(margin), found.alternatives(h.name),
        confidence=confidence(against, found.learnt, found.over_formulation.get(h.name, np.inf)),
        rivals={name: float(odds) for name, odds in rivals.items()},
    )  # fmt: skip


def _steps(found: Found, fit: Model, heldout: Model) -> list[EffectGain]:
    """The refit alone, each effect as it was added, and what exchanging has changed."""

    def with_errors(step: EffectGain, of: Fit) -> EffectGain:
        return replace(
            step, fit=rms_by_channel(fit, raw_residuals(fit, of)),
            heldout=rms_by_channel(heldout, raw_residuals(heldout, of)),
            parameters={n: Estimate(of.values[n], *of.interval(n), "") for n in of.free},
        )  # fmt: skip

    steps = [with_errors(EffectGain(NOMINAL), found.rounds[0].base.fit)]
    for before, turn in zip(found.rounds, found.rounds[1:], strict=False):
        steps.append(with_errors(_step(before, turn.base.effects[-1]), turn.base.fit))
    path, last = [h.name for h in found.rounds[-1].base.effects], found.best
    new = [h for h in last.effects if h.name not in path]
    gone = tuple(name for name in path if name not in {h.name for h in last.effects})
    steps += [EffectGain(h, float(found.without[h.name])) for h in new]
    final = _judged(fit, last, found.null).fit
    alike = {h.name: found.alternatives(h.name) for h in last.effects}
    sure = {h.name: _gain(h, found).confidence for h in last.effects}
    steps = [
        replace(s, alternatives=alike[s.hypothesis.name], confidence=sure[s.hypothesis.name])
        if s.hypothesis.name in alike else s
        for s in steps
    ]  # fmt: skip
    steps[len(path) :] = [with_errors(s, final) for s in steps[len(path) :]]
    steps[-1] = replace(steps[-1], dropped=gone)
    return steps


def _step(before: Round, added: Hypothesis) -> EffectGain:
    odds = before.odds[added.name]
    alike = tuple(n for n, other in before.odds.items() if n != added.name and odds - other < np.log(SURE))
    return EffectGain(added, odds, 0.0, odds, alike, rivals=dict(before.odds))


def _unpredicted(model: Model, fit: Fit) -> list[str]:
    """Channels that a fit predicts worse than their own mean does."""
    left = rms_by_channel(model, raw_residuals(model, fit))
    about = {}
    for channel in left:
        seen = np.concatenate([b.measured[b.good] for b in model.blocks if b.channel == channel])
        about[channel] = float(np.std(seen))
    return [channel for channel, error in left.items() if error > WORSE * about[channel]]
