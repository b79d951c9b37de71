"""Other starts of a refit: a model may have several valleys, and one refit ends in the nearest."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from cable_envs.diagnosis.fit.refit import Fit, Start, look, refit
from cable_envs.diagnosis.model.model import Free, Model, Whitener

COUNT = 8
"""Starts about a refit (a Sobol sequence)."""
SPREAD = float(np.log(3.0))
"""How far about it: of the logarithm of a positive value, and of any other in its scale."""
GLANCE, KEPT, LAST = 4, 2, 8
"""Iterations of all starts, how many of them go on, and for how many iterations more."""
BETTER = 2.0
"""Fall of the whitened sum of squares from which another valley is taken."""


def from_about(model: Model, whitener: Whitener, found: Fit, names: Sequence[str]) -> Fit:
    """The best of a refit and of refits from about it.

    Parameters
    ----------
    model : Model
        The records to fit.
    whitener : Whitener
        Their noise.
    found : Fit
        The refit, with the parameters that are free.
    names : sequence of str
        Parameters that begin elsewhere; the others begin where they are.

    Returns
    -------
    Fit
        ``found`` itself where no start ends better by `BETTER`.
    """
    rows = [p for p in model.parameters if p.name in names and p.name in found.free]
    if not rows:
        return found
    places = 2.0 * qmc.Sobol(len(rows), seed=0).random(COUNT) - 1.0
    starts = [
        Start(found.label, found.free, {**found.values, **_moved(rows, found, by)}) for by in places
    ]  # fmt: skip
    looks = look(model, whitener, starts, GLANCE)
    best = [Start(one.label, one.free, one.values) for one in sorted(looks, key=lambda one: one.cost)[:KEPT]]
    here = refit(model, whitener, [Start(found.label, found.free, found.values), *best], LAST, central=False)
    lowest = min(here, key=lambda fit: fit.cost)
    return lowest if lowest.cost < here[0].cost - BETTER else here[0]


def _moved(rows: Sequence[Free], found: Fit, by: np.ndarray) -> dict[str, float]:
    """Values about those of a refit, by shares of `SPREAD`."""
    there = {}
    for p, share in zip(rows, by.tolist(), strict=True):
        value = found.values[p.name]
        moved = value * np.exp(SPREAD * share) if value > 0.0 and p.low >= 0.0 else value + SPREAD * share * p.scale
        there[p.name] = p.clip(float(moved))
    return there
