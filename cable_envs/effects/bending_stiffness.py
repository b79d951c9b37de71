"""A stiff cable lifts off at both ends of the hole's edge, most at low tension, and so has less friction."""

from cable_envs.effects.base import FORCE, Effect, EffectParameter

EFFECT = Effect(
    name="bending_stiffness",
    seam="contact",
    equation="theta_e = theta - sqrt(B / f1) / (2 R) - sqrt(B / f2) / (2 R)",
    source="Eq. (1), (A1)-(A11), Gu 2024",
    parameters=(
        EffectParameter(
            "rigidity", "N m^2", 0.0, 0.0, 10.0, "flexural rigidity B of the cable", 2e-5,
        ),
    ),
    validity="free spans l with l sqrt(T / B) > 1.83",
    experiment="Measure the tension ratio at four tensions and with two cable diameters",
    confusable=("coulomb_friction", "load_dependent_friction"),
    offsets=(FORCE,),  # T2 - B / (2 R^2) = (T1 - B / (2 R^2)) e^(mu theta): Stuart, Brit. J. Appl. Phys. 12 (1961) 559
)  # fmt: skip
