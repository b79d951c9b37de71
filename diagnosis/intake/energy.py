"""Signs and swapped columns, by the power balance: over a closed way friction only takes energy.

Along a way that ends where it began, springs and weights give back what they took, so that what an effort has put in
is what friction took and what the kinetic energy has gained:

    sum F dx = D + (T_end - T_begin),  D >= 0

The kinetic energy is taken in and given back between the middle and the turning point, so that the sum of |F dx| is at
least twice the largest T. The loss factor  w = sum F dx / sum |F dx|  of a closed way is therefore never below
-|v_end^2 - v_begin^2| / (2 v_max^2), whatever the rig is; of n ways that follow each other the mean is not
below the n-th part of that. A sign that is turned makes w negative; so do effort and
position in each other's column, since  sum x dF = -sum F dx  on a closed way.

What a driven end gives to its surroundings comes from the drive: over closed ways its work is at most the drive's. Of a
cable whose driven end was not recorded that end goes as far as its drive, and the difference of both tensions is what
rubs between them.

A driven end that nothing else drives follows its drive. With a force F = g(x - y), g rising, between drive x and
driven end y, and energy only taken beyond y, it is  sum F dy >= 0  and with it  sum x dy >= 0:  the end is late by
sum x dy / sum v_x v_y  s, not early.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import DRIVEN, LAG, PASSED_ON, WORKS, Fault, Track, closed_ways

FEWEST = 2
"""Closed ways that say anything."""
AS_FAR = ("drive_position",)
"""Positions of a drive whose driven end goes as far, but for what a cable stretches: where its own was not recorded."""
_RUBS = "friction between both ends"
_SURE = 5.0
"""Standard deviations of a sum of noise."""


def against_nature(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Efforts that take energy out of a rig which nothing but they put in, and driven ends that lead their drive."""
    for effort, place in WORKS.items():
        if effort in recording.channels and place in recording.channels:
            yield from _gives(tracks, effort, place)
    for (effort, place), (out, end) in PASSED_ON.items():
        if {effort, place, out, end} <= set(recording.channels):
            yield from _gains(tracks, (effort, place), (out, end))
        elif {effort, place, out} <= set(recording.channels) and place in AS_FAR and _adds(tracks, effort, out, place):
            yield from _gains(tracks, (effort, place), (out, place))
    for drive, driven in DRIVEN.items():
        if drive in recording.channels and driven in recording.channels:
            yield from _leads(tracks, drive, driven)


def _gives(tracks: Sequence[Track], effort: str, place: str) -> Iterator[Fault]:
    found = [losses(track, effort, place) for track in tracks]
    factors = np.concatenate([w for w, _ in found])
    if not _below(factors):
        return
    late = np.concatenate([losses(track, effort, place, LAG)[0] for track in tracks])
    least = np.mean([least for w, least in found if len(w)])
    # a lag, which a rig may have, turns no sign; `least` is what kinetic energy and noise make of a way
    if _below(late) and np.mean(factors) < least:
        text = (
            f"over {len(factors)} closed ways of {place} it takes out {-np.mean(factors):.0%} of the work that it does "
            f"to and fro, and friction only takes energy: turn the sign of one of them, or exchange the two where "
            f"they are in each other's column"
        )
        yield Fault(tracks[0].name, effort, 1, text)


def _gains(tracks: Sequence[Track], drive: tuple[str, str], end: tuple[str, str]) -> Iterator[Fault]:
    put_in, taken = (np.concatenate([works(track, *port, drive[1]) for track in tracks]) for port in (drive, end))
    if len(put_in) < FEWEST:
        return
    lost = (put_in - taken) / np.maximum(np.abs(put_in) + np.abs(taken), 1e-300)
    # two sensors' scales may be off; the square root of 2 is the nearest that a factor of 2 may be
    if _below(lost) and float(np.sum(taken)) > np.sqrt(2.0) * float(np.sum(np.abs(put_in))):
        text = (
            f"over {len(lost)} closed ways it does {np.sum(taken) / np.sum(np.abs(put_in)):.3g} times the work that "
            f"{drive[0]} puts in: exchange the two where they are in each other's column, or look at their units"
        )
        yield Fault(tracks[0].name, end[0], 1, text)


