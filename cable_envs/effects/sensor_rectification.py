"""A sensor that does not see negative values, or takes them as positive."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="sensor_rectification",
    seam="sense",
    equation="y = x - share min(x, 0): 1 cuts them off, 2 turns them round",
    source="half- and full-wave rectification; unsigned converters",
    parameters=(
        EffectParameter("signal", "1", 0.0, 0.0, 2.0, "share of negative values that is lost", 1.0, complete=True),
    ),
    validity="acts after scale and bias",
    experiment="the same motion mirrored",
    confusable=("asymmetric_friction", "slack"),
    each_sensor=True,
    proportional=True,
)
