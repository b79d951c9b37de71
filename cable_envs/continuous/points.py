"""Points at which a model rests, and the slopes of its equations there."""

from typing import Any

import numpy as np

from cable_envs.continuous.numbers import STEP
from cable_envs.core.errors import ConfigurationError

NEWTON = 30
"""Steps of Newton's method, at most."""
STILL = 1e-12
"""Size of a step, over that of what is looked for, at which it has arrived."""
LEFT = 1e-6
"""Largest rate that counts as none, m/s^2, rad/s^2 and so on."""


def slopes(model: Any, x: np.ndarray, u: np.ndarray, way: int) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of rates and outputs of a model, by complex steps.

    Parameters
    ----------
    model : cable_envs.continuous.models.Model
        The model.
    x, u : ndarray
        The point.
    way : int
        Direction of sliding.

    Returns
    -------
    over_x : ndarray, shape (states + outputs, states)
        The slopes of the rates above those of the outputs.
    over_u : ndarray, shape (states + outputs, inputs)
        The same over the inputs.
    """
    point, columns = np.concatenate([x, u]), []
    for k in range(len(point)):
        moved = [np.complex128(value) for value in point]
        moved[k] += 1j * STEP
        rates, shown = model.evaluated(moved[: len(x)], moved[len(x) :], way)
        columns.append([np.imag(value) / STEP for value in (*rates, *shown)])
    found = np.array(columns).T
    return found[:, : len(x)], found[:, len(x) :]


def balanced(model: Any, x: np.ndarray, u: np.ndarray, way: int) -> tuple[np.ndarray, np.ndarray]:
    """A point without rates, by Newton's method from one near it.

    Parameters
    ----------
    model : cable_envs.continuous.models.Model
        The model; its first input is the command.
    x, u : ndarray
        Where to begin. The place of the output stays.
    way : int
        1 or -1: on the verge of sliding; the command and all other places are looked for. 0: held by friction, in the
        middle between both limits; the command is looked for.

    Returns
    -------
    x, u : ndarray
        The point.

    Raises
    ------
    ConfigurationError
        Where there is none.
    """
    n, place = len(x), model.equations.place
    others = [k for k, s in enumerate(model.states) if s.unit in ("m", "rad") and s.name != place]
    free, z = [*(others if way else ()), n], np.concatenate([x, u])
    for _ in range(NEWTON):
        rates, steep = _rates(model, z[:n], z[n:], way)
        step = np.linalg.lstsq(steep[:, free], -rates, rcond=None)[0]
        z[free] += step
        if np.abs(step).max() <= STILL * np.abs(z[free]).max(initial=0.0):
            break
    if np.abs(model.f(z[:n], z[n:], way or None)).max() > LEFT:
        how = "on the verge of sliding" if way else "at rest"
        at = x[[s.name for s in model.states].index(place)]
        raise ConfigurationError(f"no command holds {model.rig.name} {how} at {place} = {at:g}")
    return z[:n], z[n:]


def _rates(model: Any, x: np.ndarray, u: np.ndarray, way: int) -> tuple[np.ndarray, np.ndarray]:
    """Rates and their slopes over x and u.

    What friction holds has no rate; where the command moves nothing else, the mean rate of both directions.
    """
    rates, steep = np.array(model.evaluated(x.tolist(), u.tolist(), way)[0]), np.hstack(slopes(model, x, u, way))
    if way == 0 and not steep[: len(x), len(x)].any():
        both = [_rates(model, x, u, one) for one in (1, -1)]
        rates[model.held] = np.mean([r[model.held] for r, _ in both])
        steep[model.held] = np.mean([s[model.held] for _, s in both], axis=0)
    return rates, steep[: len(x)]
