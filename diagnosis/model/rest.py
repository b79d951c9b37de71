"""The noise of sensors from a record at rest: what moves while nothing does is noise, and no mismatch can be in it.

A noise that is learnt from what a model leaves takes slow mismatches for its own colour (`model.noise`). A record
at rest (``use: rest``) tells the colour beforehand; only its size is then taken from what is left. The spectrum is that
of sensors (IEEE Std 952, annex C: white noise, an exponentially correlated part, flicker),

    S(f) = white + marked (1 - rho^2) / |1 - rho exp(-2 pi i f)|^2 + flicker / f,   f in cycles per sample,

by Whittle's likelihood (Beran, Statistics for Long-Memory Processes, 1994, ch. 6), times the response of an
autoregression where this leaves a colour (hum, resonances). Below half a wave over the records that it is for it is
taken as flat: sensors are zeroed before a record, and their zero wanders no more from record to record than within one
(else `offset_free` says so). Predictors of every order up to `LONGEST` follow from its autocovariance (Durbin and
Levinson; Brockwell, Davis, Time Series, 1991, sec. 5.2), so that a record is whitened from its first sample on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import minimize
from scipy.signal import lfilter, oaconvolve

from cable_envs.diagnosis.model.noise import Noise, bridged, learn_noise

LONGEST = 512
"""Samples of the past that predict the next."""
FEWEST = 2000
"""Samples of a record at rest: fewer do not tell a colour."""
MEMORIES = (0.5, 0.7, 0.8, 0.87, 0.92, 0.95, 0.97, 0.985)
"""Values of rho that are tried."""
COARSE = 2.0
"""Standard deviations at rest that a sensor's step may have: what a larger one adds depends on the motion."""
SHORT = 6
"""Coefficients of the autoregression, at most."""
ABOUT = 40
"""Powers to either side of a line that it is held against."""
LINE = 1e-3
"""Chance of a line where there is none."""
_BANDS = 60
_GRID = 2**17


