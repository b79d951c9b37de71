"""Stepwise selection of effects by held-out records (cross-validation by hold-out): the criterion "unseen".

`search.select` takes what is left after a refit for sensor noise with a colour, and whitens it. On a bench whose
sensors are far better than any model (0.2 mN m against 3) what is left is model error, slow over seconds: an
autoregression of it would throw away the slow parts, which are what a model is to explain. Here every channel counts by
its residual's size and by its effective sample size (`fit.weights`), and the records that no refit has seen judge.
Scores, starts and refits are those of `cable_envs.diagnosis.fit.score_tests` and
`cable_envs.diagnosis.search.comparison`.

forward    | score all hypotheses (`score_tests`), refit the best, take the one that improves the held-out records most
accept     | if that gain is above `MARGIN`, comes from most held-out records, no size ends on a bound
backward   | whatever the held-out records do not miss any more, once others are in, goes
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.score_tests import ScoreTests, score_tests
from cable_envs.diagnosis.fit.weights import autocorrelation_time, multistart, reweighted_refit, rmse
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.model.verdict import NOMINAL, EffectGain
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.search.comparison import refits
from cable_envs.diagnosis.search.objections import bounded

MARGIN = 6.0
"""Held-out gain (`HeldoutError.gain`) that an effect must bring: a likelihood ratio of e^3."""
MISSED = 2.0
"""Held-out gain below which an effect that is in goes again."""
SHARE = 0.6
"""Of the held-out records that must gain."""
EQUAL = 1.0
"""Difference of penalised gains that says nothing."""
NEAR, RIVALS = 0.4, 3
"""Share of the best gain from which a hypothesis is refitted from more starts, and how many of them at the most."""
MOST = 10
"""Effects at the most."""
Keep = Callable[[str, Callable[[], Any]], Any]


@dataclass(frozen=True, kw_only=True)
class Step(EffectGain):
    """A step of the selection: the effect that was added (`NOMINAL` at the first), with its refit.

    ``gain`` and ``margin`` are of the held-out records (`HeldoutError.gain`), ``alternatives`` rivals over which it
    gains less than `MARGIN`. ``rivals`` are all in effective samples of what the step before leaves; of a step without
    effect, those that were refused.

    Parameters
    ----------
    refit : Fit
        The model with it.
    refused : Mapping of str to str
        Hypothesis -> why it was not taken at this step; at the last one, at the step that found none.
    further : Mapping of str to float
        At the last step: the held-out gain of every hypothesis that was refitted on top of it.
    score_tests : ScoreTests, optional
        From which it was chosen.
    """

    refit: Fit
    refused: Mapping[str, str] = field(default_factory=dict)
    further: Mapping[str, float] = field(default_factory=dict)
    score_tests: ScoreTests | None = None


@dataclass(frozen=True)
class HeldoutError:
    """What a model leaves of records, and in how many effective samples.

    Parameters
    ----------
    squares : Mapping of (str, str) to float
        Sum of squares by (record, channel), SI.
    counts : Mapping of str to int
        Samples by channel.
    autocorrelation_time : float
        Samples that count as one (`fit.weights.autocorrelation_time`).
    """

    squares: Mapping[tuple[str, str], float]
    counts: Mapping[str, int]
    autocorrelation_time: float

    def gain(self, other: "HeldoutError", time: float | None = None) -> float:
        """Twice the log likelihood ratio of another model over this one.

        Effective samples times the logarithm of the quotient of the sums of squares. A change in coloured errors is as
        sure as the product of both autocorrelations is short (Bartlett): a slow mismatch may not hide what removes it,
        nor a slow rest what removed quick errors.

        Parameters
        ----------
        other : HeldoutError
            The other model, on the same records.
        time : float, optional
            Autocorrelation time, samples; by default the shorter of what both leave.
        """
        time = time or min(self.autocorrelation_time, other.autocorrelation_time)
        return sum(
            count / time * float(np.log(self._total(channel) / other._total(channel)))
            for channel, count in self.counts.items()
        )

    def records(self, other: "HeldoutError") -> tuple[int, int]:
        """(records that ``other`` predicts better, of how many), channels by what ``other`` leaves in them."""
        gains: dict[str, float] = {}
        for (record, channel), mine in self.squares.items():
            gained = (mine - other.squares[record, channel]) / other._total(channel)
            gains[record] = gains.get(record, 0.0) + gained
        return sum(g > 0.0 for g in gains.values()), len(gains)

    @property
    def effective_samples(self) -> float:
        """Effective sample size of all channels together."""
        return sum(self.counts.values()) / self.autocorrelation_time

    def _total(self, channel: str) -> float:
        return max(sum(v for (_, c), v in self.squares.items() if c == channel), 1e-300)


def heldout_error(model: Model, fit: Fit) -> HeldoutError:
    """What a fit leaves of the records of ``model``."""
    left = raw_residuals(model, fit)
    squares: dict[tuple[str, str], float] = {}
    counts: dict[str, int] = {}
    parts: dict[str, list[np.ndarray]] = {}
    for block, values in zip(model.blocks, left, strict=True):
        squares[block.record, block.channel] = float(np.sum(values[block.good] ** 2))
        counts[block.channel] = counts.get(block.channel, 0) + int(block.good.sum())
        parts.setdefault(block.channel, []).append(np.where(block.good, values, 0.0))
    return HeldoutError(squares, counts, max(autocorrelation_time(p) for p in parts.values()))


def stepwise(
    fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis], *,
    start: Start | None = None, most: int = MOST, tell: Callable[[str], None] = lambda text: None,
    keep: Keep = lambda name, make: make(),
) -> list[Step]:  # fmt: skip
    """Forward selection of effects with backward elimination, judged by held-out records.

    Parameters
    ----------
    fit, heldout : Model
        The records to fit, and those that judge.
    nominals : tuple of str
        Parameters that every refit moves.
    hypotheses : sequence of Hypothesis
        What may still be missing.
    start : Start, optional
        Where to begin instead of the refit of ``nominals``.
    most : int
        Effects at the most.
    tell, keep : callable
        As of `cable_envs.diagnosis.search.select.select`.

    Returns
    -------
    list of Step
        The first is the refit without effects; it ends where none is accepted.
    """
    rng = np.random.default_rng(0)
    tell(stages.REFITTING)
    best, whitener = keep("null", partial(reweighted_refit, fit, start or Start("", nominals, {})))
    steps = [Step(NOMINAL, fit=rmse(fit, best), heldout=rmse(heldout, best), refit=best)]
    taken: list[Hypothesis] = []
    left = list(hypotheses)
    while left and len(taken) < most:
        tell(stages.testing(len(left)))
        step = keep("forward", partial(_forward, fit, heldout, best, whitener, left, rng))
        if not step.hypothesis.name:
            last = steps[-1]
            steps[-1] = replace(
                last, refused=step.refused, further=step.rivals, rivals=last.rivals or step.rivals,
                score_tests=last.score_tests or step.score_tests,
            )  # fmt: skip
            break
        taken.append(step.hypothesis)
        left.remove(step.hypothesis)
        settled, whitener = keep("refit", partial(reweighted_refit, fit, Start("", step.refit.free, step.refit.values)))
        best, whitener, gone = keep("backward", partial(_backward, fit, heldout, settled, whitener, taken))
        taken = [h for h in taken if h.name not in gone]
        steps.append(replace(step, refit=best, fit=rmse(fit, best), heldout=rmse(heldout, best), dropped=gone))
        tell(f"{step.hypothesis.name} ({step.gain:.0f}); {_said(steps[-1])}; without {', '.join(gone) or 'nothing'}")
    return steps


def inside(steps: Sequence[EffectGain]) -> tuple[str, ...]:
    """Hypotheses that are in after the last step, in the order in which they came."""
    found: list[str] = []
    for step in steps[1:]:
        found = [name for name in (*found, step.hypothesis.name) if name not in step.dropped]
    return tuple(found)


def _said(step: Step) -> str:
    return ", ".join(f"{channel} {value:.4g}" for channel, value in step.heldout.items())


def _forward(fit, heldout, best, whitener: Whitener, left, rng) -> Step:
    """The best of the hypotheses left; `NOMINAL` where none is accepted."""
    known = Judged(best, tuple(raw_residuals(fit, best)), whitener, 0.0)
    scored = score_tests(fit, known, left, rng, whitener)
    fits = refits(fit, best, scored)
    base = heldout_error(heldout, best)
    nearest = _nearest(base, {name: heldout_error(heldout, one) for name, one in fits.items()})
    fits |= _polished(fit, fits, nearest, whitener, rng)
    judged = {name: heldout_error(heldout, one) for name, one in fits.items()}
    sums = {name: base.gain(one, base.autocorrelation_time) for name, one in judged.items()}  # one scale for all rivals
    refused = {}
    for name in fits:
        h = next(h for h in left if h.name == name)
        reason = _against(h, fits[name], base.gain(judged[name]), *base.records(judged[name]))
        if reason:
            refused[name] = reason
    open_to = {name: gain for name, gain in sums.items() if name not in refused}
    if not open_to:
        return Step(NOMINAL, rivals=sums, refit=best, refused=refused, score_tests=scored)
    top = judged[max(open_to, key=lambda name: open_to[name])]
    behind = {name: judged[name].gain(top) for name in fits}  # by what those two leave, not by what both have removed
    near = [h for h in left if h.name in open_to and behind[h.name] < MARGIN]
    penalised = {h.name: -behind[h.name] - 2.0 * len(h.free) for h in near}  # Akaike's information criterion
    # two springs in series are one until friction lies between them: of equals, the library's first
    first = next(h for h in near if penalised[h.name] > max(penalised.values()) - EQUAL)
    name = first.name
    alike = tuple(h.name for h in near if h is not first)
    gain = base.gain(judged[name])
    margin = min([judged[n].gain(judged[name]) for n in fits if n not in (name, *alike)], default=gain)
    return Step(
        first, gain, gain, min(margin, gain), alike, rivals=sums, refit=fits[name], refused=refused, score_tests=scored
    )  # fmt: skip


def _nearest(base: HeldoutError, judged: Mapping[str, HeldoutError]) -> list[str]:
    """Hypotheses that may still lead, the best first."""
    gains = {name: base.gain(one, base.autocorrelation_time) for name, one in judged.items()}
    top = max(gains.values(), default=0.0)
    near = [name for name, gain in gains.items() if gain > NEAR * top]
    return sorted(near, key=lambda name: -gains[name])[:RIVALS]


def _polished(model: Model, fits: Mapping[str, Fit], near: Sequence[str], whitener: Whitener, rng) -> dict[str, Fit]:
    """Those that lead, each refitted from where it is, from where the leader is, and from about there."""
    if not near:
        return {}
    leader, found = fits[near[0]], {}
    for name in near:
        own = fits[name]
        there = {n: (leader if n in leader.free else own).values[n] for n in own.free}
        starts = [Start(name, own.free, {**own.values, **values}) for values in ({}, there)]
        best = multistart(model, whitener, starts, rng)
        found[name] = reweighted_refit(model, Start(name, best.free, best.values))[0]
    return found


def _against(hypothesis: Hypothesis, fit: Fit, gain: float, better: int, records: int) -> str:
    """Why a refitted hypothesis is not taken; empty if nothing speaks against it."""
    if gain < MARGIN:
        return f"it gains {gain:.1f} on the held-out records, less than {MARGIN:g}"
    if better < SHARE * records:
        return f"only {better} of {records} held-out records gain"
    stuck = bounded(hypothesis, fit)
    return f"{', '.join(stuck)} ended on a bound" if stuck else ""


def _backward(fit, heldout, best, whitener, taken) -> tuple[Fit, Whitener, tuple[str, ...]]:
    """Leave out, one by one, what the held-out records do not miss; each time everything else is refitted."""
    gone: list[str] = []
    while len(taken) - len(gone) > 1:
        candidates = [h for h in taken if h.name not in gone]
        starts = []
        for h in candidates:
            free = tuple(n for n in best.free if n not in h.names)
            starts.append(Start(h.name, free, {**best.values, **{p.name: p.start for p in h.free}}))
        fits = refit(fit, whitener, starts, iterations=12)
        losses = [heldout_error(heldout, one).gain(heldout_error(heldout, best)) for one in fits]
        least = fits[int(np.argmin(losses))]
        if min(losses) >= MARGIN:
            break
        settled, weights = reweighted_refit(fit, Start("", least.free, least.values))
        if heldout_error(heldout, settled).gain(heldout_error(heldout, best)) >= MISSED:
            break
        gone.append(least.label)
        best, whitener = settled, weights
    return best, whitener, tuple(gone)
