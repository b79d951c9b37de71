"""Spectra of what a model leaves and of what its runs differ by, in bands, over that of a known noise.

Runs that are nudged apart by next to nothing tell what of a simulation can be predicted, their mean, and what cannot,
their spread: where it is chaotic, runs soon have nothing in common. What is left of a recording beside the mean of
many runs should then have the power

    S(f) = 1 + V(f),    V: of the spread;  all over the power of the sensors' noise,

which Whittle's likelihood holds against the power D that it has (Beran, Statistics for Long-Memory Processes, 1994,
ch. 6); what the mean of few runs has of their spread, V / n, is taken out of it, or smaller spreads would be favoured:

    cost = sum over channels and bands  2 m (ln S + D / S),    m: frequencies of a band

The noise must be known, stated or from a record at rest. Channels that show one oscillation count as if each had its
own: where errors are asked for, a rise of the cost is divided by what the best model leaves over the number of bands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import chi2

from cable_envs.diagnosis.evidence.shared import bayes_bound
from cable_envs.diagnosis.model.leftover import Leftover
from cable_envs.diagnosis.model.model import Block, Model, Whitener, white_noise
from cable_envs.diagnosis.model.rest import AnyNoise

BAND = 16
"""Frequencies of a band, of the longest record."""
AT_ONCE = 192
"""Runs at a time: a long recording's must fit into memory."""
LEAST = 0.05
"""Share of what the mean of few runs leaves that stays in any case."""
NUDGE = 1e-4
"""Between runs, over a parameter's scale: too little to be seen but where it grows."""


@dataclass(frozen=True)
class Bands:
    """Power [B] of every channel, band by band, over that of its noise.

    channels, at | channel and middle frequency, Hz, of each band
    count        | frequencies in it
    left, spread | power of what the mean of many runs leaves, and of what the runs differ by
    """

    channels: tuple[str, ...]
    at: np.ndarray
    count: np.ndarray
    left: np.ndarray
    spread: np.ndarray

    @property
    def expected(self) -> np.ndarray:
        """S of the module [B]."""
        return 1.0 + self.spread

    @property
    def cost(self) -> float:
        """Of the module."""
        return float(np.sum(2.0 * self.count * (np.log(self.expected) + self.left / self.expected)))

    @property
    def beyond(self) -> np.ndarray:
        """Cost of each band beyond that of a model that expects what is left [B]; by chance about 1."""
        ratio = np.maximum(self.left, 1e-300) / self.expected
        return 2.0 * self.count * (ratio - 1.0 - np.log(ratio))

    @property
    def excess(self) -> float:
        """The same of all bands, less what chance leaves; at least 0."""
        return max(float(self.beyond.sum()) - len(self.left), 0.0)

    @property
    def dispersion(self) -> float:
        """Its mean; at least 1."""
        return max(float(self.beyond.mean()), 1.0)

    @property
    def p_value(self) -> float:
        """Of its sum."""
        return float(chi2.sf(self.beyond.sum(), len(self.left)))

    @property
    def expected_gain(self) -> float:
        """What the spread gains if the recording has it: how much the model oscillates by itself."""
        return float(np.sum(2.0 * self.count * (self.expected - 1.0 - np.log(self.expected))))

    @property
    def over_noise(self) -> float:
        """Largest RMS of a channel over what is expected."""
        weights = ((self._of(c), self.count[self._of(c)]) for c in dict.fromkeys(self.channels))
        return max(float(np.sqrt((self.left[own] @ w) / (self.expected[own] @ w))) for own, w in weights)

    @property
    def without_spread(self) -> "Bands":
        """As if the runs did not differ."""
        return replace(self, spread=np.zeros_like(self.spread))

    def coarse(self, width: int) -> "Bands":
        """``width`` bands as one: for oscillations whose frequency is a little off."""
        ends = [int(self._of(c)[-1]) + 1 for c in dict.fromkeys(self.channels)]
        first = np.concatenate([np.arange(a, b, width) for a, b in pairwise([0, *ends])])
        count = np.add.reduceat(self.count, first)
        left, spread = (np.add.reduceat(power * self.count, first) / count for power in (self.left, self.spread))
        names = tuple(self.channels[k] for k in first)
        return replace(self, channels=names, at=self.at[first], count=count, left=left, spread=spread)

    def leftovers(self) -> tuple[Leftover, ...]:
        """Where the power is not as expected, channel by channel, the surest first."""
        found = []
        for channel in dict.fromkeys(self.channels):
            own = self._of(channel)
            total, worst = float(self.beyond[own].sum()), own[int(np.argmax(self.beyond[own]))]
            odds = bayes_bound(float(chi2.sf(total, len(own))))
            found.append(Leftover(channel, "frequency", "Hz", odds, 0.5 * total, at=(float(self.at[worst]),)))
        return tuple(sorted(found, key=lambda leftover: -leftover.log_odds))

    def rows(self) -> list[dict[str, Any]]:
        """For figures, channel by channel: frequencies, Hz, what is left and what is expected there."""
        names = ("at", "left", "expected")
        return [
            {"channel": channel, **{name: getattr(self, name)[self._of(channel)].tolist() for name in names}}
            for channel in dict.fromkeys(self.channels)
        ]

    def _of(self, channel: str) -> np.ndarray:
        return np.flatnonzero([c == channel for c in self.channels])


