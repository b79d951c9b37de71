"""A sensor does not see negative values, or shows them as positive."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="sensor_rectification",
    seam="sense",
    equation="y = x - share min(x, 0): a share of 1 cuts negative values off, a share of 2 makes them positive",
    source="half- and full-wave rectification; unsigned converters",
    parameters=(
        EffectParameter("signal", "1", 0.0, 0.0, 2.0, "share of negative values that is lost", 1.0, complete=True),
    ),
    validity="after scale and bias, which act first",
    experiment="Repeat the motion mirrored",
    confusable=("asymmetric_friction", "slack"),
    each_sensor=True,
    proportional=True,
)
