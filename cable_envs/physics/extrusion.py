"""Lateral extrusion of a cable in a hole: contact geometry, and the tension ratio with varying friction.

Sections 2.2-2.3 of Gu 2024. A hole presses the cable flat; friction grows with the area that is pressed.

symbol | meaning | unit
------ | ------- | ----
N'     | line force, contact force per angle dN/dphi = T - T''/rho (Eq. 14) | N/rad
chi    | contact width per root of the line force (Eq. 3) | m N^(-1/2)
b      | width of the contact, 2 chi sqrt(N') (Eq. 3: the width, not the half width of Hertz) | m
eps    | virtual penetration = lateral compression (Eq. 4) | m
k      | resistance per area, k = K / (R chi^2 / (2 r)) (Eq. 10) | N/m^2 (s/m)^omega

Eq. (7) as printed lacks factors. Expanding Eqs. (4) and (6) gives

    eps = chi^2 N'/(2r) + chi^4 N'^2/(8 r^3) + ...
    area per angle = R eps + eps^2 = [R chi^2/(2r)] N' + [R/(8 r^3) + 1/(4 r^2)] chi^4 N'^2 + ...

where the print has R chi^2/r and chi^4/r^2. What Eq. (6) calls area is depth times arc, not width times arc; the
identified K absorbs the difference. Plain Python and NumPy: plants use the closed forms of `physics.contact`, of
which this is the reference.
"""

import math
from dataclasses import dataclass, fields

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest

LAWS = ("exact", "taylor", "linear")
"""How the area follows the line force: Eq. (6) itself; its first two Taylor terms, Eq. (7); the first term alone."""


def _require(name: str, value: float, low: float, high: float = math.inf, unit: str = "") -> None:
    if not (math.isfinite(value) and low <= value <= high):
        shown = f"{name} = {value:g} {unit}".rstrip()
        raise ConfigurationError(f"{shown} is outside its physical range [{low:g}, {high:g}]")


@dataclass(frozen=True)
class ExtrudedContact:
    """A soft round cable on a rigid hole edge; Eqs. (3)-(7), Gu 2024. Line forces may be floats or arrays, in N/rad.

    Raises ConfigurationError for non-physical numbers, and from every method for line forces outside
    [0, `largest_line_force`], where half the cable would be flattened and Eq. (4) ends.
    """

    hole_radius: float
    """R, m"""
    cable_radius: float
    """r without load, m"""
    lateral_modulus: float
    """E_r, Pa; far below the wire's own: a rope's strands move"""
    poisson: float = 0.3
    """of the cable in the lateral direction; not printed, usual value"""

    def __post_init__(self):
        for field in fields(self)[:3]:
            _require(field.name, getattr(self, field.name), 1e-12)
        _require("poisson", self.poisson, 0.0, 0.5)

    @classmethod
    def from_compression(
        cls, hole_radius: float, cable_radius: float, compression: float, line_force: float, poisson: float = 0.3
    ) -> "ExtrudedContact":
        """The contact with the measured ``compression`` (m) at ``line_force`` (N/rad): Eq. (4) inverted."""
        _require("cable_radius", cable_radius, 1e-12, unit="m")
        _require("compression", compression, 1e-12, cable_radius, "m")
        _require("line_force", line_force, 1e-12, unit="N/rad")
        chi_squared = compression * (2.0 * cable_radius - compression) / line_force
        unit = cls(hole_radius, cable_radius, 1.0, poisson)
        return cls(hole_radius, cable_radius, unit.chi**2 / chi_squared, poisson)

    @property
    def radius_ratio(self) -> float:
        """rho0 = R / r (Eq. 2 prints the inverse: docs/physics.md)."""
        return self.hole_radius / self.cable_radius

    @property
    def chi(self) -> float:
        """chi of Eq. (3), m N^(-1/2). Hertz: half width^2 = 4 (N'/R) (1 - nu^2) / (pi E_r (1/R + 1/r))."""
        curvature = 1.0 / self.hole_radius + 1.0 / self.cable_radius
        return math.sqrt(
            4.0 * (1.0 - self.poisson**2) / (math.pi * self.hole_radius * self.lateral_modulus * curvature)
        )

    @property
    def largest_line_force(self) -> float:
        """r^2 / chi^2, N/rad: eps = r."""
        return (self.cable_radius / self.chi) ** 2

    @property
    def area_coefficient(self) -> float:
        """R chi^2 / (2 r), m^2/N: first Taylor term of the area per angle; lambda of Eq. (11), K = k lambda."""
        return self.hole_radius * self.chi**2 / (2.0 * self.cable_radius)

    @property
    def area_curvature(self) -> float:
        """[R / (8 r^3) + 1 / (4 r^2)] chi^4, m^2 rad/N^2: second Taylor term of the area per angle."""
        R, r = self.hole_radius, self.cable_radius
        return (R / (8.0 * r**3) + 1.0 / (4.0 * r**2)) * self.chi**4

    def resistance(self, gain: float) -> float:
        """k of Eq. (10) that belongs to the identified gain K of Eq. (17): K / area_coefficient."""
        return gain / self.area_coefficient

    def _checked(self, line_force):
        force = np.asarray(line_force, dtype=float)
        if not np.all((force >= 0.0) & (force <= self.largest_line_force)):
            raise ConfigurationError(f"line force outside [0, {self.largest_line_force:g}] N/rad, where eps reaches r")
        return force

    def width(self, line_force):
        """b = 2 chi sqrt(N'), m: the full width of the flattened strip.  Eq. (3)."""
        return 2.0 * self.chi * np.sqrt(self._checked(line_force))

    def compression(self, line_force):
        """eps = r - sqrt(r^2 - (b/2)^2), m.  Eq. (4)."""
        squared = self.chi**2 * self._checked(line_force)
        return squared / (self.cable_radius + np.sqrt(np.maximum(self.cable_radius**2 - squared, 0.0)))

    def arc(self, line_force):
        """dl/dphi = R + eps, m/rad.  Eq. (5)."""
        return self.hole_radius + self.compression(line_force)

    def area(self, line_force):
        """ds/dphi = eps (R + eps), m^2/rad.  Eq. (6)."""
        return self.compression(line_force) * self.arc(line_force)

    def area_taylor(self, line_force):
        """The first two Taylor terms of `area`, m^2/rad.  Eq. (7), coefficients rederived."""
        force = self._checked(line_force)
        return (self.area_coefficient + self.area_curvature * force) * force


