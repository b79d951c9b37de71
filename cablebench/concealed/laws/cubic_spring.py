"""A spring that hardens with the cube of its travel, from a place where it is slack.

gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="cubic_spring.py",
               effects={"cubic_spring": {"stiffness": 2e6}})
"""

from cable_envs.effects import Effect, EffectParameter


def spring(position, stiffness, neutral):
    """F = stiffness (y - neutral)^3."""
    away = position - neutral
    return stiffness * away * away * away


EFFECT = Effect(
    name="cubic_spring",
    seam="load",
    equation="F = stiffness (y - neutral)^3",
    source="Duffing, Erzwungene Schwingungen (1918)",
    parameters=(
        EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e12, "spring to ground", 2e6, 0.01),
        EffectParameter("neutral", "m", 0.0, -10.0, 10.0, "where it pulls at nothing", 0.0, shape=True),
    ),
    hooks={"load": spring},
    validity="any travel",
    experiment="hold at eight positions",
)
