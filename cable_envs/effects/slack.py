"""The cable is longer than its path, so that the drive moves for a while without tension."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="slack",
    seam="cable",
    equation="T = max(0, k (stretch - length)); circuit: T_pre L -> T_pre L - EA length on both sides, T >= 0",
    source="unilateral cable; lost pretension: Zou 2022, section 3.2",
    parameters=(EffectParameter("length", "m", 0.0, 0.0, 1.0, "surplus length of each cable", 1e-3, 5e-4),),
    validity="a weightless cable; the plants contain already that a cable cannot push. On the hole, under a load that "
    "always keeps the cable taut, it only moves the zero of the drive's position",
    experiment="Lock the output, and move the drive back and forth through zero torque. The width of the flat part "
    "does not depend on speed",
    confusable=("backlash", "sensor_bias", "stiffness_hardening", "viscoelastic_creep"),
)
