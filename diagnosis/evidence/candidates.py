"""Models with effects as candidates: refitted under one noise, linear about where the refit ended, ready to compare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cable_envs.diagnosis.evidence.marginal import Frame, Linear, Marginal
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.features import families
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free, Model, Whitener, learn_whitener, of_all_records
from cable_envs.diagnosis.model.noise import Noise, resolution

SCALES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Standard deviations of a discrepancy that are tried, over the RMS of what the nominal refit leaves of its channel."""
WIDE = 3.0
"""Standard deviation of the prior of an effect's size, over the size at which it is typical."""
ITERATIONS = 8
"""Of a refit from where the last one ended, at most."""


class Joint:
    """Fitted and held-out records as one model: what a refit leaves in both, and with what slopes."""

    def __init__(self, fit: Model, heldout: Model):
        self._models = (fit, heldout)
        self.parameters: list[Free] = list(fit.parameters)
        known = {p.name for p in heldout.parameters}
        self._rows = [j for j, p in enumerate(self.parameters) if p.name in known]
        self.blocks = of_all_records(fit, heldout)

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        fit, heldout = self._models
        return [*fit.predict(values), *heldout.predict(values[self._rows])]

    def left_by(self, fit: Fit) -> dict[str, float]:
        """RMS of what a refit leaves, channel by channel."""
        predicted = self.predict(self.columns(fit))
        return sizes_of(self.blocks, [b.measured - p[:, 0] for b, p in zip(self.blocks, predicted, strict=True)])

    def columns(self, fit: Fit, *changed: Mapping[str, float]) -> np.ndarray:
        """Parameter columns of a refit, and of the same with other values."""
        values = [[{**fit.values, **new}[p.name] for p in self.parameters] for new in ({}, *changed)]
        return np.array(values).T


@dataclass(frozen=True)
class Candidate:
    """A model with effects: its refit, and what all records say of it.

    Parameters
    ----------
    effects : tuple of Hypothesis
        What it has beside the nominal model.
    fit : Fit
        Of the fitted records.
    frame : Frame
        Under whose noise it is compared.
    linear : Linear
        On all records.
    """

    effects: tuple[Hypothesis, ...]
    fit: Fit
    frame: Frame
    linear: Linear

    @property
    def name(self) -> str:
        """Names of its effects."""
        return " + ".join(h.name for h in self.effects)

    @cached_property
    def plain(self) -> Marginal:
        """Without a discrepancy."""
        return self.frame.marginal(self.linear, 0.0)

    @cached_property
    def best(self) -> Marginal:
        """With the discrepancy that the records ask for most, or with none where they ask for none.

        Of all families together, or of one coordinate's in all channels. Half of the prior is on none.
        """
        groups: dict[str, list[int]] = {}
        for k, family in enumerate(self.frame.families):
            groups.setdefault(family.name, []).append(k)
        price = -float(np.log((len(groups) + 1) * len(SCALES)))
        found, log = self.plain, self.plain.log
        for chosen in (None, *map(tuple, groups.values())):
            for scale in SCALES:
                one = self.frame.marginal(self.linear, scale, chosen)
                if one.log + price > log:
                    found, log = replace(one, volume=one.volume + price), one.log + price
        return found

    @cached_property
    def left(self) -> float:
        """Log odds that it is not all, a discrepancy over none."""
        return self._over(self.best, self.plain)

    def _over(self, one: Marginal, other: Marginal) -> float:
        return ratio(self.frame, (self.linear, one), (self.linear, other))


def ratio(frame: Frame, one: tuple[Linear, Marginal], other: tuple[Linear, Marginal]) -> float:
    """Logarithm of the ratio of two evidences under the same noise, as far as it may be trusted."""
    (a, mine), (b, their) = one, other
    left, others = a.left - mine.explained, b.left - their.explained
    better = left if mine.fit >= their.fit else others
    share = frame.adjustment(others - left, better)
    return share * (mine.fit - their.fit) + mine.volume - their.volume


def log_odds(one: Candidate, other: Candidate) -> float:
    """Of two candidates under the same noise, either with its own discrepancy: logarithm of the evidence's ratio."""
    return ratio(one.frame, (one.linear, one.best), (other.linear, other.best))


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
        In the same order.
    """
    effects, best = fits[leader]
    predicted = [p[:, 0] for p in joint.predict(joint.columns(best))]
    raw = [b.measured - p for b, p in zip(joint.blocks, predicted, strict=True)]
    kinds = list(families(joint.blocks, predicted))
    frame = Frame(joint.blocks, noise_of(joint.blocks, raw, stated), kinds)
    first = Candidate(effects, best, frame, linear(joint, frame, effects, best, sizes))
    apart = frame.raw(first.best.weights)
    whitener = noise_of(joint.blocks, [r - a for r, a in zip(raw, apart, strict=True)], stated)
    frame = Frame(joint.blocks, whitener, kinds)
    starts = [Start("", old.free, old.values) for _, old in fits]
    again = refit(fit, whitener, starts, ITERATIONS)
    return [
        Candidate(e, new, frame, linear(joint, frame, e, new, sizes)) for (e, _), new in zip(fits, again, strict=True)
    ]  # fmt: skip


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
        measured = np.concatenate([b.measured[b.good] for b in blocks if b.channel == channel])
        noise[channel] = Noise(np.empty(0), float(np.hypot(stated[channel], resolution(measured) / np.sqrt(12.0))))
    return Whitener(noise)


def linear(joint: Joint, frame: Frame, effects: tuple[Hypothesis, ...], fit: Fit, sizes: Mapping[str, float]) -> Linear:
    """A refitted model on all records, linear about where its refit ended."""
    own = refit(joint, frame.whitener, [Start("", fit.free, fit.values)], 0)[0]
    rows = {p.name: p for p in joint.parameters}
    nulls = {name: null for h in effects for name, null in h.nulls.items()}
    added = {name for h in effects for name in h.names}
    variances, moved = np.zeros(len(fit.free)), np.zeros(len(fit.free))
    for k, name in enumerate(fit.free):
        p = rows[name]
        spread = p.std or (WIDE * p.scale if name in added else max(abs(p.start), p.scale))
        variances[k] = spread**2
        centred = bool(p.std) or name in nulls
        moved[k] = fit.values[name] - nulls.get(name, p.start) if centred else 0.0
    return Linear(own.residual, own.jacobian, variances, moved, sizes, frame.products(own.residual, own.jacobian))
