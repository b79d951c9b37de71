"""Models with effects as candidates: refitted under one noise, with what they leave, ready to compare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cable_envs.diagnosis.evidence.marginal import Frame, Marginal, Remainder
from cable_envs.diagnosis.fit.likelihood import raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.weights import autocorrelation_time, weigh
from cable_envs.diagnosis.model.constants import constants_of, with_constants
from cable_envs.diagnosis.model.features import ELAPSED, families
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free, Model, Whitener, learn_whitener, of_all_records, white_noise

SCALES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Standard deviations of a discrepancy that are tried, over the RMS of what the nominal refit leaves of its channel."""
WIDE = 3.0
"""Standard deviation of the prior of an effect's size, over the size at which it is typical."""
SHAPES = float(np.log(3.0))
"""Standard deviation of the prior of what only shapes an effect: of its logarithm, about where it begins."""
ITERATIONS = 5
"""Of a refit from where the last one ended, at most."""
FARTHER, MORE = 1.0, 3
"""Half the fall of the sum of squares that a step on all records promises beside the refit of some of them, from which
their own optimum is looked for, and the iterations to that."""
TOGETHER = 6
"""Models whose optima of all records are looked for at a time: their slopes take memory twice."""
CALIBRATED = (-4.65, 1.40)
"""Where the noise is learnt from what is left: logit of the share of right names, constant and slope over the logarithm
of their log odds. By maximum likelihood from 42 effects that were named on 126 logs of generator A
(`cable_envs.proof.logs`, seed 5), 35 of them right."""
DOMINANT = 1.0
"""RMS of a discrepancy over that of the noise from which it is no stationary noise that limits: each channel then
counts by the size of all that is left of it and by its effective sample size (`cable_envs.diagnosis.fit.weights`)."""


class Joint:
    """Fitted and held-out records as one model: what a refit leaves in both, and with what slopes."""

    def __init__(self, fit: Model, heldout: Model):
        self._models = (fit, heldout)
        self.parameters: list[Free] = list(fit.parameters)
        known = {p.name for p in heldout.parameters}
        self._rows = [j for j, p in enumerate(self.parameters) if p.name in known]
        self.blocks = of_all_records(fit, heldout)
        self._constants = [*constants_of(fit), *constants_of(heldout)]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        fit, heldout = self._models
        return [*fit.predict(values), *heldout.predict(values[self._rows])]

    def with_constants(self, whitener: Whitener, left: np.ndarray) -> np.ndarray:
        """What a fit leaves, or its slopes, whitened [N] or [N, n], with each record's constants as this noise has."""
        return with_constants(self.blocks, self._constants, whitener, left)

    def left_by(self, fit: Fit) -> dict[str, float]:
        """RMS of what a refit leaves, channel by channel."""
        return sizes_of(self.blocks, self.raw(fit))

    def raw(self, fit: Fit) -> list[np.ndarray]:
        """Measured less predicted [T] of every block, in the channels' units."""
        return raw_residuals(self, fit)


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
        sensor's zero drifts. Half of the prior is on none.
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

    @cached_property
    def left(self) -> float:
        """Log odds that it is not all: of the discrepancy that is most probable over none."""
        found = -np.inf
        for one in sorted(self._beside, key=self._at_most, reverse=True):
            if self._at_most(one) <= found:  # nor are those that follow
                break
            found = max(found, self.over_none(one))
        return found if self._beside else 0.0

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
    return ratio(one.frame, (one.remainder, one.best), (other.remainder, other.best))


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
    again = _nested(fit, whitener, refit(fit, whitener, starts, ITERATIONS, central=False))
    again = [new.outline for new in again]
    found, peaks = [], _peaks(joint, whitener, again)[::-1]
    for (e, _), new in zip(fits, again, strict=True):  # the slopes of many models take more memory than all else
        peak = peaks.pop()
        left = remainder(joint, frame, e, peak, sizes)
        found.append(Candidate(e, new, peak.outline if e else peak, frame, left, by_size))
    return found


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


def _nested(model: Model, whitener: Whitener, fits: Sequence[Fit]) -> list[Fit]:
    """Refits of which none is worse than a larger model that holds it makes it: such a one may have left a valley."""
    found, of, starts = list(fits), [], []
    for k, own in enumerate(fits):
        larger = [other for other in fits if set(own.free) < set(other.free)]
        if larger:
            best = min(larger, key=lambda other: other.cost)
            of.append(k)
            starts.append(Start(own.label, own.free, {n: best.values[n] for n in own.free}))
    for k, new in zip(of, refit(model, whitener, starts, MORE, central=False) if starts else (), strict=True):
        found[k] = new if new.cost < found[k].cost else found[k]
    return found


def _peaks(joint: Joint, whitener: Whitener, fits: Sequence[Fit]) -> list[Fit]:
    """Refits of some records, expanded about the optimum of all of them where that is elsewhere."""
    found: list[Fit] = []
    for first in range(0, len(fits), TOGETHER):
        starts = [Start("", f.free, f.values) for f in fits[first : first + TOGETHER]]
        some = refit(joint, whitener, starts, 0, central=False)
        far = [k for k, f in enumerate(some) if _promised(joint, f) > FARTHER]
        moved = refit(joint, whitener, [starts[k] for k in far], MORE, central=False) if far else []
        for k, new in zip(far, moved, strict=True):
            some[k] = new if new.cost < some[k].cost else some[k]
        found += some
    return _nested(joint, whitener, found)


def with_central_slopes(joint: Joint, candidate: Candidate) -> Candidate:
    """The same with the slopes that intervals need: those of the comparison are from one side."""
    peak = candidate.peak
    return replace(candidate, peak=refit(joint, candidate.frame.whitener, [Start("", peak.free, peak.values)], 0)[0])


def _promised(joint: Joint, fit: Fit) -> float:
    """Half the fall of the cost that a Gauss-Newton step promises."""
    gradient = _gradient(joint, fit)
    return 0.5 * float(gradient @ fit.covariance @ gradient)


def _gradient(joint: Joint, fit: Fit) -> np.ndarray:
    """Of half the cost, with priors, downhill [free]."""
    rows = {p.name: p for p in joint.parameters}
    gradient = fit.jacobian.T @ fit.residual
    for k, name in enumerate(fit.free):
        p = rows[name]
        if p.std:
            gradient[k] -= (fit.values[name] - p.start) / p.std**2
    return gradient


def sizes_of(blocks: Sequence[Block], left: Sequence[np.ndarray]) -> dict[str, float]:
    """RMS of what a model leaves [T] of every block, channel by channel."""
    found = {}
    for channel in dict.fromkeys(b.channel for b in blocks):
        parts = [r[b.good] for r, b in zip(left, blocks, strict=True) if b.channel == channel]
        found[channel] = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    return found


def noise_of(blocks: Sequence[Block], left: Sequence[np.ndarray], stated: Mapping[str, float]) -> Whitener:
    """The noise of what is left [T] of every block: learnt; white and of the size that is stated, where one is."""
    noise = dict(learn_whitener(blocks, left).noise)
    for channel in noise.keys() & stated.keys():
        noise[channel] = white_noise(blocks, channel, stated[channel])
    return Whitener(noise)


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
    return Remainder(left, occam, sizes, frame.products(left))


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
            spread, off[k] = WIDE * p.scale, value - nulls[name]
        elif name in added and value > 0.0:
            spread = SHAPES * value
            off[k] = value * float(np.log(value / (p.start if p.start > 0.0 else p.scale)))
        else:
            spread = WIDE * p.scale if name in added else max(abs(p.start), p.scale)
        variances[k] = spread**2
    return variances, off
