"""A measurement that comes late."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="sensor_delay",
    seam="sense",
    equation="y(t) = x(t - delay), by straight lines between control steps",
    source="Smith, Chem. Eng. Prog. 53 (1957) 217: dead time",
    parameters=(EffectParameter("signal", "s", 0.0, 0.0, 1.0, "delay of this sensor", 0.02),),
    validity="whole and part control steps; until the delay has passed the first value is seen",
    experiment="a chirp, and a step seen by two sensors: a delay shifts, a lag smears",
    confusable=("actuator_lag",),
    each_sensor=True,
)
