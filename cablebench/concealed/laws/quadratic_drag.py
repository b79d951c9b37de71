"""Drag of a fluid on the load: in proportion to the square of the speed.

gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="quadratic_drag.py",
               effects={"quadratic_drag": {"coefficient": 2e4}})
"""

from cable_envs.effects import Effect, EffectParameter


def drag(velocity, speed, coefficient):
    """F = coefficient |v| v."""
    return coefficient * speed * velocity


EFFECT = Effect(
    name="quadratic_drag",
    seam="load",
    equation="F = coefficient |v| v",
    source="Newton, Principia II (1687): drag at large Reynolds numbers",
    parameters=(EffectParameter("coefficient", "N s^2/m^2", 0.0, 0.0, 1e9, "drag at 1 m/s", 2e4, 0.02),),
    hooks={"load": drag},
    validity="turbulent flow around the load",
    experiment="constant speeds, each twice the one before",
)
