"""The noise of one channel with its colour: an autoregression learnt from residuals.

    e(t) = a_1 e(t - 1) + ... + a_p e(t - p) + b_16 m_16(t) + b_32 m_32(t) + ... + std w(t),   w white with variance 1

m_k(t) is the mean of the k values before t: few numbers for the long memory of drifting zeros and 1/f noise, that no
short autoregression has (heterogeneous autoregression: Corsi, J. Fin. Econometrics 7 (2009) 174). Coefficients by least
squares (Luetkepohl, New Introduction to Multiple Time Series Analysis, 2005, ch. 3), the number of them by the deviance
with a price for each. Whitened with the right model, what is left of a residual may be treated as independent samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.fft import irfft, rfft
from scipy.signal import lfilter

from cable_envs.diagnosis.data.readings import resolution

MAX_ORDER = 8
LONG = (16, 32, 64, 128)
"""Samples of the means; each comes with all shorter ones."""
PRICE = 3.0
"""Of a coefficient, in the deviance: Akaike's is 2. Schwarz's, ln(count), leaves slow noise in that is then physics."""
WAVES, LOWER = 8, 2.0
"""Slowest waves of a record beside which its mean is held, and how much more power lies below them."""
_RECORDS = 10
"""Memories that a record must hold for a mean to be used."""


@dataclass(frozen=True)
class Noise:
    """Autoregression and the standard deviation ``std`` of what drives it (channel's unit).

    short   | coefficients [p] of the last values
    means   | of the means of the last ``LONG[0]``, ``LONG[1]``, ... values
    numbers | how many of them are free
    lift    | what a record's mean counts for beyond what the autoregression makes of it, in 1 / unit
    mean_deviance | what the means of the residuals that it was learnt from add to the deviance
    """

    short: np.ndarray
    std: float
    numbers: int = 0
    means: np.ndarray = field(default_factory=lambda: np.empty(0))
    lift: float = 0.0
    mean_deviance: float = 0.0

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Of every lag [order]."""
        lags = np.zeros(self.order)
        lags[: len(self.short)] = self.short
        for width, share in zip(LONG, self.means, strict=False):
            lags[:width] += share / width
        return lags

    @property
    def order(self) -> int:
        """The longest lag, samples."""
        return max([len(self.short), *LONG[: len(self.means)]])

    def whiten(self, series: np.ndarray) -> np.ndarray:
        """Series [T] or [T, n] as w; the first ``order`` samples, that have no whole past, are 0."""
        taps = np.r_[1.0, -self.short] / self.std
        white = taps[0] * series
        for lag, tap in enumerate(taps[1:], start=1):
            white[lag:] += tap * series[:-lag]
        if len(self.means):
            sums = np.concatenate([np.zeros_like(series[:1]), np.cumsum(series, axis=0)])
            now, end = slice(self.order, len(series)), len(series)
            for width, share in zip(LONG, self.means, strict=False):
                past = sums[now] - sums[self.order - width : end - width]
                white[now] -= share / (width * self.std) * past
        white[: self.order] = 0.0
        return white

    def flat(self, series: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Series [T] or [T, n] whitened; samples that do not count (good [T]), or lack a past (`with_past`), are 0."""
        white = self.whiten(bridged(series, good))
        if self.lift and good.any():
            white = white + self.lift * series[good].mean(axis=0)
        ready = with_past(good, len(self.short), self.order)
        return white * ready.reshape(-1, *[1] * (series.ndim - 1))

    def counted(self, goods: Sequence[np.ndarray]) -> int:
        """Samples of records on which it is learnt (`with_past`)."""
        longest = memory([len(good) for good in goods])
        return sum(int(np.count_nonzero(with_past(good, MAX_ORDER, longest))) for good in goods)

    def simulate(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """``count`` samples of this noise, after 1000 that are thrown away."""
        drive = rng.normal(0.0, self.std, count + 1000)
        return lfilter([1.0], np.r_[1.0, -self.coefficients], drive)[1000:]

    def of_mean(self, width: int) -> float:
        """Standard deviation of the mean of ``width`` samples in a row."""
        shape = np.r_[1.0, -self.coefficients]
        response = lfilter(np.ones(width) / width, shape, np.r_[1.0, np.zeros(4999)])
        return float(self.std * np.sqrt(np.sum(response**2)))

    @property
    def floor(self) -> float:
        """Standard deviation of the coloured noise itself, over all time."""
        return float(self.std * np.sqrt(np.sum(self._response(10_000) ** 2)))

    def within(self, count: int) -> float:
        """Standard deviation of ``count`` samples in a row about their own mean, as one record shows it.

        Noise that wanders over more than a record is far larger over all time. By the variogram g of the noise the
        variance is the mean of g(i - j) over all pairs of samples: g keeps its digits where the variance does not.
        """
        most = max(2 * count, 10_000)
        response = self._response(most)
        power = np.abs(rfft(response, 2 * most)) ** 2
        shared = irfft(power, 2 * most)[:count]
        lags = np.arange(count)
        # a response that has not died out goes on behind its end, and does not fall to 0 there
        ended = np.concatenate([[0.0], np.cumsum(response[::-1] ** 2)[: count - 1]])
        pairs = 2.0 * (1.0 - lags / count) / count
        return float(self.std * np.sqrt(max(float(pairs @ (shared[0] - shared - 0.5 * ended)), 0.0)))

    def _response(self, count: int) -> np.ndarray:
        """Of the noise to one unit of what drives it, over ``count`` samples."""
        return lfilter([1.0], np.r_[1.0, -self.coefficients], np.r_[1.0, np.zeros(count - 1)])


def with_past(good: np.ndarray, short: int, longest: int) -> np.ndarray:
    """Samples [T] that an autoregression predicts: good, as the last ``short`` are, and ``longest`` after the first.

    The means of longer pasts hardly change where straight lines stand for lost samples (`bridged`), and where a past
    had to be whole, one row in a hundred that is lost would take three quarters of all samples with it.
    """
    ready = np.convolve(~good, np.ones(short + 1))[: len(good)] < 0.5
    ready[: int(np.argmax(good)) + longest] = False
    return ready


def bridged(series: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Series [T] or [T, n] with straight lines over samples that are not good [T]."""
    if good.all():
        return series
    if not good.any():
        return np.zeros_like(series)
    places, bad = np.flatnonzero(good), np.flatnonzero(~good)
    at = np.interp(bad, places, np.arange(len(places)))
    low = at.astype(int)
    high, part = np.minimum(low + 1, len(places) - 1), at - low
    part = part.reshape(-1, *[1] * (series.ndim - 1))
    found = series.copy()
    found[bad] = (1.0 - part) * series[places[low]] + part * series[places[high]]
    return found


def jitter(values: np.ndarray, step: float = 0.0) -> float:
    """About the standard deviation of white noise on samples [T] of a motion that is sampled well, in their unit.

    From third differences, of which the motion has next to nothing, by their median: jumps do not count. At least what
    the resolution makes, or the ``step`` of readings that were brought to another clock since; never 0.
    """
    third = np.diff(values, 3)
    spread = float(np.median(np.abs(third))) / 0.6745 / np.sqrt(20.0) if len(third) else 0.0
    coarse = max(step, resolution(values)) / np.sqrt(12.0)
    return max(spread, coarse, 1e-9 * float(np.max(np.abs(values), initial=0.0)), 1e-300)


def memory(lengths: Sequence[int], max_order: int = MAX_ORDER) -> int:
    """Longest past, samples, that records of these lengths can show."""
    usable = [k for k in LONG if k * _RECORDS <= max(lengths, default=0)] if max_order == MAX_ORDER else []
    return max(usable, default=max_order)


def learn_noise(residuals: Sequence[np.ndarray], max_order: int = MAX_ORDER) -> Noise:
    """The noise of residuals [T] of several records; NaN marks samples that do not count.

    All orders are compared on the same samples. Raises ValueError where fewer than ten times ``max_order`` are usable.
    """
    longest = memory([len(r) for r in residuals], max_order)
    widths = [k for k in LONG if k <= longest and max_order == MAX_ORDER]
    columns, nows = [], []
    for residual in residuals:
        good = np.isfinite(residual)
        whole, rows = bridged(residual, good), np.flatnonzero(with_past(good, max_order, longest))
        sums = np.cumsum(np.r_[0.0, whole])
        lags = [whole[rows - k] for k in range(1, max_order + 1)]
        columns.append(np.reshape([*lags, *((sums[rows] - sums[rows - k]) / k for k in widths)], (-1, len(rows))).T)
        nows.append(whole[rows])
    past, now = np.concatenate(columns), np.concatenate(nows)
    count = len(now)
    if count < 10 * max(max_order, 1):
        raise ValueError(f"{count} usable samples in a row do not show the noise; {10 * max(max_order, 1)} would")
    best = (np.inf, np.empty(0), 0.0)
    gram, cross, power = past.T @ past, past.T @ now, float(now @ now)
    for order in range(past.shape[1] + 1):
        size = np.sqrt(np.maximum(np.diag(gram)[:order], 1e-300))
        scaled = gram[:order, :order] / np.outer(size, size)
        found = np.linalg.lstsq(scaled, cross[:order] / size, rcond=1e-12)[0] / size
        variance = max((power - float(found @ cross[:order])) / count, 1e-300)
        score = count * np.log(variance) + PRICE * order
        if score < best[0]:
            best = (score, found, np.sqrt(variance))
    noise = Noise(best[1][:max_order], float(best[2]), len(best[1]), best[1][max_order:])
    return _with_means(noise, residuals) if max_order == MAX_ORDER and noise.numbers else noise


def _with_means(noise: Noise, residuals: Sequence[np.ndarray]) -> Noise:
    """The same with what the records' means tell beside their slowest waves (Student's t of a mean).

    Power densities, unit^2 per sample: of the waves, of the autoregression at frequency 0, of each record's mean.
    """
    waves, means = zip(*(_slowest(r) for r in residuals), strict=True)
    freedom = sum(len(w) for w in waves)
    slow = LOWER * sum(float(w.sum()) for w in waves) / max(freedom, 1)
    taken = noise.std**2 / max((1.0 - float(np.sum(noise.coefficients))) ** 2, 1e-300)
    if not 0.0 < slow < taken:
        return noise
    lift = 1.0 / np.sqrt(slow) - 1.0 / np.sqrt(taken)
    mean_deviance = (1.0 - slow / taken) * (freedom + len(means)) * np.log1p(sum(means) / (freedom * slow))
    return replace(noise, lift=float(lift), mean_deviance=float(mean_deviance))


def _slowest(residual: np.ndarray) -> tuple[np.ndarray, float]:
    """Power density of a record's `WAVES` slowest waves, each of two numbers, and of its mean."""
    good = np.isfinite(residual)
    count = int(good.sum())
    if count < 10 * WAVES:
        return np.empty(0), 0.0
    mean = float(residual[good].mean())
    spectrum = np.fft.rfft(np.where(good, residual - mean, 0.0))[1 : WAVES + 1]
    return np.repeat(np.abs(spectrum) ** 2 / count, 2), count * mean**2
