"""Whether a recording can tell its effect from another at all: odds for whoever knows both laws and the noise.

The mismatch that the true effect leaves behind the refit, whitened by the noise's spectrum, is held against what all
other effects of the library leave: for a few draws of the rival's shape, its size by least squares, then again about
the best draws with a size that leaves as much as the truth. Half of the energy that then remains is the expected
logarithm of the odds for the truth. A rival may fit still better in a shape that was not drawn, so the odds are an
upper limit; where even these are below `SEPARABLE`, a class of both is the right answer.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.proof.family_b.effects import LIBRARY
from cable_envs.proof.family_b.logger import Noise
from cable_envs.proof.refit import Excess, Refit

SEPARABLE = 20.0
"""Odds above which a recording separates two effects."""
DRAWS = 3
"""Of a rival's shape."""
CLOSEST = 3
"""Rivals that are looked at again with a size of their own."""


@dataclass(frozen=True)
class Spectrum:
    """Power of a channel's noise over its variance, as `cable_envs.proof.sensors.flat` asks for it.

    Attributes
    ----------
    noise : Noise
        Of the channel. Lines are known exactly by whoever knows the noise, and count for nothing.
    period : float
        Between samples, s.
    """

    noise: Noise
    period: float

    def _variance(self) -> float:
        """Of what is neither slow nor a walk, per variance of the noise."""
        counts = (self.noise.count / self.noise.std) ** 2 / 12.0
        return 1.0 - self.noise.slow + counts + self.noise.grows**2 / 4.0

    def power(self, f: np.ndarray) -> np.ndarray:
        """At each frequency, cycles per sample; 1 for white noise."""
        keep = np.exp(-self.period / self.noise.memory)
        slow = (1.0 - keep**2) / np.abs(1.0 - keep * np.exp(-2j * np.pi * f)) ** 2
        walk = self.noise.walk**2 * self.period / 30.0 / np.maximum(4.0 * np.sin(np.pi * f) ** 2, 1e-12)
        return self._variance() + self.noise.slow * slow + walk

    def of_mean(self, count: int) -> float:
        """The same of the mean of ``count`` samples."""
        return float(self.power(np.array([0.5 / count]))[0])


def against_rivals(
    refit: Refit, truth: str, found: Excess, seen: Callable[[int, np.ndarray], np.ndarray], rng: np.random.Generator
) -> dict[str, float]:
    """Logarithm of the odds for the truth against every other effect.

    Parameters
    ----------
    refit : Refit
        Of the records to which the effect is fitted.
    truth : str
        Name of the concealed effect.
    found : Excess
        What it leaves behind.
    seen : callable
        (channel, series of shape (T, n)) -> the series whitened by that channel's noise.
    rng : numpy.random.Generator
        Draws shapes.

    Returns
    -------
    dict of str to float
        Rival -> natural logarithm of the odds, an upper limit.
    """
    own = [(rival, draw) for rival in LIBRARY[refit.rig.system] if rival.name != truth for draw in _draws(rival, rng)]
    best: dict[str, tuple[float, Any, Any]] = {}
    for rival, (shape, sign) in own:
        at_one = {**shape, **{name: sign * unit for name, unit in rival.sized.items()}}
        left = _left(refit, at_one)
        odds = np.inf if left is None else 0.5 * _remains(refit, found.left, left, rival.signed, seen)
        if rival.name not in best or odds < best[rival.name][0]:
            best[rival.name] = (odds, rival, (shape, sign))
    closest = sorted(best, key=lambda name: best[name][0])[:CLOSEST]
    for name in closest:
        odds, rival, (shape, sign) = best[name]

        def change(size: float, rival=rival, shape=shape, sign=sign) -> dict[str, float]:
            return {**shape, **{name: sign * size * unit for name, unit in rival.sized.items()}}

        _, excess = refit.sized(change, max(found.added, 1e-4), rival.largest, tries=4)
        if np.isfinite(excess.left).all():
            again = 0.5 * _remains(refit, found.left, excess.left, rival.signed, seen)
            best[name] = (min(odds, again), rival, (shape, sign))
    return {name: float(min(odds, 1e6)) for name, (odds, _, _) in best.items()}


def separable(found: Mapping[str, float]) -> bool:
    """Whether a recording tells its effect from every other one by odds of `SEPARABLE`.

    Parameters
    ----------
    found : mapping of str to float
        Of `against_rivals`.

    Returns
    -------
    bool
        False where even the upper limit of the odds is lower for one of them.
    """
    return min(found.values()) > np.log(SEPARABLE)


def _draws(rival: Any, rng: np.random.Generator) -> list[tuple[dict[str, float], float]]:
    return [rival.draw(rng) for _ in range(DRAWS if rival.shaped else 1)]


def _left(refit: Refit, changes: dict[str, float]) -> np.ndarray | None:
    """What changes leave behind the linear refit; None where they give no finite recording."""
    left = refit.excess(changes).left
    return left if np.isfinite(left).all() else None


def _remains(
    refit: Refit, truth: np.ndarray, rival: np.ndarray, signed: bool, seen: Callable[[int, np.ndarray], np.ndarray]
) -> float:
    """Energy of ``truth`` that no size of ``rival`` takes, in the noise's metric."""
    if not np.any(rival):
        return refit.gain(truth, seen)
    # in the noise's own metric: the sizes are few and the energy is a parabola of the size
    a, b, both = refit.gain(truth, seen), refit.gain(rival, seen), refit.gain(truth + rival, seen)
    cross = 0.5 * (both - a - b)
    if b <= 0.0 or (cross <= 0.0 and not signed):
        return a
    return max(a - cross * cross / b, 0.0)
