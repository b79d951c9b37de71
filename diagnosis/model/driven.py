"""The noise of a recorded position that drives the simulator, in what the simulator predicts.

    u_used = H u_recorded,   u_recorded = u + e_u,   y = f(u) + e_y
    y - f(u_used) = e_y - f' (H e_u - (1 - H) u)   to first order

H smooths. Its input error has the part of the noise that passes, and what is lost of the motion. Both spectra are
known: with P, the power of what smoothing takes away, that of the input error is

    S = |H|^2 S_e + max(P - |1 - H|^2 S_e, 0)

Through the simulator it becomes a noise of every output, with a colour: of a spring k times the error's covariance.
Whatever the simulator is, a few drawn errors that are added to its input show that covariance (Monte Carlo). With that
of the sensor itself it whitens the output, as a noise known from a record at rest does (`model.rest`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter
from scipy.signal.windows import parzen

from cable_envs.diagnosis.data.readings import resolution
from cable_envs.diagnosis.model.model import Block, Model
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.model.rest import LONGEST, RestNoise, known_by

WIDTHS = (5, 7, 9, 11, 15, 21, 31, 41)
"""Samples over which a position may be smoothed by cubics; four or fewer these leave as they are."""
DRAWS = 4
"""Errors that are drawn for every record: of three records of 2000 samples a covariance is then known to 1 %."""
BANDS = 24
"""Of the spectrum of what is lost of the motion, alike in width: a periodogram by itself scatters as much as it is."""
DENSITIES = 2049
"""Frequencies, from 0 to half a sample's, at which a power density is given."""


