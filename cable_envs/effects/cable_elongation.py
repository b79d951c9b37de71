"""The cable stretches in proportion to its tension. Without the effect it is nearly rigid."""

from cable_envs.effects.base import Effect, EffectParameter

_PROBES = (1.0, 5.0, 25.0)

EFFECT = Effect(
    name="cable_elongation",
    seam="cable",
    equation="T = k stretch (hole, belt); EA de/ds = T (circuit, Zou 2022 Eq. 14-16)",
    source="Hooke; Zou 2022, section 2.2",
    parameters=(
        EffectParameter(
            "stiffness", "N/m", 1e7, 1.0, 1e9, "EA / L of the span at the drive", 6e4, probes=_PROBES, inverse=True,
        ),
        EffectParameter(
            "tensile_stiffness", "N", 1e6, 1.0, 1e8, "EA of the cable", 1.684e4, 1.684e4,
            probes=_PROBES, inverse=True,
        ),
        EffectParameter(
            "belt_stiffness", "N/m", 0.0, 0.0, 1e9, "spring between motor and carriage; 0 is a rigid belt", 1e5,
            probes=_PROBES, inverse=True,
        ),
    ),
    validity="strains below 1 %, without waves. At its null the stiffness of a cable is a hundred times the usual "
    "one, because a rigid cable would leave the tension undetermined",
    experiment="Lock the output, and ramp the force up and down. The compliance is the slope of drive motion over "
    "tension",
    confusable=("backlash", "presliding_hysteresis", "stiffness_hardening", "viscoelastic_creep"),
)  # fmt: skip
