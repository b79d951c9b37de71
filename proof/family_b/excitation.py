"""Reference motions of generator B: sweeps, moves with bounded jerk, swelling waves, trapezoids, random walks."""

from collections.abc import Callable, Mapping

import numpy as np


def reference(
    design: str, rng: np.random.Generator, seconds: float, amplitude: float, clock: float, pace: float = 1.0
) -> np.ndarray:
    """A reference motion about zero.

    Parameters
    ----------
    design : str
        One of `DESIGNS`.
    rng : numpy.random.Generator
        Draws its numbers.
    seconds, amplitude, clock : float
        Length, s; about the largest excursion; s between ticks.
    pace : float
        How much quicker it all is.

    Returns
    -------
    ndarray, shape (ticks,)
        It starts at zero and stays there for half a second.
    """
    t = np.arange(round(seconds / clock)) * clock
    motion = DESIGNS[design](rng, pace * t) * amplitude * np.clip((t - 0.5) / 2.0, 0.0, 1.0)
    width = max(round(0.06 / clock), 1)  # corners are rounded three times: the acceleration is continuous
    for _ in range(3):
        padded = np.concatenate([np.full(width, motion[0]), motion, np.full(width, motion[-1])])
        motion = np.convolve(padded, np.ones(width) / width, mode="same")[width:-width]
    return motion - motion[0]


def _sweep(rng, t):
    """A sine whose frequency rises, or falls."""
    low, high = np.exp(rng.uniform(*np.log([0.05, 0.1]))), np.exp(rng.uniform(*np.log([0.3, 0.6])))
    rate = (high - low) / t[-1]
    phase = 2.0 * np.pi * (low * t + 0.5 * rate * t * t)
    wave = np.sin(phase) / (1.0 + 1.2 * (low + rate * t))
    return wave if rng.random() < 0.6 else wave[::-1] - wave[-1] * (1.0 - t / t[-1])


def _moves(rng, t):
    """From place to place along seventh-order paths, with pauses."""
    out, here, now = np.zeros(len(t)), 0.0, 0.5
    while now < t[-1]:
        there, time, pause = rng.uniform(-1.0, 1.0), rng.uniform(0.8, 3.5), rng.uniform(0.0, 1.2)
        s = np.clip((t - now) / time, 0.0, 1.0)
        path = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
        out += (there - here) * path
        here, now = there, now + time + pause
    return out


def _swelling(rng, t):
    """A wave that swells and ebbs about a slowly moving middle."""
    f, g = rng.uniform(0.12, 0.4), rng.uniform(0.02, 0.05)
    swell = 0.55 + 0.4 * np.sin(2.0 * np.pi * g * t + rng.uniform(0.0, 6.28))
    return swell * np.sin(2.0 * np.pi * f * t) + 0.25 * np.sin(2.0 * np.pi * 0.37 * g * t)


def _trapezoids(rng, t):
    """To and fro with constant speeds that are drawn for each way, one of them slow."""
    times, places, side = [0.0], [0.0], 1.0
    while times[-1] < t[-1]:
        way, hold = rng.choice([rng.uniform(1.0, 2.5), rng.uniform(4.0, 8.0)]), rng.uniform(0.1, 0.8)
        place = side * rng.uniform(0.5, 1.0)
        times += [times[-1] + way, times[-1] + way + hold]
        places += [place, place]
        side = -side
    return np.interp(t, times, places)


def _walk(rng, t):
    """Band-limited noise, as of a hand that drives the rig."""
    knots = np.arange(0.0, t[-1] + 2.0, rng.uniform(0.7, 1.4))
    values = np.convolve(rng.normal(size=len(knots) + 4), [0.2, 0.6, 1.0, 0.6, 0.2], mode="same")[: len(knots)]
    values /= np.abs(values).max()
    part = np.interp(t, knots, np.arange(len(knots)))
    low = np.floor(part).astype(int)
    high, share = np.minimum(low + 1, len(knots) - 1), part - low
    return values[low] + (values[high] - values[low]) * share * share * (3.0 - 2.0 * share)


DESIGNS: Mapping[str, Callable[[np.random.Generator, np.ndarray], np.ndarray]] = {
    "sweep": _sweep, "moves": _moves, "swelling": _swelling, "trapezoids": _trapezoids, "walk": _walk,
}  # fmt: skip
