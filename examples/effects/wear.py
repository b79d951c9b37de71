"""Wear: the friction of the contact grows with the way that the cable has slid in it.

    gymnasium.make("cable_envs/CableHole-Position-Sine-v1", effect_file="examples/effects/wear.py",
                   effects={"wear": {"growth": 0.5}})

Archard, Journal of Applied Physics 24 (1953) 981: what is worn off is in proportion to the way.
"""

from cable_envs.effects import Effect, EffectParameter, EffectState


def slid(way, speed, dt):
    """The way after dt, m."""
    return way + speed * dt


def rougher(way, growth):
    """What the friction coefficient has more."""
    return growth * way


EFFECT = Effect(
    name="wear",
    seam="contact",
    equation="mu = mu_0 + growth way, way' = |v|",
    source="Archard, J. Appl. Phys. 24 (1953) 981",
    parameters=(EffectParameter("growth", "1/m", 0.0, 0.0, 100.0, "friction coefficient for 1 m", typical=0.1),),
    states=(EffectState("way", "m", 0.0, "way that the cable has slid in the contact"),),
    advance={"way": slid},
    hooks={"contact": rougher},
    validity="ways on which the growth is still a straight line",
    experiment="the same motion a hundred times",
    confusable=("friction_drift",),
)
