"""The effects of the library in the form that they have on a transmission of unknown geometry.

A form has the name of its effect, and the equation, the parameters and the sizes that belong to this plant: what is
printed as the equation of an answer is what the kernel computes.
"""

from dataclasses import replace

from cable_envs.effects import EFFECTS, Acting, Effect, EffectParameter


def _form(name: str, equation: str, *parameters: EffectParameter, **changes) -> Effect:
    """The effect ``name`` on this plant."""
    return replace(EFFECTS[name], equation=equation, parameters=parameters, **changes)


FORMS = (
    _form(
        "cable_elongation", "angle = ratio x - drive_side M - output_side M_out: springs at both ends of the friction",
        EffectParameter("drive_side", "rad/(N m)", 0.0, 0.0, 50.0, "compliance that feels the drive's torque", 0.5),
        EffectParameter("output_side", "rad/(N m)", 0.0, 0.0, 50.0, "compliance that feels the output's torque", 0.5),
    ),
    _form(
        "stiffness_hardening", "stretch e = C 2 M / (1 + sqrt(1 + 2 h |M|)), so that M = (e / C) (1 + h e / (2 C))",
        EffectParameter("drive_side", "1/(N m)", 0.0, 0.0, 300.0, "growth of the drive's stiffness per torque", 10.0),
        EffectParameter("output_side", "1/(N m)", 0.0, 0.0, 300.0, "growth of the output's stiffness per torque", 10.0),
    ),
    _form(
        "coulomb_friction", "M = w + level sign(v) between the drive's torque M and the torque w behind the friction",
        EffectParameter("level", "N m", 0.0, 0.0, 10.0, "dry friction that no load changes, at the drive", 0.02),
        # pretension times the capstan's exponent looks like it, and the torque's free zero takes up what the
        # directions differ by
        confusable=(*EFFECTS["coulomb_friction"].confusable, "asymmetric_friction"),
    ),
    _form(
        "load_dependent_friction", "opening (v > 0): M = w e^(-exponent) where w < 0 pulls; closing: M = w e^exponent",
        EffectParameter(
            "exponent", "1", 0.0, 0.0, 3.0, "exponent of the tension ratio over the whole path (capstan, bearings)", 0.2
        ),
        source="tension ratio of a wrap: Eytelwein; Zou 2022 Eq. 12-13",
    ),
    _form(
        "presliding_hysteresis",
        "w = share max(low, min(w_before, high)) + (1 - share) (low where v > 0, high where v < 0): low and high are w "
        "at full friction against opening and against closing, w_before what the play of the torque was a step before",
        EffectParameter("share", "1", 0.0, 0.0, 1.2, "part of the friction that sticks; the rest follows sign(v)", 0.5),
        source="play operator: Krasnosel'skii and Pokrovskii, Systems with Hysteresis, Springer 1989",
    ),
    _form(
        "partial_slip",
        "two contacts: share of exponent and level at the drive, then angle -= compliance w_1, then the rest of them",
        EffectParameter("share", "1", 0.0, 0.0, 0.95, "part of the friction before the spring in the path", 0.3),
        EffectParameter("compliance", "rad/(N m)", 0.0, 0.0, 50.0, "compliance of that spring", 0.5),
    ),
    _form(
        "viscous_friction", "M = w + coefficient v",
        EffectParameter("coefficient", "N m s/rad", 0.0, 0.0, 10.0, "viscous friction at the drive", 0.01),
    ),
    _form(
        "stribeck_friction", "level + excess exp(-(v / velocity)^2) in the place of level",
        EffectParameter("excess", "N m", 0.0, 0.0, 10.0, "friction at v = 0 above Coulomb's", 0.02),
        EffectParameter(
            "velocity", "rad/s", 0.3, 0.01, 10.0, "speed at which the excess has fallen to 1/e", 0.1, shape=True,
            probes=(1.0, 3.0, 10.0),
        ),
    ),
    _form(
        "backlash", "angle in [path - gap / 2, path + gap / 2], where it was unless an edge moves it (play operator)",
        EffectParameter("gap", "rad", 0.0, 0.0, 1.0, "whole width of the gap", 0.02),
    ),
    _form(
        "viscoelastic_creep", "angle -= u, time u' = share e - u with the elastic stretch e of all springs",
        EffectParameter("share", "1", 0.0, 0.0, 20.0, "compliance of the creep over the elastic one", 0.2),
        EffectParameter(
            "time", "s", 1.0, 0.02, 100.0, "time constant of the creep", 1.0, shape=True, probes=(0.1, 1.0, 5.0)
        ),
    ),
    _form(
        "friction_drift", "level, excess and exponent times 1 + change d, d' = (1 - d) (1 / time + |v| / travel)",
        EffectParameter("change", "1", 0.0, -0.9, 5.0, "final relative change of all dry friction", 0.6),
        EffectParameter("time", "s", 60.0, 1e-2, 1e9, "time constant; 1e9 is no change", 60.0, shape=True),
        EffectParameter("travel", "rad", 1e9, 1e-6, 1e9, "travel constant; 1e9 is no change", 50.0, shape=True),
    ),
    _form(
        "position_ripple", "angle = ratio x + sine (sin 2x - 2x) + cosine (cos 2x - 1), with a period of half a turn",
        EffectParameter("sine", "rad", 0.0, -1.0, 1.0, "amplitude of the sine", 0.02),
        EffectParameter("cosine", "rad", 0.0, -1.0, 1.0, "amplitude of the cosine", 0.02),
        wave=None,
    ),
    _form(
        "position_dependent_load", "M = w + drive_side x ;  M_out = w / ratio - output_side x",
        EffectParameter("drive_side", "N m/rad", 0.0, -1.0, 1.0, "spring on the drive", 0.02),
        EffectParameter("output_side", "N m/rad", 0.0, -1.0, 1.0, "spring on the output, over the drive's angle", 0.02),
    ),
)  # fmt: skip
"""In the order in which a search looks at them: of two that are one on a recording the first is named."""

ACTING = Acting(effects={}, sensors={"output_angle": "rad", "output_torque": "N m"}, seams=(), forms=FORMS)
