"""Lines in the spectra of what is left, and whether they are of a sensor or of the rig."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import i0e, logsumexp
from scipy.stats import chi2, f

from cable_envs.diagnosis.evidence.candidates import SCALES
from cable_envs.diagnosis.evidence.joint import Joint, sizes_of
from cable_envs.diagnosis.evidence.shared import bayes_bound, by_block
from cable_envs.diagnosis.intake.tracks import RATES
from cable_envs.diagnosis.model.features import families
from cable_envs.diagnosis.model.leftover import AT_REST, MAINS, Leftover
from cable_envs.diagnosis.model.model import Block, learn_whitener
from cable_envs.diagnosis.model.verdict import SURE

ABOUT = 48
"""Values of a spectrum, twice as fine as its resolution, to either side, whose median a line is held against."""
PERIODS = 8
"""Of a tone in a record, at least: what is slower is no line but a slope."""
ALIKE = 0.5
"""Difference of a speed from that of the place, over the speed, below which both are of one motion."""
SMALLEST, UNEVEN = 1e-3, 0.3
"""Amplitude of a tone that is tried, over what is left in all; share by which a hum differs from record to record."""
MAINS_HZ, MAINS_WANDER, HARMONICS = (50.0, 60.0), 0.1, 3
"""Frequencies of mains and by how much they wander, Hz, and the multiples that are asked for."""
WIDTH, BROAD, FAR = 6, 40, 200
"""Values of a spectrum to either side of a line that are its own, up to which it would have neighbours if it rang and
died away, and up to which the noise is told."""
SPREAD, BY_CHANCE = 0.1, 3.0
"""Power of these neighbours beyond the noise, over the line's, and in standard deviations, from which it is broad."""
OF_WINDOW = 2.0 * (35.0 / 128.0) / (3.0 / 8.0) ** 2
"""Variance of a sum of the values of a spectrum over that of as many independent ones: with Hann's window w and twice
as many values as samples it is 2 mean(w^4) / mean(w^2)^2."""


def tones(
    blocks: Sequence[Block], raw: Sequence[np.ndarray], white: np.ndarray, taken: Sequence[Leftover] = ()
) -> list[Leftover]:
    """The strongest line of every channel's spectrum (Fisher's test), and whether it is a sensor's.

    A noise of eight coefficients takes a line for a resonance of its own; one of one coefficient leaves it in sight.
    Under that a line is held against the spectrum about it, whatever the colour. What vibrates passes through the rig
    to several sensors, with the same phases between them in every record. So do mains, whose frequencies are known;
    other hum enters each sensor by itself, and brings its harmonics. A hum is there whatever the rig does: a line that
    records have as their motions differ, or that functions of the motion make, is the rig's. What a record at rest
    shows is the sensor's.

    Parameters
    ----------
    blocks : sequence of Block
        Of all records.
    raw : sequence of ndarray
        What a model leaves [T] of each.
    white : ndarray
        The same whitened, one below the other.
    taken : sequence of Leftover
        Tones of sensors that are taken out already.
    """
    found = []
    for channel in dict.fromkeys(b.channel for b in blocks):
        line = _line(blocks, raw, white, channel)
        own = _harmonic(blocks, line, [t for t in taken if t.channel == channel])
        line = replace(line, known=AT_REST if _at_rest(blocks, line) else MAINS if of_mains(line.at[0], blocks) else "")
        of_rig = -np.inf
        if line.known != AT_REST and not (own and _steady(blocks, raw, line)):
            of_rig = _of_the_rig(blocks, raw, line)
        if of_rig < -np.log(SURE):
            line = replace(line, cause=f"a steady tone of {line.at[0]:.3g} Hz in this sensor")
        else:  # that it is there, and the rig's
            line = replace(line, log_odds=line.log_odds - float(np.logaddexp(0.0, -of_rig)))
        found.append(line)
    return found


def _line(all_blocks, all_raw, white, channel) -> Leftover:
    """Over all the channel's records together, each with its own phase."""
    blocks = [b for b in all_blocks if b.channel == channel]
    raw = [r for b, r in zip(all_blocks, all_raw, strict=True) if b.channel == channel]
    period, width = float(np.median(np.diff(blocks[0].time))), 2 * max(len(b.time) for b in blocks)
    count = 2 * len(blocks)
    power = 2.0 * _periodogram([w for b, w in by_block(all_blocks, white) if b.channel == channel], width)
    k = 2 * PERIODS + int(np.argmax(power[2 * PERIODS :]))
    found = [(_of_many(float(chi2.sf(power[k], count)), width), float(power[k]), k)]
    simple = learn_whitener(blocks, raw, 1).flat(blocks, raw)
    power = 2.0 * _periodogram([w for _, w in by_block(blocks, simple)], width)
    if len(power) > 4 * ABOUT:
        power *= chi2.median(count) / np.maximum(median_filter(power, 2 * ABOUT + 1, mode="reflect"), 1e-300)
        k = ABOUT + int(np.argmax(power[ABOUT:]))  # below, a colour's slope is steep
        found.append((_of_many(float(f.sf(power[k] / count, count, 0.5 * ABOUT * count)), width), float(power[k]), k))
    p, power_there, k = min(found)
    at = (k + 1) / (width * period)
    return Leftover(channel, "frequency", "Hz", bayes_bound(p), 0.5 * power_there, at=(at,))


