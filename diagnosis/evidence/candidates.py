"""Models with effects as candidates: refitted under one noise, with what they leave, ready to compare."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from cable_envs.diagnosis.evidence.joint import Joint, noise_of, sizes_of
from cable_envs.diagnosis.evidence.marginal import Frame, Marginal, Priced, Remainder
from cable_envs.diagnosis.evidence.optima import nested, peaks
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.weights import autocorrelation_time, weigh
from cable_envs.diagnosis.model.features import ELAPSED, families
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free, Model, Whitener

Key = TypeVar("Key", bound=Hashable)

SCALES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Standard deviations of a discrepancy that are tried, over the RMS of what the nominal refit leaves of its channel."""
WIDE = 3.0
"""Standard deviation of the prior of an effect's size, over the size at which it is typical, which is that of a small
rig. A size that is larger has a prior as wide as it is, and costs as its logarithm: the tail of a mixture of scales
(Gelman, Bayesian Anal. 1 (2006) 515). A robot's joint rubs 300 times as much as a servo."""
SHAPES = float(np.log(3.0))
"""Standard deviation of the prior of what only shapes an effect: of its logarithm, about where it begins."""
ITERATIONS = 5
"""Of a refit from where the last one ended, at most."""
CALIBRATED = (-11.06, 3.92)
"""Where the noise is learnt from what is left: logit of the share of right names, constant and slope over the logarithm
of their log odds, as `benchmarks.logs` prints them: of 88 effects that were named on 248 logs of generator A
(`cable_envs.proof.logs`, seed 46, `--each 2`), with `EVEN` of `likely.py` at 0, 76 were right."""
DOMINANT = 1.0
"""RMS of a discrepancy over that of the noise from which it is no stationary noise that limits: each channel then
counts by the size of all that is left of it and by its effective sample size (`cable_envs.diagnosis.fit.weights`)."""


