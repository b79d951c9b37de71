"""A measurement has a wrong scale."""

from cable_envs.effects.base import CONSTANT, Effect, EffectParameter

ACCURATE = 0.005
"""Of a sensor's scale: transducers of force and torque are sold in classes of 0.1 to 0.5 %, and the radius of a pulley,
which makes a place of an angle, is seldom known better."""

EFFECT = Effect(
    name="sensor_scale",
    seam="sense",
    equation="y = scale x",
    source="ISO/IEC Guide 98-3 (GUM), systematic error",
    parameters=(EffectParameter("signal", "1", 1.0, -100.0, 100.0, "factor on what is measured", 1.1, least=ACCURATE),),
    validity="linear sensors, with wrong counts, gains or gear ratios",
    experiment="Measure two known weights or lengths",
    confusable=("asymmetric_friction", "sensor_bias", "friction_drift", "load_dependent_friction", "cable_elongation"),
    each_sensor=True,
    proportional=True,
    over_time=CONSTANT,
)
