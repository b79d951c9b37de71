"""Optima of refits: of all records where some were fitted, and of models that larger ones hold."""

from collections.abc import Sequence

import numpy as np

from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.model import Model, Whitener

FARTHER, MORE = 1.0, 3
"""Half the fall of the sum of squares that a step on all records promises beside the refit of some of them, from which
their own optimum is looked for, and the iterations to that."""
AFRESH = 10
"""Iterations of a model that begins again where a smaller one is."""
TOGETHER = 6
"""Models whose optima of all records are looked for at a time: their slopes take memory twice."""


def nested(model: Model, whitener: Whitener, fits: Sequence[Fit]) -> list[Fit]:
    """Refits of models that hold each other, each at least as good as where the others are.

    A smaller model that is worse than a larger one makes it, without what that has more, may have left a valley. A
    larger one that is worse than a smaller one has come from another valley: it begins again where the smaller one is.
    """
    found, of, starts = list(fits), [], []
    for k, own in enumerate(fits):
        larger = [other for other in fits if set(own.free) < set(other.free)]
        if larger:
            best = min(larger, key=lambda other: other.cost)
            of.append(k)
            starts.append(Start(own.label, own.free, {n: best.values[n] for n in own.free}))
    _take_better(found, of, refit(model, whitener, starts, MORE, central=False) if starts else ())
    of, starts = [], []
    for k, own in enumerate(found):
        smaller = [other for other in found if set(other.free) < set(own.free)]
        best = min(smaller, key=lambda other: other.cost, default=own)
        if best.cost < own.cost:
            there = {n: best.values[n] for n in own.free}
            more = {n: own.values[n] for n in own.free if n not in best.free}
            of += [k, k]
            starts += [Start(own.label, own.free, there), Start(own.label, own.free, {**there, **more})]
    _take_better(found, of, refit(model, whitener, starts, AFRESH, central=False) if starts else ())
    return found


def _take_better(found: list[Fit], of: Sequence[int], others: Sequence[Fit]) -> None:
    """Put refits in the place of those of the same models, by number, where they are better."""
    for k, new in zip(of, others, strict=True):
        found[k] = new if new.cost < found[k].cost else found[k]


def peaks(joint: Joint, whitener: Whitener, fits: Sequence[Fit]) -> list[Fit]:
    """Refits of some records, expanded about the optimum of all of them where that is elsewhere."""
    found: list[Fit] = []
    for first in range(0, len(fits), TOGETHER):
        starts = [Start("", f.free, f.values) for f in fits[first : first + TOGETHER]]
        some = refit(joint, whitener, starts, 0, central=False)
        far = [k for k, f in enumerate(some) if _promised(joint, f) > FARTHER]
        moved = refit(joint, whitener, [starts[k] for k in far], MORE, central=False) if far else []
        _take_better(some, far, moved)
        found += some
    return nested(joint, whitener, found)


def _promised(joint: Joint, fit: Fit) -> float:
    """Half the fall of the cost that a Gauss-Newton step promises."""
    gradient = _gradient(joint, fit)
    return 0.5 * float(gradient @ fit.covariance @ gradient)


def _gradient(joint: Joint, fit: Fit) -> np.ndarray:
    """Of half the cost, with priors, downhill [free]."""
    rows = {p.name: p for p in joint.parameters}
    gradient = fit.jacobian.T @ fit.residual
    for k, name in enumerate(fit.free):
        p = rows[name]
        if p.std:
            gradient[k] -= (fit.values[name] - p.start) / p.std**2
    return gradient
