"""Where a mismatch is: when in each record, and in which regime of the motion.

The mismatch d [T] is what the named model predicts less what the refit predicts, over the channel's noise; where
nothing is named, the residual over its noise, as a moving mean of `SMOOTHED` s. Its energy is d^2.

    intervals  the fewest windows of `WINDOW` s that hold `HELD` of a channel's energy in a record
    regime     the range of one coordinate (speed, direction, position, time since reversal, tension, elapsed time) that
               holds `IN_REGIME` of the energy in the least share of the time

`clues` asks of a residual by itself whether it follows a coordinate: the largest mean of a bin over its standard error,
against the same with the signs of whole blocks drawn at random (Good, Permutation, Parametric and Bootstrap Tests of
Hypotheses, 2005), so that what is correlated stays together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_envs.diagnosis.model.model import Block, Coordinate

WINDOW, HELD, IN_REGIME, SMOOTHED = 0.5, 0.92, 0.8, 0.3
EVERYWHERE = 0.7
"""Share of the time from which a regime is no place any more."""
BINS, DRAWS, BLOCK = 12, 400, 0.5
_LATE = 1.6
"""A record's excitation changes with time: that it acts late says little where its speed says nearly as much."""
LEAST_CHANNEL = 0.05
"""Share of all energy below which a channel is not listed."""
BY_SPEED, SINCE, ELAPSED = "size of speed", "time since reversal", "elapsed time"


@dataclass(frozen=True)
class Regime:
    """Range of a coordinate, SI; ``energy``: share of the mismatch in it, ``time``: share of the samples."""

    coordinate: str
    unit: str
    low: float
    high: float
    energy: float
    time: float


def smooth(values: np.ndarray, good: np.ndarray, period: float) -> np.ndarray:
    """Moving mean over `SMOOTHED` s of the good samples [T]; its noise is taken out of the energy by `energy_of`."""
    width = max(round(SMOOTHED / period), 1)
    kernel = np.ones(width)
    count = np.convolve(good.astype(float), kernel, "same")
    return np.convolve(np.where(good, values, 0.0), kernel, "same") / np.maximum(count, 1.0)


def intervals(time: np.ndarray, energy: np.ndarray) -> tuple[list[list[float]], float]:
    """([[from, to]] s of the fewest windows that hold `HELD` of the energy [T], neighbours merged; share held)."""
    total = float(energy.sum())
    if total <= 0.0:
        return [], 0.0
    place = np.floor((time - time[0]) / WINDOW).astype(int)
    sums = np.bincount(place, weights=energy)
    order = np.argsort(-sums, kind="stable")
    count = int(np.searchsorted(np.cumsum(sums[order]), HELD * total)) + 1
    chosen = np.zeros(len(sums), dtype=bool)
    chosen[order[:count]] = True
    edges = np.flatnonzero(np.diff(np.r_[False, chosen, False].astype(int)))
    spans = [
        [float(time[0] + WINDOW * a), float(min(time[0] + WINDOW * b, time[-1]))]
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    return spans, float(sums[chosen].sum() / total)


def regime(coordinates: Sequence[Coordinate], energy: np.ndarray) -> Regime | None:
    """The coordinate whose range of bins holds `IN_REGIME` of the energy [T] in the least time; None: everywhere."""
    found = [r for c in coordinates if (r := _narrowest(c, energy)) is not None]
    best = min(found, key=lambda r: r.time * (_LATE if r.coordinate == ELAPSED else 1.0), default=None)
    return best if best is not None and best.time < EVERYWHERE else None


def _narrowest(coordinate: Coordinate, energy: np.ndarray) -> Regime | None:
    values, total = coordinate.values, float(energy.sum())
    if coordinate.name == "direction":
        edges = np.array([-1.5, -0.5, 0.5, 1.5])
    else:
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))
    if len(edges) < 3 or total <= 0.0:
        return None
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    held = np.r_[0.0, np.cumsum(np.bincount(place, weights=energy, minlength=len(edges) - 1))] / total
    count = np.r_[0.0, np.cumsum(np.bincount(place, minlength=len(edges) - 1))] / len(values)
    best = None
    for a in range(len(edges) - 1):
        b = int(np.searchsorted(held, held[a] + IN_REGIME - 1e-12))
        if b < len(held) and (best is None or count[b] - count[a] < best.time):
            share, time = float(held[b] - held[a]), float(count[b] - count[a])
            best = Regime(coordinate.name, coordinate.unit, float(edges[a]), float(edges[b]), share, time)
    if best is None or (coordinate.name == "direction" and best.low < -0.5 and best.high > 0.5):
        return None
    return best