def _line_force_from_friction(contact: ExtrudedContact, mu: float, drag: float, law: str):
    """The function f -> N' that inverts f = mu N' + drag * area(N'); drag = k v^omega in N/m^2, f in N/rad.

    Each law is a quadratic: in N' for "taylor", in eps for "exact" (N' = (2 r eps - eps^2) / chi^2).
    """
    linear = mu + drag * contact.area_coefficient
    if law == "linear":
        return lambda f: f / linear
    if law == "taylor":
        square = drag * contact.area_curvature
        return lambda f: 2.0 * f / (linear + math.sqrt(linear * linear + 4.0 * square * max(f, 0.0)))
    r, chi2 = contact.cable_radius, contact.chi**2
    square, slope = drag - mu / chi2, 2.0 * r * mu / chi2 + drag * contact.hole_radius

    def invert(f):
        eps = 2.0 * f / (slope + math.sqrt(max(slope * slope + 4.0 * square * f, 0.0)))
        return (2.0 * r - eps) * eps / chi2

    return invert


def nonlinear_tension_profile(
    contact: ExtrudedContact,
    mu: float,
    gain: float,
    exponent: float,
    speed: float,
    wrap: float,
    inlet_tension: float,
    *,
    delta: float = 0.0,
    law: str = "exact",
    points: int = 101,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(phi [points] rad, T [points] N, N' [points] N/rad) along the contact.  Eq. (13), Gu 2024, solved numerically.

    Friction per angle mu N' + k |v|^omega area(N') = T' (1 + rho) / rho and N' = T - T''/rho (Eqs. 8, 10, 14). The
    first gives N' from T' by a quadratic, the second then is the initial value problem

        T'' = rho (T - N'(T')),    T(0) = inlet tension (the low one),  T'(0) = 0,   rho = rho0 (1 + delta)

    mu > 0; gain K in (s/m)^omega; speed in m/s (its absolute value counts); wrap in rad; tension in N; law one of
    `LAWS`. Unlike the closed forms the result depends on the tension, not only on its ratio. With "linear" it equals
    ``contact.tension_ratio(rho, mu + K |v|^omega, phi)``. Raises ConfigurationError where eps would pass r.
    """
    from scipy.integrate import solve_ivp  # lazily: plants and environments start without scipy

    if law not in LAWS:
        raise ConfigurationError(f"unknown area law '{law}'; {nearest(law, LAWS)}")
    _require("mu", mu, 1e-6)
    _require("gain", gain, 0.0)
    _require("exponent", exponent, 1e-6)
    _require("speed", abs(speed), 0.0, unit="m/s")
    _require("wrap", wrap, 0.0, unit="rad")
    _require("inlet_tension", inlet_tension, 1e-9, unit="N")
    _require("delta", delta, -0.5, 1.0)
    rho = contact.radius_ratio * (1.0 + delta)
    drag = contact.resistance(gain) * abs(speed) ** exponent
    line_force = _line_force_from_friction(contact, mu, drag, law)
    share = (1.0 + rho) / rho

    def slope(phi, y):
        return y[1], rho * (y[0] - line_force(share * y[1]))

    phi = np.linspace(0.0, wrap, points)
    if wrap == 0.0:
        return phi, np.full(points, inlet_tension), np.zeros(points)
    solution = solve_ivp(  # Radau: the slope relaxes within mu / (1 + rho) rad
        slope, (0.0, wrap), (inlet_tension, 0.0), "Radau", phi, rtol=1e-9, atol=1e-11 * inlet_tension
    )
    if not solution.success:
        raise ConfigurationError(f"no tension profile: {solution.message}")
    force = np.array([line_force(share * s) for s in solution.y[1]])
    limit = contact.largest_line_force
    if law != "linear" and share * solution.y[1, -1] >= mu * limit + drag * float(contact.area(limit)):  # T' grows
        raise ConfigurationError(
            f"line force reaches {limit:g} N/rad: the cable would be flattened beyond its half; "
            f"use a lower tension or a stiffer cable"
        )
    return phi, solution.y[0], force


def nonlinear_tension_ratio(
    contact: ExtrudedContact,
    mu: float,
    gain: float,
    exponent: float,
    speed: float,
    wrap: float,
    inlet_tension: float,
    *,
    delta: float = 0.0,
    law: str = "exact",
) -> float:
    """T(wrap)/T(0) >= 1 of Eq. (13), Gu 2024, with N' varying along the contact.

    Arguments of `nonlinear_tension_profile`. The reference for the closed forms `contact.tension_ratio` and
    `contact.tension_ratio_perturbed`, whose friction coefficient does not depend on N'.
    """
    profile = nonlinear_tension_profile(
        contact, mu, gain, exponent, speed, wrap, inlet_tension, delta=delta, law=law, points=2
    )
    return float(profile[1][-1] / inlet_tension)
