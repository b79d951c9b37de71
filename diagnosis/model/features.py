"""What a model may be off by: smooth functions of the motion and of the time, channel by channel.

A discrepancy is a Gaussian process (Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425) of finite rank: hats over
quantiles of a coordinate (speed, position, tension, time since reversal), the same with the sign of the direction, slow
waves of the elapsed time, and those times what may drift. A family is what shares one coordinate; the weights of its
functions are independent.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_envs.diagnosis.model.model import Block

HATS = 7
"""Along each coordinate, over quantiles of its values."""
FINE, SHARP = 28, "position"
"""The same for what a tooth or a stop makes uneven within a few per cent of the range."""
SLOW, DRIFTS = 6, 3
"""Waves of the elapsed time of each record: half a period over the record, a whole one, ..., beside its level; of them,
those that multiply what may drift."""
ELAPSED = "elapsed time"
"""Family of slow waves, each record's its own."""
_CLOSE = 1e-3
"""Share of a coordinate's range below which two of its values are one: at rest a prediction differs by rounding, and
that rounding follows what was measured."""


@dataclass(frozen=True)
class Family:
    """Functions of one channel along one coordinate.

    Parameters
    ----------
    channel, name : str
        Of which channel, and along what.
    unit : str
        Of the coordinate.
    columns : mapping of int to ndarray
        Number of a block -> functions [T, n]; blocks of other channels have none.
    at : tuple of float
        Places of the hats; empty for waves.
    """

    channel: str
    name: str
    unit: str
    columns: Mapping[int, np.ndarray]
    at: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of functions."""
        return next(iter(self.columns.values())).shape[1]


def families(blocks: Sequence[Block], predicted: Sequence[np.ndarray]) -> Iterator[Family]:
    """All families of all channels.

    Parameters
    ----------
    blocks : sequence of Block
        Of all records.
    predicted : sequence of ndarray
        Prediction [T] of every block: where a coordinate is measured by the channel itself, the prediction stands for
        it, because the channel's noise would otherwise be on both sides.
    """
    for channel in dict.fromkeys(b.channel for b in blocks):
        yield from _of_channel([k for k, b in enumerate(blocks) if b.channel == channel], blocks, predicted)


def _of_channel(own: list[int], blocks: Sequence[Block], predicted: Sequence[np.ndarray]) -> Iterator[Family]:
    channel = blocks[own[0]].channel
    slow = {k: np.sqrt(2.0) * waves(blocks[k], SLOW) for k in own}
    records = {k: j for j, k in enumerate(own)}
    level = {k: np.column_stack([np.ones(len(slow[k])), slow[k]]) for k in own}
    wide = {k: _placed(level[k], records[k], len(own)) for k in own}
    yield Family(channel, ELAPSED, "s", wide)
    sides = _along(own, blocks, predicted, "direction")
    for name in ("own scale", "speed", "direction"):
        values = {k: predicted[k] for k in own} if name == "own scale" else _along(own, blocks, predicted, name)
        if values:
            drifts = {k: _centred(values[k], blocks[k].good)[:, None] * slow[k][:, :DRIFTS] for k in own}
            yield Family(
                channel, f"{name} with elapsed time", "s",
                {k: _placed(d, records[k], len(own)) for k, d in drifts.items()},
            )  # fmt: skip
    for coordinate in blocks[own[0]].along:
        if coordinate.name == "direction":
            continue
        values = _along(own, blocks, predicted, coordinate.name)
        if not values:
            continue
        together = np.concatenate([values[k][blocks[k].good] for k in own])
        for count in (HATS, FINE) if coordinate.name == SHARP else (HATS,):
            at = places(together, count)
            if len(at) < 3:
                continue
            bumps, fine = {k: hats(v, at) for k, v in values.items()}, " (fine)" if count == FINE else ""
            yield Family(channel, coordinate.name + fine, coordinate.unit, bumps, tuple(at))
            if coordinate.name != "speed" and sides:
                turned = {k: h * np.sign(sides[k])[:, None] for k, h in bumps.items()}
                yield Family(channel, f"{coordinate.name} with direction{fine}", coordinate.unit, turned, tuple(at))


def _along(own: Sequence[int], blocks: Sequence[Block], predicted: Sequence[np.ndarray], name: str):
    """A coordinate of every block of a channel; empty where one has none."""
    found = {}
    for k in own:
        coordinate = next((c for c in blocks[k].along if c.name == name), None)
        if coordinate is None:
            return {}
        found[k] = predicted[k] if coordinate.channel == blocks[k].channel else coordinate.values
    return found


def waves(block: Block, count: int) -> np.ndarray:
    """Cosines of the elapsed time of a record [T, count]: half a period over it, a whole one, ..."""
    at = (block.time - block.time[0]) / max(block.time[-1] - block.time[0], 1e-12)
    return np.cos(np.pi * np.outer(at, np.arange(1, count + 1)))


def _placed(columns: np.ndarray, record: int, records: int) -> np.ndarray:
    """Columns that each record has for itself."""
    wide = np.zeros((len(columns), columns.shape[1] * records))
    wide[:, columns.shape[1] * record : columns.shape[1] * (record + 1)] = columns
    return wide


def _centred(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Values less their mean, over their standard deviation."""
    if not good.any():
        return np.zeros_like(values)
    spread = float(np.std(values[good]))
    return (values - float(np.mean(values[good]))) / (spread if spread > 0.0 else 1.0)


def places(values: np.ndarray, count: int) -> np.ndarray:
    """Where the hats along a coordinate stand: its quantiles, without those that fall together."""
    if not len(values) or np.ptp(values) == 0.0:
        return np.empty(0)
    found = np.quantile(values, np.linspace(0.02, 0.98, count))
    return found[np.r_[True, np.diff(found) > _CLOSE * (found[-1] - found[0])]]


def hats(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Straight lines between the places, constant beyond [T, places]."""
    return np.stack([np.interp(values, at, row) for row in np.eye(len(at))], axis=1)
