"""Smooth functions of what a mismatch may follow, regressed on what a model leaves.

Along each coordinate of a channel (speed, position, tension, time since reversal, ...) bumps, the same with the sign of
the direction; slow waves of the elapsed time, and those times the channel itself, the speed and the direction: a gain,
a drag, a friction that drifts. They are filtered as the residual is, freed of what the parameters can still absorb, and
regressed on. Under the right model the fall of the sum of squares is chi-square with as many degrees as functions.
A mismatch shows in several channels at once: channels whose noises know nothing of each other are taken together, too,
along each coordinate, and at each single place of it (what a tooth, a pawl or a stop does).

A mismatch that lasts is colour to a noise that is learnt from it: a bias an endless memory, a vibration a resonance.
So the functions are taken out of the residual, the noise is learnt again from what is left, and the fall of the
deviance (`cable_envs.diagnosis.fit.likelihood`) is what counts.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.signal import correlate
from scipy.stats import chi2

from cable_envs.diagnosis.adequacy.spectra import by_block
from cable_envs.diagnosis.fit.likelihood import Judged, deviance
from cable_envs.diagnosis.fit.score_tests import basis
from cable_envs.diagnosis.model.features import DRIFTS, FINE, HATS, SHARP, SLOW, hats, places, waves
from cable_envs.diagnosis.model.leftover import ALL, Leftover
from cable_envs.diagnosis.model.model import Block, Whitener, learn_whitener

SHIFTED, SHIFTS = 1e-3, 20
"""p-value below which functions are also held against the residual at other times, and how often."""
APART, LAGS = 0.2, 64
"""Correlation of two channels' whitened residuals, at any of so many lags, from which their noises count as one."""
_NOT_MAPPED = ("direction",)

Columns = Mapping[int, np.ndarray]
"""id of a block -> functions [T, n]; a block that is not there has none."""


class Regression:
    """What a refit leaves, ready for functions to be regressed on it; each [N] or [N, n] of all blocks together."""

    def __init__(self, blocks: Sequence[Block], judged: Judged):
        self.blocks, self.raw, self._whitener = blocks, judged.raw, judged.whitener
        self._span = basis(judged.fit.jacobian)
        self.white = self._freed(self._whitener.flat(blocks, judged.raw))
        ends = np.cumsum([0, *(len(b.time) for b in blocks)])
        self._rows = [slice(*pair) for pair in pairwise(ends)]
        self.channels = list(dict.fromkeys(b.channel for b in blocks))

    def of(self, channel: str) -> list[tuple[Block, np.ndarray]]:
        """Blocks of a channel, and what is left in each [T]."""
        return [(b, r) for b, r in zip(self.blocks, self.raw, strict=True) if b.channel == channel]

    def filtered(self, columns: Columns) -> np.ndarray:
        """Functions as the residual is: whitened, and freed of what the parameters absorb [N, n]."""
        count = next(iter(columns.values())).shape[1]
        white = np.zeros((len(self.white), count))
        for block, rows in zip(self.blocks, self._rows, strict=True):
            if id(block) in columns:
                white[rows] = self._whitener.flat([block], [columns[id(block)]])
        return self._freed(white)

    def chance(self, columns: Columns) -> float:
        """Fall of the whitened sum of squares by the functions, the noise being what it is."""
        functions = self.filtered(columns)
        sizes, turns = np.linalg.eigh(functions.T @ functions)
        sound = sizes > 1e-12 * max(float(sizes[-1]), 1e-300)
        parts = turns[:, sound].T @ (functions.T @ self.white)
        return float(np.sum(parts**2 / sizes[sound]))

    def fall(self, channel: str, columns: Columns) -> float:
        """Of the channel's deviance when the functions are taken out and the noise is learnt from what is left."""
        blocks, raw = [block for block, _ in self.of(channel)], [left for _, left in self.of(channel)]
        series = _of_blocks(blocks, columns)
        noise = Whitener({channel: self._whitener.noise[channel]})
        before = deviance(blocks, learn_whitener(blocks, raw))
        for _ in range(2):
            amount = np.linalg.lstsq(noise.flat(blocks, series), noise.flat(blocks, raw), rcond=1e-6)[0]
            noise = learn_whitener(blocks, [r - c @ amount for r, c in zip(raw, series, strict=True)])
        return max(before - deviance(blocks, noise), 0.0)

    def learnt(self, channel: str) -> bool:
        """Whether the channel's noise has a colour, learnt from the residual."""
        return self._whitener.noise[channel].numbers > 0

    @cached_property
    def apart(self) -> list[str]:
        """Channels whose noises know nothing of each other."""
        found: list[str] = []
        for channel in self.channels:
            if all(self._correlation(channel, other) < APART for other in found):
                found.append(channel)
        return found

    def _correlation(self, one: str, other: str) -> float:
        parts = by_block(self.blocks, self.white)
        mine, theirs = ({b.record: w for b, w in parts if b.channel == channel} for channel in (one, other))
        total = np.zeros(2 * LAGS + 1)
        for record in mine.keys() & theirs.keys():
            a, b = mine[record], theirs[record]
            if min(len(a), len(b)) > LAGS and len(a) == len(b):
                total += correlate(a, b, method="fft")[len(a) - 1 - LAGS : len(a) + LAGS]
        size = np.sqrt(sum(float(w @ w) for w in mine.values()) * sum(float(w @ w) for w in theirs.values()))
        return float(np.max(np.abs(total)) / max(size, 1e-300))

    def _freed(self, flat: np.ndarray) -> np.ndarray:
        return flat - self._span @ (self._span.T @ flat)


