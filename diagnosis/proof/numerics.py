"""Numerical pieces of the generators: hysteresis advanced exactly along its path, and nothing of the tool's kernels.

Dry friction is an assembly of Maxwell-slip elements (stop operators): each is a spring that slides at its limit. A single
element with a very short spring stands for true sticking; many with limits spread over a distance give the rounded
hysteresis of pre-sliding (Iwan 1966, J. Appl. Mech. 33, 893; Al-Bender et al. 2005, IEEE TAC 50, 1883). The operators
are advanced by the displacement of a step, exactly, so that a step of any length dissipates and never produces energy.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

ELEMENTS = 8
"""Maxwell-slip elements of one contact."""

jit = njit(cache=True, error_model="numpy")


@jit
def stop(z, ds, distance):
    """State of one element in [-1, 1] after a displacement ds; ``distance``: half the way from one limit to the other."""
    z += ds / distance
    return 1.0 if z > 1.0 else (-1.0 if z < -1.0 else z)


@jit
def stops(z, first, ds, stiff, soft):
    """Advance the elements z[first : first + ELEMENTS]; their mean in [-1, 1].

    With ``soft`` 0 one element of distance ``stiff`` acts. Else the limits are spread evenly from ``stiff`` to ``soft``:
    from rest at zero the mean rises as 1 - (1 - s / soft)^2 or so, with the slope of a harmonic mean at the start.
    """
    if soft <= stiff:
        z[first] = stop(z[first], ds, stiff)
        return z[first]
    total = 0.0
    for k in range(ELEMENTS):
        z[first + k] = stop(z[first + k], ds, stiff + (soft - stiff) * (k + 0.5) / ELEMENTS)
        total += z[first + k]
    return total / ELEMENTS


@jit
def tension_ratio(rho, mu, phi):
    """lambda of section 1 in physics.md, from mu T'' + (1 + rho) T' - rho mu T = 0, T(0) = 1, T'(0) = 0.

    Written with hyperbolic functions of the half difference of the two rates, unlike the tool's form.
    """
    mu = max(mu, 1e-9)
    half = 0.5 * (1.0 + rho) / mu
    root = np.sqrt(half * half + rho)
    # cosh and sinh would overflow for small mu: take e^(root phi) out
    fade = np.exp(-2.0 * root * phi)
    return np.exp((root - half) * phi) * 0.5 * ((1.0 + fade) + half / root * (1.0 - fade))


class Table:
    """Names of a simulator's parameters in the order of its vector, with the values that switch their physics off."""

    def __init__(self, nulls: Mapping[str, float]):
        self.nulls = dict(nulls)
        self.names = tuple(nulls)

    def pack(self, values: Mapping[str, float]) -> np.ndarray:
        """The vector of ``values`` over the nulls; KeyError for a name that the simulator does not have."""
        for name in values:
            if name not in self.nulls:
                raise KeyError(f"the simulator has no parameter '{name}'")
        return np.array([float(values.get(name, null)) for name, null in self.nulls.items()])


def indices(names: Sequence[str], *wanted: str) -> tuple[int, ...]:
    """Places of ``wanted`` in ``names``."""
    return tuple(list(names).index(name) for name in wanted)
