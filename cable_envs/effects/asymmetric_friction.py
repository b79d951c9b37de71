"""Friction in one direction only: the difference between both directions."""

from cable_envs.core.kernels import inline, maximum
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="asymmetric_friction",
    seam="load",
    equation="F = -max(difference, 0) for v > 0, +max(-difference, 0) for v < 0: never gives energy; hole: "
    "mu -> mu (1 + contact sign(v))",
    source="Armstrong-Helouvry, Control of Machines with Friction, Kluwer 1991, ch. 4",
    parameters=(
        EffectParameter(
            "difference", "N", 0.0, -1e4, 1e4, "dry friction moving up less that moving down, load or output", 2.0,
            0.01, signed=True,
        ),
        EffectParameter(
            "contact", "1", 0.0, -0.9, 0.9, "share by which the hole rubs more hauling in than paying out", 0.2,
            signed=True,
        ),
    ),
    validity="as Coulomb's friction; with it, it is Coulomb friction of half the size and a constant force; contact: "
    "the lay of the strands, an edge that is rounder on one side; at rest that of "
    "the way it would go",
    experiment="the same in both directions with the force sensor checked outside, unloaded and by a weight",
    confusable=("sensor_bias", "sensor_scale", "coulomb_friction", "position_dependent_load"),
)  # fmt: skip


@inline
def levels(difference):
    """(friction moving up, friction moving down), both >= 0."""
    return maximum(difference, 0.0), maximum(-difference, 0.0)
