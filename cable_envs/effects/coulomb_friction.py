"""Dry friction of constant size acts at the contact of the cable, and at the load or output."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="coulomb_friction",
    seam="contact",
    equation="F = -level sign(v), set-valued at v = 0; contact: mu in T' = mu N' (Gu 2024 Eq. 8, Zou 2022 Eq. 7)",
    source="Coulomb 1785; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083",
    parameters=(
        EffectParameter(
            "level", "N", 0.0, 0.0, 1e4, "dry friction at the load or output", 2.0, 0.01,
        ),
        EffectParameter(
            "contact", "1", 0.0, 0.0, 5.0, "friction coefficient of the cable where it is wrapped", 0.4,
        ),
    ),
    validity="rigid bodies that slide much farther than their pre-sliding",
    experiment="Move at constant slow speeds in both directions, under two loads. The level is the part of the "
    "friction that does not change with the load",
    confusable=("stribeck_friction", "load_dependent_friction", "presliding_hysteresis"),
)  # fmt: skip
