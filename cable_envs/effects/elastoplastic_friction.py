"""Dry friction is an elastic contact that begins to slip only near its breakaway, and does not creep below it."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="elastoplastic_friction",
    seam="contact",
    equation="z' = (v - alpha |v| z / g(v)) / displacement, F = level (z + damping z' / w), w = sqrt(level / "
    "(displacement m)); alpha = 0 on the way back and up to z / g = breakaway, then t^2 (3 - 2 t) with t = (z / g - "
    "breakaway) / (1 - breakaway)",
    source="Dupont, Hayward, Armstrong, Altpeter, IEEE TAC 47 (2002) 787, with a cubic in the place of their sine",
    parameters=(
        EffectParameter(
            "displacement", "m", 0.0, 0.0, 1.0, "deflection of the contact at full friction", 1e-4, 5e-3,
            probes=(0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0),
        ),
        EffectParameter(
            "damping", "1", 0.1, 0.0, 10.0, "damping of the contact over sqrt(stiffness x inertia)", 0.1, shape=True
        ),
        EffectParameter(
            "breakaway", "1", 0.7, 0.0, 0.99, "share of the friction up to which nothing slips", 0.7, shape=True
        ),
    ),
    validity="wherever dry friction acts, in the place of presliding_hysteresis",
    experiment="Let a force swing below breakaway for long around a constant one. The position does not creep",
    confusable=("presliding_hysteresis", "lugre_friction", "cable_elongation"),
    excludes=("presliding_hysteresis", "lugre_friction"),
    apart=True,
    hypothesis=False,
)  # fmt: skip
