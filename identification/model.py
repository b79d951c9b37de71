"""Tension ratios of many parameter sets at many points, and their exact derivatives: the inner loop of identification.

Rows of ``theta``: delta, mu, K, omega, rho0 (SI), one column for each parameter set. The ratios are the kernels of
`cable_envs.physics.contact`: no second copy of the physics, only its derivatives.
"""

import numpy as np

from cable_envs.core.kernels import exp, inline, jit, log, maximum, sqrt
from cable_envs.physics.contact import (
    extrusion_coefficient,
    tension_ratio,
    tension_ratio_and_slope,
    tension_ratio_perturbed,
)
from cable_envs.physics.hole_ratio import EXACT, G22

NAMES = ("delta", "mu", "K", "omega", "rho0")
"""Row order of ``theta``; K in (s/m)^omega, all others are pure numbers."""
DELTA, MU, GAIN, OMEGA, RHO0 = (NAMES.index(name) for name in ("delta", "mu", "K", "omega", "rho0"))
FORMS = {"exact": EXACT, "g22": G22}
"""How n follows from the parameters: the exact solution of Eq. (17), or its expansion Eq. (22), Gu 2024."""

_STEP = 1e-5  # central differences of exact slopes: truncation and rounding both about 1e-10


@inline
def ratio_slope_in_rho(rho, mu, phi):
    """d lambda / d rho of `contact.tension_ratio`, exact."""
    mu = maximum(mu, 1e-9)
    q = 1.0 + rho
    root = sqrt(q * q + 4.0 * mu * mu * rho)
    high = root + q
    low = 4.0 * mu * mu * rho / high
    ea = exp(0.5 * phi * low / mu)
    eb = exp(-0.5 * phi * high / mu)
    d_root = (q + 2.0 * mu * mu) / root
    d_high = d_root + 1.0
    d_low = (4.0 * mu * mu - low * d_high) / high  # root' - 1 without the cancellation
    ratio = 0.5 * (low * eb + high * ea) / root
    slope = d_low * eb + d_high * ea + 0.5 * phi / mu * (high * d_low * ea - low * d_high * eb)
    return 0.5 * slope / root - ratio * d_root / root


@inline
def _ratio(form, theta, j, wrap, speed):
    friction = theta[MU, j] + extrusion_coefficient(theta[GAIN, j], theta[OMEGA, j], speed)
    if form == G22:
        return tension_ratio_perturbed(theta[RHO0, j], theta[DELTA, j], friction, wrap)
    return tension_ratio(theta[RHO0, j] * (1.0 + theta[DELTA, j]), friction, wrap)


@jit
def ratios(form, theta, wrap, speed):
    """Tension ratio of many parameter sets at many points.

    Parameters
    ----------
    form : int
        Of `FORMS`.
    theta : ndarray
        Parameter sets [5, sets], rows as `NAMES`, SI.
    wrap, speed : ndarray
        [points]: rad, m/s (>= 0).

    Returns
    -------
    ndarray
        n >= 1 [sets, points].
    """
    result = np.empty((theta.shape[1], wrap.shape[0]))
    for j in range(theta.shape[1]):
        for i in range(wrap.shape[0]):
            result[j, i] = _ratio(form, theta, j, wrap[i], speed[i])
    return result


@jit
def costs(form, theta, wrap, speed, measured, weight):
    """Sum of squares of weighted deviations of the tension ratio.  Eq. (23), Gu 2024, with weight 1.

    Parameters
    ----------
    form, theta, wrap, speed
        As of `ratios`.
    measured, weight : ndarray
        [points].

    Returns
    -------
    ndarray
        [sets].
    """
    result = np.empty(theta.shape[1])
    points = wrap.shape[0]
    buffer = np.empty(points)
    for j in range(theta.shape[1]):
        delta, rho0, mu, gain, omega = theta[DELTA, j], theta[RHO0, j], theta[MU, j], theta[GAIN, j], theta[OMEGA, j]
        if form == G22:  # one loop for each form and the sum apart, whose order must not change: these loops vectorise
            for i in range(points):
                friction = mu + extrusion_coefficient(gain, omega, speed[i])
                buffer[i] = weight[i] * (tension_ratio_perturbed(rho0, delta, friction, wrap[i]) - measured[i])
        else:
            for i in range(points):
                friction = mu + extrusion_coefficient(gain, omega, speed[i])
                buffer[i] = weight[i] * (tension_ratio(rho0 * (1.0 + delta), friction, wrap[i]) - measured[i])
        total = 0.0
        for i in range(points):
            total += buffer[i] * buffer[i]
        result[j] = total
    return result


@jit
def ratio_jacobian(form, theta, wrap, speed):
    """d n / d theta [points, 5] at one parameter set theta [5], in physical units; speed >= 0."""
    result = np.empty((wrap.shape[0], 5))
    delta, rho0 = theta[DELTA], theta[RHO0]
    for i in range(wrap.shape[0]):
        c = extrusion_coefficient(1.0, theta[OMEGA], speed[i])
        m, phi = theta[MU] + theta[GAIN] * c, wrap[i]
        if form == G22:  # n = lambda + delta rho0 lambda_rho, all at rho0
            d_rho = ratio_slope_in_rho(rho0, m, phi)
            up, down = rho0 * (1.0 + _STEP), rho0 * (1.0 - _STEP)
            d_rho_rho = (ratio_slope_in_rho(up, m, phi) - ratio_slope_in_rho(down, m, phi)) / (up - down)
            d_m_up, d_m_down = tension_ratio_and_slope(up, m, phi)[1], tension_ratio_and_slope(down, m, phi)[1]
            slope = tension_ratio_and_slope(rho0, m, phi)[1] + delta * rho0 * (d_m_up - d_m_down) / (up - down)
            result[i, DELTA] = rho0 * d_rho
            result[i, RHO0] = d_rho + delta * (d_rho + rho0 * d_rho_rho)
        else:
            rho = rho0 * (1.0 + delta)
            d_rho = ratio_slope_in_rho(rho, m, phi)
            slope = tension_ratio_and_slope(rho, m, phi)[1]
            result[i, DELTA] = rho0 * d_rho
            result[i, RHO0] = (1.0 + delta) * d_rho
        result[i, MU] = slope
        result[i, GAIN] = slope * c
        result[i, OMEGA] = slope * theta[GAIN] * c * log(maximum(speed[i], 1e-300))
    return result