def elapsed(block: Block) -> Coordinate:
    """s since the record's start, as a coordinate."""
    return Coordinate(ELAPSED, "s", block.time - block.time[0])


_SHOWN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", 180.0 / np.pi), "rad/s": ("deg/s", 180.0 / np.pi)}


def words(found: Regime | None, ways: tuple[str, str], coordinates: Mapping[str, Coordinate]) -> str:  # noqa: PLR0911 - one for each sentence
    """A regime in words for a person: "within 0.3 s after each reversal", "moving forward, above 20 mm/s"."""
    if found is None:
        return "all over the motion"
    forward, backward = ways
    unit, factor = _SHOWN.get(found.unit, (found.unit, 1.0))
    unit = "" if unit == "1" else f" {unit}"
    low, high = (f"{factor * v:.3g}{unit}" for v in (found.low, found.high))
    values = coordinates[found.coordinate].values
    first, last = found.low <= float(values.min()), found.high >= float(values.max())
    if found.coordinate == "direction":
        return forward if found.low > 0.0 else backward if found.high < 0.0 else "at rest"
    if found.coordinate == "speed" and found.low >= 0.0:
        return f"{forward}, above {low}" if last else f"{forward}, at {low} to {high}"
    if found.coordinate == "speed" and found.high <= 0.0:
        slow, fast = (f"{abs(factor * v):.3g}{unit}" for v in (found.high, found.low))
        return f"{backward}, above {slow}" if first else f"{backward}, at {slow} to {fast}"
    if found.coordinate == SINCE:
        return f"within {high} after each reversal" if first else f"from {low} after each reversal on"
    name = "speeds" if found.coordinate == BY_SPEED else found.coordinate
    if found.coordinate == ELAPSED:
        if first:
            return f"in the first {high} of the record"
        return f"from {low} of the record on" if last else f"from {low} to {high} of the record"
    if first:
        return f"at {name} below {high}"
    return f"at {name} above {low}" if last else f"at {name} from {low} to {high}"


def clues(blocks: Sequence[Block], white: np.ndarray, rng: np.random.Generator) -> dict[tuple[str, str], float]:
    """(channel, coordinate) -> p-value of a whitened residual [all blocks' samples], over all records together."""
    first, parts = 0, []
    for block in blocks:
        parts.append(white[first : first + len(block.time)])
        first += len(block.time)
    found = {}
    for channel in dict.fromkeys(b.channel for b in blocks):
        own = [k for k, b in enumerate(blocks) if b.channel == channel]
        residual = np.concatenate([parts[k] for k in own])
        signs = np.concatenate([_block_signs(blocks[k], rng) for k in own], axis=1)
        names = [c.name for c in blocks[own[0]].along if c.name != "direction"]
        series = {n: np.concatenate([_named(blocks[k], n) for k in own]) for n in names}
        series[ELAPSED] = np.concatenate([elapsed(blocks[k]).values for k in own])
        for name, values in series.items():
            found[channel, name] = _permuted(values, residual, signs)
    return found


def _named(block: Block, name: str) -> np.ndarray:
    return next(c.values for c in block.along if c.name == name)


def _block_signs(block: Block, rng: np.random.Generator) -> np.ndarray:
    place = np.floor((block.time - block.time[0]) / BLOCK).astype(int)
    return rng.choice([-1.0, 1.0], (DRAWS, place[-1] + 1))[:, place]


def _permuted(values: np.ndarray, residual: np.ndarray, signs: np.ndarray) -> float:
    use = residual != 0.0
    edges = np.unique(np.quantile(values[use], np.linspace(0.0, 1.0, BINS + 1))) if use.any() else np.empty(0)
    if len(edges) < 3:
        return 1.0
    place = np.clip(np.searchsorted(edges, values[use], side="right") - 1, 0, len(edges) - 2)
    members = np.eye(len(edges) - 1)[place]
    size = np.sqrt(np.maximum(members.sum(axis=0), 1.0))
    seen = np.abs(residual[use] @ members / size).max()
    drawn = np.abs((signs[:, use] * residual[use]) @ members / size).max(axis=1)
    return float((1 + np.sum(drawn >= seen)) / (DRAWS + 1))
