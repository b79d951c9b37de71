"""The load has a spring or a weight that its nominal model lacks: return springs, wiring, gravity."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="position_dependent_load",
    seam="load",
    equation="F = -stiffness (y - neutral); circuit: also M = -mass g arm cos(theta)",
    source="Hooke; the payload of section 3.2, Zou 2022",
    parameters=(
        EffectParameter(
            "stiffness", "N/m", 0.0, 0.0, 1e7, "spring between load or output and ground", 500.0, 0.05,
        ),
        EffectParameter(
            "neutral", "m", 0.0, -100.0, 100.0, "position at which that spring is relaxed", 0.0, 0.0, shape=True,
        ),
        EffectParameter(
            "mass", "kg", 0.0, 0.0, 1e3, "point mass carried by the driven pulley", 0.2, 0.2,
        ),
    ),
    validity="any travel; the spring of the hole is relaxed at y = 0, and a mass also adds inertia",
    experiment="Hold at eight positions, each approached from both sides",
    confusable=("position_ripple", "cable_elongation", "asymmetric_friction"),
)  # fmt: skip
