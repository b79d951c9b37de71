"""The effects of the library in the form that they have on a band brake: its equation, parameters and sizes."""

from dataclasses import replace

from cable_envs.effects import EFFECTS, Acting, Effect, EffectParameter

RIGID = 1e-9
"""m/N of a band that is taken as rigid: 5 um at 5 kN."""
HARDEST = 1e-3
"""1/N: six times as stiff at 5 kN. The law is of first order in the tension; a spring all of hardening is a play."""


def _form(name: str, equation: str, *parameters: EffectParameter, **changes) -> Effect:
    """The effect ``name`` on this plant."""
    return replace(EFFECTS[name], equation=equation, parameters=parameters, **changes)


FORMS = (
    _form(
        "load_dependent_friction", "F = coefficient D + coulomb sign(v): force on the drum from the band's pull D",
        EffectParameter("coefficient", "1", 0.0, 0.0, 20.0, "force on the drum for one newton of the band's pull", 1.0),
    ),
    _form(
        "backlash", "D = f(s - gap / 2) for s > gap / 2, f(s + gap / 2) for s < -gap / 2, else 0; s = x - z, z slips",
        EffectParameter("gap", "m", 0.0, 0.0, 0.1, "whole travel over which the band does not pull", 1e-3),
    ),
    _form(
        "cable_elongation", "D = (x - z) / compliance, |D| <= grip: beyond it the drum slips (z follows)",
        EffectParameter("compliance", "m/N", RIGID, RIGID, 1e-3, "compliance of the band", 1e-7),
    ),
    _form(
        "stiffness_hardening", "D = p (1 + coefficient p / 2), p = (x - z) / compliance",
        EffectParameter("coefficient", "1/N", 0.0, 0.0, HARDEST, "relative growth of stiffness per tension", 1e-4),
    ),
    _form(
        "presliding_hysteresis",
        "s_k' = 4 z' / (k displacement), held in [0, 1], k = 1..4; D = -down + mean(s) (up + down), and D is the "
        "band's spring of x - z: friction builds up over the slip z",
        EffectParameter(
            "displacement", "m", 0.0, 0.0, 0.1, "slip after a reversal until all of the friction has reversed", 1e-3
        ),
    ),
    _form(
        "viscous_friction", "F += coefficient v;  D += band v",
        EffectParameter("coefficient", "N s/m", 0.0, 0.0, 1e6, "viscous friction of the drum", 1e3),
        EffectParameter("band", "N s/m", 0.0, 0.0, 1e6, "viscous part of the band's pull", 1e3),
    ),
    _form(
        "stribeck_friction", "grip + excess exp(-(v / velocity)^2) in the place of grip",
        EffectParameter("excess", "N", 0.0, 0.0, 1e5, "grip at v = 0 above that of sliding", 100.0),
        EffectParameter(
            "velocity", "m/s", 0.02, 1e-3, 1.0, "speed at which the excess has fallen to 1/e", 0.01, shape=True,
            probes=(0.5, 2.0, 8.0),
        ),
    ),
    _form(
        "asymmetric_friction", "up = grip + max(difference, 0), down = grip + max(-difference, 0)",
        EffectParameter(
            "difference", "N", 0.0, -1e5, 1e5, "grip up minus grip down", 100.0, signed=True
        ),
    ),
    _form(
        "position_dependent_load", "F += stiffness (x - neutral)",
        EffectParameter("stiffness", "N/m", 0.0, 0.0, 1e7, "spring on the drum", 1e4),
        EffectParameter("neutral", "m", 0.0, -100.0, 100.0, "position at which it is relaxed", 0.0, shape=True),
    ),
)  # fmt: skip

ACTING = Acting(effects={}, sensors={"force": "N", "band_tension_difference": "N"}, seams=(), forms=FORMS)
