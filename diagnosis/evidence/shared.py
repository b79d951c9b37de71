"""What the residual's spectra show of channels together: whether they know of each other.

Of all that can be asked of a residual coherence asks least of the noise: of independent sensors the squared coherence c
over n frequencies has the density (n - 1)(1 - c)^(n - 2), whatever the colours are (Brockwell, Davis, Time Series,
1991, sec. 11.6), and of sensors with the coherence g

    (n - 1)(1 - g)^n (1 - c)^(n - 2) F(n, n; 1; g c)

(Carter, Proc. IEEE 75 (1987) 236). With all g alike beforehand the ratio of the two evidences is

    F(n, n; n + 2; c) / (n + 1) = (1 - c)^(2 - n) F(2, 2; n + 2; c) / (n + 1),    F: Gauss' hypergeometric function
"""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy.special import hyp2f1, logsumexp

from cable_envs.diagnosis.model.leftover import ALL, Leftover
from cable_envs.diagnosis.model.model import Block

OCTAVES = tuple((2**k + 1, 2 ** (k + 1) + 1) for k in range(3, 9))
"""Of frequencies, in inverse lengths of a record, over which the coherence of two channels is taken."""
_HANN = 35 / 18
"""Frequencies that a Hann window makes one: neighbours know of each other by 2/3, the next by 1/6, and the variance of
a mean grows by 1 + 2 (4/9 + 1/36). With 1.5, the window's noise bandwidth, a third of recordings that had no mismatch
had p < 0.05."""
_RARE = 64
EVERYWHERE = "all frequencies"
LOUD = 2.0
"""Times the median of an octave's amplitudes beyond which one counts for no more: a line is one frequency, not many."""


def by_block(blocks: Sequence[Block], flat: np.ndarray) -> list[tuple[Block, np.ndarray]]:
    """What stands one below the other, block by block."""
    edges = pairwise(np.cumsum([0, *(len(b.time) for b in blocks)]))
    return [(b, flat[first:last]) for b, (first, last) in zip(blocks, edges, strict=True)]


def bayes_bound(p: float) -> float:
    """Logarithm of the most that a p-value may speak for anything else (Sellke et al., Am. Stat. 55 (2001) 62).

    The bound is 1 / (-e p ln p); from p = 1/e on there is none, and 0 is given.
    """
    p = max(p, 1e-300)
    return float(-1.0 - np.log(p) - np.log(-np.log(p))) if p < np.exp(-1.0) else 0.0


def coherence_evidence(coherence: float, count: float) -> float:
    """Logarithm of the module's ratio, for a squared coherence over ``count`` frequencies."""
    c = min(max(coherence, 0.0), 1.0 - 1e-15)
    return float(np.log(hyp2f1(2.0, 2.0, count + 2.0, c)) - (count - 2.0) * np.log1p(-c) - np.log(count + 1.0))


def coherences(blocks: Sequence[Block], white: np.ndarray) -> list[Leftover]:
    """What is left in two channels with sensors of their own, octave by octave and over all octaves.

    Parameters
    ----------
    blocks : sequence of Block
        Of all records.
    white : ndarray
        Whitened residuals, one below the other; a spectrum that falls within an octave counts for less.
    """
    waves: dict[tuple[str, str], np.ndarray] = {}
    sensors = {b.channel: b.sensor for b in blocks if b.sensor}
    for block, left in by_block(blocks, white):
        left = _used(left)
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
            found.append(_together(f"{a} and {b}", own))
    pairs = [leftover for leftover in found if leftover.coordinate == EVERYWHERE]
    return [*found, _together(ALL, pairs)] if len(pairs) > 1 else found


def any_of(kinds: Sequence[Leftover]) -> float:
    """Log odds that one of several is there, each as likely as the others beforehand; minus infinity of none."""
    if not kinds:
        return -np.inf
    return float(logsumexp([k.log_odds for k in kinds]) - np.log(len(kinds)))


def _shared(name: str, both, octave: tuple[int, int], period: float) -> Leftover | None:
    low, high = octave
    parts = [(x[low:high], y[low:high]) for x, y in both if min(len(x), len(y)) > high]
    count = sum(len(x) for x, _ in parts) / _HANN
    if count < 4:
        return None
    x, y = (_without_lines(np.concatenate(side)) for side in zip(*parts, strict=True))
    powers = float(np.vdot(x, x).real * np.vdot(y, y).real)
    shared = min(abs(np.vdot(x, y)) ** 2 / powers, 1.0 - 1e-15) if powers > 0.0 else 0.0
    size = -(count - 1.0) * float(np.log1p(-shared))
    at = (0.5 * (low + high) / (period * 2 * max(len(x) - 1 for x, _ in both)),)
    return Leftover(name, "frequency", "Hz", coherence_evidence(shared, count), size, at=at)


def _used(left: np.ndarray) -> np.ndarray:
    """A series without the samples at either end that do not count, which are 0."""
    inside = np.flatnonzero(left)
    return left[inside[0] : inside[-1] + 1] if len(inside) else left[:0]


def _without_lines(waves: np.ndarray) -> np.ndarray:
    """Amplitudes of an octave of which none is more than `LOUD` times their median."""
    sizes = np.abs(waves)
    return waves * np.minimum(1.0, LOUD * np.median(sizes) / np.maximum(sizes, 1e-300))


def _together(channel: str, parts: Sequence[Leftover]) -> Leftover:
    """Independent ones as one."""
    return Leftover(channel, EVERYWHERE, "", sum(p.log_odds for p in parts), sum(p.size for p in parts))
