"""A measurement has a wrong scale."""

from cable_envs.effects.base import CONSTANT, Effect, EffectParameter

EFFECT = Effect(
    name="sensor_scale",
    seam="sense",
    equation="y = scale x",
    source="ISO/IEC Guide 98-3 (GUM), systematic error",
    parameters=(EffectParameter("signal", "1", 1.0, -100.0, 100.0, "factor on what is measured", 1.1),),
    validity="linear sensors, with wrong counts, gains or gear ratios",
    experiment="Measure two known weights or lengths",
    confusable=("asymmetric_friction", "sensor_bias", "friction_drift", "load_dependent_friction", "cable_elongation"),
    each_sensor=True,
    proportional=True,
    over_time=CONSTANT,
)