def _of_the_rig(blocks: Sequence[Block], raw: Sequence[np.ndarray], line: Leftover) -> float:
    """Log odds that a line is the rig's, over that it enters a sensor whatever the rig does.

    Mains enter several sensors with the same phases between them in every record, as what vibrates does.
    """
    if not _steady(blocks, raw, line) or (line.known != MAINS and _passes_through(blocks, raw, line)):
        return np.inf
    return _of_motion(blocks, raw, line)


def of_mains(frequency: float, blocks: Sequence[Block]) -> bool:
    """Whether a frequency, Hz, is that of mains or of a harmonic, as sampling folds it, as closely as records tell."""
    known = 1.0 / max(b.time[-1] - b.time[0] for b in blocks)
    multiples = [(n * base, n * MAINS_WANDER) for base in MAINS_HZ for n in range(1, HARMONICS + 1)]
    return any(abs(frequency - _folded(f, blocks)) < wide + known for f, wide in multiples)


def _folded(frequency: float, blocks: Sequence[Block]) -> float:
    """Where samples show a frequency, Hz."""
    rate = 1.0 / float(np.median(np.diff(blocks[0].time)))
    return abs(frequency - rate * round(frequency / rate))


def _at_rest(blocks: Sequence[Block], line: Leftover) -> bool:
    """Whether the record at rest has a line there, too, as closely as the records are long."""
    for block in blocks:
        if block.channel == line.channel and block.noise is not None:
            turn = line.at[0] * float(np.median(np.diff(block.time)))
            return any(abs(turn - own) < 1.0 / len(block.time) for own in block.noise.lines)
    return False


def _steady(blocks: Sequence[Block], raw: Sequence[np.ndarray], line: Leftover) -> bool:
    """Whether a line is as narrow as its records are long: what rings and dies away is broader.

    Its neighbours are held against the noise there, whose power goes in a straight line, in logarithms, from one side
    of them to the other. Each value of a spectrum scatters by as much as it is.
    """
    line_power, beside, variance = 0.0, 0.0, 0.0
    for block, left in zip(blocks, raw, strict=True):
        if block.channel != line.channel:
            continue
        values = np.where(block.good, left, 0.0)
        power = np.abs(np.fft.rfft(values * np.hanning(len(values) + 2)[1:-1], 2 * len(values))) ** 2
        k = round(line.at[0] * 2 * len(values) * float(np.median(np.diff(block.time))))
        about = np.arange(max(k - BROAD, 0), min(k + BROAD + 1, len(power)))
        noise, own = _noise_about(power, k, about), np.abs(about - k) <= WIDTH
        more = power[about] - noise
        line_power += float(more[own].sum())
        beside += float(more[~own].sum())
        variance += OF_WINDOW * float(np.sum(noise[~own] ** 2))
    return beside < max(SPREAD * line_power, BY_CHANCE * float(np.sqrt(variance)))


def _noise_about(power: np.ndarray, k: int, about: np.ndarray) -> np.ndarray:
    """Mean of a spectrum at places ``about`` the k-th, as its medians to either side of these have it."""
    sides = [power[max(k - FAR, 0) : max(k - BROAD, 0)], power[k + BROAD + 1 : k + FAR + 1]]
    known = [float(np.median(side)) / np.log(2.0) if len(side) >= BROAD else 0.0 for side in sides]
    left, right = (one or max(known) for one in known)
    if not right > 0.0:
        return np.zeros(len(about))
    middle = 0.5 * (BROAD + FAR)
    return np.exp(np.interp(about, [k - middle, k + middle], np.log([left, right])))


