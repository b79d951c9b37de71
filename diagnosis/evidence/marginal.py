"""Evidence of a model: the marginal likelihood of all records, with its parameters and its discrepancy integrated out.

    z = G S a + e,   a ~ N(0, 1),   e ~ N(0, 1)

symbol | meaning
------ | ------------------------------------------------------------------------------------------------------
z      | what the refit leaves, whitened by the noise of each channel [N]
G, S   | whitened functions of `model.features`, and their scale: diagonal, of a channel's functions all alike

Parameters are those of the least squares, and the discrepancy is what these leave: fitted together with parameters it
would do their work, and neither could be told (Brynjarsdottir, O'Hagan, Inverse Problems 30 (2014) 114007; the two
steps are the modularization of Liu, Bayarri, Berger, Bayesian Analysis 4 (2009) 119, and the projection of Plumlee,
J. Am. Stat. Assoc. 112 (2017) 1274). About its optimum the model is linear in its parameters (Laplace's approximation;
Tierney and Kadane, J. Am. Stat. Assoc. 81 (1986) 82), so that both integrals are a Gaussian's: the more a model can do
that the records did not ask for, the smaller they are.

Two models are compared on records whose noise is never quite the one that is assumed. How far the logarithm of a
likelihood ratio may be trusted, the records say themselves: along the difference d of two predictions the sums of the
scores over batches of consecutive samples have the variance J = sum (sum d w)^2, where the noise that is assumed has
I = sum d^2. The logarithm of the ratio is multiplied by I / J where that is below one (Kent, Biometrika 69 (1982) 19).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cable_envs.diagnosis.model.features import Family
from cable_envs.diagnosis.model.model import Block, Whitener

FAR = 2.0
"""Standard deviations of its prior from which a parameter is unusual."""
BATCHES = (60, 30, 15, 6)
"""Batches of consecutive samples in all records together, about, by which the variance of the scores is estimated."""


@dataclass(frozen=True)
class Priced:
    """The price of single parameters.

    Parameters
    ----------
    names : tuple of str
        Of the free parameters.
    narrowed : ndarray, shape (free, free)
        Their covariance over the variances of their priors.
    off : ndarray, shape (free,)
        How far each is from the middle of its prior, over its standard deviation.
    """

    names: tuple[str, ...] = ()
    narrowed: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    off: np.ndarray = field(default_factory=lambda: np.empty(0))

    def of(self, names: Collection[str]) -> float:
        """Logarithm of the share of what some parameters can do that does not agree with the records."""
        rows = [k for k, name in enumerate(self.names) if name in names]
        kept = np.linalg.slogdet(self.narrowed[np.ix_(rows, rows)])[1]
        return -0.5 * float(kept) + 0.5 * float(np.sum(self.off[rows] ** 2))

    def is_unusual(self, names: Collection[str]) -> bool:
        """Whether one of some parameters is where its prior says that it seldom is."""
        return any(n in names and abs(way) > FAR for n, way in zip(self.names, self.off, strict=True))


@dataclass(frozen=True)
class Remainder:
    """What a refitted model leaves of all records, whitened, and the price of its parameters.

    Parameters
    ----------
    left : ndarray, shape (N,)
        z of the module.
    occam : float
        Logarithm of the share of what its parameters can do that agrees with the records, priors included.
    sizes : mapping of str to float
        Channel -> size of what its discrepancy is measured by, SI.
    products : mapping of str to ndarray
        As `Frame.products` gives it.
    priced : Priced
        What each parameter has of the price; of a model without parameters nothing.
    """

    left: np.ndarray
    occam: float
    sizes: Mapping[str, float]
    products: Mapping[str, np.ndarray]
    priced: Priced = Priced()


@dataclass(frozen=True)
class _Part:
    """Functions of one channel as they enter: which, their scale, and their normal equations, factored."""

    channel: str
    mask: np.ndarray
    scale: float
    factor: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class Marginal:
    """The marginal likelihood with some functions of the discrepancy, and what it takes them to be.

    fit           | half the sum of squares that is left, negative
    volume        | logarithm of the share of what the model can do that agrees with the records (Occam's factor)
    weights       | of the functions, by channel
    scale, chosen | as of `Frame.marginal`
    """

    fit: float
    volume: float
    weights: dict[str, np.ndarray]
    scale: float = 0.0
    chosen: tuple[int, ...] | None = None

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
        self._kept: dict[tuple[int, ...] | None, list[tuple[str, np.ndarray, int, np.ndarray]]] = {}

    def _batch(self, count: int) -> np.ndarray:
        """Number of the batch of every sample: of one record and time, whatever the channel."""
        records = list(dict.fromkeys(b.record for b in self.blocks))
        each = max(round(count / max(len(records), 1)), 1)
        found = np.zeros(self.count, dtype=int)
        for block, rows in zip(self.blocks, self.rows, strict=True):
            inside = np.cumsum(block.good) / max(int(block.good.sum()), 1)
            found[rows] = each * records.index(block.record) + np.minimum((each * inside).astype(int), each - 1)
        return found

    def at(self, channel: str) -> np.ndarray:
        """Which samples are a channel's."""
        return self._at[channel]

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

    def products(self, left: np.ndarray) -> dict[str, np.ndarray]:
        """Products of all functions with what a model leaves [n], by channel."""
        return {c: g.T @ left[self._at[c]] for c, g in self._functions.items()}

    def marginal(self, model: Remainder, scale: float, chosen: Collection[int] | None = None) -> Marginal:
        """The marginal likelihood of a model with a discrepancy.

        Parameters
        ----------
        model : Remainder
            The model.
        scale : float
            Standard deviation of the discrepancy of every channel, as a share of `Remainder.sizes`; 0: there is none.
        chosen : collection of int, optional
            Numbers of the families it is made of; None: all.

        Returns
        -------
        Marginal
            Its parts, and the posterior mean of the discrepancy's weights.
        """
        fit, volume = -0.5 * float(model.left @ model.left), model.occam
        weights = {}
        for part in self._parts(model, scale, chosen) if scale > 0.0 else ():
            found = cho_solve((part.factor, True), part.right)
            fit += 0.5 * float(part.right @ found)
            volume -= float(np.sum(np.log(np.diag(part.factor))))
            weights[part.channel] = np.zeros(len(part.mask))
            weights[part.channel][part.mask] = part.scale * found
        return Marginal(fit, volume, weights, scale, None if chosen is None else tuple(chosen))

    def explained(self, one: Marginal) -> np.ndarray:
        """The discrepancy of a marginal likelihood at its posterior mean, whitened [N]: G S a of the module."""
        found = np.zeros(self.count)
        for channel, weights in one.weights.items():
            used = np.flatnonzero(weights)
            if len(used):  # few of them where one family is chosen
                some = slice(used[0], used[-1] + 1)
                found[self._at[channel]] = self._functions[channel][:, some] @ weights[some]
        return found

    def _parts(self, model: Remainder, scale: float, chosen: Collection[int] | None) -> Iterator[_Part]:
        """The channels' functions of the chosen families at their scale."""
        for channel, mask, count, gram in self._chosen(None if chosen is None else tuple(chosen)):
            s = scale * model.sizes[channel] / np.sqrt(count)
            factor = cho_factor(s**2 * gram + np.eye(len(gram)), lower=True)[0]
            yield _Part(channel, mask, s, factor, s * model.products[channel][mask])

    def _chosen(self, chosen: tuple[int, ...] | None) -> list[tuple[str, np.ndarray, int, np.ndarray]]:
        """(channel, which of its functions, of how many families, their products) where families are chosen; kept."""
        if chosen not in self._kept:
            found = []
            for channel in self.channels:
                family = self._family[channel]
                mask = np.ones(len(family), dtype=bool) if chosen is None else np.isin(family, list(chosen))
                if mask.any():
                    gram = self._grams[channel][np.ix_(mask, mask)]
                    found.append((channel, mask, len(np.unique(family[mask])), gram))
            self._kept[chosen] = found
        return self._kept[chosen]

    def map_of(self, model: Remainder, one: Marginal, family: int) -> tuple[np.ndarray, np.ndarray]:
        """(posterior means, standard deviations) of the weights of a family that a marginal likelihood consists of."""
        channel = self.families[family].channel
        part = next(p for p in self._parts(model, one.scale, one.chosen) if p.channel == channel)
        own = self._family[channel][part.mask] == family
        inverse = cho_solve((part.factor, True), np.eye(len(part.right)))
        return one.weights[channel][self._family[channel] == family], part.scale * np.sqrt(np.diag(inverse)[own])

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
