"""Channels that are late or early against the others by more than a rig's own lags.

What belongs together is looked for among the shifts of one channel against all others: it is regressed on them, on
their slopes, curvatures and directions of motion (what mass, damping, springs and friction make of motion), for every
shift. A shift counts if it is longer than `LAG`, is the best of each record by itself, and none of the longest that are
tried (where more is better still, the others do not tell this channel's time). It must leave less than every shorter
one and every one to the other side, and do so in block after block (the test of equal predictions of Diebold and
Mariano, J. Bus. Econ. Stat. 13 (1995) 253, on the logarithm of the squares left in blocks).
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import stats

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import LAG, RATES, Found, Track, is_told
from cable_envs.diagnosis.systems.common import smooth_speed

_FARTHEST = 4.0 * LAG
"""s of the shifts that are tried."""
_SHIFTS = 49
_ROWS = 3000
"""Rows of a record that are compared; of more, every so many."""
_BLOCKS = 10
"""Of a record: each is longer than what its residual remembers, a way to and fro."""
_CHANCE = 1e-5
"""Of a false alarm, a channel."""
_EXPLAINED = 0.5
"""Share of a channel's variance that the others must explain for its time to be known from them."""
_TURN = 0.05
"""Of the fastest speed, over which the sign of friction turns."""
_MOST = 6
"""Records that are looked at: a logger that is late is so in all."""


def late_channels(recording: Recording, tracks: Sequence[Track]) -> Iterator[Found]:
    """The channel whose shift explains most, if any does."""
    longest = max(track.time[-1] - track.time[0] for track in tracks)
    if longest < 10.0 * _FARTHEST:
        return
    found = []
    for channel in recording.channels:
        if channel != "time" and not is_told(channel) and RATES.get(channel) not in recording.channels:
            if _moves(channel) and not any(_moves(n) for n in recording.channels if n != channel):
                continue  # what moves is no sum of what pushes: the effort is held against the motion instead
            shift, sure = shift_of(tracks[:_MOST], channel)
            found.append((sure, shift, channel))
    if not found:
        return
    sure, shift, channel = max(found)
    blocks = _BLOCKS * len(tracks[:_MOST])
    if sure > stats.t.isf(_CHANCE, blocks - 1):
        late = "late" if shift > 0.0 else "early"
        text = (
            f"read {1e3 * abs(shift):.0f} ms {late} against the other channels, more than a sensor or an amplifier "
            f"lags ({1e3 * LAG:.0f} ms): bring them to one clock"
        )
        yield Found(tracks[0].name, channel, 1, text)


def shift_of(tracks: Sequence[Track], channel: str) -> tuple[float, float]:
    """(s by which a channel is late, t of its being longer than `LAG`; 0 where it is not)."""
    shifts = np.linspace(-_FARTHEST, _FARTHEST, _SHIFTS)
    left = [_left(track, channel, shifts) for track in tracks]
    if any(np.min(np.sum(part, axis=1)) > 1.0 - _EXPLAINED for part in left):
        return 0.0, 0.0
    blocks = np.concatenate([part / np.min(np.sum(part, axis=1)) for part in left], axis=1)
    total = np.sum(blocks, axis=1)
    best = int(np.argmin(total))
    alone = [float(shifts[int(np.argmin(np.sum(part, axis=1)))]) for part in left]
    if best in (0, _SHIFTS - 1) or any(abs(one - shifts[best]) > LAG for one in alone):
        return float(shifts[best]), 0.0
    others = (np.abs(shifts) <= LAG) | (shifts * shifts[best] < 0.0)
    near = int(np.flatnonzero(others)[np.argmin(total[others])])
    if abs(shifts[best]) <= LAG or total[near] <= total[best]:
        return float(shifts[best]), 0.0
    tiny = 1e-6  # of a record's squares: blocks in which all is at rest say nothing
    gains = np.log((blocks[near] + tiny) / (blocks[best] + tiny))
    return float(shifts[best]), float(np.mean(gains) / (np.std(gains, ddof=1) / np.sqrt(len(gains))))


def _left(track: Track, channel: str, shifts: np.ndarray) -> np.ndarray:
    """Squares of a channel that the others leave, over its own, for every shift and block [shifts, `_BLOCKS`]."""
    every = max(len(track.time) // _ROWS, 1)
    columns = [c for name, values in track.channels.items() if name != channel for c in _columns(track, name, values)]
    table = np.column_stack([np.ones(len(track.time)), *columns])[::every]
    time = track.time[::every]
    inner = (time > time[0] + _FARTHEST) & (time < time[-1] - _FARTHEST)
    table = table[inner]
    basis = np.linalg.qr(table / np.maximum(np.max(np.abs(table), axis=0), 1e-300))[0]
    own, found = track.channels[channel], []
    for shift in shifts:
        values = np.interp(time[inner] + shift, track.time, own)
        values = values - np.mean(values)
        rest = values - basis @ (basis.T @ values)
        scale = max(float(values @ values), 1e-300)
        found.append([float(part @ part) / scale for part in np.array_split(rest, _BLOCKS)])
    return np.array(found) + 1e-12


def _moves(name: str) -> bool:
    """Whether a channel is a motion: of a place, or a speed."""
    places = ("position", "angle", "position_reference", "angle_command", "angle_reference")
    return "velocity" in name or name.endswith(places)


def _columns(track: Track, name: str, values: np.ndarray) -> list[np.ndarray]:
    """A channel, and what mass, damping and friction make of it if it is a motion."""
    if "velocity" in name:
        return [values, np.cumsum(values - np.mean(values)) * track.period]
    if not _moves(name):
        return [values]
    speed = smooth_speed(values, track.period)
    turn = _TURN * float(np.quantile(np.abs(speed), 0.95))
    return [values, speed, smooth_speed(speed, track.period), np.tanh(speed / max(turn, 1e-300))]
