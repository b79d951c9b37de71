"""A measurement has a wrong zero."""

from cable_envs.effects.base import CONSTANT, Effect, EffectParameter

EFFECT = Effect(
    name="sensor_bias",
    seam="sense",
    equation="y = x + bias",
    source="ISO/IEC Guide 98-3 (GUM), systematic error",
    parameters=(EffectParameter("signal", "", 0.0, -1e6, 1e6, "error of the sensor's zero, in its unit", 0.05),),
    validity="errors that are constant over the record",
    experiment="Unload the sensor and read it, or turn it round",
    confusable=("asymmetric_friction", "sensor_scale", "position_dependent_load", "slack"),
    each_sensor=True,
    proportional=True,
    over_time=CONSTANT,
)
