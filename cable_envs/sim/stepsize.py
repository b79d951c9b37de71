"""The integration steps of an environment: enough of them for every rig that it may meet, or a refusal by name."""

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import product

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.base import Plant

MOST = 10_000
"""Most integration steps in a control period."""

CORNERS = 8
"""Most ranges of which all corners are looked at; of more, 2**CORNERS random ones. A rig that a reset draws is looked
at again there."""


def substeps_for(
    plant: Plant, column: np.ndarray, ranges: Sequence[tuple[str, float, float]], period: float, given: int | None,
    usual: int,
) -> int:  # fmt: skip
    """Integration steps in a control period.

    Parameters
    ----------
    plant : Plant
        What simulates the rig.
    column : ndarray, shape (len(plant.table), 1)
        Parameters of the rig, SI.
    ranges : sequence of (str, float, float)
        Parameters that episodes draw, with the ends of their ranges, SI.
    period : float
        Control period, s.
    given : int or None
        What was asked for; None: ``usual``, or as many as the quickest rig needs.
    usual : int
        Steps that are taken unless the rig needs more.

    Returns
    -------
    int
        Steps, between 1 and `MOST`.

    Raises
    ------
    ConfigurationError
        Where fewer are given than the quickest rig needs, and where it needs more than `MOST`, with the number that
        would do.
    """
    p = plant.prepare(_corners(plant, column, ranges))
    if given is not None:
        check_step(plant, p, period, given, "this rig" if not ranges else "the quickest rig of the ranges")
        return given
    needed = _needed(plant, p, period, "this rig" if not ranges else "the quickest rig of the ranges")
    return in_ticks(plant, p[:, :1], period, max(usual, needed))


def in_ticks(plant: Plant, p: np.ndarray, period: float, substeps: int) -> int:
    """At least as many integration steps, so that an encoder's readings are at the ends of steps.

    Parameters
    ----------
    plant : Plant
        What simulates the rig.
    p : ndarray, shape (rows, 1)
        Its coefficients (`Plant.prepare`).
    period : float
        Control period, s.
    substeps : int
        Integration steps in it.

    Returns
    -------
    int
        ``substeps`` where the plant has no encoder, or where no number up to `MOST` would do.
    """
    if not plant.ticks:
        return substeps
    tick = float(getattr(plant.coefficient_rows.over(p), plant.ticks)[0])
    whole = Fraction(period / tick).limit_denominator(MOST).numerator
    steps = math.ceil(substeps / max(whole, 1)) * max(whole, 1)
    return steps if steps <= MOST and abs(period / tick * steps - round(period / tick * steps)) < 1e-6 else substeps


def check_step(plant: Plant, p: np.ndarray, period: float, substeps: int, what: str) -> None:
    """Refuse rigs that are too quick for the steps, with the number that would do.

    Parameters
    ----------
    plant : Plant
        What simulates them.
    p : ndarray, shape (rows, n)
        Their coefficients (`Plant.prepare`).
    period : float
        Control period, s.
    substeps : int
        Integration steps in it.
    what : str
        What the rigs are, for the error.

    Raises
    ------
    ConfigurationError
        Where one needs more steps.
    """
    needed = _needed(plant, p, period, what)
    if needed > substeps:
        raise ConfigurationError(
            f"substeps = {substeps} is too few: {what} needs {needed} integration steps in a control period of "
            f"{period:g} s; make the environment with substeps={needed} or more, or leave substeps out"
        )


def _needed(plant: Plant, p: np.ndarray, period: float, what: str) -> int:
    longest = float(np.min(plant.longest_step(p)))
    needed = math.ceil(period / longest * (1.0 - 1e-9)) if longest > 0.0 else math.inf
    if needed > MOST:
        raise ConfigurationError(
            f"{what} is too quick: its fastest motion needs integration steps of {longest:.2g} s, {needed:.3g} in a "
            f"control period of {period:g} s, and {MOST} are the most; give it more inertia or a softer cable, or "
            f"control_period={longest * MOST:.2g}"
        )
    return max(int(needed), 1)


def _corners(plant: Plant, column: np.ndarray, ranges: Sequence[tuple[str, float, float]]) -> np.ndarray:
    """Columns of the rig and of the corners of its ranges."""
    rows = [plant.table.index(name) for name, _, _ in ranges]
    ends = [(low, high) for _, low, high in ranges]
    if len(ends) > CORNERS:
        picks = [tuple(pick) for pick in np.random.default_rng(0).integers(0, 2, (2**CORNERS, len(ends))).tolist()]
    else:
        picks = list(product((0, 1), repeat=len(ends)))
    values = np.repeat(column, len(picks) + 1, axis=1)
    for k, pick in enumerate(picks):
        values[rows, k + 1] = [end[side] for end, side in zip(ends, pick, strict=True)]
    return values
