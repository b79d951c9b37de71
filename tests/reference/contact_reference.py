"""The equations of one wrapped contact in plain NumPy and SciPy, as they stand; nothing of the package is used."""

from itertools import pairwise

import numpy as np
from scipy.integrate import quad, solve_bvp, solve_ivp
from scipy.optimize import brentq


def tension_ratio_printed(rho, mu, phi):
    """Eq. (12), Zou 2022, as printed; accepts a complex mu for derivatives by complex step."""
    root = np.sqrt((1 + rho) ** 2 + 4 * mu**2 * rho)
    a, b = (-(1 + rho) + root) / (2 * mu), (-(1 + rho) - root) / (2 * mu)
    return (a * np.exp(b * phi) - b * np.exp(a * phi)) / (a - b)


def tension_ratio_by_ode(rho, mu, phi):
    """Balance of an element with shear force Q: T' = rho Q, Q' = T - N', mu N' = T' + Q (Eqs. 2-6, Zou 2022)."""
    solution = solve_ivp(
        lambda _, y: (rho * y[1], y[0] - (1 + rho) * y[1] / mu), (0, phi), (1.0, 0.0), "Radau", rtol=1e-10, atol=1e-12
    )
    return solution.y[0, -1]


def tension_integral_by_quadrature(rho, mu, phi):
    """Integral of Eq. (12), Zou 2022, over the angle."""
    return quad(lambda angle: tension_ratio_printed(rho, mu, angle), 0, phi, epsabs=0, epsrel=1e-12)[0]


def perturbation_by_ode(rho, mu, phi):
    """(T_e0, T_d1) of Eqs. (19)-(20), Gu 2024, for T(0) = 1."""

    def slope(_, y):
        t0, s0, t1, s1 = y
        return (
            s0,
            rho * t0 - (1 + rho) / mu * s0,
            s1,
            rho * t1 - (1 + rho) / mu * s1 + (rho * mu * t0 - rho * s0) / mu,
        )

    solution = solve_ivp(slope, (0, phi), (1.0, 0.0, 0.0, 0.0), "Radau", rtol=1e-10, atol=1e-12)
    return solution.y[0, -1], solution.y[2, -1]


def chi(hole_radius, cable_radius, modulus, poisson):
    """Eq. (3), Gu 2024: half of the contact width per root of the line force."""
    hertz = 4 / (np.pi * hole_radius) * (1 - poisson**2) / modulus / (1 / hole_radius + 1 / cable_radius)
    return np.sqrt(hertz)


def extruded_area(line_force, hole_radius, cable_radius, chi_):
    """Eqs. (4)-(6), Gu 2024, as printed."""
    width = 2 * chi_ * np.sqrt(line_force)
    eps = cable_radius - np.sqrt(cable_radius**2 - (width / 2) ** 2)
    return eps * (hole_radius + eps)


def nonlinear_ratio_by_roots(hole_radius, cable_radius, chi_, mu, drag, wrap, inlet):
    """Eq. (13), Gu 2024, in T and Q with N' found at each step by bisection on mu N' + drag area(N') = T' + Q."""
    rho = hole_radius / cable_radius
    limit = (cable_radius / chi_) ** 2 * (1 - 1e-12)

    def slope(_, y):
        tension, shear = y
        friction = (rho + 1) * shear
        balance = lambda force: mu * force + drag * extruded_area(force, hole_radius, cable_radius, chi_) - friction  # noqa: E731
        force = brentq(balance, 0.0, limit, xtol=1e-13, rtol=1e-14) if friction > 0 else 0.0
        return rho * shear, tension - force

    solution = solve_ivp(slope, (0, wrap), (inlet, 0.0), "LSODA", rtol=1e-9, atol=1e-11)
    return solution.y[0, -1] / inlet


def turning_by_roots(radius, support_radius, friction, wrap, load_torque=0.0, low=1.0):
    """T_2 / T_1 that turns a pulley: torque balance, support force as a sum of vectors (Eqs. 24-26, Zou 2022)."""

    def balance(high):
        # unit vectors of the two cable ends leaving the pulley; at wrap pi they are parallel
        force = low * np.array([1.0, 0.0]) + high * np.array([-np.cos(wrap), np.sin(wrap)])
        return radius * (high - low) - load_torque - friction * support_radius * np.linalg.norm(force)

    start = low + load_torque / radius
    return brentq(balance, start, 1e3 * start, xtol=1e-14, rtol=1e-14) / low


def lift_off_turn_by_elastica(rigidity, tension, radius):
    """Angle a cable still turns after lift-off: B theta'' = T sin(theta), curvature 1/R there, straight far away."""
    u = np.sqrt(tension / rigidity)
    x = np.linspace(0, 20 / u, 200)
    guess = np.array([np.exp(-u * x) / (u * radius), -np.exp(-u * x) / radius])
    solution = solve_bvp(
        lambda _, y: np.array([y[1], u * u * np.sin(y[0])]),
        lambda near, far: np.array([near[1] + 1 / radius, far[0]]),
        x,
        guess,
        tol=1e-8,
    )
    return solution.y[0, 0]


def capstan_friction_work(mu, slip, scale, inlet, outlets):
    """Work of friction [len(outlets) - 1] while the outlet of a capstan goes down through ``outlets``, loaded before.

    An element of the cable moves by the change of u(theta), the stretch between it and the inlet; ``scale`` is R / EA.
    """
    theta = np.linspace(0, slip, 4001)
    rising = inlet * np.exp(mu * theta)

    def state(outlet):
        tension = np.minimum(rising, outlet * np.exp(mu * (slip - theta)))
        mid = 0.5 * (tension[1:] + tension[:-1])
        return tension, np.concatenate([[0.0], np.cumsum(mid * np.diff(theta))]) * scale

    works = []
    for before, after in pairwise(outlets):
        (t0, u0), (t1, u1) = state(before), state(after)
        friction = 0.5 * (np.abs(np.diff(t0)) + np.abs(np.diff(t1)))
        moved = np.abs(u1 - u0)
        works.append(np.sum(friction * 0.5 * (moved[1:] + moved[:-1])))
    return np.array(works)
