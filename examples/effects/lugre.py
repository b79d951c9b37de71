"""LuGre friction of the load: bristles bend before they slip, and friction lags behind the speed.

    gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="examples/effects/lugre.py",
                   effects={"lugre": {"level": 4.0, "displacement": 2e-5}})

Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Transactions on Automatic Control 40 (1995) 419, with the deflection
over its value at high speed: their sigma_0 is level / displacement, their sigma_1 is sigma_0 damping.
"""

from math import exp

from cable_envs.effects import Effect, EffectParameter, EffectState


def slips(velocity, displacement, excess, stribeck):
    """How fast the bristles lose their deflection, 1/s."""
    return abs(velocity) / (displacement * (1.0 + excess * exp(-((velocity / stribeck) ** 2))))


def bend(bent, velocity, dt, displacement, excess, stribeck):
    """z' = v / displacement - z slips, order 2 and stable for any dt: 1 / (1 + x + x^2 / 2) in the place of e^-x."""
    x = dt * slips(velocity, displacement, excess, stribeck)
    return (bent + dt * velocity / displacement * (1.0 + 0.5 * x)) / (1.0 + x + 0.5 * x * x)


def friction(bent, velocity, level, displacement, damping, excess, stribeck):
    """F = level (z + damping z')."""
    rate = velocity / displacement - bent * slips(velocity, displacement, excess, stribeck)
    return level * (bent + damping * rate)


EFFECT = Effect(
    name="lugre",
    seam="load",
    equation="F = level (z + damping z'), z' = (v - |v| z / (1 + excess e^-(v / stribeck)^2)) / displacement",
    source="Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419",
    parameters=(  # probes: what a diagnosis fits beside the level, and where it begins; the damping keeps its default
        EffectParameter("level", "N", 0.0, 0.0, 1e4, "friction at high speed", typical=4.0),
        EffectParameter(
            "displacement", "m", 1e-4, 1e-9, 1.0, "deflection at that friction", 1e-4, shape=True,
            probes=(0.1, 0.3, 1.0),
        ),
        EffectParameter("damping", "s", 1e-3, 0.0, 10.0, "damping of the bristles over stiffness", 1e-3, shape=True),
        EffectParameter(
            "excess", "1", 0.5, 0.0, 10.0, "friction at v = 0 above level, over it", 0.5, shape=True, probes=(1.0,)
        ),
        EffectParameter(
            "stribeck", "m/s", 2e-3, 1e-6, 10.0, "speed at which it has fallen to 1/e", 2e-3, shape=True, probes=(1.0,)
        ),
    ),
    states=(EffectState("bent", "1", 0.0, "mean deflection of the bristles over displacement"),),
    advance={"bent": bend},
    hooks={"load": friction},
    validity="plants that move straight",
    experiment="small reversals, then constant speeds",
)  # fmt: skip
