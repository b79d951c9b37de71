"""The cable goes on stretching under load, and recovers after it (standard linear solid)."""

from cable_envs.core.kernels import exp, inline, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="viscoelastic_creep",
    seam="cable",
    equation="T = k (stretch - u), time u' = share T / k - u (circuit: share (T - T_pre): it is settled at rest)",
    source="standard linear solid: Zener, Elasticity and Anelasticity of Metals, Chicago 1948",
    parameters=(
        EffectParameter("share", "1", 0.0, 0.0, 20.0, "compliance of the creep over the elastic one", 0.5),
        EffectParameter(
            "time", "s", 5.0, 1e-3, 1e5, "time constant of the creep", 5.0, shape=True, probes=(0.1, 1.0),
            search_low=0.2,  # creep that is over in 0.1 s is a cable's damping
        ),
    ),
    validity="linear creep with one time constant. A rope has several; the one that is visible in the record counts",
    experiment="Hold a load, unload, hold, and repeat. Creep comes back, and drift does not",
    confusable=("friction_drift", "cable_elongation", "actuator_lag", "slack", "sensor_bias"),
)  # fmt: skip


@inline
def kept(time, dt):
    """Share of the distance to its target that the creep still has after dt."""
    return exp(-dt / time)


@inline
def crept(u, share, elongation, keep):
    """Creep after a step with the elastic ``elongation``; zero stays zero without the effect."""
    target = share * elongation
    return select(share > 0.0, target + (u - target) * keep, u)