class Spectra:
    """The bands of a model at parameter values, under the noise that is known; false where none is.

    stated: channel -> standard deviation of its noise, SI; a record at rest goes before it. Channels whose noise is not
    known are left out.
    """

    def __init__(self, model: Model, stated: Mapping[str, float]):
        self.model = model
        found = {b.channel: known_noise(b, model.blocks, stated) for b in model.blocks}
        self.whitener = Whitener({channel: noise for channel, noise in found.items() if noise is not None})
        self._blocks = [k for k, b in enumerate(model.blocks) if b.channel in self.whitener.noise]
        self._bands = max((len(model.blocks[k].time) for k in self._blocks), default=0) // (2 * BAND)

    def __bool__(self) -> bool:
        return self._bands > 1

    def of(self, columns: np.ndarray, runs: int) -> list[Bands]:
        """Of every column [parameters, n], each run so many times."""
        pieces = range(0, columns.shape[1], max(AT_ONCE // runs, 1))
        return [bands for k in pieces for bands in self._of(columns[:, k : k + pieces.step], runs)]

    def _of(self, columns: np.ndarray, runs: int) -> list[Bands]:
        n = columns.shape[1]
        predictions = self.model.predict(_nudged(self.model, columns, runs))
        sums: dict[str, np.ndarray] = {}
        for k in self._blocks:
            block = self.model.blocks[k]
            series = predictions[k].reshape(-1, n, runs)
            mean = series.mean(axis=2)
            apart = (series - mean[:, :, None]).reshape(-1, n * runs)
            white = self.whitener.noise[block.channel].flat(
                np.concatenate([block.measured[:, None] - mean, apart], axis=1), block.good
            )
            power, count = _banded(white, int(block.good.sum()), self._bands)
            spread = power[:, n:].reshape(-1, n, runs).sum(axis=2) / (runs - 1)
            own = np.stack([power[:, :n], spread, np.repeat(count[:, None], n, axis=1)])
            sums[block.channel] = sums.get(block.channel, 0.0) + own
        left, spread, counts = np.concatenate(list(sums.values()), axis=1)
        finite = np.isfinite(left).all(axis=0) & np.isfinite(spread).all(axis=0)
        left, spread = (np.where(finite, power, 1e30) / np.maximum(counts, 1.0) for power in (left, spread))
        period = float(np.median(np.diff(self.model.blocks[0].time)))
        at = np.tile((np.arange(self._bands) + 0.5) * 0.5 / (self._bands * period), len(sums))
        names = tuple(channel for channel in sums for _ in range(self._bands))
        many = np.maximum(left - spread / runs, LEAST * left)
        return [Bands(names, at, counts[:, j], many[:, j], spread[:, j]) for j in range(n)]

    def at(self, values: Mapping[str, float], runs: int) -> Bands:
        """At parameter values by name."""
        return self.of(self.column(values), runs)[0]

    def bent(self, values: Mapping[str, float], runs: int) -> float:
        """Share of what runs at parameter values are apart by that is not in proportion to how far they are nudged.

        1 of an oscillation whose phase is any; next to 0 where a parameter only shifts what is predicted, however far.
        """
        predictions = self.model.predict(_nudged(self.model, self.column(values), runs))
        by = np.arange(runs) - 0.5 * (runs - 1)
        bent, apart = 0.0, 0.0
        for k in self._blocks:
            block = self.model.blocks[k]
            off = predictions[k] - predictions[k].mean(axis=1, keepdims=True)
            rest = off - np.outer(off @ by / (by @ by), by)
            power = self.whitener.noise[block.channel].floor ** -2.0
            bent += power * float(np.sum(rest[block.good] ** 2))
            apart += power * float(np.sum(off[block.good] ** 2))
        return bent / apart if apart > 0.0 else 0.0

    def column(self, values: Mapping[str, float]) -> np.ndarray:
        """[parameters, 1]; what ``values`` does not have is at its start."""
        return np.array([[values.get(p.name, p.start)] for p in self.model.parameters])


class Averaged:
    """A model that predicts the mean of runs that are nudged apart: of what is chaotic, what can be predicted."""

    def __init__(self, model: Model, runs: int):
        self.model, self.blocks, self.parameters, self._runs = model, model.blocks, model.parameters, runs

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        every = self.model.predict(_nudged(self.model, values, self._runs))
        return [series.reshape(-1, values.shape[1], self._runs).mean(axis=2) for series in every]


def _nudged(model: Model, columns: np.ndarray, runs: int) -> np.ndarray:
    """Columns [parameters, n runs]: every column so many times, the first parameter that is claimed in doubt moved.

    It is one of the mechanism's own, without a dot in its name: what only delays a reading would move nothing else.
    """
    row = next((k for k, p in enumerate(model.parameters) if p.std and "." not in p.name), 0)
    found = np.repeat(columns, runs, axis=1)
    step = NUDGE * model.parameters[row].scale * (np.arange(runs) - 0.5 * (runs - 1))
    found[row] += np.tile(step, columns.shape[1])
    return found


def known_noise(block: Block, blocks: Sequence[Block], stated: Mapping[str, float]) -> AnyNoise | None:
    """The noise of a block's channel where a record at rest or the recording tells it; else None."""
    if block.noise is not None or block.channel not in stated:
        return block.noise
    return white_noise(blocks, block.channel, stated[block.channel])


def _banded(white: np.ndarray, samples: int, bands: int) -> tuple[np.ndarray, np.ndarray]:
    """(power [bands, n] of whitened series [T, n], summed over each band's frequencies, how many those are)."""
    power = np.abs(np.fft.rfft(white, axis=0))[1:] ** 2 / max(samples, 1)
    edges = np.round(np.linspace(0, len(power), bands + 1)).astype(int)
    count = np.diff(edges)
    starts = np.minimum(edges[:-1], len(power) - 1)
    return np.add.reduceat(power, starts, axis=0) * (count > 0)[:, None], count.astype(float)
