"""The stiffness of a rope grows with its tension, because strands and braids settle."""

from cable_envs.core.kernels import inline, sqrt
from cable_envs.effects.base import PLACE, Effect, EffectParameter

EFFECT = Effect(
    name="stiffness_hardening",
    seam="cable",
    equation="T = T_lin (1 + coefficient T_lin / 2), dT/ds = k (1 + coefficient T_lin), T_lin = k stretch",
    source="ropes grow stiffer with stress: Feyrer, Wire Ropes, Springer 2015; here to first order",
    parameters=(
        EffectParameter(
            "coefficient", "1/N", 0.0, 0.0, 1.0, "relative growth of stiffness per tension", 0.01, 0.01,
            probes=(0.1, 0.5, 2.0, 6.0),
        ),
    ),
    validity="first order in the tension; the chain takes the secant stiffness of each span from the step before",
    experiment="Lock the output, and ramp the force over the whole range. The curve of drive motion over tension bends",
    confusable=("cable_elongation", "slack"),
    offsets=(PLACE,),  # strands that settle below the tensions of use leave the cable longer: Feyrer, ch. 3
)  # fmt: skip


@inline
def linear(tension, coefficient):
    """The inverse of `hardened`, for tensions >= 0; exact without the effect."""
    return 2.0 * tension / (1.0 + sqrt(1.0 + 2.0 * coefficient * tension))


@inline
def hardened(linear, coefficient):
    """(tension, its slope over that of the linear law) of the tension that the linear law would give."""
    return linear * (1.0 + 0.5 * coefficient * linear), 1.0 + coefficient * linear
