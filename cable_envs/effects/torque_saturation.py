"""The torque of a motor grows less than its current: iron saturates."""

import numpy as np

from cable_envs.core.kernels import inline
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="torque_saturation",
    seam="actuate",
    equation="T = k_t i / (1 + drop |i|); the back-EMF stays k_t v",
    source="Froelich's curve of magnetisation, B = H / (a + b H): Kennelly, Trans. AIEE 8 (1891) 485, of the field "
    "that the current makes",
    parameters=(
        EffectParameter("drop", "1/A", 0.0, 0.0, 100.0, "inverse of the current that loses half of the torque", 0.2),
    ),
    validity="static; what the current does to the back-EMF is left out",
    experiment="Hold loads at rest, the largest three times the smallest. Current over load grows, at any duty",
    confusable=("supply_sag", "gear_friction", "winding_heating"),
)  # fmt: skip


@inline
def saturated(current, drop):
    """(current that would make the same torque without saturation, its slope over the current).

    Examples
    --------
    >>> saturated(-2.0, 0.5)
    (-1.0, 0.25)
    """
    share = 1.0 / (1.0 + drop * abs(current))
    return share * current, share * share


def unsaturated(current, drop):
    """Currents [n] that make the torques of ``current`` [n] without saturation; from 1 / drop on none does: endless.

    Examples
    --------
    >>> float(unsaturated(np.array([-1.0]), 0.5)[0])
    -2.0
    """
    return current / np.maximum(1.0 - drop * np.abs(current), 1e-12)
