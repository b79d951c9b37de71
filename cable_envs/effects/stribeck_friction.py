"""Friction is largest at breakaway, and falls to its sliding value as the speed grows."""

from cable_envs.core.kernels import exp, inline
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="stribeck_friction",
    seam="contact",
    equation="F = -(level + excess exp(-(v / velocity)^2)) sign(v); contact: mu + contact exp(-(v / velocity)^2)",
    source="Stribeck 1902; Bo and Pavelescu, Wear 82 (1982) 277",
    parameters=(
        EffectParameter("excess", "N", 0.0, 0.0, 1e4, "friction at v = 0 above Coulomb's, load or output", 2.0, 0.01),
        EffectParameter(
            "contact", "1", 0.0, 0.0, 5.0, "friction coefficient of the hole at v = 0 above the sliding one", 0.15,
        ),
        EffectParameter(
            "velocity", "m/s", 2e-3, 1e-6, 100.0, "speed at which the excess has fallen to 1/e", 2e-3, 0.1, shape=True,
            probes=(0.3, 1.0, 4.0, 16.0), null_turning=0.1,
        ),
    ),
    validity="steady sliding; within a few pre-sliding lengths the friction has not yet fallen",
    experiment="Move at eight constant speeds in both directions, from far below `velocity` to far above it",
    confusable=("coulomb_friction", "viscous_friction", "presliding_hysteresis"),
)  # fmt: skip


@inline
def excess_at(excess, velocity, v):
    """(excess exp(-(v / velocity)^2), its slope to |v|)."""
    per = 1.0 / velocity
    u = v * per
    now = excess * exp(-u * u)
    return now, -2.0 * abs(u) * per * now
