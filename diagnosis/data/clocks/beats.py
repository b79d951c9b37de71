"""What the noise of samples says of another clock that an export brought them from by straight lines.

Between two samples a and b of independent noise a straight line has (1 - x) a + x b, whose variance is
(1 - x)^2 + x^2 of that of either: the noise swells and fades as the two clocks beat, with 1/P seen by the clock of the
recording, for a period P of the other one. Squares of differences of the samples, in which no motion is left, show this
as a line of a known size in their spectrum. All channels have it at the same frequency, and its phase says when the
other clock took its samples.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from math import comb

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import median_filter
from scipy.sparse import csr_matrix
from scipy.special import i0e, logsumexp

from cable_envs.diagnosis.data.clocks.even import numbers, sample_period, zero
from cable_envs.diagnosis.data.clocks.lines import NO_LINES, Lines
from cable_envs.diagnosis.data.clocks.sure_times import SURE
from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.data.readings import ROUNDING
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording

OTHERS = (0.5, 5.0)
"""Period of another clock from which straight lines may have brought samples, over that of the recording."""
DIFFERENCES = (2, 3)
"""Orders of differences of samples in which noise is looked for: the first in which a channel's motion is not seen."""
FEW, SPARSE, ABOUT = 500, 4, 48
"""Differences by which noise is told, numbers for one sample beyond which a record has too long gaps; values of a
spectrum about a line by which it is held against the others."""
AROUND, FINE = 1.5, 61
"""How far about a line the other clock is looked for, in turns over the longest record, and at how many ratios."""
PHASES = 96
"""Phases of the other clock that are told apart."""
QUIET = 0.02
"""Of the mean square of differences, what they have at least: of samples on one straight line it would be nothing."""
Differences = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Of every record (numbers of samples, differences that begin there, over their RMS)."""


def lines_of(recording: Recording) -> Lines:
    """Whether an export brought samples from another clock by straight lines, and when that took them.

    Parameters
    ----------
    recording : Recording
        Its samples as they were read.

    Returns
    -------
    Lines
        The clock with the largest likelihood of the squares of differences, of all between `OTHERS`, which are alike
        beforehand.
    """
    moving = [(r, sample_period([r])) for r in recording.records if r.use != "rest"]
    longest = max((float(numbers(r.time, period)[-1]) for r, period in moving), default=0.0)
    ratios = np.linspace(1.0 / OTHERS[1], 1.0 / OTHERS[0], int(2.0 * longest) + 2)
    odds, seen = np.zeros(len(ratios)), []
    for channel in (name for name in recording.channels if name != "time" and not told(name)):
        for order in DIFFERENCES:
            own = _differences(moving, channel, order)
            if own:
                share = np.interp(ratios, *_swelling(order))
                odds += sum(_odds_of_line(k, d**2 - 1.0, ratios, share) for k, d in own.values())
                seen.append((order, own))
                break
    if not seen:
        return NO_LINES
    total = float(logsumexp(odds) - np.log(len(odds)))
    if total <= SURE:
        return Lines(total)
    about = np.linspace(-AROUND, AROUND, FINE) / longest
    found = [_likeliest(seen, ratio + about) for ratio in _alike(ratios[int(np.argmax(odds))])]
    ratio, phases = max(found, key=lambda clock: _log_likelihood(seen, *clock))
    clocks = {record.name: (zero(record.time, period), period) for record, period in moving if record.name in phases}
    return Lines(total, ratio, phases, clocks)


def _alike(ratio: float) -> list[float]:
    """Ratios of clocks whose noise swells as often, as seen by the clock of the recording."""
    turns = min(ratio % 1.0, 1.0 - ratio % 1.0)
    wanted = {whole + sign * turns for whole in range(int(1.0 / OTHERS[0]) + 1) for sign in (1.0, -1.0)}
    return sorted(r for r in wanted if 1.0 / OTHERS[1] <= r <= 1.0 / OTHERS[0])


def _likeliest(seen: Sequence[tuple[int, Differences]], ratios: np.ndarray) -> tuple[float, dict[str, float]]:
    """(ratio, phase of every record) of the clock of which the squares of differences are likeliest, each by itself."""
    most, best = -np.inf, (0.0, dict[str, float]())
    for ratio in ratios:
        total, phases = 0.0, {}
        for record in dict.fromkeys(name for _, own in seen for name in own):
            own = [_by_phase(*one[record], order, ratio) for order, one in seen if record in one]
            log = np.sum(own, axis=0)
            top = int(np.argmax(log))
            around = log[(top + np.array([-1, 0, 1])) % PHASES]
            bend = around[0] - 2.0 * around[1] + around[2]
            beside = 0.5 * (around[0] - around[2]) / bend if bend < 0.0 else 0.0
            total, phases[record] = total + float(log[top]), (top + beside) / PHASES
        if total > most:
            most, best = total, (float(ratio), phases)
    return best


def _log_likelihood(seen: Sequence[tuple[int, Differences]], ratio: float, phases: Mapping[str, float]) -> float:
    """Of differences as straight lines make them of independent noise, all together.

    Clocks whose beats are alike, of ratios r and 2 - r, differ in how the noise of neighbours belongs together.
    """
    total = 0.0
    for order, own in seen:
        taps = np.diff(np.eye(order + 1), order, axis=0)[0]
        for record, (count, differences) in own.items():
            place = phases[record] + ratio * (count[:, None] + np.arange(order + 1))
            behind = np.floor(place)
            knots = np.concatenate([behind, behind + 1.0], axis=1)
            weights = np.concatenate([taps * (1.0 - place + behind), taps * (place - behind)], axis=1)
            rows = np.repeat(np.arange(len(count)), knots.shape[1])
            shares = csr_matrix((weights.ravel(), (rows, (knots - knots.min()).ravel().astype(int))))
            covariance = (shares @ shares.T).tocoo()
            mean = covariance.diagonal().mean()
            across = covariance.col - covariance.row
            bands = np.zeros((int(across.max()) + 1, len(count)))
            lower = across >= 0
            bands[across[lower], covariance.row[lower]] = covariance.data[lower] / mean
            bands[0] += QUIET
            factor = cholesky_banded(bands, lower=True)
            left = cho_solve_banded((factor, True), differences)
            total -= float(np.sum(np.log(factor[0]))) + 0.5 * float(differences @ left)
    return total


def _by_phase(count: np.ndarray, differences: np.ndarray, order: int, ratio: float) -> np.ndarray:
    """Log likelihood of differences, each by itself, for every phase of the other clock at number 0 [PHASES]."""
    power = _power(order, ratio)
    power = np.maximum(power / power.mean(), QUIET)
    at = np.floor(PHASES * ((ratio * count) % 1.0)).astype(int)
    counted = np.bincount(at, minlength=PHASES)
    summed = np.bincount(at, weights=differences**2, minlength=PHASES)
    turned = np.fft.rfft(np.log(power)), np.fft.rfft(1.0 / power)
    both = sum(t * np.conj(np.fft.rfft(own)) for t, own in zip(turned, (counted, summed), strict=True))
    return -0.5 * np.fft.irfft(both, PHASES)


def _differences(
    records: Sequence[tuple[Record, float]], channel: str, order: int
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """As `Differences`; empty without noise.

    Noise has as much in differences of two orders more, a motion less.
    """
    ahead = order + 2
    found, spread = {}, []
    for record, period in records:
        count, good = numbers(record.time, period), record.usable(channel)
        if len(count) <= ahead or count[-1] > SPARSE * len(count):
            continue
        rows = np.flatnonzero(np.convolve(~good, np.ones(ahead + 1), "valid") < 0.5)
        rows = rows[count[rows + ahead] - count[rows] == ahead]
        own = [np.diff(record.data[channel], n) for n in (order, order + 2)]
        found[record.name] = count[rows], own[0][rows]
        spread.append(np.column_stack([np.abs(d[rows]) for d in own]))
    values = np.concatenate([np.zeros((0, 2)), *spread])
    if len(values) < FEW:
        return {}
    noise, beyond = np.median(values, axis=0) / 0.6745 / np.sqrt([comb(2 * n, n) for n in (order, order + 2)])
    step = _least(np.concatenate([r.data[channel][r.usable(channel)] for r, _ in records]))
    if beyond < 0.5 * noise or noise < 2.0 * step / np.sqrt(12.0):
        return {}
    top = 3.0 * noise * np.sqrt(comb(2 * order, order))  # a jump is one sample
    parts = {name: (k, np.clip(d, -top, top)) for name, (k, d) in found.items() if len(d)}
    return {name: (k, d / max(float(np.sqrt(np.mean(d**2))), 1e-150)) for name, (k, d) in parts.items()}


def _least(values: np.ndarray) -> float:
    """The least difference between values, beyond rounding of a computer."""
    steps = np.diff(np.sort(values))
    return float(np.min(steps[steps > ROUNDING * float(np.max(np.abs(values)))], initial=np.inf))


def _odds_of_line(count: np.ndarray, squares: np.ndarray, ratios: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Log odds of one record for every ratio of its period to that of another clock: Rice's law over Rayleigh's."""
    long = 1 << int(np.ceil(np.log2(count[-1] + 1.0)) + 2)
    series = np.zeros(long)
    series[count.astype(int)] = squares
    power = np.abs(np.fft.rfft(series)) ** 2
    about = median_filter(power, 4 * ABOUT + 1, mode="reflect") / np.log(2.0)
    turns = ratios % 1.0
    at = np.round(np.minimum(turns, 1.0 - turns) * long).astype(int)
    line = len(squares) * share
    both = 2.0 * np.sqrt(power[at]) * line / about[at]
    return np.log(i0e(both)) + both - line**2 / about[at]


@cache
def _swelling(order: int) -> tuple[np.ndarray, np.ndarray]:
    """(ratios of periods, share of the mean square of differences that turns once a period of the other clock)."""
    ratios, phases = np.linspace(1.0 / OTHERS[1], 1.0 / OTHERS[0], 400), np.arange(PHASES) / PHASES
    powers = [_power(order, ratio) for ratio in ratios]
    return ratios, np.array([abs(np.mean(p * np.exp(-2j * np.pi * phases))) / p.mean() for p in powers])


def _power(order: int, ratio: float) -> np.ndarray:
    """Mean square of a difference of noise by straight lines, by the phase of its first sample [PHASES]."""
    phases, taps = np.arange(PHASES) / PHASES, np.diff(np.eye(order + 1), order, axis=0)[0]
    places = phases[:, None] + ratio * np.arange(order + 1)
    knots = np.arange(int(places.max()) + 2)
    weights = np.maximum(1.0 - np.abs(places[:, :, None] - knots), 0.0)  # of every sample of the other clock
    return np.sum((taps[:, None] * weights).sum(axis=1) ** 2, axis=1)
