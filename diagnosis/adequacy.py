"""Whether what a model leaves is noise: no hypothesis is asked, only smooth functions of what a mismatch may follow.

For every channel, bumps along each coordinate of its blocks (speed, position, tension, time since reversal, ...), the
same with the sign of the direction, and slow waves of the elapsed time are filtered as the residual is, freed of what
the parameters can still absorb, and regressed on. Under the right model the fall of the sum of squares is chi-square
with as many degrees as functions. A single line of the spectrum is looked for beside it (Fisher's test).

A mismatch that lasts is colour to a noise that is learnt from it: a bias an endless memory, a vibration a resonance.
So the functions are taken out of the residual, the noise is learnt again from what is left, and the fall of the
deviance (`diagnosis.likelihood`) counts where it is larger.

Where the recording states its noise, what is left is also held against that: the only test that sees white physics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from diagnosis.likelihood import Judged, deviance
from diagnosis.model import Block, Model, Whitener, learn_whitener
from diagnosis.screen import basis

BUMPS = 7
"""Along each coordinate, over quantiles of its values."""
SLOW = 6
"""Waves of the elapsed time, per record: half a period over the record, a whole one, ..."""
SURE = 1e-3
"""Familywise p-value below which something is left."""
_NOT_MAPPED = ("direction",)
_APART = 1e-3
"""Share of a coordinate's range below which two of its values are one: at rest a prediction differs by rounding, and
that rounding follows what was measured."""
LINES = 3
"""Peaks of the spectrum that are looked at."""


@dataclass(frozen=True)
class Leftover:
    """What is left beyond noise in one channel along one coordinate.

    gain, functions | fall of the whitened sum of squares, and the chi-square's degrees of freedom
    at, height, error | the smooth map: places along the coordinate, what is left there and its standard error
    """

    channel: str
    coordinate: str
    unit: str
    gain: float
    functions: int
    p_value: float
    at: tuple[float, ...] = ()
    height: tuple[float, ...] = ()
    error: tuple[float, ...] = ()


@dataclass(frozen=True)
class Adequacy:
    """All of them, the surest first; ``p_value`` is familywise; ``excess``: largest sum of squares beyond noise."""

    p_value: float
    excess: float
    leftovers: tuple[Leftover, ...]
    over_noise: float = 1.0
    """largest RMS over what the recording states as a channel's noise; 1 where it states none"""


def adequacy(model: Model, judged: Judged, stated: dict[str, float] | None = None) -> Adequacy:
    """Look for structure in what a refit leaves. ``stated``: channel -> standard deviation of its noise, SI."""
    span = basis(judged.fit.jacobian)
    white = judged.whitener.flat(model.blocks, judged.raw)
    white = white - span @ (span.T @ white)
    found = []
    for channel in dict.fromkeys(b.channel for b in model.blocks):
        for name, unit, columns, at in _families(model.blocks, judged.raw, channel):
            found.append(_regressed(model, judged, span, white, channel, (name, unit), columns, at))
        found.append(_line(model, judged, white, channel))
    tests = len(found)
    best = min(found, key=lambda f: f.p_value)
    p = min(1.0, tests * best.p_value)
    excess = max([f.gain - f.functions for f in found if tests * f.p_value < SURE], default=0.0)
    over = _over_noise(model.blocks, judged, stated or {})
    return Adequacy(p, excess, tuple(sorted(found, key=lambda f: f.p_value)), over)


def _families(blocks: Sequence[Block], raw: Sequence[np.ndarray], channel: str):
    """(coordinate, unit, columns by block, places of the bumps) of every family of functions of a channel."""
    own = [b for b in blocks if b.channel == channel]
    left = {id(b): r for b, r in zip(blocks, raw, strict=True)}
    waves = []
    for block in own:
        at = (block.time - block.time[0]) / max(block.time[-1] - block.time[0], 1e-12)
        waves.append((block, np.cos(np.pi * np.outer(at, np.arange(1, SLOW + 1)))))
    for block, columns in waves:  # a family of its own for each record
        name = "elapsed time" if len(own) == 1 else f"elapsed time of {block.record}"
        yield name, "s", {id(block): columns}, ()
    names = [(c.name, c.unit) for c in own[0].along if c.name not in _NOT_MAPPED]
    sides = {id(b): next((c.values for c in b.along if c.name == "direction"), None) for b in own}
    for k, (name, unit) in enumerate(names):
        values = {
            id(b): _without_noise(b, [c for c in b.along if c.name not in _NOT_MAPPED][k].values, left[id(b)])
            for b in own
        }
        at = _places(np.concatenate([values[id(b)][b.good] for b in own]))
        if len(at) < 3:
            continue
        columns = {key: _bumps(v, at) for key, v in values.items()}
        yield name, unit, columns, at
        if name != "speed" and all(s is not None for s in sides.values()):
            turned = {key: c * sides[key][:, None] for key, c in columns.items()}
            yield f"{name} with direction", unit, turned, at


def _without_noise(block: Block, values: np.ndarray, left: np.ndarray) -> np.ndarray:
    """A coordinate that is the channel itself has its noise, which would then be on both sides: as predicted, instead.

    Where the noise is a thousandth of the range, it does not matter.
    """
    use = block.good
    if np.ptp(values[use]) == 0.0 or np.corrcoef(values[use], block.measured[use])[0, 1] < 0.98:
        return values
    noise = float(np.std(np.diff(block.measured, 3))) / np.sqrt(20.0)
    return values if noise < 1e-3 * float(np.ptp(values)) else block.measured - left


