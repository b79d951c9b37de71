"""What happens once in a record and in no rig: counts that are lost, offsets that jump, rows out of order, spikes.

A body with mass does not jump. Lines through the samples before and behind a row meet there but for noise and
curvature, which the rest of the record shows: a gap between them that is far beyond every other in the record was made
by the logger. Tails of gaps are taken to fall no slower than an exponential. Then the largest of n is about s ln n, it
is beyond the largest elsewhere by more than s ln(1/p) with a chance of p, and their ratio by more than
1 + ln(1/p) / ln(n) likewise.

Stick and slip, and an impact, are sudden too, but all of a rig feels them: what one channel alone shows, while every
other goes on as it does most of the time, was made by the logger.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import INPUTS, WORKS, Fault, Track, is_told, of_steps

CHANCE = 1e-6
"""Of a false alarm, a channel of a record."""
_SIDE = 6
"""Samples of the line on either side."""
_AROUND = 0.025
"""Of a record: gaps this close to the largest one belong to it (a block that was moved has two ends or three)."""
_TAIL = 0.02
"""Of the samples, whose lone steps show how the tail falls."""
_ROUNDING = 1e-9
"""Of the largest value: what a conversion of units leaves between values that were one."""
_SPLITS = 50
"""Places in a record where its unit may change."""
_CALM, _NEAR = 0.99, 2
"""Share of a channel's gaps up to which it goes on as usual, and samples about a jump of another in which it does."""
_FAR = 3.0
"""Times the step that 99 % of a position's steps stay below, at each seam of two blocks in each other's place."""
_SMOOTH = 1.5
"""The same where they are back in order: such a step is one of many."""
_SEAMS, _BLOCKS = 12, 0.1
"""Most seams that are tried, and share of a record that two blocks may have."""
_FACTOR = np.sqrt(9.81)
"""Half way, in logarithms, between the same unit and kilograms for newtons, the two units that are nearest."""


