"""One pulley: what its support costs in tension, how far the cable slips on it, how much the wrapped part stretches.

Eqs. (13)-(30), Zou 2022.

symbol | meaning | unit
------ | ------- | ----
R      | bending radius of the cable on the pulley | m
r_s    | radius at which the pulley rubs on its support: shaft, or bore of the bearing | m
mu_s   | friction coefficient there | 1
g      | (r_s mu_s / R)^2, gamma of Eq. (28) | 1
w      | cosine of the wrap angle | 1
T_high, T_low | the larger and the smaller tension of the two sides | N

The loss at a pulley is the smaller of cable-on-pulley and pulley-on-support friction (Eq. 22). A fixed pulley has only
the first. `Pulley` and `WrappedPart` are plain Python; the functions above them are scalar kernels for the plants.
"""

import math
from dataclasses import dataclass

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.kernels import clip, inline, log, maximum, sqrt
from cable_envs.physics.contact import tension_integral, tension_ratio

SUPPORTS = ("fixed", "shaft", "bearing")
JOINTS = ("continuous", "printed")

BEARING_FRICTION = 0.0015
"""Constant friction coefficient of an open deep-groove ball bearing, referred to its bore: M = mu P d/2 (SKF, Rolling
bearings, section Friction, table of constant coefficients; running, lubricated, no seals)."""


@inline
def support_share(friction, support_radius, radius):
    """g = (r_s mu_s / R)^2.  gamma of Eq. (28), Zou 2022."""
    arm = support_radius * friction / radius
    return arm * arm


@inline
def shaft_ratio(share, cos_wrap):
    """T_high / T_low >= 1 that turns an idler on its support.  Inverse of Eq. (30), Zou 2022.

    From (T_high - T_low)^2 = g (T_high^2 + T_low^2 - 2 T_high T_low w), the support force being the resultant of both
    tensions. share g in [0, 1) (limited to 0.999), cos_wrap in [-1, 1].

    Examples
    --------
    A frictionless support asks for nothing, one with a tenth of the radius times friction for 22 % at half a turn.

    >>> round(shaft_ratio(0.0, -1.0), 4), round(shaft_ratio(0.01, -1.0), 4)
    (1.0, 1.2222)
    """
    g = clip(share, 0.0, 0.999)
    root = sqrt(maximum(g * (1.0 - cos_wrap) * (2.0 - g * (1.0 + cos_wrap)), 0.0))  # (1 - g w)^2 - (1 - g)^2
    return (1.0 - g * cos_wrap + root) / (1.0 - g)


@inline
def loaded_shaft_ratio(k, share, cos_wrap):
    """T_1 / T_2 of a pulley that carries a load torque M, turned by T_2.  Eq. (29), Zou 2022.

    k = M / (T_1 R) + 1 > 0; the result solves k x - 1 = -sqrt(g (x^2 + 1 - 2 x w)), so x <= 1 / k. k = 1 is the idler.
    """
    g = clip(share, 0.0, 0.999)
    off = k - cos_wrap
    root = sqrt(g * (off * off + (1.0 - cos_wrap * cos_wrap) * (1.0 - g)))  # (k - g w)^2 - (k^2 - g)(1 - g)
    return (1.0 - g) / (k - g * cos_wrap + root)


@inline
def slip_angle(ratio, friction, wrap):
    """Angle over which the cable creeps on the pulley, rad: ln(T_high / T_low) / mu_c, at most the wrap.

    Zou's choice (it reproduces Table 3): the capstan equation. `slip_angle_exact` inverts Eq. (12) instead.
    """
    return clip(log(maximum(ratio, 1.0)) / maximum(friction, 1e-9), 0.0, wrap)


def slip_angle_exact(rho: float, mu: float, ratio: float) -> float:
    """The angle at which Eq. (12), Zou 2022, reaches ``ratio``: tension_ratio(rho, mu, angle) = ratio, rad.

    ln(lambda) is convex and grows with the angle; Newton's method started beyond the solution descends to it.
    Raises ConfigurationError for a ratio below 1 and for numbers that are not positive.
    """
    for name, value in (("rho", rho), ("mu", mu)):
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigurationError(f"{name} = {value:g}: expected a positive number")
    if not (math.isfinite(ratio) and ratio >= 1.0):
        raise ConfigurationError(f"ratio = {ratio:g}: expected T_high / T_low, at least 1")
    if ratio == 1.0:
        return 0.0
    root = math.sqrt((1.0 + rho) ** 2 + 4.0 * mu * mu * rho)
    a, b = 2.0 * mu * rho / (root + 1.0 + rho), -(root + 1.0 + rho) / (2.0 * mu)
    target = math.log(ratio)
    angle = (target + math.log1p(-a / b)) / a  # from a e^(b phi) >= 0: an upper bound
    for _ in range(100):
        ea, eb = 1.0, math.exp((b - a) * angle)  # lambda, scaled by e^(a phi) so that large angles do not overflow
        value = (a * eb - b * ea) / (a - b)
        excess = math.log(value) + a * angle - target
        if excess <= 4e-16 * max(target, 1.0):  # rounding of the logarithm
            break
        angle -= excess * value * (a - b) / (a * b * (eb - ea))
    return max(angle, 0.0)


