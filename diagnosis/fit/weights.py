"""Refits where what is left is the model's own error, not the sensors' noise: weights of channels, honest intervals.

A model's error repeats with the motion: it is no stationary noise, and no autoregression of it leaves independent
samples. So every channel counts by the size of its residual and by its effective sample size, the two in turns with the
refit (iteratively reweighted least squares), and the covariance of a refit is found from the parts of the records
themselves (`with_sandwich_covariance`): whatever the weights are, it holds for errors that are independent from part to
part.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from cable_envs.core.intervals import NORMAL_95
from cable_envs.diagnosis.fit.likelihood import raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.model import Block, Model, Whitener
from cable_envs.diagnosis.model.noise import Noise

ROUNDS = 2
PARTS, EACH = 12, 3
"""Parts into which all records together are cut, at least, and for every free parameter."""


def weigh(blocks: Sequence[Block], series: Sequence[np.ndarray]) -> Whitener:
    """Every channel by its RMS times the root of its autocorrelation time.

    The sum goes to the first negative autocorrelation of the channel that is slower, and holds for both: else a channel
    that is wrong by a constant would count for nothing. No sample is coloured.
    """
    sizes, slowest = {}, 1.0
    for channel in dict.fromkeys(b.channel for b in blocks):
        parts = [np.where(b.good, s, 0.0) for b, s in zip(blocks, series, strict=True) if b.channel == channel]
        count = sum(int(b.good.sum()) for b in blocks if b.channel == channel)
        sizes[channel] = max(float(np.sqrt(sum(float(p @ p) for p in parts) / max(count, 1))), 1e-12)
        slowest = max(slowest, autocorrelation_time(parts))
    return Whitener({channel: Noise(np.empty(0), size * float(np.sqrt(slowest))) for channel, size in sizes.items()})


def autocorrelation_time(parts: Sequence[np.ndarray]) -> float:
    """Integrated autocorrelation time of series [T], samples: 1 + 2 sum of autocorrelations up to the first negative.

    A series of n samples has the effective sample size n over this (Sokal, Monte Carlo Methods in Statistical
    Mechanics, 1997): so many independent ones would tell as much of its mean.
    """
    longest = max(len(p) for p in parts)
    total = np.zeros(longest)
    for part in parts:
        spectrum = np.abs(np.fft.rfft(part, 2 * longest)) ** 2
        total += np.fft.irfft(spectrum)[:longest]
    if not total[0] > 0.0:
        return 1.0
    negative = np.flatnonzero(total < 0.0)
    end = int(negative[0]) if len(negative) else longest
    return float(1.0 + 2.0 * np.sum(total[1:end]) / total[0])


def rmse(model: Model, fit: Fit) -> dict[str, float]:
    """Root mean square of measured less predicted by channel, SI."""
    return rms_by_channel(model, raw_residuals(model, fit))


def effective_samples(model: Model, fit: Fit) -> float:
    """Effective sample size of a model's records, by what a fit leaves in them."""
    parts: dict[str, list[np.ndarray]] = {}
    for block, left in zip(model.blocks, raw_residuals(model, fit), strict=True):
        parts.setdefault(block.channel, []).append(np.where(block.good, left, 0.0))
    slowest = max(autocorrelation_time(own) for own in parts.values())
    return sum(int(b.good.sum()) for b in model.blocks) / slowest


def rms_by_channel(model: Model, series: Sequence[np.ndarray]) -> dict[str, float]:
    """Root mean square of the good samples of series [T] of every block, by channel."""
    squares: dict[str, list[np.ndarray]] = {}
    for block, left in zip(model.blocks, series, strict=True):
        squares.setdefault(block.channel, []).append(left[block.good] ** 2)
    return {channel: float(np.sqrt(np.mean(np.concatenate(parts)))) for channel, parts in squares.items()}


def reweighted_refit(model: Model, start: Start, rounds: int = ROUNDS) -> tuple[Fit, Whitener]:
    """A refit with the channels weighed by what it leaves, the two in turns, and the noise that it then leaves.

    Its covariance is that of `with_sandwich_covariance`.
    """
    values = np.array([[start.values.get(p.name, p.start)] for p in model.parameters])
    left = [b.measured - p[:, 0] for b, p in zip(model.blocks, model.predict(values), strict=True)]
    whitener = weigh(model.blocks, left)
    for _ in range(rounds):
        fit = _converged(model, whitener, start)
        start = Start(fit.label, fit.free, fit.values)
        whitener = weigh(model.blocks, raw_residuals(model, fit))
    return with_sandwich_covariance(model, fit), whitener


def _converged(model: Model, whitener: Whitener, start: Start) -> Fit:
    """Refits from where the last one ended, until one gains nothing: friction's kinks stop a single one early."""
    fit = refit(model, whitener, [start])[0]
    for _ in range(4):
        again = refit(model, whitener, [Start(fit.label, fit.free, fit.values)])[0]
        gain, fit = fit.cost - again.cost, again
        if gain < 1e-2:
            break
    return fit


def with_sandwich_covariance(model: Model, fit: Fit) -> Fit:
    """The fit with a covariance from parts of the records: the cluster-robust sandwich estimator.

    H^-1 (sum of g g') H^-1 over the parts, with g the part's gradient and H the normal matrix (Liang, Zeger, Biometrika
    73 (1986) 13), times parts / (parts - free) and Student's quantile over 1.96, since parts are few. Curvature stays
    where no part shows a parameter, and all of it where there are fewer parts than parameters.
    """
    place = _parts(model.blocks, max(PARTS, EACH * len(fit.free)))
    count, free = int(place.max()) + 1, len(fit.free)
    if count <= free + 1:
        return fit
    gradients = np.zeros((count, free))
    np.add.at(gradients, place, fit.jacobian * fit.residual[:, None])
    few = count / (count - free) * (float(student.ppf(0.975, count - 1)) / NORMAL_95) ** 2
    spread = fit.covariance @ (gradients.T @ gradients) @ fit.covariance * few
    unseen = ~np.any(fit.jacobian != 0.0, axis=0)
    spread[unseen] = fit.covariance[unseen]
    spread[:, unseen] = fit.covariance[:, unseen]
    return replace(fit, covariance=spread)


def _parts(blocks: Sequence[Block], least: int) -> np.ndarray:
    """Number of the part of every sample [samples of all blocks]: records in equal lengths, their channels together."""
    records = list(dict.fromkeys(b.record for b in blocks))
    each = -(-least // len(records))
    found = []
    for block in blocks:
        inside = np.cumsum(block.good) / max(int(block.good.sum()), 1)
        found.append(each * records.index(block.record) + np.minimum((each * inside).astype(int), each - 1))
    return np.concatenate(found)