def _places(values: np.ndarray) -> np.ndarray:
    if not len(values) or np.ptp(values) == 0.0:
        return np.empty(0)
    found = np.quantile(values, np.linspace(0.02, 0.98, BUMPS))
    return found[np.r_[True, np.diff(found) > _APART * (found[-1] - found[0])]]


def _bumps(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Hats: straight lines between the places, constant beyond [T, places]."""
    return np.stack([np.interp(values, at, row) for row in np.eye(len(at))], axis=1)


def _regressed(model, judged, span, white, channel, named, columns, at) -> Leftover:
    count = next(iter(columns.values())).shape[1]
    series = [columns.get(id(b), np.zeros((len(b.time), count))) for b in model.blocks]
    functions = judged.whitener.flat(model.blocks, series)
    functions = functions - span @ (span.T @ functions)
    u, s, vt = np.linalg.svd(functions, full_matrices=False)
    sound = s > 1e-6 * max(float(s[0]), 1e-300) if len(s) else np.zeros(0, dtype=bool)
    rank = int(np.sum(sound))
    if rank == 0:
        return Leftover(channel, *named, 0.0, 0, 1.0)
    parts = u[:, sound].T @ white
    gain = max(float(parts @ parts), _relearned(model, judged, channel, columns))
    p = float(chi2.sf(gain, rank))
    height, error = (), ()
    if len(at):
        inverse = vt[sound].T / s[sound]
        height, error = tuple(inverse @ parts), tuple(np.sqrt(np.sum(inverse**2, axis=1)))
    return Leftover(channel, *named, gain, rank, p, tuple(at), height, error)


def _relearned(model, judged, channel: str, columns) -> float:
    """Fall of the channel's deviance when the functions are taken out and the noise is learnt from what is left."""
    own = [(b, r) for b, r in zip(model.blocks, judged.raw, strict=True) if b.channel == channel]
    blocks, raw = [b for b, _ in own], [r for _, r in own]
    count = next(iter(columns.values())).shape[1]
    series = [columns.get(id(b), np.zeros((len(r), count))) for b, r in own]
    noise = Whitener({channel: judged.whitener.noise[channel]})
    before = deviance(blocks, learn_whitener(blocks, raw))
    for _ in range(2):
        amount = np.linalg.lstsq(noise.flat(blocks, series), noise.flat(blocks, raw), rcond=1e-6)[0]
        noise = learn_whitener(blocks, [r - c @ amount for r, c in zip(raw, series, strict=True)])
    return before - deviance(blocks, noise)


def _line(model, judged, white, channel) -> Leftover:
    """The strongest line of a channel's spectrum, over all its records together, each with its own phase.

    A noise of eight coefficients takes a line for a resonance of its own; one of one coefficient leaves it in sight.
    """
    blocks = [b for b in model.blocks if b.channel == channel]
    raw = [r for b, r in zip(model.blocks, judged.raw, strict=True) if b.channel == channel]
    period, width = float(np.median(np.diff(blocks[0].time))), 2 * max(len(b.time) for b in blocks)
    power = _periodogram([w for b, w in _by_block(model.blocks, white) if b.channel == channel], width)
    candidates = [(2.0 * float(np.max(power)), int(np.argmax(power)))]
    simple = learn_whitener(blocks, raw, 1).flat(blocks, raw)
    for k in np.argsort(_periodogram([w for _, w in _by_block(blocks, simple)], width))[::-1][:LINES]:
        at = 2.0 * np.pi * (k + 1) / (width * period)
        waves = [{id(b): np.c_[np.cos(at * b.time), np.sin(at * b.time)]} for b in blocks]
        candidates.append((sum(_relearned(model, judged, channel, w) for w in waves), int(k)))
    gain, k = max(candidates)
    p = float(-np.expm1(0.25 * width * np.log1p(-min(chi2.sf(gain, 2 * len(blocks)), 1.0 - 1e-12))))
    return Leftover(channel, "frequency", "Hz", gain, 2 * len(blocks), p, ((k + 1) / (width * period),))


def _by_block(blocks: Sequence[Block], flat: np.ndarray) -> list[tuple[Block, np.ndarray]]:
    edges = pairwise(np.cumsum([0, *(len(b.time) for b in blocks)]))
    return [(b, flat[first:last]) for b, (first, last) in zip(blocks, edges, strict=True)]


def _periodogram(series: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Sum over whitened series, without the ends; 1 each for white noise."""
    return sum(np.abs(np.fft.rfft(w, width))[1:-1] ** 2 / max(float(np.sum(w != 0.0)), 1.0) for w in series)


def _over_noise(blocks: Sequence[Block], judged: Judged, stated: dict[str, float]) -> float:
    worst = 1.0
    for channel, std in stated.items():
        own = [r[b.good] for r, b in zip(judged.raw, blocks, strict=True) if b.channel == channel]
        if own:
            step = _step(np.concatenate([b.measured[b.good] for b in blocks if b.channel == channel]))
            worst = max(worst, float(np.sqrt(np.mean(np.concatenate(own) ** 2) / (std**2 + step**2 / 12.0))))
    return worst


def _step(values: np.ndarray) -> float:
    """Quantisation step: the least difference between values, where there are few of them."""
    levels = np.unique(values)
    return float(np.min(np.diff(levels))) if 1 < len(levels) < 0.5 * len(values) else 0.0
