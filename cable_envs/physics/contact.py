"""A cable wrapped over a rigid surface: tension ratio, its integral, its slope, and what changes the wrap.

Force balance, Amontons friction and moment balance with constant bending moment give (Gu 2024 Eq. 8; Zou 2022 Eq. 7)

    mu T'' + (1 + rho) T' - rho mu T = 0,    T(0) = T1,  T'(0) = 0

symbol | meaning | unit
------ | ------- | ----
rho    | surface radius over cable radius, R / r (Gu prints r / R, which has no capstan limit: docs/physics.md) | 1
mu     | friction coefficient (with extrusion: M = mu + C) | 1
phi    | wrap angle in contact | rad

All functions are scalar kernels without branches; they accept Python floats too. mu is limited below at 1e-9.
"""

from cable_envs.core.kernels import exp, expm1, inline, maximum, power, sqrt


@inline
def tension_ratio(rho, mu, phi):
    """T(phi)/T(0) >= 1.  Eq. (12), Zou 2022; Eq. (9), Gu 2024.

    With D = sqrt((1 + rho)^2 + 4 mu^2 rho), a, b = (-(1 + rho) +/- D) / (2 mu):
    lambda = (a e^(b phi) - b e^(a phi)) / (a - b). Limit rho -> infinity: e^(mu phi); always below it.

    Parameters
    ----------
    rho : float
        Radius of the edge over the cable's, 1.
    mu : float
        Friction coefficient, 1.
    phi : float
        Wrap angle, rad.

    Returns
    -------
    float
        The larger tension over the smaller.

    Examples
    --------
    A thin cable over half a turn is close to the capstan's e^(mu phi) = 1.874, a thick one is not.

    >>> round(tension_ratio(1e6, 0.2, 3.14159), 3), round(tension_ratio(1.5, 0.2, 3.14159), 3)
    (1.874, 1.439)
    """
    return tension_ratio_and_slope(rho, mu, phi)[0]


@inline
def tension_ratio_and_slope(rho, mu, phi):
    """(lambda, d lambda / d mu): the ratio of `tension_ratio` and its exact derivative to the friction coefficient."""
    mu = maximum(mu, 1e-9)
    q = 1.0 + rho
    root = sqrt(q * q + 4.0 * mu * mu * rho)
    high = root + q
    low = 4.0 * mu * mu * rho / high  # root - q without the cancellation
    inv_mu, inv_root = 1.0 / mu, 1.0 / root  # few divisions: this is the inner loop of every plant
    a = 0.5 * inv_mu * low
    b = -0.5 * inv_mu * high
    ea = exp(a * phi)
    eb = exp(b * phi)
    ratio = 0.5 * inv_root * (low * eb + high * ea)
    d_root = 4.0 * mu * rho * inv_root
    d_a = (0.5 * d_root - a) * inv_mu
    d_b = (-0.5 * d_root - b) * inv_mu
    slope = inv_root * (0.5 * (d_root * (eb + ea) + phi * (low * d_b * eb + high * d_a * ea)) - ratio * d_root)
    return ratio, slope


@inline
def tension_integral(rho, mu, phi):
    """Integral of `tension_ratio` over [0, phi], in rad.  Phi of Eq. (16), Zou 2022."""
    mu = maximum(mu, 1e-9)
    q = 1.0 + rho
    root = sqrt(q * q + 4.0 * mu * mu * rho)
    a = 2.0 * mu * rho / (root + q)
    b = -(root + q) / (2.0 * mu)
    return ((a / b) * expm1(b * phi) - (b / a) * expm1(a * phi)) / (a - b)


@inline
def tension_ratio_perturbed(rho, delta, mu, phi):
    """First-order expansion in delta of ``tension_ratio(rho (1 + delta), mu, phi)``.  Eq. (22), Gu 2024.

    mu here is mu + C, the Coulomb part and the extrusion part together.
    """
    mu = maximum(mu, 1e-9)
    q = 1.0 + rho
    root = sqrt(q * q + 4.0 * mu * mu * rho)
    b = 2.0 * mu * rho / (root + q)  # a and b as in Gu: b is the positive root
    a = -(root + q) / (2.0 * mu)
    coeff_a = -b / (a - b)
    coeff_b = a / (a - b)
    a22 = rho * (mu - a) * coeff_a / (2.0 * mu * a + q)
    b22 = rho * (mu - b) * coeff_b / (2.0 * mu * b + q)
    a21 = -(a22 + b22) / (a - b)
    return (coeff_a + delta * (a21 + a22 * phi)) * exp(a * phi) + (coeff_b + delta * (b22 * phi - a21)) * exp(b * phi)


@inline
def extrusion_coefficient(gain, exponent, speed):
    """C = K |v|^omega, the speed-dependent part of the friction coefficient.  Eq. (17), Gu 2024.

    gain K in (s/m)^omega, speed in m/s (its absolute value is used).

    Examples
    --------
    >>> round(extrusion_coefficient(0.5, 0.5, -0.04), 6)
    0.1
    """
    return gain * power(abs(speed), exponent)


@inline
def wrap_in_contact(wrap, rigidity, radius, tension_a, tension_b):
    """Wrap angle that remains in contact under bending stiffness, rad, never negative.  Eq. (1), (A11), Gu 2024.

    wrap rad; rigidity B in N m^2; radius R of the hole's edge in m; tensions of both sides in N.
    Valid for free spans l with l sqrt(T / B) > 1.83; tensions are limited below at 1 mN.
    """
    root_a, root_b = sqrt(maximum(tension_a, 1e-3)), sqrt(maximum(tension_b, 1e-3))
    lost = sqrt(rigidity) * (root_a + root_b) / (2.0 * radius * root_a * root_b)
    return maximum(wrap - lost, 0.0)
