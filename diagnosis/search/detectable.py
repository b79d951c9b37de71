"""Whether noise is what limits a recording.

If what the best model leaves is far above the sensors' noise everywhere, no likelihood under that noise can judge, and
held-out records should (`cable_envs.diagnosis.search.heldout`).
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.model.model import Block, Model
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.search.selection import Selection

FAR = 3.0
"""RMS of what is left over the sensor's noise, in every regime, from which the model's error is what limits."""
ENOUGH = 1000
"""Samples of a channel, for regimes to be looked at."""
_BINS = 5


def limited_by_the_model(model: Model, selection: Selection, stated: Mapping[str, float]) -> str:
    """A sentence for the notes where the criterion "noise" does not suit a recording; else empty.

    stated: channel -> standard deviation of its noise, where the recording says it; else it is taken from third
    differences of the channel, in which motion that is sampled well has no part.
    """
    if selection.adequate and selection.after.p_value >= selection.rules.left_p:
        return ""
    least = {}
    for channel in dict.fromkeys(b.channel for b in model.blocks):
        own = [(b, r) for b, r in zip(model.blocks, selection.final.raw, strict=True) if b.channel == channel]
        if sum(int(b.good.sum()) for b, _ in own) < ENOUGH:
            return ""
        noise = stated.get(channel) or jitter(np.concatenate([b.measured[b.good] for b, _ in own]))
        least[channel] = min(_regimes(own)) / max(noise, 1e-300)
    if min(least.values()) < FAR:
        return ""
    said = ", ".join(f"{channel.replace('_', ' ')} {ratio:.0f}" for channel, ratio in least.items())
    return (
        f"the sensors' noise is not what limits the fit: in every part of the motion the residual is far above it (at "
        f"least this many times: {said}). Use --judge unseen, which accepts effects by the error on held-out records"
    )


def _regimes(own: Sequence[tuple[Block, np.ndarray]]) -> Iterator[float]:
    """RMS of what is left in every bin of every coordinate."""
    left = np.concatenate([r[b.good] for b, r in own])
    yield float(np.sqrt(np.mean(left**2)))
    for k in range(len(own[0][0].along)):
        values = np.concatenate([b.along[k].values[b.good] for b, _ in own])
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(len(edges) - 2, 0))
        for bin_ in np.unique(place):
            inside = left[place == bin_]
            if len(inside) >= 50:
                yield float(np.sqrt(np.mean(inside**2)))
