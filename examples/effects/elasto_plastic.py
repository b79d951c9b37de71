"""Elasto-plastic friction of the load: as LuGre, but without drift; below breakaway it is a spring and nothing else.

    gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="examples/effects/elasto_plastic.py",
                   effects={"elasto_plastic": {"level": 4.0, "displacement": 2e-5}})

Dupont, Hayward, Armstrong, Altpeter, IEEE Transactions on Automatic Control 47 (2002) 787, with the deflection over its
largest value.
"""

from math import pi, sin

from cable_envs.effects import Effect, EffectParameter, EffectState


def slips(bent, velocity, displacement, breakaway):
    """How fast the deflection is lost, 1/s: not below breakaway, nor on the way back; whole at full friction."""
    size = min(abs(bent), 1.0)
    share = 0.5 + 0.5 * sin(pi * (size - 0.5 * (1.0 + breakaway)) / (1.0 - breakaway))
    return share * abs(velocity) / displacement if size > breakaway and bent * velocity > 0.0 else 0.0


def bend(bent, velocity, dt, displacement, breakaway):
    """z' = v / displacement - z slips, stable for any dt: z stays within 1."""
    x = dt * slips(bent, velocity, displacement, breakaway)
    z = (bent + dt * velocity / displacement * (1.0 + 0.5 * x)) / (1.0 + x + 0.5 * x * x)
    return max(-1.0, min(1.0, z))


def friction(bent, velocity, level, displacement, damping, breakaway):
    """F = level (z + damping z')."""
    rate = velocity / displacement - bent * slips(bent, velocity, displacement, breakaway)
    return level * (bent + damping * rate)


EFFECT = Effect(
    name="elasto_plastic",
    seam="load",
    equation="F = level (z + damping z'), z' = (v - alpha(z, v) |v| z) / displacement",
    source="Dupont, Hayward, Armstrong, Altpeter, IEEE TAC 47 (2002) 787",
    parameters=(  # probes: what a diagnosis fits beside the level, and where it begins
        EffectParameter("level", "N", 0.0, 0.0, 1e4, "friction while it slides", typical=4.0),
        EffectParameter(
            "displacement", "m", 1e-4, 1e-9, 1.0, "deflection at that friction", 1e-4, shape=True,
            probes=(0.1, 0.3, 1.0),
        ),
        EffectParameter("damping", "s", 1e-3, 0.0, 10.0, "damping of the contact over stiffness", 1e-3, shape=True),
        EffectParameter("breakaway", "1", 0.7, 0.0, 0.99, "share of it up to which nothing slips", 0.7, shape=True),
    ),
    states=(EffectState("bent", "1", 0.0, "elastic deflection over displacement"),),
    advance={"bent": bend},
    hooks={"load": friction},
    validity="plants that move straight",
    experiment="a force that swings below breakaway for long: the load must not creep away",
)  # fmt: skip