def _of_motion(blocks: Sequence[Block], raw: Sequence[np.ndarray], line: Leftover) -> float:
    """Log odds that a line is as large in each record as that record's motion makes it, over a hum.

    A hum has about one amplitude A in all records: that of a Fourier coefficient in noise has Rice's density. Against
    it stand amplitudes of each record's own, where these are 20 times as probable, and a discrepancy along the motion
    (`model.features`), which makes lines at all multiples of a periodic one.
    """
    own = [k for k, b in enumerate(blocks) if b.channel == line.channel and b.good.any()]
    found = [_amplitude(blocks[k], raw[k], line.at[0]) for k in own]
    power = np.array([p for _, p in found if np.isfinite(p)])
    if len(power) < len(own):
        return -np.inf
    seen = np.array([x for x, _ in found])
    reach = np.array([0.5 * np.sum(_window(blocks[k])) for k in own])  # of a sine of amplitude 1
    size = max(sizes_of(blocks, raw)[line.channel], 1e-300)
    tried = size * np.geomspace(SMALLEST, 2.0, 60)[:, None]
    steady = _one_mean(_rice(seen, power, tried * reach, UNEVEN).sum(axis=1))
    if float(np.sum(_one_mean(_rice(seen, power, tried * reach)))) - steady > np.log(SURE):
        return np.inf
    mine, predicted = [blocks[k] for k in own], [blocks[k].measured - raw[k] for k in own]
    unit = max(float(np.sqrt(np.mean(np.concatenate(predicted) ** 2))), 1e-300)
    kinds = [[p[:, None] / unit for p in predicted]]
    kinds += [[f.columns[k] for k in range(len(own))] for f in families(mine, predicted) if f.at]
    odds = []
    for columns in kinds:
        made = np.array([_coefficient(b, c, line.at[0]) for b, c in zip(mine, columns, strict=True)])
        for scale in SCALES:
            spread = np.diag(power) + (scale * size) ** 2 * made @ made.conj().T
            odds.append(-float(np.vdot(seen, np.linalg.solve(spread, seen)).real) - np.linalg.slogdet(spread)[1])
    along = _one_mean(np.array(odds)) - len(own) * np.log(np.pi)
    return float(along - steady)


def _rice(seen: np.ndarray, power: np.ndarray, height: np.ndarray, uneven: float = 0.0) -> np.ndarray:
    """Log density of coefficients [n] of any phase, of heights [m, n], uneven by a share, in noise of a power [n]."""
    power = power + (uneven * height) ** 2
    turned = 2.0 * np.abs(seen) * height / power
    return np.log(i0e(turned)) + turned - (np.abs(seen) ** 2 + height**2) / power - np.log(np.pi * power)


