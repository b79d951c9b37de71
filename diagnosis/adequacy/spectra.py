"""Whether what a model leaves has a line in its spectrum, and whether channels know of each other.

Of all tests coherence is the one that asks least of the noise: under independence the squared coherence over n
frequencies has the tail (1 - c)^(n - 1), whatever the colours are (Brockwell, Davis, Time Series, 1991, sec. 11.6).
"""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import chi2, f

from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.model.leftover import ALL, Leftover
from cable_envs.diagnosis.model.model import Block, learn_whitener

ABOUT = 48
"""Values of a spectrum, twice as fine as its resolution, to either side, whose median a line is held against."""
OCTAVES = tuple((2**k + 1, 2 ** (k + 1) + 1) for k in range(3, 9))
"""Of frequencies, in inverse lengths of a record, over which the coherence of two channels is taken."""
_HANN = 35 / 18
"""Frequencies that a Hann window makes one: neighbours know of each other by 2/3, the next by 1/6, and the variance of
a mean grows by 1 + 2 (4/9 + 1/36). With 1.5, the window's noise bandwidth, a third of recordings that had no mismatch
had p < 0.05."""
_RARE = 64


def lines(blocks: Sequence[Block], judged: Judged, white: np.ndarray) -> list[Leftover]:
    """The strongest line of every channel's spectrum (Fisher's test). ``white``: whitened residuals, one after another.

    A noise of eight coefficients takes a line for a resonance of its own; one of one coefficient leaves it in sight.
    Under that a line is held against the spectrum about it, whatever the colour.
    """
    return [_line(blocks, judged, white, channel) for channel in dict.fromkeys(b.channel for b in blocks)]


def _line(all_blocks, judged, white, channel) -> Leftover:
    """Over all the channel's records together, each with its own phase."""
    blocks = [b for b in all_blocks if b.channel == channel]
    raw = [r for b, r in zip(all_blocks, judged.raw, strict=True) if b.channel == channel]
    period, width = float(np.median(np.diff(blocks[0].time))), 2 * max(len(b.time) for b in blocks)
    count = 2 * len(blocks)
    power = 2.0 * _periodogram([w for b, w in by_block(all_blocks, white) if b.channel == channel], width)
    k = int(np.argmax(power))
    found = [(_of_many(float(chi2.sf(power[k], count)), width), float(power[k]), k)]
    simple = learn_whitener(blocks, raw, 1).flat(blocks, raw)
    power = 2.0 * _periodogram([w for _, w in by_block(blocks, simple)], width)
    if len(power) > 4 * ABOUT:
        power *= chi2.median(count) / np.maximum(median_filter(power, 2 * ABOUT + 1, mode="reflect"), 1e-300)
        k = ABOUT + int(np.argmax(power[ABOUT:]))  # below, a colour's slope is steep
        found.append((_of_many(float(f.sf(power[k] / count, count, 0.5 * ABOUT * count)), width), float(power[k]), k))
    p, gain, k = min(found)
    return Leftover(channel, "frequency", "Hz", gain, count, p, ((k + 1) / (width * period),))


def _of_many(p: float, width: int) -> float:
    """Of the largest of a periodogram's values, of which a quarter of ``width`` are independent."""
    return float(-np.expm1(0.25 * width * np.log1p(-min(p, 1.0 - 1e-12))))


def by_block(blocks: Sequence[Block], flat: np.ndarray) -> list[tuple[Block, np.ndarray]]:
    """What stands one below the other, block by block."""
    edges = pairwise(np.cumsum([0, *(len(b.time) for b in blocks)]))
    return [(b, flat[first:last]) for b, (first, last) in zip(blocks, edges, strict=True)]


def _periodogram(series: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Sum over whitened series, without the ends; 1 each for white noise."""
    parts = (np.abs(np.fft.rfft(w, width))[1:-1] ** 2 / max(float(np.sum(w != 0.0)), 1.0) for w in series)
    return sum(parts, np.zeros(()))


def coherences(blocks: Sequence[Block], white: np.ndarray) -> list[Leftover]:
    """What is left in two channels with sensors of their own, octave by octave and over all octaves.

    ``white``: whitened residuals, one after another; a spectrum that falls within an octave counts for less.
    """
    waves: dict[tuple[str, str], np.ndarray] = {}
    sensors = {b.channel: b.sensor for b in blocks if b.sensor}
    for block, left in by_block(blocks, white):
        seen = left != 0.0
        if block.channel in sensors and int(seen.sum()) > _RARE:
            centred = np.where(seen, left - np.mean(left[seen]), 0.0)
            waves[block.channel, block.record] = np.fft.rfft(centred * np.hanning(len(centred) + 2)[1:-1])
    channels, records = (list(dict.fromkeys(key[k] for key in waves)) for k in (0, 1))
    period = float(np.median(np.diff(blocks[0].time)))
    found: list[Leftover] = []
    for a, b in combinations(channels, 2):
        if sensors[a] == sensors[b]:
            continue
        both = [(waves[a, r], waves[b, r]) for r in records if (a, r) in waves and (b, r) in waves]
        tested = (_shared(f"{a} and {b}", both, octave, period) for octave in OCTAVES)
        own = [leftover for leftover in tested if leftover is not None]
        found += own
        if len(own) > 1:
            found.append(summed(f"{a} and {b}", "all frequencies", own))
    pairs = [leftover for leftover in found if leftover.coordinate == "all frequencies"]
    return [*found, summed(ALL, "all frequencies", pairs)] if len(pairs) > 1 else found


def _shared(name: str, both, octave: tuple[int, int], period: float) -> Leftover | None:
    low, high = octave
    parts = [(x[low:high], y[low:high]) for x, y in both if min(len(x), len(y)) > high]
    count = sum(len(x) for x, _ in parts) / _HANN
    if count < 4:
        return None
    x, y = (np.concatenate(side) for side in zip(*parts, strict=True))
    powers = float(np.vdot(x, x).real * np.vdot(y, y).real)
    shared = min(abs(np.vdot(x, y)) ** 2 / powers, 1.0 - 1e-15) if powers > 0.0 else 0.0
    gain = -2.0 * (count - 1.0) * float(np.log1p(-shared))
    at = (0.5 * (low + high) / (period * 2 * max(len(x) - 1 for x, _ in both)),)
    return Leftover(name, "frequency", "Hz", gain, 2, float(np.exp(-0.5 * gain)), at)


def summed(channel: str, coordinate: str, parts: Sequence[Leftover], unit: str = "") -> Leftover:
    """Independent tests as one."""
    gain, functions = sum(p.gain for p in parts), sum(p.functions for p in parts)
    return Leftover(channel, coordinate, unit, gain, functions, float(chi2.sf(gain, functions)))
