"""Dry friction is carried by bristles that bend before they slip, so that it lags behind the speed."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="lugre_friction",
    seam="contact",
    equation="z' = (v - |v| z / g(v)) / displacement, F = level (z + damping z' / w), w = sqrt(level / (displacement "
    "m)); level g(v) is the dry friction at constant speed, Stribeck's part included",
    source="Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419, with z over its value at high speed: "
    "sigma_0 = level / displacement, sigma_1 = damping sqrt(sigma_0 m); without Stribeck's part it is Dahl's model",
    parameters=(
        EffectParameter(
            "displacement", "m", 0.0, 0.0, 1.0, "deflection of the bristles at full friction", 1e-4, 5e-3,
            probes=(0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0),
        ),
        EffectParameter(
            "damping", "1", 0.1, 0.0, 10.0, "damping of the bristles over sqrt(stiffness x inertia)", 0.1, shape=True
        ),
    ),
    validity="wherever dry friction acts, in the place of presliding_hysteresis. Loops within a loop do not close: "
    "under a force that swings below breakaway the load creeps away",
    experiment="Raise and lower the speed without a stop, quickly and slowly. The loop of friction over speed grows "
    "with the rate",
    confusable=("presliding_hysteresis", "elastoplastic_friction", "stribeck_friction"),
    excludes=("presliding_hysteresis", "elastoplastic_friction"),
    apart=True,
    hypothesis=False,
)  # fmt: skip
