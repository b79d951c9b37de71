"""Closed form of a hole's tension ratio for controllers and identification: one compiled call, cached on disk.

The pieces are those of `contact`; the plant inlines the same ones. Three forms are offered because Gu 2024 compares
them: the exact solution of G17, its first-order expansion G22, and G9 without extrusion.
"""

from cable_envs.core.kernels import jit
from cable_envs.physics.contact import extrusion_coefficient, tension_ratio, tension_ratio_perturbed, wrap_in_contact

EXACT, G22, G9 = 0, 1, 2


@jit
def hole_ratio(form, speed, wrap, rho, mu, delta, gain, exponent, rigidity, radius, tension_a, tension_b):
    """Tension ratio n >= 1 of one hole.  Eq. (9), (17), (22) with (1), Gu 2024.

    symbol     | meaning                                                      | unit
    ---------- | ------------------------------------------------------------ | ----
    form       | EXACT, G22 or G9 (the last without delta and extrusion)      |
    speed      | sliding speed; its absolute value is used                    | m/s
    wrap       | geometric wrap angle                                         | rad
    rho, delta | radius ratio rho0 = R / r and its relative change            | 1
    mu         | Coulomb coefficient                                          | 1
    gain, exponent | K and omega of C = K v^omega                             | SI
    rigidity, radius | flexural rigidity of the cable, bending radius of the hole | N m^2, m
    tension_a, tension_b | tensions of both sides (only used by the rigidity) | N
    """
    contact = wrap_in_contact(wrap, rigidity, radius, tension_a, tension_b)
    if form == G9:
        return tension_ratio(rho, mu, contact)
    total = mu + extrusion_coefficient(gain, exponent, speed)
    if form == G22:
        return tension_ratio_perturbed(rho, delta, total, contact)
    return tension_ratio(rho * (1.0 + delta), total, contact)
