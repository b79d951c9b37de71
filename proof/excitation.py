"""Reference motions: sines, multisines, triangles with holds, steps and staircases of speed, all with finite speed."""

import numpy as np

DESIGNS = ("sine", "multisine", "triangle", "steps", "staircase")


def reference(design: str, rng: np.random.Generator, seconds: float, amplitude: float, clock: float) -> np.ndarray:
    """A reference motion about zero.

    Parameters
    ----------
    design : str
        One of `DESIGNS`.
    rng : numpy.random.Generator
        Draws its numbers.
    seconds, amplitude, clock : float
        Length, s; about the largest excursion; s between ticks.

    Returns
    -------
    ndarray
        [ticks]; it starts and stays 0.5 s at zero.
    """
    ticks = round(seconds / clock)
    t = np.arange(ticks) * clock
    made = {"sine": _sine, "multisine": _multisine, "triangle": _triangle, "steps": _steps, "staircase": _staircase}
    motion = made[design](rng, t, seconds) * amplitude
    motion *= np.clip((t - 0.5) / 1.5, 0.0, 1.0)
    width = max(round(0.08 / clock), 1)  # corners take 0.16 s: no drive jumps
    for _ in range(2):
        padded = np.concatenate([np.full(width, motion[0]), motion, np.full(width, motion[-1])])
        motion = np.convolve(padded, np.ones(width) / width, mode="same")[width:-width]
    return motion


def _sine(rng, t, seconds):
    f = np.exp(rng.uniform(*np.log([0.08, 0.35])))
    return np.sin(2 * np.pi * f * t)


def _multisine(rng, t, seconds):
    f = rng.choice(np.arange(2, 16), 5, replace=False) / 20.0
    waves = np.sin(2 * np.pi * np.outer(f, t) + rng.uniform(0, 2 * np.pi, (5, 1))) / (1 + 2 * f[:, None])
    total = waves.sum(axis=0)
    return total / np.abs(total).max()


def _triangle(rng, t, seconds):
    """Ramps between random turning points with holds."""
    times, places, side = [0.0], [0.0], 1.0
    while times[-1] < seconds:
        ramp, hold = rng.uniform(1.5, 4.0), rng.uniform(0.3, 2.0)
        place = side * rng.uniform(0.4, 1.0)
        times += [times[-1] + ramp, times[-1] + ramp + hold]
        places += [place, place]
        side = -side
    return np.interp(t, times, places)


def _steps(rng, t, seconds):
    edges = np.cumsum(rng.uniform(1.0, 3.0, int(seconds) + 2))
    levels = rng.uniform(-1.0, 1.0, len(edges) + 1)
    level = levels[np.searchsorted(edges, t)]
    width = max(len(t) // round(seconds) // 2, 1)  # a step takes half a second
    return np.convolve(np.pad(level, (width, width), mode="edge"), np.ones(width) / width, mode="same")[width:-width]


def _staircase(rng, t, seconds):
    """To and fro at speeds that grow from cycle to cycle."""
    times, places, side = [0.0], [0.0], 1.0
    duration = rng.uniform(4.0, 6.0)
    while times[-1] < seconds:
        times += [times[-1] + duration, times[-1] + duration + 0.4]
        places += [side * 0.9, side * 0.9]
        side, duration = -side, max(duration * 0.75, 0.9)
    return np.interp(t, times, places)