def _positive(owner: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigurationError(f"{owner}: {name} = {value:g}, expected a positive number")


@dataclass(frozen=True)
class Pulley:
    """A pulley with one of three supports; Eqs. (22)-(30), Zou 2022. Bad values raise ConfigurationError."""

    radius: float
    """R, m"""
    cable_radius: float
    """r, m"""
    wrap: float
    """rad"""
    cable_friction: float
    """mu_c"""
    support: str = "shaft"
    """one of `SUPPORTS`"""
    support_radius: float | None = None
    """r_s, m: of the shaft, or of the bearing's bore; not used when fixed"""
    support_friction: float | None = None
    """mu_s; for a bearing `BEARING_FRICTION` unless given"""

    def __post_init__(self):
        if self.support not in SUPPORTS:
            raise ConfigurationError(f"unknown pulley support '{self.support}'; {nearest(self.support, SUPPORTS)}")
        _positive("pulley", radius=self.radius, cable_radius=self.cable_radius, cable_friction=self.cable_friction)
        if self.radius <= self.cable_radius:
            raise ConfigurationError(
                f"pulley: radius {self.radius:g} m, expected more than the cable's {self.cable_radius:g} m"
            )
        if not (math.isfinite(self.wrap) and self.wrap >= 0.0):
            raise ConfigurationError(f"pulley: wrap = {self.wrap:g} rad, expected at least 0")
        if self.support == "fixed":
            return
        if self.support == "bearing" and self.support_friction is None:
            object.__setattr__(self, "support_friction", BEARING_FRICTION)
        for name in ("support_radius", "support_friction"):
            value = getattr(self, name)
            if value is None or not (math.isfinite(value) and value >= 0.0):
                raise ConfigurationError(f"pulley: {name} = {value}, expected a number >= 0 on a {self.support}")
        if self.share >= 0.998:
            raise ConfigurationError("pulley: support_radius * support_friction reaches the pulley's radius: it jams")

    @property
    def radius_ratio(self) -> float:
        """rho = (R - r) / r.  Eq. (6)."""
        return (self.radius - self.cable_radius) / self.cable_radius

    @property
    def share(self) -> float:
        """g of Eq. (28); infinite for a fixed pulley."""
        if self.support == "fixed":
            return math.inf
        return float(support_share(self.support_friction, self.support_radius, self.radius))

    @property
    def sliding_ratio(self) -> float:
        """T_high / T_low when the cable slides over the whole wrap.  Eq. (12)."""
        return float(tension_ratio(self.radius_ratio, self.cable_friction, self.wrap))

    @property
    def turning_ratio(self) -> float:
        """T_high / T_low that turns the pulley on its support, infinite when fixed.  Eq. (30)."""
        return math.inf if self.support == "fixed" else float(shaft_ratio(self.share, math.cos(self.wrap)))

    @property
    def ratio(self) -> float:
        """T_high / T_low in steady motion: the smaller of both frictions.  Eq. (22)."""
        return min(self.sliding_ratio, self.turning_ratio)

    @property
    def slip_angle(self) -> float:
        """Angle of elastic slip, rad, as in Table 3: `slip_angle` of `turning_ratio`; the wrap when fixed."""
        if self.support == "fixed":
            return self.wrap
        return float(slip_angle(self.turning_ratio, self.cable_friction, self.wrap))

    @property
    def ratio_over_slip(self) -> float:
        """lambda over `slip_angle`: the tension ratios of Table 3.

        Below `ratio` on rotating pulleys: Zou takes the angle from the capstan equation and the ratio from Eq. (12).
        """
        return float(tension_ratio(self.radius_ratio, self.cable_friction, self.slip_angle))

    def loss(self, low_tension: float) -> float:
        """T_high - T_low in steady motion, N.  Eqs. (22)-(24)."""
        return low_tension * (self.ratio - 1.0)


@dataclass(frozen=True)
class WrappedPart:
    """Stretch of the slipping part of a wrap; Eqs. (14)-(21), Zou 2022.

    The tension is ``inlet`` at angle 0 and ``outlet`` at ``slip``; the inlet's stays, the outlet's goes up and down.
    Rising: the tension grows towards the outlet (Zou: sgn = 0); falling: it drops (sgn = 1). Elongations in m, relative
    to the same part under ``pretension``.

    After a turn the slip reverses from the outlet up to an angle alpha. Eqs. (17)-(21) join the two parts as if
    lambda(x + y) = lambda(x) lambda(y). That is true of the capstan; with finite rho the tension then jumps at the
    joint, and the part grows longer at first while the outlet lets go. So the joint is ``continuous`` here: the tension
    of both parts is the same. ``joint="printed"`` gives Eqs. (17)-(21) for comparison; both agree at either end of the
    cycle.
    """

    rho: float
    mu: float
    slip: float
    """theta_slip, rad"""
    radius: float
    """R, m"""
    axial_stiffness: float
    """EA, N"""
    pretension: float = 0.0
    """N"""
    joint: str = "continuous"
    """one of `JOINTS`"""

    def __post_init__(self):
        _positive("wrapped part", rho=self.rho, mu=self.mu, slip=self.slip, radius=self.radius,
                  axial_stiffness=self.axial_stiffness)  # fmt: skip
        if not (math.isfinite(self.pretension) and self.pretension >= 0.0):
            raise ConfigurationError(f"wrapped part: pretension = {self.pretension:g} N, expected at least 0")
        if self.joint not in JOINTS:
            raise ConfigurationError(f"unknown joint '{self.joint}'; {nearest(self.joint, JOINTS)}")

    def ratio(self, angle: float) -> float:
        """lambda over ``angle``.  Eq. (12)."""
        return float(tension_ratio(self.rho, self.mu, angle))

    def _integral(self, angle: float) -> float:
        return float(tension_integral(self.rho, self.mu, angle))

    def _elongation(self, integral: float) -> float:
        """From the integral of the tension over the angle, N rad, to m.  Eqs. (14)-(15)."""
        return (integral - self.pretension * self.slip) * self.radius / self.axial_stiffness

    def loading(self, inlet: float, rising: bool = True) -> float:
        """Elongation with slip all along in one direction, m.  Eq. (16)."""
        _positive("loading", inlet=inlet)
        low = inlet if rising else inlet / self.ratio(self.slip)
        return self._elongation(low * self._integral(self.slip))

    def turning_outlet(self, inlet: float, rising: bool = True) -> float:
        """Outlet tension at the end of loading, T_pk, N.  Eq. (13)."""
        return inlet * self.ratio(self.slip) if rising else inlet / self.ratio(self.slip)

    def reversed_angle(self, inlet: float, outlet: float, rising: bool = True) -> float:
        """alpha: how far from the outlet the slip has reversed since `turning_outlet`, rad.

        Printed, and where the outlet rises again: lambda(alpha)^2 = T_pk / T_2 or its inverse, Eq. (18). Where it
        falls: inlet lambda(slip - alpha) = outlet lambda(alpha). Raises ConfigurationError where the outlet is beyond
        the turning point (still loading), and where the front has passed the inlet, whose tension then changes too.
        """
        _positive("unloading", inlet=inlet, outlet=outlet)
        turning = self.turning_outlet(inlet, rising)
        back = turning / outlet if rising else outlet / turning
        most = self.ratio(self.slip) ** 2
        if back < 1.0 - 1e-12:
            raise ConfigurationError(f"outlet = {outlet:g} N is beyond the turning point {turning:g} N: still loading")
        if back > most * (1.0 + 1e-12):
            raise ConfigurationError(
                f"outlet = {outlet:g} N: the reversed slip has passed the inlet; after turning at {turning:g} N the "
                f"outlet may change by at most a factor {most:g}"
            )
        if rising and self.joint == "continuous":
            low, high = 0.0, self.slip
            for _ in range(60):  # bisection to rounding: both sides are monotonic in alpha
                middle = 0.5 * (low + high)
                if inlet * self.ratio(self.slip - middle) > outlet * self.ratio(middle):
                    low = middle
                else:
                    high = middle
            return 0.5 * (low + high)
        return min(slip_angle_exact(self.rho, self.mu, math.sqrt(max(back, 1.0))), self.slip)

    def unloading(self, inlet: float, outlet: float, rising: bool = True) -> float:
        """Elongation when the outlet has come back from `turning_outlet` to ``outlet``, m.  Eqs. (19)-(21)."""
        alpha = self.reversed_angle(inlet, outlet, rising)
        rest = self.slip - alpha
        turning = self.turning_outlet(inlet, rising)
        if rising:  # the reversed part drops to the outlet, the rest still rises from the inlet
            return self._elongation(outlet * self._integral(alpha) + inlet * self._integral(rest))
        joint = math.sqrt(turning * outlet)  # T_b of Eq. (17), the lowest tension
        if self.joint == "printed":
            still = inlet / self.ratio(rest) * self._integral(rest)
        else:
            still = turning * (self._integral(self.slip) - self._integral(alpha))
        return self._elongation(joint * self._integral(alpha) + still)
