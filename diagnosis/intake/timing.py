"""Channels that are late or early against the others by more than a rig's own lags.

What belongs together is looked for among the shifts of one channel against all others: it is regressed on them, on
their slopes, curvatures and directions of motion (what mass, damping, springs and friction make of motion), for every
shift. A shift counts if it is longer than `LAG`, is the best of each record by itself, and none of the longest that are
tried (where more is better still, the others do not tell this channel's time). It must leave less than every shorter
one and every one to the other side, and do so in block after block (the test of equal predictions of Diebold and
Mariano, J. Bus. Econ. Stat. 13 (1995) 253, on the logarithm of the squares left in blocks). What a gap passes on of the
places is among what it is regressed on: at a reversal what is behind a gap waits until it is crossed, which is no time
of a logger's. `_LESS` is material: efforts of generator A that are 0.13 to 0.2 s late or early (seeds 3 to 7, 30
recordings) leave at most 0.49 of what a shorter shift leaves; a da Vinci jaw, whose friction is none of these, 0.68.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import stats

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import LAG, RATES, Fault, Track, is_told
from cable_envs.diagnosis.systems.common import smooth_speed
from cable_envs.effects.backlash import play

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
_GAPS = (0.02, 0.06, 0.2)
"""Widths of a gap, of the range of a place."""
_LESS = 0.6
"""Share of what any shorter shift leaves that a shift may leave at most."""
_MOST = 6
"""Records that are looked at: a logger that is late is so in all."""


def late_channels(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
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
        yield Fault(tracks[0].name, channel, 1, text)


def shift_of(tracks: Sequence[Track], channel: str, gaps: Sequence[float] = _GAPS) -> tuple[float, float]:
    """(s by which a channel is late, t of its being longer than `LAG`; 0 where it is not), beside ``gaps``."""
    shifts = np.linspace(-_FARTHEST, _FARTHEST, _SHIFTS)
    left = [_left(track, channel, shifts, gaps) for track in tracks]
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
    if abs(shifts[best]) <= LAG or total[best] > _LESS * total[near]:
        return float(shifts[best]), 0.0
    tiny = 1e-6  # of a record's squares: blocks in which all is at rest say nothing
    gains = np.log((blocks[near] + tiny) / (blocks[best] + tiny))
    return float(shifts[best]), float(np.mean(gains) / (np.std(gains, ddof=1) / np.sqrt(len(gains))))


def _left(track: Track, channel: str, shifts: np.ndarray, gaps: Sequence[float]) -> np.ndarray:
    """Squares of a channel that the others leave, over its own, for every shift and block [shifts, `_BLOCKS`]."""
    every = max(len(track.time) // _ROWS, 1)
    others = [(name, values) for name, values in track.channels.items() if name != channel]
    columns = [c for name, values in others for c in _columns(track, name, values)]
    columns += [passed_on(v, gap * float(np.ptp(v))) for name, v in others if _is_place(name) for gap in gaps]
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


def passed_on(values: np.ndarray, gap: float) -> np.ndarray:
    """What a gap passes on of a motion."""
    found = [float(values[0])]
    for value in values[1:].tolist():
        found.append(play(found[-1], value, gap))
    return np.array(found)


def _moves(name: str) -> bool:
    """Whether a channel is a motion: of a place, or a speed."""
    return "velocity" in name or _is_place(name)


def _is_place(name: str) -> bool:
    return name.endswith(("position", "angle", "position_reference", "angle_command", "angle_reference"))


def _columns(track: Track, name: str, values: np.ndarray) -> list[np.ndarray]:
    """A channel, and what mass, damping and friction make of it if it is a motion."""
    if "velocity" in name:
        return [values, np.cumsum(values - np.mean(values)) * track.period]
    if not _moves(name):
        return [values]
    speed = smooth_speed(values, track.period)
    turn = _TURN * float(np.quantile(np.abs(speed), 0.95))
    return [values, speed, smooth_speed(speed, track.period), np.tanh(speed / max(turn, 1e-300))]
