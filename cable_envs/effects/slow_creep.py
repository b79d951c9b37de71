"""A second, slower creep of the cable: with `viscoelastic_creep` two time constants (two Kelvin elements in series).

Stretch of a cable under a constant tension T from rest, with stiffness k:

    stretch = T / k (1 + share_1 (1 - e^(-t / time_1)) + share_2 (1 - e^(-t / time_2)))

A fibre rope gives way within seconds and goes on for hours; one element has one of the two.
"""

from cable_envs.core.kernels import inline
from cable_envs.effects.base import Effect, EffectParameter
from cable_envs.effects.viscoelastic_creep import crept

EFFECT = Effect(
    name="slow_creep",
    seam="cable",
    equation="T = k (stretch - u - u_2), time u_2' = share T / k - u_2, beside the u of viscoelastic_creep",
    source="generalised Kelvin-Voigt solid: Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, "
    "Springer 1989, ch. 3",
    parameters=(
        EffectParameter("share", "1", 0.0, 0.0, 20.0, "compliance of the slow creep over the elastic one", 0.5),
        EffectParameter(
            "time", "s", 60.0, 1e-3, 1e6, "time constant of the slow creep", 60.0, shape=True, probes=(0.2, 1.0),
            search_low=5.0,  # what is over sooner is the creep of one time constant
        ),
    ),
    validity="linear creep. Records shorter than the time constant tell its share over its time and no more",
    experiment="Hold a load for three of the longer time constants, unload, and hold as long: the curve over the "
    "logarithm of time has two bends",
    confusable=("viscoelastic_creep", "friction_drift"),
    hypothesis=False,
)  # fmt: skip


@inline
def creeps_on(creep, slow, e, i, elongation, keep, slow_keep):
    """Move the creep of column i on by a step in which the elastic elongation is ``elongation``.

    creep : array of the whole creep of a cable; slow : of the slow part of it; keep, slow_keep : what is kept of the
    distance to the target. Without either effect no bit changes.
    """
    late = crept(slow[i], e.slow_creep_share[i], elongation, slow_keep)
    creep[i] = crept(creep[i] - slow[i], e.viscoelastic_creep_share[i], elongation, keep) + late
    slow[i] = late


def lasting(e):
    """Creep of a cable at rest over its elastic elongation, both elements together."""
    return e.viscoelastic_creep_share + e.slow_creep_share