def _adds(tracks: Sequence[Track], effort: str, out: str, place: str) -> bool:
    """Whether what a cable's drive pulls more than its load takes no energy but gives it, and noise would not."""
    found = []
    for track in tracks:
        rubs = {**track.channels, _RUBS: track.channels[effort] - track.channels[out]}
        found.append(losses(replace(track, channels=rubs), _RUBS, place))
    factors, least = np.concatenate([w for w, _ in found]), [least for w, least in found if len(w)]
    return _below(factors) and float(np.mean(factors)) < float(np.mean(least))


def works(track: Track, effort: str, place: str, along: str) -> np.ndarray:
    """Work of an effort on its position over every closed way of the position ``along``, J."""
    f, v = track.channels[effort], track.speed(place, along)
    ways = closed_ways(track.channels[along])
    return np.array([track.period * float((f[a:b] - np.mean(f[a:b])) @ v[a:b]) for a, b in ways])


def _below(factors: np.ndarray) -> bool:
    """Whether loss factors are below 0: all of them, or their mean by `_SURE` of its standard deviations."""
    if len(factors) < FEWEST:
        return False
    spread = float(np.std(factors, ddof=1)) / np.sqrt(len(factors))
    many = len(factors) >= 2.0 * _SURE
    return bool(np.max(factors) < 0.0 or (many and np.mean(factors) < -_SURE * spread))


def losses(track: Track, effort: str, place: str, late: float = 0.0) -> tuple[np.ndarray, float]:
    """(loss factor w of every closed way, the least mean of them that kinetic energy and noise could make).

    Kinetic energy that one way gains is there for the next: over all of them it counts once.

    Parameters
    ----------
    track : Track
        A record.
    effort, place : str
        Channel that works, and position along which it does.
    late : float
        s by which the effort is taken later.
    """
    x, v, f = track.channels[place], track.speed(place), track.channels[effort]
    f = np.interp(track.time - late, track.time, f) if late else f
    factors, noise, ways = [], [], closed_ways(x)
    for first, last in ways:
        work = (f[first:last] - np.mean(f[first:last])) * v[first:last]
        moved = float(np.sum(np.abs(work)))
        if moved > 0.0:
            factors.append(float(np.sum(work)) / moved)
            # of samples with signs at random: the root of their number over the sum of their sizes
            noise.append(float(np.sum(work**2)) / moved**2)
    if not factors:
        return np.empty(0), 0.0
    kinetic = abs(v[ways[-1][1]] ** 2 - v[ways[0][0]] ** 2) / (2.0 * float(np.max(v**2)))
    return np.array(factors), -(kinetic + _SURE * float(np.sqrt(np.sum(noise)))) / len(factors)


def _leads(tracks: Sequence[Track], drive: str, driven: str) -> Iterator[Fault]:
    found = np.concatenate([lags(track, drive, driven) for track in tracks])
    if len(found) < FEWEST or np.median(found) >= 0.0:
        return
    mean, spread = float(np.mean(found)), float(np.std(found, ddof=1)) / np.sqrt(len(found))
    if mean < -_SURE * spread and np.max(found) < 0.0:
        text = (
            f"it is {-1e3 * mean:.3g} ms ahead of {drive}, and what is driven follows: exchange the two where they are "
            f"in each other's column; else one of them is read late"
        )
        yield Fault(tracks[0].name, driven, 1, text)


def lags(track: Track, drive: str, driven: str) -> np.ndarray:
    """s by which the driven end is late, of every closed way of the drive."""
    x = track.channels[drive]
    v, w = track.speed(drive), track.speed(driven, along=drive)
    found = []
    for first, last in closed_ways(x):
        way = slice(first, last)
        over = float(np.sqrt(np.sum(v[way] ** 2) * np.sum(w[way] ** 2)))
        if over > 0.0:
            found.append(float((x[way] - np.mean(x[way])) @ w[way]) / over)
    return np.array(found)
