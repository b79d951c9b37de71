"""The winding of a motor warms up by its own losses, and its resistance grows."""

from cable_envs.core.kernels import exp, inline
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="winding_heating",
    seam="actuate",
    equation="R = R_0 (1 + h), h' = growth R i^2 - h / time, h(0) = 0",
    source="one thermal resistance and capacity, copper by 0.39 % a kelvin: Hendershot and Miller, Design of Brushless "
    "Permanent-Magnet Machines, 2010",
    parameters=(
        EffectParameter("growth", "1/J", 0.0, 0.0, 10.0, "share by which a joule of loss makes R grow", 0.02),
        EffectParameter(
            "time",
            "s",
            20.0,
            1e-2,
            1e6,
            "time constant of its cooling",
            20.0,
            shape=True,
            probes=(0.2, 1.0),
            search_low=1.0,  # what answers within less is a resistance, no heat
        ),
    ),
    validity="a winding that is at the temperature of R_0 when the run begins; torque constant and friction stay",
    experiment="Hold a load for a minute. The duty that it takes grows, and is back after a rest",
    confusable=("supply_sag", "torque_saturation", "friction_drift"),
)


@inline
def warmed(warming, loss, growth, time, dt):
    """Share by which the resistance has grown after ``dt`` with a loss in W; zero stays zero without the effect."""
    kept = exp(-dt / time)
    return warming * kept + growth * loss * time * (1.0 - kept)
