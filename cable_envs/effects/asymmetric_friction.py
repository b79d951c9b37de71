"""Friction is larger in one direction than in the other."""

from cable_envs.core.kernels import inline, maximum
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="asymmetric_friction",
    seam="load",
    equation="F = -max(difference, 0) for v > 0, +max(-difference, 0) for v < 0, which never adds energy; hole: mu -> "
    "mu (1 + contact sign(v))",
    source="Armstrong-Helouvry, Control of Machines with Friction, Kluwer 1991, ch. 4",
    parameters=(
        EffectParameter(
            "difference", "N", 0.0, -1e4, 1e4, "dry friction up minus dry friction down, at the load or output", 2.0,
            0.01, signed=True,
        ),
        EffectParameter(
            "contact", "1", 0.0, -0.9, 0.9, "share of the hole's mu, added hauling in and subtracted paying out", 0.2,
            signed=True,
        ),
    ),
    validity="as Coulomb friction. With Coulomb friction it equals Coulomb friction of half the size and a constant "
    "force. `contact` stands for the lay of the strands, or an edge that is rounder on one side; at rest it has the "
    "sign of the motion that would follow",
    experiment="Repeat the motion in both directions after the force sensor was checked by itself, unloaded and with "
    "a weight",
    confusable=("sensor_bias", "sensor_scale", "coulomb_friction", "position_dependent_load"),
)  # fmt: skip


@inline
def levels(difference):
    """(friction moving up, friction moving down), both >= 0."""
    return maximum(difference, 0.0), maximum(-difference, 0.0)
