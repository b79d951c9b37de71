"""A rough spot: dry friction of the load near one place (a burr, a kink, a scratch).

gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="rough_spot.py",
               effects={"rough_spot": {"level": 3.0, "place": 0.004, "width": 0.003}})
"""

from math import exp, tanh

from cable_envs.effects import Effect, EffectParameter


def friction(position, velocity, level, place, width, slow):
    """F = level e^-((y - place) / width)^2 tanh(v / slow)."""
    return level * exp(-(((position - place) / width) ** 2)) * tanh(velocity / slow)


EFFECT = Effect(
    name="rough_spot",
    seam="load",
    equation="F = level exp(-((y - place) / width)^2) tanh(v / slow)",
    source="Coulomb friction, smoothed, with a Gaussian bump of its level along the way",
    parameters=(
        EffectParameter("level", "N", 0.0, 0.0, 1e4, "friction at the place", 3.0, 0.02),
        EffectParameter("place", "m", 0.0, -10.0, 10.0, "where it is", 0.0, shape=True),
        EffectParameter(
            "width", "m", 3e-3, 1e-6, 10.0, "distance at which it is 1/e", 3e-3, 0.3, shape=True, null_turning=0.3
        ),
        EffectParameter(
            "slow", "m/s", 5e-4, 1e-9, 10.0, "speed of the smoothing", 5e-4, 0.02, shape=True, null_turning=0.02
        ),
    ),
    hooks={"load": friction},
    validity="motions that cross the place",
    experiment="a slow ramp over the whole travel, both ways",
)
