"""Friction grows in proportion to speed: at the load, the output, the carriage, or the drive of a circuit."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="viscous_friction",
    seam="load",
    equation="F = -coefficient v",
    source="Reynolds 1886; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(
        EffectParameter(
            "coefficient", "N s/m", 0.0, 0.0, 1e5, "viscous friction of the load, output or carriage", 50.0, 2e-3,
        ),
        EffectParameter(
            "drive", "N s/m", 0.0, 0.0, 100.0, "viscous friction of the drive (felt in torque mode)", 5e-3, 5e-3,
        ),
    ),
    validity="laminar lubrication at constant temperature",
    experiment="Move at eight constant speeds in both directions under one load. The coefficient is the slope of "
    "friction over speed",
    confusable=("lateral_extrusion", "stribeck_friction", "actuator_lag"),
)  # fmt: skip
