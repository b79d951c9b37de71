"""Points at which a model rests, and the slopes of its equations there."""

from typing import Any

import numpy as np

from cable_envs.continuous.numbers import STEP
from cable_envs.continuous.ways import Ways, asked
from cable_envs.core.errors import ConfigurationError

NEWTON = 30
"""Steps of Newton's method, at most."""
STILL = 1e-12
"""Size of a step, over that of what is looked for, at which it has arrived."""
LEFT = 1e-6
"""Largest rate that counts as none, m/s^2, rad/s^2 and so on."""


def slopes(
    model: Any, x: np.ndarray, u: np.ndarray, ways: Ways, slid: bool = False, inputs: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of rates and outputs of a model, by complex steps.

    Parameters
    ----------
    model : cable_envs.continuous.models.Model
        The model.
    x, u : ndarray
        The point.
    ways : tuple of int
        Directions of sliding.
    slid : bool
        Whether contacts without a mass follow to their limits (`Model.slid`).
    inputs : bool
        Whether those over the inputs are wanted too; else they are left out.

    Returns
    -------
    over_x : ndarray, shape (states + outputs, states)
        The slopes of the rates above those of the outputs.
    over_u : ndarray, shape (states + outputs, inputs)
        The same over the inputs.
    """
    point, columns, n = np.concatenate([x, u]), [], len(x)
    for k in range(len(point) if inputs else n):
        moved: list[Any] = [np.complex128(value) for value in point]
        moved[k] += 1j * STEP
        at = model.slid(moved[:n], moved[n:], ways) if slid else moved[:n]
        rates, shown = model.evaluated(at, moved[n:], ways)
        columns.append([np.imag(value) / STEP for value in (*rates, *shown)])
    found = np.array(columns).T
    return found[:, :n], found[:, n:]


def balanced(model: Any, x: np.ndarray, u: np.ndarray, ways: Ways) -> tuple[np.ndarray, np.ndarray]:
    """A point without rates, by Newton's method from one near it.

    Parameters
    ----------
    model : cable_envs.continuous.models.Model
        The model; its first input is the command.
    x, u : ndarray
        Where to begin. The place of the output stays.
    ways : tuple of int
        1 or -1: on the verge of sliding; the command and all other places are looked for. All 0: held by friction, in
        the middle between both limits; all commands are looked for.

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
    others = [k for k, s in enumerate(model.states) if s.unit not in ("m/s", "rad/s") and s.name != place]
    told = [n + k for k, i in enumerate(model.equations.inputs) if i.row in ("command", "second")]
    free, z = [*others, n] if any(ways) else told, np.concatenate([x, u])
    for _ in range(NEWTON):
        rates, steep = _rates(model, z[:n], z[n:], ways, any(ways))
        step = np.linalg.lstsq(steep[:, free], -rates, rcond=None)[0]
        z[free] += step
        if np.abs(step).max() <= STILL * np.abs(z[free]).max(initial=0.0):
            break
    at = np.array(model.slid(z[:n].tolist(), z[n:].tolist(), ways)) if any(ways) else z[:n]
    if np.abs(model.f(at, z[n:], ways if any(ways) else None)).max() > LEFT:
        how = "on the verge of sliding" if any(ways) else "at rest"
        where = x[[s.name for s in model.states].index(place)]
        raise ConfigurationError(f"no command holds {model.rig.name} {how} at {place} = {where:g}")
    return at, z[n:]


def _rates(model: Any, x: np.ndarray, u: np.ndarray, ways: Ways, slid: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rates and their slopes over x and u; ``slid`` as of `slopes`.

    What friction holds has no rate; where the command moves nothing else, the mean rate of both directions.
    """
    n = len(x)
    at = model.slid(x.tolist(), u.tolist(), ways) if slid else x.tolist()
    rates = np.array(model.evaluated(at, u.tolist(), ways)[0])
    steep = np.hstack(slopes(model, x, u, ways, slid))
    if not any(ways) and not steep[:n, n].any():
        both = [_rates(model, x, u, asked(model.equations, one), False) for one in (1, -1)]
        for place in model.places:
            rates[place] = np.mean([r[place] for r, _ in both])
            steep[place] = np.mean([s[place] for _, s in both], axis=0)
    return rates, steep[:n]