@dataclass(frozen=True)
class Recorded:
    """A recorded position that drives a simulator.

    channel | of the drive
    values  | as recorded [T], on an even clock
    noise   | standard deviation of the noise of its samples
    width   | samples over which it is smoothed
    """

    channel: str
    values: np.ndarray
    noise: float
    width: int

    def smoothed(self, period: float) -> tuple[np.ndarray, np.ndarray]:
        """(position, speed), each [T]: what the simulator is driven by."""
        return by_cubics(self.values, self.width, period)

    def taken(self) -> np.ndarray:
        """What smoothing takes away [T]."""
        return self.values - self.smoothed(1.0)[0]

    def sudden(self) -> np.ndarray:
        """Where [T] the drive starts or stops within samples, so that between them nobody knows where it is.

        There smoothing takes more away than the largest of T samples of noise, sqrt(2 ln T) standard deviations. So
        does every sample as near as it smooths over.
        """
        if len(self.values) < self.width:
            return np.zeros(len(self.values), dtype=bool)
        kernel = -savgol_coeffs(self.width, 3)
        kernel[self.width // 2] += 1.0
        most = self.noise * float(np.linalg.norm(kernel)) * np.sqrt(2.0 * np.log(len(self.values)))
        return maximum_filter1d(np.abs(self.taken()), 2 * self.width + 1) > most


def by_cubics(values: np.ndarray, width: int, period: float) -> tuple[np.ndarray, np.ndarray]:
    """(values, their rate), each [T], by cubics over ``width`` samples; shorter series stay as they are.

    Savitzky and Golay, Anal. Chem. 36 (1964) 1627.
    """
    if len(values) < width:
        return values.copy(), np.gradient(values, period)
    return savgol_filter(values, width, 3), savgol_filter(values, width, 3, deriv=1, delta=period)


class Driven(Protocol):
    """A model whose simulator is driven by recorded positions."""

    blocks: list[Block]
    period: float

    def driven_by(self) -> Sequence[Recorded]:
        """Of every record, in the order of `answers`; none where the simulator is told a command."""
        ...

    def answers(
        self, values: Mapping[str, float], errors: Sequence[np.ndarray], rates: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Changes [T, n] of every block's prediction with errors of the drive's position and speed, each [T, n]."""
        ...


def drives_of(model: Model) -> list[Recorded]:
    """The recorded positions that drive a simulator, of every record; none where it is told a command."""
    return list(model.driven_by()) if hasattr(model, "driven_by") else []


def noise_of_samples(parts: Sequence[np.ndarray], stated: float | None) -> float:
    """Standard deviation of the noise of a channel's samples [T]: as stated, with what its steps make; else as seen."""
    if stated is None:
        return float(np.median([jitter(p) for p in parts]))
    return float(np.hypot(stated, max(resolution(p) for p in parts) / np.sqrt(12.0)))


def best_width(parts: Sequence[np.ndarray], noise: float) -> int:
    """Samples, one number for all records [T], over which smoothing leaves the least error of the position.

    With the noise's standard deviation s and the weight h of the middle sample, the mean square of what smoothing takes
    away plus (2 h - 1) s^2 is an unbiased estimate of the mean square error (Mallows, Technometrics 15 (1973) 661).
    """
    parts = [p for p in parts if len(p) > max(WIDTHS)]

    def risk(width: int) -> float:
        taken = np.concatenate([p - savgol_filter(p, width, 3) for p in parts])
        return float(np.mean(taken**2)) + 2.0 * noise**2 * float(savgol_coeffs(width, 3)[width // 2])

    return min(WIDTHS, key=risk) if parts else WIDTHS[0]


def error_density(drives: Sequence[Recorded], noise: float | np.ndarray) -> np.ndarray:
    """Power density S of the input error of the module, at `DENSITIES` frequencies.

    Parameters
    ----------
    drives : sequence of Recorded
        Of all records.
    noise : float or ndarray
        Standard deviation of the recorded position's noise, which is white; or its density at these frequencies.

    Returns
    -------
    ndarray
        Motion is lost in the bands where more is taken away than of noise alone in the largest of `BANDS`.
    """
    width = drives[0].width
    kernel = np.zeros(2 * DENSITIES - 2)
    kernel[:width] = savgol_coeffs(width, 3)
    passed = np.fft.rfft(np.roll(kernel, -(width // 2))).real
    own = np.broadcast_to(np.square(noise) if np.isscalar(noise) else noise, passed.shape)
    taken = [np.where(d.sudden(), 0.0, d.taken()) for d in drives if len(d.values) > 4 * BANDS]
    if not taken:
        return passed**2 * own
    band = np.minimum(np.arange(len(passed)) * BANDS // len(passed), BANDS - 1)
    power, count = np.zeros(BANDS), np.zeros(BANDS)
    for series in taken:
        periodogram = np.abs(np.fft.rfft(series)) ** 2 / max(np.count_nonzero(series), 1)
        at = np.minimum(np.arange(len(periodogram)) * BANDS // len(periodogram), BANDS - 1)
        power += np.bincount(at, periodogram, BANDS)
        count += np.bincount(at, minlength=BANDS)
    of_noise = np.bincount(band, (1.0 - passed) ** 2 * own, BANDS) / np.bincount(band, minlength=BANDS)
    more, chance = power / count - of_noise, of_noise * np.sqrt(2.0 * np.log(BANDS) / count)
    lost = np.where(more > chance, more, 0.0)
    return passed**2 * own + lost[band]


def drawn(density: np.ndarray, count: int, draws: int, period: float, rng: np.random.Generator) -> np.ndarray:
    """Errors of a position and of its speed [2, count, draws] with a power density at even frequencies."""
    size = count + count % 2
    f = np.fft.rfftfreq(size)
    root = np.sqrt(np.interp(f, np.linspace(0.0, 0.5, len(density)), density))
    waves = np.fft.rfft(rng.normal(size=(size, draws)), axis=0) * root[:, None]
    turn = 2j * np.pi * f[:, None] / period
    turn[-1] = 0.0
    return np.fft.irfft(np.stack([waves, turn * waves]), size, axis=1)[:, :count]


def passed_on(
    model: Driven, values: Mapping[str, float], density: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Autocovariance [LONGEST + 1] of what the input error makes of every channel.

    Parameters
    ----------
    model : Driven
        The simulator.
    values : mapping of str to float
        At which it is asked, SI.
    density : ndarray
        Of the input error (`error_density`).
    rng : numpy.random.Generator
        Of the errors.
    """
    errors, rates = [], []
    for drive in model.driven_by():
        error, rate = drawn(density, len(drive.values), DRAWS, model.period, rng)
        errors.append(error)
        rates.append(rate)
    sums: dict[str, np.ndarray] = {}
    counts: dict[str, int] = {}
    for block, change in zip(model.blocks, model.answers(values, errors, rates), strict=True):
        begin = int(np.argmax(block.good))
        series = change[begin:] - change[begin:].mean(axis=0)
        spectrum = np.sum(np.abs(np.fft.rfft(series, 2 * len(series), axis=0)) ** 2, axis=1)
        lags = np.fft.irfft(spectrum)[: min(LONGEST + 1, len(series))]
        sums.setdefault(block.channel, np.zeros(LONGEST + 1))[: len(lags)] += lags
        counts[block.channel] = counts.get(block.channel, 0) + series.size
    taper = parzen(2 * LONGEST + 1)[LONGEST:]  # whose spectrum is nowhere negative, so that no power becomes so
    return {channel: taper * total / counts[channel] for channel, total in sums.items()}


def with_input(own: float | RestNoise, passed: np.ndarray) -> RestNoise:
    """The noise of an output: its sensor's, white of a standard deviation or known from rest, and what is passed on."""
    covariance = passed.copy()
    if isinstance(own, RestNoise):
        covariance += own.covariance
    else:
        covariance[0] += own**2
    return replace(known_by(covariance), lines=own.lines if isinstance(own, RestNoise) else ())
