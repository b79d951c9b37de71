"""Whether what a model leaves is noise: no hypothesis is asked, only smooth functions of what a mismatch may follow.

For every channel, bumps along each coordinate of its blocks (speed, position, tension, time since reversal, ...), the
same with the sign of the direction, and slow waves of the elapsed time are filtered as the residual is, freed of what
the parameters can still absorb, and regressed on. Under the right model the fall of the sum of squares is chi-square
with as many degrees as functions. A single line of the spectrum is looked for beside it (Fisher's test), and whether
channels know of each other.

A mismatch that lasts is colour to a noise that is learnt from it: a bias an endless memory, a vibration a resonance.
So the functions are taken out of the residual, the noise is learnt again from what is left, and the fall of the
deviance (`diagnosis.likelihood`) is what counts.

Where the recording states its noise, what is left is also held against that: the only test that sees white physics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import chi2, f

from diagnosis.likelihood import Judged, deviance
from diagnosis.model import Block, Model, Whitener, learn_whitener
from diagnosis.screen import basis

BUMPS = 7
"""Along each coordinate, over quantiles of its values."""
FINE, _SHARP = 28, ("position",)
"""The same for what a tooth or a stop may make uneven within a few per cent of the range."""
SLOW = 6
"""Waves of the elapsed time, per record: half a period over the record, a whole one, ..."""
SHIFTED, SHIFTS = 1e-3, 20
"""p-value below which functions are also held against the residual at other times, and how often."""
SURE = 1e-3
"""Familywise p-value below which something is left."""
_NOT_MAPPED = ("direction",)
_APART = 1e-3
"""Share of a coordinate's range below which two of its values are one: at rest a prediction differs by rounding, and
that rounding follows what was measured."""
_OWN = 0.5
"""Correlation of a coordinate with the channel itself from which it is taken for it."""
ABOUT = 48
"""Values of a spectrum, twice as fine as its resolution, to either side, whose median a line is held against."""
OCTAVES = tuple((2**k + 1, 2 ** (k + 1) + 1) for k in range(3, 9))
"""Of frequencies, in inverse lengths of a record, over which the coherence of two channels is taken."""
_HANN = 1.5
"""Frequencies that a Hann window makes one."""
_RARE = 64


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
    found += _together(model, judged)
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
        together = np.concatenate([values[id(b)][b.good] for b in own])
        for count in (BUMPS, FINE) if name in _SHARP else (BUMPS,):
            at = _places(together, count)
            if len(at) < 3:
                continue
            columns = {key: _bumps(v, at) for key, v in values.items()}
            yield name, unit, columns, at
            if name != "speed" and all(s is not None for s in sides.values()):
                turned = {key: c * sides[key][:, None] for key, c in columns.items()}
                yield f"{name} with direction", unit, turned, at


def _without_noise(block: Block, values: np.ndarray, left: np.ndarray) -> np.ndarray:
    """A coordinate that is the channel itself has its noise: as predicted, else that would be on both sides."""
    use = block.good
    if np.ptp(values[use]) == 0.0 or np.corrcoef(values[use], block.measured[use])[0, 1] < _OWN:
        return values
    return block.measured - left


def _places(values: np.ndarray, count: int) -> np.ndarray:
    if not len(values) or np.ptp(values) == 0.0:
        return np.empty(0)
    found = np.quantile(values, np.linspace(0.02, 0.98, count))
    return found[np.r_[True, np.diff(found) > _APART * (found[-1] - found[0])]]


def _bumps(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Hats: straight lines between the places, constant beyond [T, places]."""
    return np.stack([np.interp(values, at, row) for row in np.eye(len(at))], axis=1)


def _regressed(model, judged, span, white, channel, named, columns, at) -> Leftover:
    functions = judged.whitener.flat(model.blocks, _of_blocks(model.blocks, columns))
    functions = functions - span @ (span.T @ functions)
    u, s, vt = np.linalg.svd(functions, full_matrices=False)
    sound = s > 1e-6 * max(float(s[0]), 1e-300) if len(s) else np.zeros(0, dtype=bool)
    rank = int(np.sum(sound))
    if rank == 0:
        return Leftover(channel, *named, 0.0, 0, 1.0)
    parts = u[:, sound].T @ white
    gain = max(_relearned(model, judged, channel, columns), 0.0)
    p = float(chi2.sf(gain, rank))
    if p < SHIFTED and judged.whitener.noise[channel].numbers:
        p = float(chi2.sf(gain / _inflated(model, judged, span, white, columns, rank), rank))
    height, error = (), ()
    if len(at):
        inverse = vt[sound].T / s[sound]
        height, error = tuple(inverse @ parts), tuple(np.sqrt(np.sum(inverse**2, axis=1)))
    return Leftover(channel, *named, gain, rank, p, tuple(at), height, error)


def _inflated(model, judged, span, white, columns, rank: int) -> float:
    """How much more than its degrees of freedom the same functions gain at other times, where they mean nothing.

    A learnt colour is never quite the noise's: slow functions find more in 1/f noise than chi-square allows.
    """
    rng, gains = np.random.default_rng(0), []
    for share in rng.uniform(0.1, 0.9, SHIFTS):
        turned = {key: np.roll(c, int(share * len(c)), axis=0) for key, c in columns.items()}
        functions = judged.whitener.flat(model.blocks, _of_blocks(model.blocks, turned))
        functions = functions - span @ (span.T @ functions)
        u, s, _ = np.linalg.svd(functions, full_matrices=False)
        parts = u[:, s > 1e-6 * max(float(s[0]), 1e-300)].T @ white
        gains.append(float(parts @ parts))
    return max(float(np.mean(gains)) / rank, 1.0)


