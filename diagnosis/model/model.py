"""What the steps of the diagnosis see of a simulator: measured blocks, parameters, and predictions for many columns."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from cable_envs.diagnosis.data.readings import FINE, Reading
from cable_envs.diagnosis.model.noise import Noise, learn_noise
from cable_envs.diagnosis.model.rest import AnyNoise, RestNoise


@dataclass(frozen=True)
class Free:
    """A parameter that may be refitted, SI.

    Parameters
    ----------
    name : str
        Of the plant's table, or the model's own.
    start, low, high : float
        Where refits begin, and the bounds.
    scale : float
        A size at which it matters.
    std : float, optional
        Standard deviation of a normal prior about ``start``; None: no prior.
    """

    name: str
    start: float
    low: float
    high: float
    scale: float
    std: float | None = None

    def clip(self, value: float) -> float:
        """``value`` within the bounds."""
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Coordinate:
    """Something that a mismatch may depend on, at every sample [T], SI: "speed", "tension", "time since reversal".

    channel: of which the values are the measurements, noise and all; empty where they are of none, or of its changes.
    """

    name: str
    unit: str
    values: np.ndarray
    channel: str = ""


@dataclass(frozen=True)
class Block:
    """One channel of one record.

    Parameters
    ----------
    record, channel : str
        Which one.
    time, measured, good : ndarray
        [T]: s, what was measured (SI), and where that counts.
    unit : str
        Of the measurements.
    along : tuple of Coordinate
        At which a mismatch is looked for, besides the elapsed time.
    memory : int, optional
        Samples over which its noise may be coloured; 0 where what a right model leaves is no sensor's noise, and colour
        would explain a slow mismatch away. None: as many as asked for.
    sensor : str
        Whose noise is in what a right model leaves. Empty where other sensors' noise is in it, too: a controller that
        acts on a noisy position puts its noise into the effort, a simulator that is driven by a recorded one into all.
    noise : RestNoise, optional
        Of its sensor, where a record at rest tells it; None: it is learnt from what a model leaves.
    reading : Reading
        How its samples were read.
    unsure : ndarray, optional
        [T]: what steps of a recorded effort may have moved by more than noise does; None: nothing.
    """

    record: str
    channel: str
    time: np.ndarray
    measured: np.ndarray
    good: np.ndarray
    unit: str = ""
    along: tuple[Coordinate, ...] = ()
    memory: int | None = None
    sensor: str = ""
    noise: RestNoise | None = None
    reading: Reading = FINE
    unsure: np.ndarray | None = None


class Model(Protocol):
    """A simulator with its records. ``parameters`` are rows of the columns that `predict` takes."""

    blocks: list[Block]

    @property
    def parameters(self) -> Sequence[Free]:
        """Everything that may be free."""
        ...

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Predictions [T, n] of every block for parameter columns [len(parameters), n]."""
        ...


class Around:
    """A model around another one: it has its parameters, its records, and what else that has.

    Parameters
    ----------
    model : Model
        The one inside.
    """

    def __init__(self, model: Model):
        self._model = model
        self.parameters: Sequence[Free] = model.parameters
        self.blocks: list[Block] = model.blocks

    def __getattr__(self, name: str) -> Any:
        """What else the model has."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._model, name)


@dataclass(frozen=True)
class Whitener:
    """Residuals of all blocks as independent samples of variance 1, given the noise of each channel."""

    noise: dict[str, AnyNoise] = field(default_factory=dict)

    def flat(self, blocks: Sequence[Block], series: Sequence[np.ndarray]) -> np.ndarray:
        """Series [T, n] of every block, one below the other, whitened; samples that do not count are 0."""
        parts = [self.noise[b.channel].flat(values, b.good) for b, values in zip(blocks, series, strict=True)]
        return np.concatenate(parts)


def white_noise(blocks: Sequence[Block], channel: str, std: float) -> Noise:
    """The white noise of a channel whose standard deviation is stated, with what the steps of its readings add."""
    step = max(b.reading.as_one for b in blocks if b.channel == channel)
    return Noise(np.empty(0), float(np.hypot(std, step / np.sqrt(12.0))))


HELD_OUT = ", held out"
"""How the name of a fitted record ends where what is held out of it is meant."""


def of_all_records(fit: Model, heldout: Model) -> list[Block]:
    """Blocks of the fitted and of the held-out records; what is held out of a fitted record is called so."""
    fitted = {b.record for b in fit.blocks}
    others = [replace(b, record=f"{b.record}{HELD_OUT}") if b.record in fitted else b for b in heldout.blocks]
    return [*fit.blocks, *others]


def residuals(blocks: Sequence[Block], predictions: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Measured less predicted [T, n] of every block."""
    return [b.measured.reshape(-1, *[1] * (p.ndim - 1)) - p for b, p in zip(blocks, predictions, strict=True)]


def learn_whitener(blocks: Sequence[Block], series: Sequence[np.ndarray], max_order: int = 8) -> Whitener:
    """The noise of every channel, from residuals [T] of its blocks; of one that is known from rest, its size only."""
    noise: dict[str, AnyNoise] = {}
    for channel in dict.fromkeys(block.channel for block in blocks):
        of_channel = [
            np.where(block.good, values, np.nan)
            for block, values in zip(blocks, series, strict=True)
            if block.channel == channel
        ]
        known = next((b.noise for b in blocks if b.channel == channel and b.noise is not None), None)
        if known is not None:
            noise[channel] = known.sized(of_channel)
            continue
        memories = [b.memory for b in blocks if b.channel == channel and b.memory is not None]
        noise[channel] = learn_noise(of_channel, min([max_order, *memories]))
    return Whitener(noise)
