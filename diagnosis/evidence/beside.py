"""A discrepancy and the noise beside it, learnt together.

An autoregression that is learnt from all that a model leaves takes in what a smooth function of the motion leaves
there, and no discrepancy is then seen beside it. Two explanations of a channel compete: noise alone, and a family of
the discrepancy with the noise that is left beside it. With the whitened residual z, the standard deviation s of what
drives the noise, and p numbers of its autoregression, either has the logarithm of the likelihood

    -1/2 sum z^2 - n log s - PRICE / 2 p

on the same n samples. The second explanation is found by turns, the family's weights under the noise and the noise
beside them, from white noise on: that is the end from which a function of the motion is seen first.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.diagnosis.evidence.candidates import SCALES
from cable_envs.diagnosis.evidence.marginal import Frame, Marginal, Remainder
from cable_envs.diagnosis.model.features import Family
from cable_envs.diagnosis.model.leftover import Leftover
from cable_envs.diagnosis.model.model import Block, Whitener, learn_whitener
from cable_envs.diagnosis.model.noise import PRICE, Noise, jitter

TURNS = 2
"""In which the weights and the noise are found."""


@dataclass(frozen=True)
class _Explained:
    """Noise of a channel, alone or beside a family: what is left, whitened, and what a family takes."""

    frame: Frame
    left: np.ndarray
    family: Marginal | None = None

    @property
    def explained(self) -> np.ndarray:
        """By the family, whitened."""
        return np.zeros_like(self.left) if self.family is None else self.frame.explained(self.family)

    def likelihood(self, counts: np.ndarray) -> float:
        """Its logarithm on the samples that count, with the prior of the family's weights, but for Occam's factor."""
        (noise,) = self.frame.whitener.noise.values()
        left = self.left - self.explained
        weights = 0.0 if self.family is None else -2.0 * self.family.fit - float(left @ left)
        numbers = noise.numbers if isinstance(noise, Noise) else 0
        own = left[counts]
        return -0.5 * (float(own @ own) + weights + PRICE * numbers) - len(own) * float(np.log(noise.std))


def beside_noise(
    blocks: Sequence[Block], families: Sequence[Family], raw: Sequence[np.ndarray], sizes: Mapping[str, float],
    learnt: Collection[str],
) -> Iterator[Leftover]:  # fmt: skip
    """Every family of channels whose noise is learnt, with odds over noise alone.

    Parameters
    ----------
    blocks : sequence of Block
        Of all records.
    families : sequence of Family
        That are asked.
    raw : sequence of ndarray
        What a model leaves [T] of every block, SI.
    sizes : mapping of str to float
        Channel -> what the scales of its discrepancy are counted in, SI.
    learnt : collection of str
        Channels whose noise nothing tells but what is left.

    Yields
    ------
    Leftover
        Of one family.
    """
    for channel in learnt:
        own = [k for k, b in enumerate(blocks) if b.channel == channel and b.good.any()]
        mine, left = [blocks[k] for k in own], [raw[k] for k in own]
        alone = _under(mine, [], left, learn_whitener(mine, left))
        for family in families:
            if family.channel == channel and set(own) <= family.columns.keys():
                columns = {j: family.columns[k] for j, k in enumerate(own)}
                yield _over(alone, replace(family, columns=columns), left, sizes)


def _over(alone: _Explained, family: Family, raw: Sequence[np.ndarray], sizes: Mapping[str, float]) -> Leftover:
    """A family over noise alone."""
    blocks = alone.frame.blocks
    white = max(jitter(r[b.good], b.reading.as_one) for b, r in zip(blocks, raw, strict=True))
    both = _with(_under(blocks, [family], raw, Whitener({family.channel: Noise(np.empty(0), white)})), sizes)
    for _ in range(TURNS):
        assert both.family is not None
        apart = both.frame.raw(both.family.weights)
        noise = learn_whitener(blocks, [r - a for r, a in zip(raw, apart, strict=True)])
        both = _with(_under(blocks, [family], raw, noise), sizes)
    counts = (alone.left != 0.0) & (both.left != 0.0)
    size = both.likelihood(counts) - alone.likelihood(counts)
    assert both.family is not None
    odds = size * _trusted(both.explained, both.left - both.explained) + both.family.volume - float(np.log(len(SCALES)))
    return as_leftover(both.frame, _remainder(both.frame, both.left, sizes), both.family, 0, (odds, size))


def most_probable(frame: Frame, model: Remainder, chosen: Collection[int]) -> Marginal:
    """The marginal likelihood with families of a discrepancy, of the scale that makes it largest."""
    return max((frame.marginal(model, scale, chosen) for scale in SCALES), key=lambda one: one.log)


def as_leftover(frame: Frame, model: Remainder, one: Marginal, family: int, found: tuple[float, float]) -> Leftover:
    """A family (its number) of a marginal likelihood, with its log odds and size, and its map where it is sure."""
    of, (odds, size) = frame.families[family], found
    if not of.at or odds <= 0.0:
        return Leftover(of.channel, of.name, of.unit, odds, size)
    height, error = frame.map_of(model, one, family)
    return Leftover(of.channel, of.name, of.unit, odds, size, "", of.at, tuple(height), tuple(error))


def _trusted(signal: np.ndarray, left: np.ndarray) -> float:
    """Share of the logarithm of a likelihood ratio that counts: noise may be larger where the signal is.

    As of `cable_envs.diagnosis.evidence.marginal.Frame.adjustment`, of batches of one sample (White, Econometrica 48
    (1980) 817): the noise beside the family has what follows one sample from the last.
    """
    information = float(signal @ signal)
    scores = float(np.sum((signal * left) ** 2))
    return min(information / scores, 1.0) if scores > 0.0 else 1.0


def _under(
    blocks: Sequence[Block], families: Sequence[Family], raw: Sequence[np.ndarray], noise: Whitener
) -> _Explained:
    frame = Frame(blocks, noise, families)
    return _Explained(frame, noise.flat(blocks, raw))


def _with(one: _Explained, sizes: Mapping[str, float]) -> _Explained:
    """The same with its family at the most probable scale."""
    return replace(one, family=most_probable(one.frame, _remainder(one.frame, one.left, sizes), (0,)))


def _remainder(frame: Frame, left: np.ndarray, sizes: Mapping[str, float]) -> Remainder:
    return Remainder(left, 0.0, sizes, frame.products(left))
