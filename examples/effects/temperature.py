"""Temperature: friction heats the contact, and a warm contact has another friction coefficient.

    gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="examples/effects/temperature.py",
                   effects={"temperature": {"slope": -0.01, "resistance": 20.0, "constant": 5.0}})

Blok, Proceedings of the General Discussion on Lubrication 2 (1937) 222; here one body with one time constant.
"""

from math import exp

from cable_envs.effects import Effect, EffectParameter, EffectState


def warmed(excess, tension, tension_behind, speed, dt, resistance, constant):
    """C theta' = P - theta / R with the power P = |T1 - T2| |v| of friction, exact for a constant power."""
    kept = exp(-dt / constant)
    return excess * kept + resistance * abs(tension - tension_behind) * speed * (1.0 - kept)


def slipperier(excess, slope):
    """What the friction coefficient has more."""
    return slope * excess


EFFECT = Effect(
    name="temperature",
    seam="contact",
    equation="mu = mu_0 + slope theta, constant theta' = resistance |T1 - T2| |v| - theta",
    source="heat balance of one body; friction power: Blok, Proc. General Discussion on Lubrication 2 (1937) 222",
    parameters=(
        EffectParameter("slope", "1/K", 0.0, -1.0, 1.0, "friction coefficient for one kelvin", -5e-3),
        EffectParameter("resistance", "K/W", 10.0, 0.0, 1e6, "temperature for one watt", 10.0, shape=True),
        EffectParameter(
            "constant", "s", 60.0, 1e-3, 1e6, "time constant of the contact", 60.0, shape=True, probes=(0.1, 1.0)
        ),
    ),
    states=(EffectState("excess", "K", 0.0, "temperature of the contact above that of the room"),),
    advance={"excess": warmed},
    hooks={"contact": slipperier},
    validity="friction that changes in a straight line with the temperature",
    experiment="move fast for minutes, then slowly: the friction at once and after a rest differ",
    confusable=("friction_drift",),
)