def _of_blocks(blocks: Sequence[Block], columns) -> list[np.ndarray]:
    """Functions [T, n] of every block; zeros where a family has none."""
    count = next(iter(columns.values())).shape[1]
    return [columns.get(id(b), np.zeros((len(b.time), count))) for b in blocks]


def _relearned(model, judged, channel: str, columns) -> float:
    """Fall of the channel's deviance when the functions are taken out and the noise is learnt from what is left."""
    own = [(b, r) for b, r in zip(model.blocks, judged.raw, strict=True) if b.channel == channel]
    blocks, raw = [b for b, _ in own], [r for _, r in own]
    series = _of_blocks(blocks, columns)
    noise = Whitener({channel: judged.whitener.noise[channel]})
    before = deviance(blocks, learn_whitener(blocks, raw))
    for _ in range(2):
        amount = np.linalg.lstsq(noise.flat(blocks, series), noise.flat(blocks, raw), rcond=1e-6)[0]
        noise = learn_whitener(blocks, [r - c @ amount for r, c in zip(raw, series, strict=True)])
    return before - deviance(blocks, noise)


def _line(model, judged, white, channel) -> Leftover:
    """The strongest line of a channel's spectrum, over all its records together, each with its own phase.

    A noise of eight coefficients takes a line for a resonance of its own; one of one coefficient leaves it in sight.
    Under that a line is held against the spectrum about it, whatever the colour.
    """
    blocks = [b for b in model.blocks if b.channel == channel]
    raw = [r for b, r in zip(model.blocks, judged.raw, strict=True) if b.channel == channel]
    period, width = float(np.median(np.diff(blocks[0].time))), 2 * max(len(b.time) for b in blocks)
    count = 2 * len(blocks)
    power = 2.0 * _periodogram([w for b, w in _by_block(model.blocks, white) if b.channel == channel], width)
    k = int(np.argmax(power))
    found = [(_of_many(float(chi2.sf(power[k], count)), width), float(power[k]), k)]
    simple = learn_whitener(blocks, raw, 1).flat(blocks, raw)
    power = 2.0 * _periodogram([w for _, w in _by_block(blocks, simple)], width)
    if len(power) > 4 * ABOUT:
        power *= chi2.median(count) / np.maximum(median_filter(power, 2 * ABOUT + 1, mode="reflect"), 1e-300)
        k = ABOUT + int(np.argmax(power[ABOUT:]))  # below, a colour's slope is steep
        found.append((_of_many(float(f.sf(power[k] / count, count, 0.5 * ABOUT * count)), width), float(power[k]), k))
    p, gain, k = min(found)
    return Leftover(channel, "frequency", "Hz", gain, count, p, ((k + 1) / (width * period),))


def _of_many(p: float, width: int) -> float:
    """Of the largest of a periodogram's values, of which a quarter of ``width`` are independent."""
    return float(-np.expm1(0.25 * width * np.log1p(-min(p, 1.0 - 1e-12))))


def _together(model: Model, judged: Judged) -> list[Leftover]:
    """Coherence of what is left in two channels, octave by octave: sensors' noises know nothing of each other.

    Of all tests the one that needs no noise to be known: under independence the squared coherence over n frequencies
    has the tail (1 - c)^(n - 1), whatever the colours are (Brockwell, Davis, Time Series, 1991, sec. 11.6).
    """
    waves: dict[tuple[str, str], np.ndarray] = {}
    sensors = {b.channel: b.sensor for b in model.blocks if b.sensor}
    for block, left in zip(model.blocks, judged.raw, strict=True):
        if block.channel in sensors and int(block.good.sum()) > _RARE:
            centred = np.where(block.good, left - np.mean(left[block.good]), 0.0)
            waves[block.channel, block.record] = np.fft.rfft(centred * np.hanning(len(centred) + 2)[1:-1])
    channels, records = (list(dict.fromkeys(key[k] for key in waves)) for k in (0, 1))
    period = float(np.median(np.diff(model.blocks[0].time)))
    found = []
    for a, b in combinations(channels, 2):
        if sensors[a] == sensors[b]:
            continue
        both = [(waves[a, r], waves[b, r]) for r in records if (a, r) in waves and (b, r) in waves]
        for low, high in OCTAVES:
            parts = [(x[low:high], y[low:high]) for x, y in both if min(len(x), len(y)) > high]
            count = sum(len(x) for x, _ in parts) / _HANN
            if count < 4:
                continue
            x, y = (np.concatenate(side) for side in zip(*parts, strict=True))
            powers = float(np.vdot(x, x).real * np.vdot(y, y).real)
            shared = min(abs(np.vdot(x, y)) ** 2 / powers, 1.0 - 1e-15) if powers > 0.0 else 0.0
            gain = -2.0 * (count - 1.0) * float(np.log1p(-shared))
            at = (0.5 * (low + high) / (period * 2 * max(len(x) - 1 for x, _ in both)),)
            found.append(Leftover(f"{a} and {b}", "frequency", "Hz", gain, 2, float(np.exp(-0.5 * gain)), at))
    return found


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