@dataclass
class _Family:
    """Functions of one channel, with what they gain."""

    regression: Regression
    channel: str
    name: str
    unit: str
    columns: Columns
    at: np.ndarray
    group: str = ""
    """name under which channels (and records) are taken together"""

    @cached_property
    def _parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return _decomposed(self.regression.filtered(self.columns))

    @property
    def rank(self) -> int:
        return len(self._parts[1])

    @cached_property
    def gain(self) -> float:
        return self.regression.fall(self.channel, self.columns) if self.rank else 0.0

    @cached_property
    def calibrated_gain(self) -> float:
        """The gain over how much more than their number the same functions gain at other times, by chance.

        A learnt colour is never quite the noise's: slow functions find more in 1/f noise than chi-square allows.
        """
        if not self.rank or not self.regression.learnt(self.channel):
            return self.gain
        rng, gains = np.random.default_rng(0), []
        for share in rng.uniform(0.1, 0.9, SHIFTS):
            turned = {key: np.roll(c, int(share * len(c)), axis=0) for key, c in self.columns.items()}
            gains.append(self.regression.chance(turned))
        return self.gain / max(float(np.mean(gains)) / self.rank, 1.0)

    def leftover(self) -> Leftover:
        if not self.rank:
            return Leftover(self.channel, self.name, self.unit, 0.0, 0, 1.0)
        p = float(chi2.sf(self.gain, self.rank))
        gain = self.gain if p >= SHIFTED else self.calibrated_gain
        height, error = (), ()
        if len(self.at):
            u, s, vt = self._parts
            inverse = vt.T / s
            height = tuple(inverse @ (u.T @ self.regression.white))
            error = tuple(np.sqrt(np.sum(inverse**2, axis=1)))
        p = float(chi2.sf(gain, self.rank))
        return Leftover(self.channel, self.name, self.unit, gain, self.rank, p, tuple(self.at), height, error)


def regressed(regression: Regression) -> list[Leftover]:
    """Every family of functions in every channel; channels together along each coordinate, and at single places."""
    families = [family for channel in regression.channels for family in _families(regression, channel)]
    found = [family.leftover() for family in families]
    for group in dict.fromkeys(f.group for f in families):
        own = [f for f in families if f.group == group and f.channel in regression.apart and f.rank]
        if len(own) > 1:
            found.append(_together(own, group))
    return found + _at_one_place(regression)


def _together(families: Sequence[_Family], name: str, among: int = 1) -> Leftover:
    """Families of channels apart, as one test; ``among``: of how many it is the best."""
    functions = sum(f.rank for f in families)
    gain = sum(f.gain for f in families)
    if among * chi2.sf(gain, functions) < SHIFTED:
        gain = sum(f.calibrated_gain for f in families)
    p = min(among * float(chi2.sf(gain, functions)), 1.0)
    at = tuple(families[0].at) if among > 1 else ()
    return Leftover(ALL, name, families[0].unit, gain, functions, p, at)


def _families(regression: Regression, channel: str) -> Iterator[_Family]:
    own = regression.of(channel)

    def family(name: str, unit: str, columns: Columns, at: np.ndarray | tuple = (), group: str = "") -> _Family:
        return _Family(regression, channel, name, unit, columns, np.asarray(at), group or name)

    slow = {id(b): waves(b, SLOW) for b, _ in own}
    for block, _ in own:  # a family of its own for each record
        name = "elapsed time" if len(own) == 1 else f"elapsed time of {block.record}"
        yield family(name, "s", {id(block): slow[id(block)]}, group="elapsed time")
    for name, unit, values in _drifting(own):
        yield family(name, unit, _drifts(own, values, slow))
    sides = _along(own, "direction")
    for c in own[0][0].along:
        if c.name in _NOT_MAPPED:
            continue
        values = {id(b): _without_noise(b, r, c.name) for b, r in own}
        together = np.concatenate([values[id(b)][b.good] for b, _ in own])
        for count in (HATS, FINE) if c.name == SHARP else (HATS,):
            at = places(together, count)
            if len(at) < 3:
                continue
            columns = {key: hats(v, at) for key, v in values.items()}
            fine = " (fine)" if count == FINE else ""
            yield family(c.name, c.unit, columns, at, c.name + fine)
            if c.name != "speed" and sides:
                turned = {key: b * sides[key][:, None] for key, b in columns.items()}
                yield family(f"{c.name} with direction", c.unit, turned, at, f"{c.name} with direction{fine}")


