"""The cable is longer than the way it goes: a stretch of drive motion without tension."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="slack",
    seam="cable",
    equation="T = max(0, k (stretch - length)); circuit: T_pre L -> T_pre L - EA length on both sides, T >= 0",
    source="unilateral cable; lost pretension: Zou 2022, section 3.2",
    parameters=(EffectParameter("length", "m", 0.0, 0.0, 1.0, "surplus length of each cable", 1e-3, 5e-4),),
    validity="weightless cable; that a cable cannot push is in the plants already. On the hole, under a load that "
    "never lets the cable go limp, it only moves the zero of the drive's position",
    experiment="output locked, drive to and fro through zero torque; the width of the flat does not depend on speed",
    confusable=("backlash", "sensor_bias", "stiffness_hardening"),
)