def _one_mean(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the mean along the first axis."""
    return logsumexp(logs, axis=0) - np.log(len(logs))


def _harmonic(blocks: Sequence[Block], line: Leftover, taken: Sequence[Leftover]) -> bool:
    """Whether a line is at a whole multiple of a tone, as sampling folds it, as closely as its records are long."""
    longest, at = max(b.time[-1] - b.time[0] for b in blocks), line.at[0]
    multiples = ((n, tone.at[0]) for tone in taken for n in {*range(2, HARMONICS + 1), round(at / tone.at[0])} if n > 1)
    return any(abs(_folded(n * base, blocks) - at) < n / longest for n, base in multiples)


def _passes_through(blocks: Sequence[Block], raw: Sequence[np.ndarray], line: Leftover) -> bool:
    """Whether another sensor has a line too, with the same phase between the two in every record.

    A place and its speed have more: what moves has a speed of 2 pi f times its amplitude, a quarter turn ahead. A hum
    that a controller passes on moves the rig, too, but not by what the sensor shows.
    """
    own = _amplitudes(blocks, raw, line.channel, line.at[0])
    sensor = next(b.sensor for b in blocks if b.channel == line.channel)
    others = dict.fromkeys(
        b.channel for b in blocks if b.channel != line.channel and (b.sensor != sensor or not sensor)
    )
    speed, place = RATES.get(line.channel, ""), next((p for p, s in RATES.items() if s == line.channel), "")
    if speed in others or place in others:
        there = _amplitudes(blocks, raw, speed if speed in others else place, line.at[0])
        turn = 2j * np.pi * line.at[0]
        moved = [(own[r][0] * turn, there[r][0]) if speed in others else (there[r][0] * turn, own[r][0]) for r in own]
        return bool(sum(abs(x - v) ** 2 for x, v in moved) < ALIKE**2 * sum(abs(v) ** 2 for _, v in moved))
    seen = (_amplitudes(blocks, raw, channel, line.at[0]) for channel in others)
    odds = (one_phase([(own[r], there[r]) for r in own if r in there]) for there in seen)
    return max(odds, default=-np.inf) > np.log(SURE)


def one_phase(pairs: Sequence[tuple[tuple[complex, float], tuple[complex, float]]]) -> float:
    """Log odds that the phase between two channels is one in all records, over that it is any in each.

    Parameters
    ----------
    pairs : sequence of tuple
        Of every record, for each channel: a Fourier coefficient, and the power of the noise in it.

    Returns
    -------
    float
        A measured phase is about the true one as von Mises' distribution says, with the concentration k = 1 / variance;
        a coefficient x in noise of the power p has the variance p / (2 |x|^2). With the true phase integrated out, over
        all angles alike, the odds are  I0(|sum k exp(i phase)|) / product of I0(k).
    """
    total, odds = 0.0 + 0.0j, 0.0
    for (x, of_x), (y, of_y) in pairs:
        if not (abs(x) > 0.0 and abs(y) > 0.0):
            continue
        k = 2.0 / (of_x / abs(x) ** 2 + of_y / abs(y) ** 2)
        turn = x * np.conj(y)
        total += k * turn / abs(turn)
        odds -= k + float(np.log(i0e(k)))
    return odds + abs(total) + float(np.log(i0e(abs(total))))


def _amplitudes(blocks, raw, channel: str, frequency: float) -> dict[str, tuple[complex, float]]:
    """Record -> the channel's Fourier coefficient there, and the power about it."""
    return {b.record: _amplitude(b, r, frequency) for b, r in zip(blocks, raw, strict=True) if b.channel == channel}


def without_tones(joint: Joint, raw: Sequence[np.ndarray], lines: Sequence[Leftover]) -> Joint:
    """All records without a tone each in some channels.

    Parameters
    ----------
    joint : Joint
        The records.
    raw : sequence of ndarray
        What a model leaves [T] of every block, in which the tones are seen.
    lines : sequence of Leftover
        Of the channels, one for each.

    Returns
    -------
    Joint
        Predicts the same; measured is what is left when the sine of each record that fits best, all of one frequency
        near that of the line, is taken out.
    """
    cleaned = copy(joint)
    cleaned.blocks = list(joint.blocks)
    for line in lines:
        own = [k for k, b in enumerate(joint.blocks) if b.channel == line.channel]
        longest = max(joint.blocks[k].time[-1] - joint.blocks[k].time[0] for k in own)
        about = np.linspace(line.at[0] - 1.0 / longest, line.at[0] + 1.0 / longest, 41)
        taken = [[_sine(joint.blocks[k], raw[k], f) for k in own] for f in about]
        best = max(taken, key=lambda sines: sum(float(s @ s) for s in sines))
        for k, sine in zip(own, best, strict=True):
            block = cleaned.blocks[k]
            cleaned.blocks[k] = replace(block, measured=block.measured - sine)
    return cleaned


def _sine(block: Block, left: np.ndarray, frequency: float) -> np.ndarray:
    """The sine of a frequency that fits a series best [T]."""
    turn = 2.0 * np.pi * frequency * block.time
    waves = np.column_stack([np.sin(turn), np.cos(turn)])
    return waves @ np.linalg.lstsq(waves[block.good], left[block.good], rcond=None)[0]


def _amplitude(block: Block, left: np.ndarray, frequency: float) -> tuple[complex, float]:
    """(Fourier coefficient of a record at a frequency, mean power of those about it)."""
    spectrum = np.fft.rfft(np.where(block.good, left, 0.0) * _window(block))
    k = round(frequency * len(left) * float(np.median(np.diff(block.time))))
    near = np.r_[spectrum[max(k - ABOUT, 1) : max(k - 3, 1)], spectrum[k + 4 : k + ABOUT]]
    power = float(np.median(np.abs(near) ** 2) / np.log(2.0)) if len(near) else np.inf
    return complex(_coefficient(block, left, frequency)), power


def _window(block: Block) -> np.ndarray:
    """Hann's window over a record [T], 0 where samples do not count."""
    return np.hanning(len(block.time) + 2)[1:-1] * block.good


def _coefficient(block: Block, series: np.ndarray, frequency: float) -> np.ndarray:
    """Fourier coefficient of series [T] or [T, n] of a record at a frequency."""
    window = _window(block)
    turn = window * np.exp(-2j * np.pi * frequency * (block.time - block.time[0]))
    return turn @ np.where(window.reshape(-1, *[1] * (series.ndim - 1)) > 0.0, series, 0.0)


def _of_many(p: float, width: int) -> float:
    """Of the largest of a periodogram's values, of which a quarter of ``width`` are independent."""
    return float(-np.expm1(0.25 * width * np.log1p(-min(p, 1.0 - 1e-12))))


def _periodogram(series: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Sum over whitened series, without the ends; 1 each for white noise."""
    parts = (np.abs(np.fft.rfft(w, width))[1:-1] ** 2 / max(float(np.sum(w != 0.0)), 1.0) for w in series)
    return sum(parts, np.zeros(()))
