"""Numerical pieces of the generators: hysteresis advanced exactly along its path, and nothing of the tool's kernels.

Dry friction is its level times a state z in [-1, 1] that the displacement drives. True sticking is one Maxwell-slip
element (stop operator) with a very short spring; pre-sliding is Dahl's equation dz/ds = (1 - z sign(s')) / distance
(Dahl 1968, Aerospace Report TOR-0158), which has the exact solution used here. Both are rate-independent, so that a
step of any length dissipates and never produces energy.
"""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba import njit

jit = njit(cache=True, error_model="numpy")


@jit
def slipped(z, ds, stiff, soft):
    """State z after a displacement ds: an element as long as ``stiff``, or Dahl's where ``soft`` > 0."""
    if soft > 0.0:
        limit = 1.0 if ds > 0.0 else -1.0
        return limit + (z - limit) * np.exp(-abs(ds) / max(soft, 0.5 * stiff))  # joins the other one
    z += ds / stiff
    return 1.0 if z > 1.0 else (-1.0 if z < -1.0 else z)


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


def _named(names: Sequence[str], module: str) -> Any:
    return namedtuple("Parameters", names, module=module)  # its fields are known at run time


class Table:
    """Names of a simulator's parameters, with the values that switch their physics off.

    Parameters
    ----------
    module : str
        Of the simulator, which has ``Parameters = TABLE.kind``: compiled kernels are found again by that name.
    nulls : Mapping of str to float
        Dotted names of effects' parameters, "backlash.gap"; the kernels have them as ``p.backlash_gap``.
    """

    def __init__(self, module: str, nulls: Mapping[str, float]):
        self.nulls = dict(nulls)
        self.names = tuple(nulls)
        self.kind: Any = _named([name.replace(".", "_") for name in nulls], module)

    def pack(self, values: Mapping[str, float]) -> Any:
        """``values`` over the nulls, as a named tuple for a kernel.

        Raises
        ------
        KeyError
            For a name that the simulator does not have.
        """
        for name in values:
            if name not in self.nulls:
                raise KeyError(f"the simulator has no parameter '{name}'")
        return self.kind(*(float(values.get(name, null)) for name, null in self.nulls.items()))
