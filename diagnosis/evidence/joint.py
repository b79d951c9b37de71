"""All records as one model, the size of what it leaves of each channel, and the noise of that."""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.fit.likelihood import raw_residuals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.constants import constants_of, with_constants
from cable_envs.diagnosis.model.model import Block, Free, Model, Whitener, learn_whitener, of_all_records, white_noise


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
