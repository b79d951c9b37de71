"""The friction of a hole grows with the sliding speed, because the cable is pressed against the edge and flattened."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="lateral_extrusion",
    seam="contact",
    equation="n = lambda(rho0 (1 + delta), mu + gain |v|^exponent, theta_e)",
    source="Eq. (13)-(22), Gu 2024",
    parameters=(
        EffectParameter(
            "gain", "SI", 0.0, 0.0, 1e7, "K in C = K v^omega", 6574.0
        ),
        EffectParameter(
            "delta", "1", 0.0, -0.5, 1.0, "relative change of the radius ratio", 0.02,
        ),
        EffectParameter(
            "exponent", "1", 2.03, 0.2, 10.0, "omega in C = K v^omega", 2.03, shape=True,
        ),
    ),
    validity="braided and stranded cables, 30 to 90 degrees, up to about 11 mm/s (Gu 2024, Table A1)",
    experiment="Measure the tension ratio over speed at three wrap angles and two clearances",
    confusable=("viscous_friction", "stribeck_friction"),
)  # fmt: skip