@dataclass(frozen=True)
class RestNoise:
    """Noise with a known colour, as `cable_envs.diagnosis.model.noise.Noise` is used.

    start      | [order, order] lower triangle: the first samples whitened, each with all before it
    taps       | [order + 1] filter of all later ones
    covariance | [order + 1] of lags 0 and up, at rest
    std        | standard deviation over that at rest
    lines      | frequencies of steady tones at rest, cycles per sample: hum
    """

    start: np.ndarray
    taps: np.ndarray
    covariance: np.ndarray
    std: float = 1.0
    numbers: int = 0
    mean_deviance: float = 0.0
    lines: tuple[float, ...] = ()

    @property
    def floor(self) -> float:
        """Standard deviation at rest."""
        return float(np.sqrt(self.covariance[0]))

    def within(self, count: int) -> float:
        """As `Noise.within`: that of the record at rest, of whatever length."""
        return self.floor

    def of_mean(self, width: int) -> float:
        """Standard deviation of the mean of ``width`` samples in a row, up to the order."""
        lags = np.arange(1, min(width, len(self.covariance)))
        total = width * self.covariance[0] + 2.0 * float((width - lags) @ self.covariance[lags])
        return self.std * float(np.sqrt(total)) / width

    def whiten(self, series: np.ndarray) -> np.ndarray:
        """Series [T] or [T, n] as independent samples of variance 1 (of ``std`` times the level at rest)."""
        columns = series.reshape(len(series), -1)
        first = min(len(self.start), len(columns))
        white = np.empty(columns.shape)
        white[:first] = self.start[:first, :first] @ columns[:first]
        if len(columns) > first:
            white[first:] = oaconvolve(columns, self.taps[:, None], axes=0)[first : len(columns)]
        return white.reshape(series.shape) / self.std

    def flat(self, series: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Series [T] or [T, n] whitened, with straight lines over samples that do not count (good [T]), which are 0."""
        return self.whiten(bridged(series, good)) * good.reshape(-1, *[1] * (series.ndim - 1))

    def density(self, count: int) -> np.ndarray:
        """Power density at so many frequencies [count] from 0 to half a sample's: that of the longest predictor."""
        return self.std**2 / np.abs(np.fft.rfft(self.taps, 2 * count - 2)) ** 2

    def simulate(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """So many samples [count] in a row of the noise, after as many as it remembers."""
        white = rng.normal(size=count + 4 * len(self.taps)) * self.std
        return lfilter([1.0], self.taps, white)[-count:]

    def counted(self, goods: Sequence[np.ndarray]) -> int:
        """Samples of records by which its size is known."""
        return sum(int(good.sum()) for good in goods)

    def sized(self, residuals: Sequence[np.ndarray]) -> "RestNoise":
        """The same colour at the size of residuals [T] of several records; NaN marks samples that do not count."""
        alone = replace(self, std=1.0)
        squares, count = 0.0, 0
        for residual in residuals:
            good = np.isfinite(residual)
            if good.any():
                squares += float(np.sum(alone.whiten(bridged(residual, good))[good] ** 2))
                count += int(good.sum())
        return replace(self, std=float(np.sqrt(max(squares / max(count, 1), 1e-300))))


def noise_at_rest(values: np.ndarray, step: float = 0.0, longest: int | None = None) -> RestNoise | None:
    """The noise of a channel from its samples [T] at rest, on an even clock; None where it has none above a step.

    step: of the sensor; what rounding makes of a motion it does not make of a rest: an encoder between two counts shows
    nothing. longest: samples of the records that it is for; None: as many as here. Raises ValueError for fewer than
    `FEWEST` samples.
    """
    if len(values) < FEWEST:
        raise ValueError(f"{len(values)} samples at rest do not show the noise's colour; {FEWEST} would")
    if np.ptp(values) == 0.0 or step > COARSE * np.std(values):
        return None
    moved = values - values.mean()
    power = np.abs(np.fft.rfft(moved))[1 : (len(moved) + 1) // 2] ** 2 / len(moved)
    own = np.arange(1, len(power) + 1) / len(moved)
    f = np.maximum(np.arange(_GRID // 2 + 1) / _GRID, 0.5 / min(longest or len(values), len(values)))
    slow = _spectrum(power)
    first = _known(slow(f))
    lines = lines_of(own, power)
    hum = learn_noise([first.whiten(moved)], SHORT)
    if not len(hum.short):
        return replace(first, lines=lines)
    return replace(_known(_spectrum(power / _response(own, hum))(f) * _response(f, hum)), lines=lines)


def lines_of(f: np.ndarray, power: np.ndarray) -> tuple[float, ...]:
    """Frequencies of the lines in a periodogram [n] at frequencies f [n] above 0, in the unit of these.

    A power is held against the median of those about it. Under noise it is exponential, whatever the colour, and the
    largest of n passes `LINE` once in 1 / `LINE` rests.
    """
    if len(power) <= 2 * ABOUT:
        return ()
    over = power * np.log(2.0) / np.maximum(median_filter(power, 2 * ABOUT + 1, mode="reflect"), 1e-300)
    k = ABOUT + np.flatnonzero(over[ABOUT:] > np.log(len(power) / LINE))  # below, a colour's slope is steep
    return tuple(f[k].tolist())


def _known(density: np.ndarray) -> RestNoise:
    return known_by(np.fft.irfft(density)[: LONGEST + 1])


def known_by(covariance: np.ndarray) -> RestNoise:
    """The noise with an autocovariance [LONGEST + 1], of lags 0 and up."""
    start, taps = _predictors(covariance)
    return RestNoise(start, taps, covariance)


def _response(f: np.ndarray, noise: Noise) -> np.ndarray:
    """Power of an autoregression at frequencies, cycles per sample, for a driving noise of variance 1."""
    turn = np.exp(-2j * np.pi * np.outer(f, np.arange(1, len(noise.short) + 1)))
    return 1.0 / np.abs(1.0 - turn @ noise.short) ** 2


def _marked(f: np.ndarray, rho: float) -> np.ndarray:
    return (1.0 - rho**2) / np.abs(1.0 - rho * np.exp(-2j * np.pi * f)) ** 2


def _spectrum(power: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """S of the module as a function of f, by the sizes that make a periodogram [n] without its mean likeliest."""
    count = len(power)
    f = np.arange(1, count + 1) / (2.0 * count + 1.0)
    edges = np.unique(np.round(np.geomspace(1, count + 1, _BANDS)).astype(int)) - 1
    many = np.diff(np.r_[edges[:-1], count])
    seen = np.add.reduceat(power, edges[:-1]) / many
    seen = np.maximum(seen, 1e-12 * seen.max())
    low, high = np.log(1e-6 * seen.min()), np.log(3.0 * seen.max())
    found = []
    for rho in MEMORIES:
        shapes = np.add.reduceat(np.array([np.ones(count), _marked(f, rho), 1.0 / f]), edges[:-1], axis=1) / many
        sizes = shapes.mean(axis=1)

        def cost(logs: np.ndarray, shapes=shapes / sizes[:, None]) -> tuple[float, np.ndarray]:
            parts = np.exp(logs)
            density = parts @ shapes
            slope = many * (1.0 / density - seen / density**2)
            return float(np.sum(many * (np.log(density) + seen / density))), parts * (shapes @ slope)

        for shares in ((0.6, 0.3, 1e-3), (0.6, 0.05, 0.35)):
            begin = np.clip(np.log(seen.mean() * np.array(shares)), low, high)
            end = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=[(low, high)] * 3)
            found.append((float(end.fun), rho, np.exp(end.x) / sizes))
    _, rho, (white, marked, flicker) = min(found, key=lambda one: one[0])
    return lambda f: white + marked * _marked(f, rho) + flicker / f


def _predictors(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(`RestNoise.start`, `RestNoise.taps`) of an autocovariance [order + 1], by Durbin's recursion."""
    order = len(covariance) - 1
    start = np.zeros((order, order))
    past = np.empty(0)
    error = float(covariance[0])
    for k in range(order + 1):
        row = np.r_[-past[::-1], 1.0] / np.sqrt(error)
        if k == order:
            return start, row[::-1].copy()
        start[k, : k + 1] = row
        reflection = (covariance[k + 1] - past @ covariance[k:0:-1]) / error if k else covariance[1] / error
        past = np.r_[past - reflection * past[::-1], reflection]
        error *= 1.0 - reflection**2
    raise AssertionError("the loop ends at the last order")


AnyNoise = Noise | RestNoise
"""What whitens a channel."""