@dataclass(frozen=True)
class Candidate:
    """A model with effects: its refit, and what all records say of it.

    Parameters
    ----------
    effects : tuple of Hypothesis
        What it has beside the nominal model.
    fit : Fit
        Of the fitted records.
    peak : Fit
        Of all records.
    frame : Frame
        Under whose noise it is compared.
    by_size : bool
        Whether that is no noise but the size of all that is left (`DOMINANT`).
    remainder : Remainder
        Of all records.
    """

    effects: tuple[Hypothesis, ...]
    fit: Fit
    peak: Fit
    frame: Frame
    remainder: Remainder
    by_size: bool = False

    @property
    def outline(self) -> "Candidate":
        """The same without what takes its memory: its effects and its refits stay, and nothing of the records."""
        bare = replace(self.remainder, left=np.empty(0), products={})
        return replace(
            self, fit=self.fit.outline, peak=self.peak.outline, frame=Frame([], Whitener(), []), remainder=bare
        )  # fmt: skip

    @cached_property
    def plain(self) -> Marginal:
        """Without a discrepancy."""
        return self.frame.marginal(self.remainder, 0.0)

    @cached_property
    def best(self) -> Marginal:
        """With the discrepancy that the records ask for most, or with none where they ask for none.

        Of all families together, of one coordinate's in all channels, or of the elapsed time in one channel, as a
        sensor's zero drifts. Half of the prior is on none. All of the likelihood counts: what the records ask for is
        not noise, however sure it is.
        """
        found, log = self.plain, self.plain.log
        for one in () if self.by_size else self._beside:
            if one.log > log:
                found, log = one, one.log
        return found

    @cached_property
    def effective(self) -> np.ndarray:
        """Effective sample size of what it leaves in every channel [channels]."""
        frame, left = self.frame, self.remainder.left
        rows = {c: [r for b, r in zip(frame.blocks, frame.rows, strict=True) if b.channel == c] for c in frame.channels}
        times = [autocorrelation_time([left[r] for r in rows[c]]) for c in frame.channels]
        counts = [sum(int(b.good.sum()) for b in frame.blocks if b.channel == c) for c in frame.channels]
        return np.array(counts) / np.array(times)

    @cached_property
    def squares(self) -> np.ndarray:
        """Sum of squares that is left in every channel, whitened [channels]."""
        left = self.remainder.left**2
        return np.array([float(np.sum(left[self.frame.at(channel)])) for channel in self.frame.channels])

    @cached_property
    def _beside(self) -> list[Marginal]:
        """With every discrepancy that is tried; the share of the prior that it has is in its volume."""
        groups: dict[str, list[int]] = {}
        for k, family in enumerate(self.frame.families):
            groups.setdefault(family.name, []).append(k)
        alone = [(k,) for k in groups.get(ELAPSED, ()) if len(groups[ELAPSED]) > 1]
        price = -float(np.log((len(groups) + 1 + len(alone)) * len(SCALES)))
        tried = (
            self.frame.marginal(self.remainder, scale, chosen)
            for chosen in (None, *map(tuple, groups.values()), *alone)
            for scale in SCALES
        )
        return [replace(one, volume=one.volume + price) for one in tried]

    @property
    def left(self) -> float:
        """Log odds that it is not all: of the discrepancy that is most probable over none."""
        return self._likeliest[1]

    @property
    def sure(self) -> Marginal:
        """With the discrepancy that is most probable as far as the likelihood may be trusted, or with none.

        With this one it is compared with others. With `best`, all of the prior's volume would count against it and of
        what that buys a share only.
        """
        one, odds = self._likeliest
        return one if odds > 0.0 and not self.by_size else self.plain

    @cached_property
    def _likeliest(self) -> tuple[Marginal, float]:
        """(the discrepancy that is most probable, its log odds over none)."""
        found, odds = self.plain, -np.inf
        for one in sorted(self._beside, key=self._at_most, reverse=True):
            if self._at_most(one) <= odds:  # nor are those that follow
                break
            over = self.over_none(one)
            if over > odds:
                found, odds = one, over
        return found, odds if self._beside else 0.0

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of its parameters, from both refits: as wide as batches of the records ask for, and as the two differ."""
        curvature = self.peak.covariance
        influence = self.peak.jacobian @ curvature
        shares = np.array([self.frame.adjustment(column, self.peak.residual) for column in influence.T])
        own = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        apart = np.array([self.peak.values[n] - self.fit.values[n] for n in self.fit.free])
        wider = np.hypot(own / np.sqrt(shares), apart) / own
        return curvature * np.outer(wider, wider)

    def _at_most(self, one: Marginal) -> float:
        """What `over_none` is at the most: all of the likelihood counts."""
        return max(one.fit - self.plain.fit, 0.0) + one.volume - self.plain.volume

    def over_none(self, one: Marginal) -> float:
        """Log odds of its marginal likelihood with some discrepancy over the one without."""
        return ratio(self.frame, (self.remainder, one), (self.remainder, self.plain))


def ratio(frame: Frame, one: tuple[Remainder, Marginal], other: tuple[Remainder, Marginal]) -> float:
    """Logarithm of the ratio of two evidences under the same noise, as far as it may be trusted."""
    (a, mine), (b, their) = one, other
    left, others = a.left - frame.explained(mine), b.left - frame.explained(their)
    better = left if mine.fit >= their.fit else others
    share = frame.adjustment(others - left, better)
    return share * (mine.fit - their.fit) + mine.volume - their.volume


def log_odds(one: Candidate, other: Candidate) -> float:
    """Of two candidates under the same noise, either with its own discrepancy: logarithm of the evidence's ratio.

    Where no noise limits them, the size of what is left is unknown in every channel and integrated out: n / 2 times the
    logarithm of the quotient of both sums of squares, with n effective samples. A change in coloured errors is as sure
    as the product of both autocorrelations is short (Bartlett), so that the larger of both numbers counts.
    """
    if one.by_size:
        count = np.maximum(one.effective, other.effective)
        fit = 0.5 * float(count @ np.log(other.squares / one.squares))
        return fit + one.remainder.occam - other.remainder.occam
    return ratio(one.frame, (one.remainder, one.sure), (other.remainder, other.sure))


def best_of(found: Iterable[tuple[Key, Candidate]]) -> dict[Key, Candidate]:
    """Of candidates with one key, which differ by where their effect is, that with the most evidence."""
    best: dict[Key, Candidate] = {}
    for key, candidate in found:
        if key not in best or log_odds(candidate, best[key]) > 0.0:
            best[key] = candidate
    return best


def agreement(one: Candidate, other: Candidate, spread: float) -> tuple[float, float]:
    """Log odds that all channels ask for one size of what a model has more, over that each asks for its own or none.

    A clock is that of all channels. What a model lacks in one of them may look like a wrong clock there alone.

    Parameters
    ----------
    one, other : Candidate
        With and without it, under the same noise.
    spread : float
        Standard deviation of the prior of its size, over the size that it has.

    Returns
    -------
    float, float
        The odds, and what they would be if all asked for exactly the same. About the refit all are linear in the size,
        with the change d of the residual r: I = d d and p = d r give the logarithm of the evidence of a channel over
        that of none, p^2 / (I + 1 / spread^2) / 2 - ln(1 + spread^2 I) / 2, and of all channels with their sums.
    """
    left, frame = other.remainder.left, one.frame
    change, parts = left - one.remainder.left, []
    for at in map(frame.at, frame.channels):
        own = np.zeros(frame.count)
        own[at] = change[at]
        sums = np.array([own @ own, own @ left])
        parts.append(frame.adjustment(own, left - sums[1] / max(sums[0], 1e-300) * own) * sums)
    information, product = np.array([*parts, np.sum(parts, axis=0)]).T

    def odds(product: np.ndarray) -> float:
        logs = 0.5 * product**2 / (information + spread**-2) - 0.5 * np.log1p(spread**2 * information)
        return float(logs[-1] - np.sum(np.logaddexp(logs[:-1], 0.0) - np.log(2.0)))

    return odds(product), odds(information * product[-1] / max(information[-1], 1e-300))


def under_one_noise(
    fit: Model, joint: Joint, fits: Sequence[tuple[tuple[Hypothesis, ...], Fit]], leader: int,
    stated: Mapping[str, float], sizes: Mapping[str, float],
) -> list[Candidate]:  # fmt: skip
    """Candidates of refits, refitted again under the noise that the leader leaves beside its discrepancy.

    Parameters
    ----------
    fit : Model
        The records to fit.
    joint : Joint
        All records.
    fits : sequence of (tuple of Hypothesis, Fit)
        Effects of each model, and its refit so far.
    leader : int
        Which of them is believed in most.
    stated : mapping of str to float
        Channel -> standard deviation of its noise where the recording says it, SI.
    sizes : mapping of str to float
        Channel -> what the scales of its discrepancy are counted in, SI.

    Returns
    -------
    list of Candidate
        In the same order. Only those without effects have slopes: for those of others see `with_central_slopes`.
    """
    effects, best = fits[leader]
    peak = refit(joint, noise_of(joint.blocks, joint.raw(best), stated), [Start("", best.free, best.values)], 0)[0]
    leading = under_its_noise(joint, effects, best, peak, stated, sizes)
    whitener, raw = leading.frame.whitener, joint.raw(peak)
    apart = leading.frame.raw(leading.best.weights)
    by_size = _dominant(joint.blocks, apart, raw)
    whitener = weigh(joint.blocks, raw) if by_size else whitener
    frame = Frame(joint.blocks, whitener, leading.frame.families) if by_size else leading.frame
    starts = [Start("", old.free, old.values) for _, old in fits]
    again = nested(fit, whitener, refit(fit, whitener, starts, ITERATIONS, central=False))
    again = [new.outline for new in again]
    found, ends = [], peaks(joint, whitener, again)[::-1]
    for (e, _), new in zip(fits, again, strict=True):  # the slopes of many models take more memory than all else
        peak = ends.pop()
        left = remainder(joint, frame, e, peak, sizes)
        new, peak, left = _likelier(fit, joint, frame, e, (new, peak, left))
        found.append(Candidate(e, new, peak.outline if e else peak, frame, left, by_size))
    return found


def _likelier(
    fit: Model, joint: Joint, frame: Frame, effects: tuple[Hypothesis, ...], at: tuple[Fit, Fit, Remainder]
) -> tuple[Fit, Fit, Remainder]:
    """Refits of some records and of all, and what is left, where the posterior is larger: ``at``, or at typical shapes.

    Least squares know no prior of what shapes an effect. Where the records do not tell a shape they end anywhere, and
    the prior there would count against the effect.
    """
    _, peak, left = at
    shapes = [p for h in effects if not h.wave for p in h.free if p.name in h.shapes and not p.std]
    far = {p.name: _typical(p) for p in shapes if p.name in peak.free and left.priced.is_unusual({p.name})}
    if not far:
        return at
    free, values = tuple(n for n in peak.free if n not in far), {**peak.values, **far}
    ends = []
    for model in (joint, fit):
        (held,) = refit(model, frame.whitener, [Start("", free, values)], ITERATIONS, central=False)
        ends += refit(model, frame.whitener, [Start("", peak.free, held.values)], 0, central=False)
        values = held.values
    other = remainder(joint, frame, effects, ends[0], left.sizes)
    better = frame.marginal(other, 0.0).log > frame.marginal(left, 0.0).log
    return (ends[1].outline, ends[0], other) if better else at


def _typical(p: Free) -> float:
    """Where the prior of what shapes an effect is largest."""
    return p.start if p.start > 0.0 else p.scale


def under_its_noise(
    joint: Joint, effects: tuple[Hypothesis, ...], fit: Fit, peak: Fit, stated: Mapping[str, float],
    sizes: Mapping[str, float],
) -> Candidate:  # fmt: skip
    """A candidate under the noise that it leaves beside its own discrepancy.

    Parameters
    ----------
    joint : Joint
        All records.
    effects, fit, peak
        As of `Candidate`.
    stated, sizes : mapping of str to float
        As of `under_one_noise`.
    """
    raw = joint.raw(peak)
    kinds = list(families(joint.blocks, [b.measured - r for b, r in zip(joint.blocks, raw, strict=True)]))
    found = None
    for _ in range(2):
        apart = found.frame.raw(found.best.weights) if found else [np.zeros_like(r) for r in raw]
        noise = noise_of(joint.blocks, [r - a for r, a in zip(raw, apart, strict=True)], stated)
        frame = Frame(joint.blocks, noise, kinds)
        there = refit(joint, noise, [Start("", peak.free, peak.values)], 0)[0]
        found = Candidate(effects, fit, there, frame, remainder(joint, frame, effects, there, sizes))
        if found.best.scale == 0.0:
            break
    assert found is not None
    return found


def _dominant(blocks: Sequence[Block], apart: Sequence[np.ndarray], raw: Sequence[np.ndarray]) -> bool:
    """Whether what a model is off by is more than the rest of what it leaves in any channel."""
    off, noise = sizes_of(blocks, apart), sizes_of(blocks, [r - a for r, a in zip(raw, apart, strict=True)])
    return any(off[channel] > DOMINANT * noise[channel] for channel in off)


def with_central_slopes(joint: Joint, candidate: Candidate) -> Candidate:
    """The same with the slopes that intervals need: those of the comparison are from one side."""
    peak = candidate.peak
    return replace(candidate, peak=refit(joint, candidate.frame.whitener, [Start("", peak.free, peak.values)], 0)[0])


def remainder(
    joint: Joint, frame: Frame, effects: tuple[Hypothesis, ...], fit: Fit, sizes: Mapping[str, float]
) -> Remainder:
    """What a model leaves of all records, and the price of its parameters.

    fit: where it is, with residual and slopes under the frame's noise.
    """
    variances, off = priors(joint, effects, fit)
    units = np.sqrt(variances)
    slopes, left = (joint.with_constants(frame.whitener, found) for found in (fit.jacobian, fit.residual))
    matrix = np.outer(units, units) * (slopes.T @ slopes) + np.eye(len(units))
    occam = -0.5 * float(np.linalg.slogdet(matrix)[1]) - 0.5 * float(np.sum(off**2 / variances))
    priced = Priced(fit.free, np.linalg.inv(matrix), off / units)
    return Remainder(left, occam, sizes, frame.products(left), priced)


def prior_width(p: Free, size: float) -> float:
    """Standard deviation of the prior of an effect's size; ``size``: where it is, from none (`WIDE`)."""
    return max(WIDE * p.scale, abs(size))


def priors(joint: Joint, effects: tuple[Hypothesis, ...], fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """(variances of the priors of a fit's free parameters, how far each is from the middle of its own), [free]."""
    rows = {p.name: p for p in joint.parameters}
    nulls = {name: null for h in effects for name, null in h.nulls.items()}
    added = {name for h in effects for name in h.names}
    variances, off = np.zeros(len(fit.free)), np.zeros(len(fit.free))
    for k, name in enumerate(fit.free):
        p, value = rows[name], fit.values[name]
        if p.std:
            spread, off[k] = p.std, value - p.start
        elif name in nulls:
            off[k] = value - nulls[name]
            spread = prior_width(p, off[k])
        elif name in added and value > 0.0:
            spread = SHAPES * value
            off[k] = value * float(np.log(value / _typical(p)))
        else:
            spread = WIDE * p.scale if name in added else max(abs(p.start), p.scale)
        variances[k] = spread**2
    return variances, off
