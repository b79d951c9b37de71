"""Samples that no sensor took: a value that is held while the rig moves, a block of rows that is written twice.

A sensor whose noise is not far below its resolution repeats a value by chance, with the share q of its samples that
equal the one before. L repetitions in a row occur in n samples with a chance of at most n q^L. At rest a fine sensor
with little noise repeats its value as a matter of course, so that a run counts only where another channel moves.
"""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import EFFORTS, INPUTS, Fault, Track, is_told, of_steps
from cable_envs.diagnosis.model.noise import jitter

_CHANCE, _SURE = 1e-3, 1e-6
"""Of a run by chance, a channel of a record: below which it is noted, and below which it cannot be used."""
_BY_NOISE = (2.0, 4.0)
"""Standard deviations of its noise: up to which the usual way of a channel's means is none, and from which one is."""
_SLOWER = 0.5
"""Of the usual way: what goes so far while an effort has one value has not stopped."""
_PILED = 0.01
"""Share of an effort's samples at each of two opposite ends from which they are no peaks of a motion."""
_BLOCK = 8
"""Rows, and different ones, from which a repetition is none by chance."""


def runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(first sample, number of samples) of every run of equal values [T]."""
    edges = np.flatnonzero(np.r_[True, np.diff(values) != 0.0])
    return edges, np.diff(np.r_[edges, len(values)])


def held(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """The longest run of equal samples of an effort, where its noise makes none so long and the rig moves.

    Of a voltage it is a note: whoever gave it may have held it.

    Positions and speeds are left out: they stand still at every turn, and `cable_envs.diagnosis.intake.gate` looks at
    those that stand for long.
    """
    records = [record for record in recording.records if record.use != "rest"]
    for channel in recording.channels:
        if channel not in (*EFFORTS, *INPUTS):
            continue
        for track, record in zip(tracks, records, strict=True):
            values = np.where(record.usable(channel), track.channels[channel], np.nan)
            run = longest_run(values)
            if run is not None and moves(track, channel, *run[:2], share=_SLOWER):
                fatal = run[2] < _SURE and channel not in INPUTS
                if values[run[0]] in (np.nanmax(values), np.nanmin(values)):
                    text = f"{run[1]} samples in a row at its end of {values[run[0]]:.6g}: saturated"
                    yield Fault(track.name, channel, run[0] + 1, f"{text}; mark them under 'quality'", fatal)
                    break
                text = (
                    f"{run[1]} equal samples in a row, {values[run[0]]:.6g}, while the rig moves, and its noise makes "
                    f"no such run: held; mark them under 'quality'"
                )
                yield Fault(track.name, channel, run[0] + 1, text, fatal)
                break


def piled(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Efforts with many samples at exactly opposite ends: a limit. Of the sensor it is a fault, of the drive none."""
    for channel in recording.channels:
        if channel not in (*EFFORTS, *INPUTS):
            continue
        for track in tracks:
            values = track.channels[channel]
            if channel in INPUTS and of_steps(values):
                continue
            high, low = float(np.max(values)), float(np.min(values))
            least = min(float(np.mean(values == high)), float(np.mean(values == low)))
            if high == -low and least > _PILED:
                text = f"{least:.0%} of its samples or more are at {high:.6g}, and as many at {low:.6g}: a limit"
                yield Fault(track.name, channel, 1, f"{text}; where it is the sensor's, mark them", False)
                break


def longest_run(values: np.ndarray) -> tuple[int, int, float] | None:
    """(first sample, number, chance) of the longest run of equal values [T], where chance makes it below `_CHANCE`.

    Runs at 0, where nothing pulls, are not looked at. Noise that remembers, and noise that comes and goes, make a run
    the likelier the longer it is: q is the larger of the share of all samples that are repeated and the share of all
    repetitions that go on (a tenth where there are none), the longest run left out.
    """
    first, count = runs(values)
    level = values[first]
    inner = (level != 0.0) & np.isfinite(level)
    if not inner.any():
        return None
    k = int(np.argmax(np.where(inner, count, 0)))
    others = np.delete(count, k)
    repeated, gone_on = (int(np.sum(np.maximum(others - n, 0))) for n in (1, 2))
    share = max((repeated + 1) / len(values), (gone_on + 1) / (repeated + 10))
    likely = float(len(values) * share ** float(count[k] - 1))
    return (int(first[k]), int(count[k]), likely) if likely < _CHANCE else None


def moves(
    track: Track, channel: str, first: int, length: int, among: Collection[str] | None = None, share: float = 1.0
) -> bool:
    """Whether another channel goes as far during some samples as it does in half of all spans of that length.

    ``among``: the channels that are looked at; None: all. share: of that way, which is enough. In a record that rests
    for long half of all spans have no way but noise: that is none.
    """
    half = max(length // 2, 1)
    for name, values in track.channels.items():
        if name == channel or len(values) < 8 * length or (among is not None and name not in among):
            continue
        means = np.convolve(values, np.full(half, 1.0 / half), mode="valid")
        ways = np.abs(means[half:] - means[:-half])
        at = min(first, len(ways) - 1)
        usual, noise = float(np.median(ways)), jitter(values) * float(np.sqrt(2.0 / half))
        least = max(share * usual, _BY_NOISE[0] * noise) if usual > _BY_NOISE[0] * noise else _BY_NOISE[1] * noise
        if ways[at] > 0.0 and ways[at] >= least:
            return True
    return False


def blocks_twice(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """A block of rows that is followed by itself, in all channels that a sensor measured."""
    names = [n for n in recording.channels if n not in ("time", "wrap_angle") and not is_told(n)]
    for track in tracks:
        table = np.column_stack([track.channels[name] for name in names])
        found = block_twice(table)
        if found is not None:
            text = f"these {found[1]} rows and those before them are the same: a buffer that was written twice"
            yield Fault(track.name, names[0], found[0] + 1, f"{text}; cut the record there into two")
            return


def block_twice(table: np.ndarray) -> tuple[int, int] | None:
    """(first row of the copy, rows) of a block [T, channels] that is written twice running; None without one."""
    last: dict[bytes, int] = {}
    back = np.zeros(len(table), int)
    for row, line in enumerate(np.ascontiguousarray(table)):
        key = line.tobytes()
        back[row] = row - last.get(key, row)
        last[key] = row
    first, count = runs(back)
    for start, length in zip(first, count, strict=True):
        lag = int(back[start])
        if length >= _BLOCK and lag == length and len(np.unique(table[start : start + length], axis=0)) >= _BLOCK:
            return int(start), int(length)
    return None
