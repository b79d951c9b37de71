"""Profile likelihood of a recording under a model: the noise of each channel, with its colour, is that of what is left.

    deviance = sum over channels of  count ln(std^2) + 3 numbers + mean_deviance

with the driving noise's ``std``, how many numbers its colour has, and what the records' means are beside their slowest
waves (`model.noise`): -2 times the logarithm of the likelihood with the noise's own parameters at their best, and
a price for them (Box, Jenkins, Time Series Analysis, ch. 7). Of a noise whose colour is known from rest only the size
is learnt (`model.rest`). Each model is judged with the noise that it leaves, so that a mismatch cannot pass as
colour of the noise of a rival.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from cable_envs.diagnosis.fit.refit import Fit, Look, Start, look, refit
from cable_envs.diagnosis.model.model import Block, Model, Whitener, learn_whitener, residuals
from cable_envs.diagnosis.model.noise import PRICE

ABOUT, SPREAD = 4, 1.5
"""Starts of the nominals' refit beside what is claimed, and how far from it, in standard deviations of the claim.

At a circuit friction and pretension trade against each other along a bent valley: from the claim alone a decoy's refit
ended 620 above the least deviance, and the difference was named as slack."""
_LOOK, _KEPT = 5, 2


@dataclass(frozen=True)
class Judged:
    """A refit with its residuals [T] by block, the noise learnt from them, and the deviance."""

    fit: Fit
    raw: tuple[np.ndarray, ...]
    whitener: Whitener
    deviance: float


def raw_residuals(model: Model, fit: Fit | Look) -> list[np.ndarray]:
    """Measured less predicted [T] of every block, in the channels' units."""
    values = np.array([[fit.values[p.name]] for p in model.parameters])
    return [r[:, 0] for r in residuals(model.blocks, model.predict(values))]


def deviance(blocks: Sequence[Block], whitener: Whitener) -> float:
    """Of residuals whose noise ``whitener`` learnt; see the module."""
    total = 0.0
    for channel, noise in whitener.noise.items():
        count = noise.counted([block.good for block in blocks if block.channel == channel])
        total += 2.0 * count * np.log(max(noise.std, 1e-300)) + PRICE * noise.numbers + noise.mean_deviance
    return float(total)


def judge(model: Model, *fits: Fit) -> list[Judged]:
    """The deviance of every refit under the noise that it leaves; all are predicted in one batch."""
    if not fits:
        return []
    values = np.array([[fit.values[p.name] for fit in fits] for p in model.parameters])
    left = residuals(model.blocks, model.predict(values))
    found = []
    for k, fit in enumerate(fits):
        raw = tuple(np.ascontiguousarray(r[:, k]) for r in left)
        whitener = learn_whitener(model.blocks, raw)
        found.append(Judged(fit, raw, whitener, deviance(model.blocks, whitener)))
    return found


def refit_and_learn(model: Model, starts: Sequence[Start], rounds: int = 2) -> Judged:
    """The best refit of ``starts``, with the noise learnt from what it leaves, the two in turns."""
    whitener = _without_colour(model, starts[0])
    for _ in range(rounds):
        best = min(refit(model, whitener, starts, central=False), key=lambda f: f.cost)
        starts = [Start(best.label, best.free, best.values)]
        whitener = learn_whitener(model.blocks, raw_residuals(model, best))
    (judged,) = judge(model, refit(model, whitener, starts, central=False)[0])
    return settled(model, judged)


def refit_nominals(model: Model, nominals: tuple[str, ...]) -> Judged:
    """The nominals refitted from several starts: from what is claimed, and from about it (a Sobol sequence).

    After a few iterations the best few go on.
    """
    claims = [p for p in model.parameters if p.name in nominals and p.std]
    starts = [Start("as claimed", nominals, {})]
    if claims:
        places = SPREAD * (2.0 * qmc.Sobol(len(claims), seed=0).random(ABOUT) - 1.0)
        for row in places.tolist():
            there = {p.name: p.clip(p.start + by * p.std) for p, by in zip(claims, row, strict=True)}
            starts.append(Start("about it", nominals, there))
        looks = look(model, _without_colour(model, starts[0]), starts, _LOOK)
        starts = [Start(f.label, nominals, f.values) for f in sorted(looks, key=lambda f: f.cost)[:_KEPT]]
    return refit_and_learn(model, starts)


def _without_colour(model: Model, start: Start) -> Whitener:
    """The size of the noise that a start leaves."""
    values = np.array([[start.values.get(p.name, p.start)] for p in model.parameters])
    return learn_whitener(model.blocks, [r[:, 0] for r in residuals(model.blocks, model.predict(values))], 0)


def settled(model: Model, judged: Judged, iterations: int = 2) -> Judged:
    """The same with residual, Jacobian and covariance under the noise that it leaves, and refitted with it."""
    again = Start(judged.fit.label, judged.fit.free, judged.fit.values)
    fit = refit(model, judged.whitener, [again], iterations)[0]
    raw = raw_residuals(model, fit)
    last = learn_whitener(model.blocks, raw)
    return Judged(fit, tuple(raw), judged.whitener, min(deviance(model.blocks, last), judged.deviance))
