"""Friction that grows with the logarithm of the time at rest, and is worn off by sliding a short way.

    gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="ageing_friction.py",
                   effects={"ageing_friction": {"level": 1.0}})

Dieterich, Journal of Geophysical Research 84 (1979) 2161: the age theta of the contacts has theta' = 1 - |v| theta / D.
"""

from math import log, tanh

from cable_envs.effects import Effect, EffectParameter, EffectState


def older(age, speed, dt, way):
    """The age after dt, s: implicit, so stable for any dt."""
    return (age + dt) / (1.0 + dt * speed / way)


def friction(age, velocity, level, young, slow):
    """F = level ln(1 + age / young) tanh(v / slow)."""
    return level * log(1.0 + age / young) * tanh(velocity / slow)


EFFECT = Effect(
    name="ageing_friction",
    seam="load",
    equation="F = level ln(1 + theta / young) tanh(v / slow), theta' = 1 - |v| theta / way",
    source="Dieterich, J. Geophys. Res. 84 (1979) 2161",
    parameters=(
        EffectParameter("level", "N", 0.0, 0.0, 1e4, "friction for each factor e of the age", 1.0, 5e-3),
        EffectParameter("young", "s", 0.05, 1e-6, 1e3, "age below which friction does not grow", 0.05, shape=True),
        EffectParameter(
            "way", "m", 2e-4, 1e-9, 1.0, "way that renews the contacts", 2e-4, 0.01, shape=True, null_turning=0.01
        ),
        EffectParameter(
            "slow", "m/s", 5e-4, 1e-9, 10.0, "speed of the smoothing", 5e-4, 0.02, shape=True, null_turning=0.02
        ),
    ),
    states=(EffectState("age", "s", 0.0, "mean age of the contacts"),),
    advance={"age": older},
    hooks={"load": friction},
    validity="contacts of metal, polymer or rock at rest for milliseconds to hours",
    experiment="ramps after rests of 0.1 s, 1 s and 10 s",
)
