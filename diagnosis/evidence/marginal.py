"""Evidence of a model: the marginal likelihood of all records, with its parameters and its discrepancy integrated out.

    z = J t + G S a + e,   t ~ N(-off, L),   a ~ N(0, 1),   e ~ N(0, 1)

symbol | meaning
------ | ------------------------------------------------------------------------------------------------------
z      | what the refit leaves, whitened by the noise of each channel [N]
J, t   | slopes of the whitened prediction, and parameters from where the refit ended [N, p], [p]
L, off | variances of the parameters' priors, and how far the refit has moved from their means
G, S   | whitened functions of `model.features`, and their scale: diagonal, of a channel's functions all alike

The model is linear in t about the refit (Laplace's approximation; Tierney and Kadane, J. Am. Stat. Assoc. 81 (1986)
82), so that the integral is a Gaussian's: the more a model can do that the records did not ask for, the smaller it is.

Two models are compared on records whose noise is never quite the one that is assumed. How far the logarithm of a
likelihood ratio may be trusted, the records say themselves: along the difference d of two predictions the sums of the
scores over batches of consecutive samples have the variance J = sum (sum d w)^2, where the noise that is assumed has
I = sum d^2. The logarithm of the ratio is multiplied by I / J where that is below one (Kent, Biometrika 69 (1982) 19).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cable_envs.diagnosis.model.features import Family
from cable_envs.diagnosis.model.model import Block, Whitener

BATCHES = (60, 30, 15, 6)
"""Batches of consecutive samples in all records together, about, by which the variance of the scores is estimated."""


@dataclass(frozen=True)
class Linear:
    """A refitted model on all records, whitened, and linear about where its refit ended.

    Parameters
    ----------
    left : ndarray, shape (N,)
        z of the module.
    slopes : ndarray, shape (N, p)
        J of the module.
    variances, moved : ndarray, shape (p,)
        L and off of the module.
    sizes : mapping of str to float
        Channel -> size of what its discrepancy is measured by, SI.
    products : mapping of str to tuple of ndarray
        As `Frame.products` gives it.
    """

    left: np.ndarray
    slopes: np.ndarray
    variances: np.ndarray
    moved: np.ndarray
    sizes: Mapping[str, float]
    products: Mapping[str, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class _Part:
    """Functions of one channel as they enter: which, their scale, and their share of the normal equations."""

    channel: str
    mask: np.ndarray
    scale: float
    gram: np.ndarray
    cross: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class Marginal:
    """The marginal likelihood with some functions of the discrepancy, and what it takes them to be.

    fit        | half the sum of squares that is left, priors included, negative
    volume     | logarithm of the share of what the model can do that agrees with the records (Occam's factor)
    explained  | J t + G S a at their posterior mean [N]
    weights    | of the functions, by channel
    """

    fit: float
    volume: float
    explained: np.ndarray
    weights: dict[str, np.ndarray]

    @property
    def log(self) -> float:
        """Logarithm of the marginal likelihood, but for a constant of the records and their noise."""
        return self.fit + self.volume


class Frame:
    """Functions of all families, whitened, ready for many models on the same records under the same noise."""

    def __init__(self, blocks: Sequence[Block], whitener: Whitener, families: Sequence[Family]):
        self.blocks, self.whitener, self.families = list(blocks), whitener, list(families)
        ends = np.cumsum([0, *(len(b.time) for b in blocks)])
        self.rows = [slice(*pair) for pair in pairwise(ends)]
        self.count = int(ends[-1])
        self.channels = list(dict.fromkeys(b.channel for b in blocks))
        self._at: dict[str, np.ndarray] = {}
        self._functions: dict[str, np.ndarray] = {}
        self._grams: dict[str, np.ndarray] = {}
        self._family: dict[str, np.ndarray] = {}
        for channel in self.channels:
            own = [k for k, b in enumerate(blocks) if b.channel == channel]
            mine = [j for j, f in enumerate(self.families) if f.channel == channel]
            parts = []
            for k in own:
                raw = [self.families[j].columns[k] for j in mine]
                wide = np.concatenate(raw, axis=1) if raw else np.zeros((len(blocks[k].time), 0))
                parts.append(whitener.flat([blocks[k]], [wide]))
            self._at[channel] = np.concatenate([np.arange(self.rows[k].start, self.rows[k].stop) for k in own])
            self._functions[channel] = np.concatenate(parts)
            self._grams[channel] = self._functions[channel].T @ self._functions[channel]
            self._family[channel] = np.repeat(mine, [self.families[j].count for j in mine]).astype(int)
        self._batches = {count: self._batch(count) for count in BATCHES}

    def _batch(self, count: int) -> np.ndarray:
        """Number of the batch of every sample: of one record and time, whatever the channel."""
        records = list(dict.fromkeys(b.record for b in self.blocks))
        each = max(round(count / len(records)), 1)
        found = np.zeros(self.count, dtype=int)
        for block, rows in zip(self.blocks, self.rows, strict=True):
            inside = np.cumsum(block.good) / max(int(block.good.sum()), 1)
            found[rows] = each * records.index(block.record) + np.minimum((each * inside).astype(int), each - 1)
        return found

    def adjustment(self, signal: np.ndarray, left: np.ndarray) -> float:
        """Share of the logarithm of a likelihood ratio that counts; see the module.

        Parameters
        ----------
        signal : ndarray, shape (N,)
            Difference of two predictions, whitened.
        left : ndarray, shape (N,)
            What the better one leaves.

        Returns
        -------
        float
            Above 0, at most 1. Sums of scores with a long correlation vary more over long batches than over short ones:
            the number of batches counts by which they vary most, beyond what chance makes of so few.
        """
        information = float(signal @ signal)
        if not information > 0.0:
            return 1.0
        scores_of, worst = signal * left, 1.0
        for count in BATCHES:
            scores = np.bincount(self._batches[count], weights=scores_of)
            chance = 1.0 + np.sqrt(2.0 / len(scores))
            worst = max(worst, float(scores @ scores) / information / chance)
        return 1.0 / worst

    def products(self, left: np.ndarray, slopes: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Products of all functions with what a model leaves [n] and its slopes [n, p], by channel."""
        return {c: (g.T @ left[self._at[c]], g.T @ slopes[self._at[c]]) for c, g in self._functions.items()}

    def marginal(self, model: Linear, scale: float, chosen: Collection[int] | None = None) -> Marginal:
        """The marginal likelihood of a model with a discrepancy.

        Parameters
        ----------
        model : Linear
            The model.
        scale : float
            Standard deviation of the discrepancy of every channel, as a share of `Linear.sizes`; 0: there is none.
        chosen : collection of int, optional
            Numbers of the families it is made of; None: all.

        Returns
        -------
        Marginal
            Its parts, and the posterior mean of parameters and discrepancy.
        """
        p = model.slopes.shape[1]
        precision = 1.0 / model.variances
        parts = list(self._parts(model, scale, chosen)) if scale > 0.0 else []
        total = p + sum(len(part.gram) for part in parts)
        matrix, right = np.zeros((total, total)), np.zeros(total)
        matrix[:p, :p] = model.slopes.T @ model.slopes + np.diag(precision)
        right[:p] = model.slopes.T @ model.left - precision * model.moved
        begin, spans = p, []
        for part in parts:
            own = slice(begin, begin + len(part.gram))
            matrix[own, own], matrix[own, :p], matrix[:p, own] = part.gram, part.cross, part.cross.T
            right[own] = part.right
            spans.append(own)
            begin = own.stop
        units = 1.0 / np.sqrt(np.diag(matrix))
        factor = cho_factor(matrix * np.outer(units, units) + 1e-12 * np.eye(total), lower=True)
        found = units * cho_solve(factor, units * right)
        logdet = 2.0 * float(np.sum(np.log(np.diag(factor[0]) / units)))
        fit = 0.5 * float(right @ found - model.left @ model.left - precision @ model.moved**2)
        volume = -0.5 * logdet - 0.5 * float(np.sum(np.log(model.variances)))
        apart, weights = np.zeros(self.count), {}
        for part, own in zip(parts, spans, strict=True):
            weights[part.channel] = np.zeros(len(part.mask))
            weights[part.channel][part.mask] = part.scale * found[own]
            apart[self._at[part.channel]] = self._functions[part.channel] @ weights[part.channel]
        return Marginal(fit, volume, model.slopes @ found[:p] + apart, weights)

    def _parts(self, model: Linear, scale: float, chosen: Collection[int] | None) -> Iterator["_Part"]:
        """The channels' functions of the chosen families at their scale."""
        for channel in self.channels:
            family = self._family[channel]
            mask = np.ones(len(family), dtype=bool) if chosen is None else np.isin(family, list(chosen))
            if not mask.any():
                continue
            s = scale * model.sizes[channel] / np.sqrt(len(np.unique(family[mask])))
            right, cross = model.products[channel]
            gram = s**2 * self._grams[channel][np.ix_(mask, mask)] + np.eye(int(mask.sum()))
            yield _Part(channel, mask, s, gram, s * cross[mask], s * right[mask])

    def raw(self, weights: dict[str, np.ndarray]) -> list[np.ndarray]:
        """The discrepancy [T] of every block in its own unit, for weights of the functions."""
        series = []
        for k, block in enumerate(self.blocks):
            total = np.zeros(len(block.time))
            own = weights.get(block.channel)
            if own is not None:
                begin = 0
                for family in (f for f in self.families if f.channel == block.channel):
                    total += family.columns[k] @ own[begin : begin + family.count]
                    begin += family.count
            series.append(total)
        return series
