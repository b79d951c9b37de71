"""Sensors as a rig has them: steps of a quantiser, readings at a rate of their own, late, speeds from differences.

A sensor shows, in this order: the signal with its noise and the effects of the seam "sense"; the encoder's zero of this
episode added; the nearest step of the quantiser; the last reading until the next one is due; all of it later by its
latency. A speed that is taken from a position is the difference of two readings over the control period behind a filter
of order 1.
"""

import math
from dataclasses import dataclass

from cable_envs.core.kernels import inline


@dataclass(frozen=True)
class Sensor:
    """What a sensor does to its signal.

    Attributes
    ----------
    quantum : float
        Step of the quantiser, in the unit of the signal; 0: none.
    period : float
        Time between two readings, s; 0: one in every control step.
    latency : float
        Time until a reading is seen, s.
    of : str
        Name of the position whose difference it is; empty: it is a sensor of its own.
    filter : float
        Time constant of the filter of a difference, s.
    """

    quantum: float = 0.0
    period: float = 0.0
    latency: float = 0.0
    of: str = ""
    filter: float = 0.0


@inline
def _in_steps(s, shown, c, lo, hi):
    """Each signal from the encoder's zero of the episode, at the nearest step of its quantiser."""
    for k in range(c.sensors):
        quantum, zeroed = c.quantum[k], c.zeroed[k]
        for i in range(lo, hi):
            shown[k, i] = shown[k, i] + zeroed * s.zero[i]
        if quantum > 0.0:
            for i in range(lo, hi):
                shown[k, i] = quantum * math.floor(shown[k, i] / quantum + 0.5)


@inline
def _speeds(shown, kept, c, fresh, lo, hi):
    """Filtered differences of positions; at the first step of an episode there is none."""
    for k in range(c.sensors):
        base = c.derived[k]
        if base >= 0:
            for i in range(lo, hi):
                speed = 0.0
                if not fresh:
                    found = (shown[base, i] - kept[base, i]) / c.period
                    speed = kept[k, i] + c.smoothing[k] * (found - kept[k, i])
                shown[k, i] = speed


@inline
def as_on_a_rig(block, s, shown, c, fresh, lo, hi):
    """What the sensors show at this step, before it is late; ``fresh``: the first of an episode."""
    kept = block[c.kept :]
    _in_steps(s, shown, c, lo, hi)
    _speeds(shown, kept, c, fresh, lo, hi)
    for k in range(c.sensors):
        every = c.every[k]
        for i in range(lo, hi):
            if every > 1 and int(s.step[i]) % every != 0:
                shown[k, i] = kept[k, i]
            kept[k, i] = shown[k, i]
