"""Friction grows in proportion to the tension of the cable, in bearings that carry it and guides that it presses."""

from cable_envs.core.kernels import inline, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="load_dependent_friction",
    seam="load",
    equation="hole: F = -coefficient T1 sign(v), mu -> mu (T1 / weight)^exponent; circuit: M = -coefficient R5 "
    "(T45t + T45b) sign(v)",
    source="Zou 2022, section 3.2: friction that grows with pretension and the neglected bearings; bearing friction "
    "mu r_s / R per tension: Eq. (24); exponent -1/3 for elastic contacts: Bowden and Tabor, The Friction and "
    "Lubrication of Solids, Oxford 1950",
    parameters=(
        EffectParameter("coefficient", "1", 0.0, 0.0, 1.0, "friction over tension, at the load or output", 0.03, 0.02),
        EffectParameter(
            "exponent", "1", 0.0, -2.0, 2.0, "exponent of the hole's friction coefficient over the tension", 0.3,
            signed=True,
        ),
        EffectParameter(
            "shaft", "1", 0.0, 0.0, 2.0, "friction coefficient of the idlers on their shafts, mu_s", 0.15,
        ),
    ),
    validity="Amontons' law; the coefficient is mu r_s / R of a plain bearing. On the hole, friction in proportion to "
    "T1 is what the coefficient of friction does as well; the weight is that of the load at rest at y = 0",
    experiment="Move at a constant slow speed under four loads or pretensions. The coefficient is the slope of "
    "friction over tension",
    confusable=("coulomb_friction", "bending_stiffness"),
)  # fmt: skip


@inline
def friction_band(torque, growth, level):
    """(low, high) torque behind a contact: at full friction against positive motion, and against negative.

    growth: e^exponent, the tension ratio of the whole wrap (Eytelwein; Zou 2022 Eq. 12-13); level: friction that no
    load changes. Positive motion: torque = w growth + level for w > 0, w / growth + level for w < 0.
    """
    low, high = torque - level, torque + level
    return select(low < 0.0, low * growth, low / growth), select(high < 0.0, high / growth, high * growth)