def _along(own: Sequence[tuple[Block, np.ndarray]], name: str) -> dict[int, np.ndarray]:
    """A coordinate of every block; empty where one has none."""
    found = {id(b): c.values for b, _ in own for c in reversed(b.along) if c.name == name}
    return found if len(found) == len({id(b) for b, _ in own}) else {}


def _drifting(own: Sequence[tuple[Block, np.ndarray]]) -> Iterator[tuple[str, str, dict[int, np.ndarray]]]:
    """(name, unit, values by block) of what may drift: the channel's scale, what goes with the speed, the friction."""
    yield "own scale with elapsed time", "s", {id(b): b.measured - r for b, r in own}
    for name in ("speed", "direction"):
        values = _along(own, name)
        if values:
            yield f"{name} with elapsed time", "s", values


def _drifts(own, values: Mapping[int, np.ndarray], slow: Mapping[int, np.ndarray]) -> Columns:
    """`DRIFTS` waves of each record times the values about their mean; a record's are its own."""
    found = {}
    for k, (block, _) in enumerate(own):
        key = id(block)
        centred = values[key] - np.mean(values[key][block.good]) if block.good.any() else values[key]
        columns = np.zeros((len(block.time), DRIFTS * len(own)))
        columns[:, DRIFTS * k : DRIFTS * (k + 1)] = centred[:, None] * slow[key][:, :DRIFTS]
        found[key] = columns
    return found


def _at_one_place(regression: Regression) -> list[Leftover]:
    """The one place of the position, passed one way or both ways, where most is left in all channels together."""
    channels = [c for c in regression.apart if _along(regression.of(c), SHARP)]
    if not channels:
        return []
    first = regression.of(channels[0])
    unit = next(c.unit for c in first[0][0].along if c.name == SHARP)
    at = places(np.concatenate([_along(first, SHARP)[id(b)][b.good] for b, _ in first]), FINE)
    if len(at) < 3:
        return []
    bumps: dict[str, Columns] = {}
    seen = np.zeros(())
    for channel in channels:
        bumps[channel] = _one_way_or_both(regression.of(channel), at)
        functions = regression.filtered(bumps[channel])
        size = np.sum(functions**2, axis=0)
        parts = functions.T @ regression.white
        seen = seen + np.where(size > 1e-12 * np.max(size, initial=1e-300), parts**2 / np.maximum(size, 1e-300), 0.0)
    k, among = int(np.argmax(seen)), len(seen)
    best = [
        _Family(regression, c, SHARP, unit, {key: b[:, [k]] for key, b in bumps[c].items()}, at[[k % len(at)]])
        for c in channels
    ]
    best = [family for family in best if family.rank]
    return [_together(best, f"one place of the {SHARP}", among)] if best else []


def _one_way_or_both(own: Sequence[tuple[Block, np.ndarray]], at: np.ndarray) -> Columns:
    """Bumps at the places, those on the way up only, and down only, where there is a direction."""
    found, sides = {}, _along(own, "direction")
    for block, left in own:
        bumps = hats(_without_noise(block, left, SHARP), at)
        ways = [(sides[id(block)] > 0)[:, None], (sides[id(block)] < 0)[:, None]] if sides else []
        found[id(block)] = np.concatenate([bumps, *(bumps * way for way in ways)], axis=1)
    return found


def _without_noise(block: Block, left: np.ndarray, coordinate: str) -> np.ndarray:
    """Values [T] of a coordinate; those that are the channel's own as predicted: else its noise were on both sides."""
    found = next(c for c in block.along if c.name == coordinate)
    return block.measured - left if found.channel == block.channel else found.values


def _of_blocks(blocks: Sequence[Block], columns: Columns) -> list[np.ndarray]:
    """Functions [T, n] of every block; zeros where a family has none."""
    count = next(iter(columns.values())).shape[1]
    return [columns.get(id(b), np.zeros((len(b.time), count))) for b in blocks]


def _decomposed(functions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Their singular values and vectors, without those that are none."""
    u, s, vt = np.linalg.svd(functions, full_matrices=False)
    sound = s > 1e-6 * max(float(s.max(initial=0.0)), 1e-300)
    return u[:, sound], s[sound], vt[sound]