def jumps(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """The first jump of every channel that nothing else in its record is like. Of an effort it may be a load's."""
    for channel in recording.channels:
        if channel == "time" or told(channel):
            continue
        for track in tracks:
            values = track.even(channel)
            if channel in INPUTS and of_steps(values):
                continue
            sample = lone_jump(values)
            if sample is None or not _others_calm(track, channel, sample):
                continue
            place = channel.endswith(("position", "angle"))
            if place and abs(_step(values, sample)) <= np.max(np.abs(track.speed(channel))) * track.period:
                continue  # where it goes in one sample at its top speed
            text, fatal = _what(values, sample, place, channel in INPUTS)
            yield Fault(track.name, channel, track.row(sample), text, fatal)
            break


def lone_jump(values: np.ndarray) -> int | None:
    """First sample behind the jump of a channel [T], if it jumps once."""
    alone, values = lone_samples(values)[0], values.copy()
    values[alone] = 0.5 * (values[alone - 1] + values[alone + 1])
    gaps = _gaps(values)
    if len(gaps) < 100:
        return None
    sample, around = int(np.argmax(gaps)), int(_AROUND * len(values)) + 2 * _SIDE
    rest = np.r_[gaps[: max(sample - around, 0)], gaps[sample + around :]]
    least = 1.0 + np.log(1.0 / CHANCE) / np.log(len(gaps))
    if len(rest) < 100 or gaps[sample] <= least * float(np.max(rest)):
        return None
    return sample + _SIDE + 1


def _others_calm(track: Track, channel: str, sample: int) -> bool:
    """Whether there are other sensors, and they and what the rig is told go on as usual about a sample."""
    others = [n for n in track.channels if n not in (channel, "time")]
    for name in others:
        gaps = _gaps(track.even(name))
        at = sample - _SIDE - 1
        if np.max(gaps[max(at - _NEAR, 0) : at + _NEAR + 1]) > np.quantile(gaps, _CALM):
            return False
    return not all(is_told(name) for name in others)


def _step(values: np.ndarray, sample: int) -> float:
    """How far a channel [T] jumps before a sample."""
    return float(np.median(values[sample : sample + _SIDE]) - np.median(values[sample - _SIDE : sample]))


def _gaps(values: np.ndarray) -> np.ndarray:
    """Size of the gap before each sample but the first and last few, between lines through `_SIDE` samples.

    The least of three: with all samples, without the one before, without the one behind, so that one sample makes none.
    """
    middle = np.arange(_SIDE) - 0.5 * (_SIDE - 1)
    full, skipping = (1.0 / _SIDE + (middle[0] - at) * middle / float(middle @ middle) for at in (0.5, 1.5))
    windows = np.lib.stride_tricks.sliding_window_view(values - values[0], _SIDE)
    at = np.arange(_SIDE + 1, len(values) - _SIDE)
    before, behind = windows @ full[::-1], windows @ full
    every = np.array([
        behind[at] - before[at - _SIDE],
        behind[at] - (windows @ skipping[::-1])[at - _SIDE - 1],
        (windows @ skipping)[at + 1] - before[at - _SIDE],
    ])  # fmt: skip
    same = (np.sign(every) == np.sign(every[0])).all(axis=0)
    return np.where(same, np.min(np.abs(every), axis=0), 0.0)


def _what(values: np.ndarray, sample: int, place: bool, given: bool) -> tuple[str, bool]:
    """(what a jump is, in words, whether it cannot be used).

    place: of a position, which no load makes jump; given: of an input, which may have been asked to.
    """
    text = f"it jumps by {_step(values, sample):.3g} at once, and nothing else in the record is like it:"
    if place:
        return f"{text} counts were lost, or rows are not in their order; cut the record there into two", True
    other = "a step that was asked for" if given else "a load that changed"
    return f"{text} an offset that was set, or {other}; cut the record there where it was the offset", False


def out_of_order(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Two neighbouring blocks of rows in each other's place."""
    places = [n for n in recording.channels if n.endswith(("position", "angle")) and not is_told(n)]
    for track in tracks:
        found = exchanged([track.channels[name] for name in places])
        if found is not None:
            a, b, c = found
            text = (
                f"rows {a + 1} to {b} and rows {b + 1} to {c} are in each other's place: every position jumps at both "
                f"ends of either, and goes on smoothly in the other order"
            )
            yield Fault(track.name, places[0], a + 1, text)
            return


def exchanged(places: Sequence[np.ndarray]) -> tuple[int, int, int] | None:
    """Rows (a, b, c) so that the positions [T] are smooth with rows a to b - 1 behind b to c - 1; None without any."""
    steps = [np.abs(np.diff(values)) for values in places]
    usual = [float(np.quantile(step, _CALM)) for step in steps]
    moving = [(v, s, u) for v, s, u in zip(places, steps, usual, strict=True) if u > 0.0]
    if not moving:
        return None
    far = np.max([s / u for _, s, u in moving], axis=0)
    seams = np.sort(np.argsort(far)[-_SEAMS:] + 1)
    seams = seams[far[seams - 1] > _FAR]
    for a, b, c in combinations(seams.tolist(), 3):
        if c - a > _BLOCKS * len(places[0]):
            continue
        joined = ((a - 1, b), (c - 1, a), (b - 1, c))
        if all(abs(v[j] - v[i]) <= _SMOOTH * u for v, _, u in moving for i, j in joined):
            return a, b, c
    return None


def mixed_units(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Efforts whose size and whose noise change together by a factor, while the rig moves as before."""
    for channel, place in WORKS.items():
        if channel not in recording.channels or place not in recording.channels:
            continue
        for track in tracks:
            found = change_of_unit(track.even(channel), np.abs(np.gradient(track.even(place))))
            if found is not None:
                sample, factor = found
                text = f"from about here on its numbers and its noise are {factor:.3g} times what they were"
                fatal = channel not in INPUTS  # an amplifier may have been set anew
                yield Fault(track.name, channel, track.row(sample), f"{text}: one unit in a record", fatal)
                break


def change_of_unit(values: np.ndarray, speed: np.ndarray) -> tuple[int, float] | None:
    """(first sample of the other unit, its factor) of an effort [T] beside its size of speed [T]; None without one.

    A gain that depends on the motion, and a rig that stands still, change the noise too: both parts must move alike.
    """
    noise = np.abs(np.diff(values, 3))
    best = (0.0, 0, 1.0)
    for sample in range(len(values) // 10, len(values) - len(values) // 10, max(len(values) // _SPLITS, 1)):
        parts = slice(0, sample), slice(sample, None)
        before, behind = (
            (float(np.median(noise[p])), float(np.std(values[p])), float(np.mean(speed[p]))) for p in parts
        )
        if min(*before, *behind) <= 0.0:
            continue
        ratios = np.log(np.array(behind) / np.array(before))
        sizes = np.abs(ratios[:2]) * (ratios[0] * ratios[1] > 0.0)
        if np.min(sizes) > np.log(_FACTOR) and abs(ratios[2]) < np.log(2.0) and np.abs(ratios[0]) > best[0]:
            best = (float(np.abs(ratios[0])), sample, float(np.exp(ratios[0])))
    return (best[1], best[2]) if best[0] else None


def spikes(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Samples that stand out alone, by more than exponential tails of all that do allow."""
    for channel in recording.channels:
        if channel == "time" or told(channel):
            continue
        for track in tracks:
            rows, size = lone_samples(track.even(channel))
            # where a motion turns, a count may be there for one sample
            if len(rows) and size > _count(track.channels[channel]):
                text = (
                    f"{len(rows)} samples stand alone by up to {size:.3g}, while its neighbours are as before: spikes; "
                    f"mark them under 'quality'"
                )
                yield Fault(track.name, channel, track.row(int(rows[0])), text, False)
                break


def _count(values: np.ndarray) -> float:
    """What all steps between values [T] are multiples of, the least of them; 0 where they are not."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > _ROUNDING * np.max(np.abs(values))] if len(steps) else steps
    times = steps / np.min(steps) if len(steps) else steps
    return float(np.min(steps)) if len(steps) and np.all(np.abs(times - np.round(times)) < 0.01) else 0.0


def lone_samples(values: np.ndarray) -> tuple[np.ndarray, float]:
    """(rows of samples [T] that stand out alone, by how much at most)."""
    # what it is off the middle of its neighbours, beyond what these are apart: a step is off by half its height only
    out = np.abs(values[1:-1] - 0.5 * (values[2:] + values[:-2])) - np.abs(values[2:] - values[:-2])
    out = np.maximum(out, 0.0)
    if len(out) < 100:
        return np.array([], int), 0.0
    usual = float(np.quantile(out, 1.0 - _TAIL))
    # the mean of an exponential: from the median of what is beyond, which a few spikes do not move; at least that of
    # one which falls to `_TAIL` there, as of a channel of few steps
    beyond = np.median(out[out > usual]) - usual if np.any(out > usual) else 0.0
    mean = max(float(beyond) / np.log(2.0), usual / np.log(1.0 / _TAIL))
    rows = np.flatnonzero(out > usual + mean * np.log(_TAIL * len(out) / CHANCE)) + 1
    return rows, float(np.max(out[rows - 1])) if len(rows) else 0.0
