"""Friction changes while the rig runs, with time or with travel (wear, lubricant, temperature)."""

from cable_envs.core.kernels import exp, inline, select
from cable_envs.effects.base import DRIFT, Effect, EffectParameter

EFFECT = Effect(
    name="friction_drift",
    seam="contact",
    equation="friction = friction_0 (1 + change d), d' = (1 - d) (1 / time + |v| / travel), d(0) = 0",
    source="running-in and warming-up: Archard and Hirst, Proc. R. Soc. A 236 (1956) 397; one exponential",
    parameters=(
        EffectParameter(
            "change", "1", 0.0, -0.9, 5.0, "final relative change of all dry friction", 0.3, signed=True
        ),
        EffectParameter(
            "time", "s", 60.0, 1e-2, 1e9, "time constant; 1e9 is no change", 60.0, shape=True,
            probes=(0.1, 0.5, 2.0), search_low=1.0,
        ),
        EffectParameter("travel", "m", 1e9, 1e-6, 1e9, "travel constant; 1e9 is no change", 1.0, 50.0, shape=True),
    ),
    validity="changes that are slow against a control step; in pulley_circuit and pulley_chain, tension ratios go in "
    "a straight line from the present to the final friction coefficients",
    experiment="Repeat the same motion at the beginning, in the middle and at the end of a long run, and once more "
    "after a rest",
    confusable=("viscoelastic_creep", "sensor_scale"),
    over_time=DRIFT,
)  # fmt: skip


@inline
def drifted(d, change, time, travel, dt, moved):
    """State after dt with ``moved`` of travel; nothing happens without the effect."""
    return select(change != 0.0, 1.0 - (1.0 - d) * exp(-dt / time - moved / travel), d)
