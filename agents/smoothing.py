"""Keeping a share of the last action at every step: the same arithmetic in training and when a saved policy acts."""

from dataclasses import dataclass

import numpy as np

from cable_envs.setup import Setup
from cable_envs.tasks import LAST_COMMAND


@dataclass(frozen=True)
class Smoothing:
    """``action = share last + (1 - share) asked for``, the action at rest being the last one of a new episode.

    The environment's last command is among its observations (channel "command"), so the task stays Markovian.
    """

    share: float
    channel: int
    gain: float
    offset: float
    """action = gain * observed command + offset"""

    @classmethod
    def of(cls, setup: Setup, share: float) -> "Smoothing":
        """For the environments of ``setup``; ``share`` in [0, 1), 0 changes nothing."""
        channel = [c.row for c in setup.channels].index(LAST_COMMAND)
        span = setup.high - setup.low
        return cls(share, channel, 2.0 * setup.channels[channel].scale / span, -2.0 * setup.low / span - 1.0)

    def rest(self, observation: np.ndarray) -> np.ndarray:
        """The action [..., 1] that the first observation [..., channels] of an episode shows as the last one."""
        return self.gain * observation[..., self.channel : self.channel + 1] + self.offset

    def blend(self, last: np.ndarray, action: np.ndarray) -> np.ndarray:
        """What the environment gets when ``action`` is asked for after ``last``; clipped to [-1, 1], float32."""
        clipped = np.minimum(np.maximum(action, -1.0), 1.0)  # np.clip takes twice as long
        return np.asarray(self.share * last + (1.0 - self.share) * clipped, dtype=np.float32)
