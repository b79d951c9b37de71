"""Directions of sliding, one for each dry friction of a plant: as they are asked for, and as the forces have them."""

from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.continuous import Equations

Ways = tuple[int, ...]
Sliding = int | Ways


def asked(equations: Equations, sliding: Any) -> Ways:
    """The directions that one number, or one for each friction, means.

    Parameters
    ----------
    equations : Equations
        Those of the plant.
    sliding : int, or sequence of int
        1 or -1: all slide as they do where the output moves that way. 0: all are held. Else one for each friction.

    Returns
    -------
    tuple of int
        1, -1 or 0 for each friction.

    Raises
    ------
    ConfigurationError
        For other numbers, and for another number of them.
    """
    names = equations.slides
    if np.ndim(sliding) == 0:
        found = [-sliding if name in equations.against else sliding for name in names] or [sliding]
    else:
        found = list(sliding)
        if len(found) != len(names):
            raise ConfigurationError(
                f"sliding: expected one direction, or {len(names)} ({', '.join(names)}), got {sliding!r}"
            )
    for way in found:
        if way not in (-1, 0, 1):
            raise ConfigurationError(f"sliding: expected 1, -1 or 0, got {sliding!r}")
    return tuple(int(way) for way in found) if names else ()


def as_forced(model: Any, x: np.ndarray, u: np.ndarray) -> Ways:
    """The directions of a state: those of its speeds, and where it rests those in which the forces push it.

    Parameters
    ----------
    model : cable_envs.continuous.models.Model
        The model.
    x, u : ndarray
        State and input.

    Returns
    -------
    tuple of int
        1, -1 or 0 for each friction.
    """
    names, places = [i.name for i in model.inputs], model.places
    speeds = [x[at] if at >= 0 else u[names.index(name)] for name, at in zip(model.equations.slides, places)]
    ways, numbers = [int(np.sign(speed)) for speed in speeds], (x.tolist(), u.tolist())
    for k, at in enumerate(places):
        if ways[k] == 0:
            ways[k] = 1
            if at >= 0 and not model.evaluated(*numbers, tuple(ways))[0][at] > 0.0:
                ways[k] = -1
                if not model.evaluated(*numbers, tuple(ways))[0][at] < 0.0:
                    ways[k] = 0
    return tuple(ways)


def told(ways: Ways) -> Sliding:
    """One number where there is at most one friction, else the directions of all."""
    return ways if len(ways) > 1 else (*ways, 0)[0]
