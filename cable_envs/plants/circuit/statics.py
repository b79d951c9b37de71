"""Closed forms of the closed cable-pulley circuit in its working phase: Eqs. (31)-(49) of Zou 2022, and their inverse.

symbol | meaning | unit
------ | ------- | ----
T01, T45 | tension of a cable at the driving and at the driven pulley | N
K        | product of the ratios lambda of a side's idlers | 1
kappa    | elongation of a side per T01, times EA: Eqs. (39)-(40) | m
D        | theta_in R0 / R5 - theta_out, the angle taken up by the cables: dtheta_out of Eq. (45) | rad
M_in, M_out | torque on the driving pulley; torque of the driven pulley on its load | N m

``direction`` is +1 for counter-clockwise motion (cable t pulls) and -1 for clockwise. Printed slips, corrected here:
L_total lacks the radius in its theta_s terms, and the signs of Eqs. (43)-(47) (docs/physics.md, section 6).

The equations assume that no cable is slack. Where one would have to push, its tension is zero, the other cable
carries the whole torque, and ``out_of_range`` is set: no result ever holds a negative tension. Ask with
``strict=True`` for a ConfigurationError instead.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import jit, maximum
from cable_envs.physics.contact import tension_integral, tension_ratio
from cable_envs.physics.supports import shaft_ratio, slip_angle, support_share
from cable_envs.plants.circuit.parameters import CIRCUIT, IDLERS, SIDES
from cable_envs.plants.servo import MOTOR


@jit
def _contact_rows(wrap, radius, cable_radius, cable_friction, shaft_friction, shaft_radius, fixed, out):
    for i in range(wrap.shape[0]):
        for j in range(wrap.shape[1]):
            rho = maximum((radius[i, j] - cable_radius[j]) / cable_radius[j], 1e-6)
            shaft = shaft_ratio(support_share(shaft_friction[j], shaft_radius[j], radius[i, j]), np.cos(wrap[i, j]))
            slip = wrap[i, j] if fixed[j] >= 0.5 else slip_angle(shaft, cable_friction[j], wrap[i, j])
            out[0, i, j] = rho
            out[1, i, j] = shaft
            out[2, i, j] = slip
            out[3, i, j] = tension_ratio(rho, cable_friction[j], slip)
            out[4, i, j] = tension_integral(rho, cable_friction[j], slip)


class Working(NamedTuple):
    """The circuit in its working phase; floats or arrays of one shape."""

    drive_torque: Any
    output_torque: Any
    elongation_angle: Any
    """dtheta_out of Eq. (45), rad"""
    tension_drive_top: Any
    tension_drive_bottom: Any
    tension_output_top: Any
    tension_output_bottom: Any
    out_of_range: Any
    """True where a cable is slack: Eqs. (42)-(46) do not hold there"""


class Inverse(NamedTuple):
    """What the drive must do for a wanted output (`Statics.inverse`)."""

    drive_angle: Any
    drive_torque: Any
    compensation: Any
    """theta_comp of Eq. (49), rad at the drive: to be added to theta_ref R5 / R0"""
    out_of_range: Any


@dataclass(frozen=True)
class Statics:
    """Coefficients of the closed forms for n mechanisms; arrays [2 sides, 4 idlers, n] and [n] (see `from_values`)."""

    radius_ratio: np.ndarray
    """rho = (R - r) / r, Eq. (6)  [2, 4, n]"""
    shaft_ratio: np.ndarray
    """T_high / T_low that turns an idler on its shaft: the inverse of Eq. (30)  [2, 4, n]"""
    slip_angle: np.ndarray
    """ln(shaft ratio) / mu_c, at most the wrap; the wrap itself on fixed idlers, rad  [2, 4, n]"""
    ratio: np.ndarray
    """lambda over the slip angle, Eq. (12)  [2, 4, n]"""
    integral: np.ndarray
    """Phi over the slip angle, Eq. (16), rad  [2, 4, n]"""
    radius: np.ndarray
    span: np.ndarray
    """free lengths  [2, 5, n]"""
    product: np.ndarray
    """K of each side  [2, n]"""
    kappa: np.ndarray
    """kappa[s, 0] and kappa[s, 1] are kappa_s1 and kappa_s2 of direction s (0 ccw, 1 cw), m  [2, 2, n]"""
    length: np.ndarray
    """L_total of each side, m  [2, n]"""
    pretension: np.ndarray
    drive_radius: np.ndarray
    output_radius: np.ndarray
    tensile_stiffness: np.ndarray

    @classmethod
    def from_values(cls, values: np.ndarray) -> "Statics":
        """Coefficients for parameter columns [len(CIRCUIT), n]; Eqs. (30), (34), (39)-(41), Zou 2022."""
        row = {name: np.ascontiguousarray(values[k], dtype=float) for k, name in enumerate(CIRCUIT.names)}
        n = values.shape[1]
        span = np.array([[row[f"span_{s}_{i}"] for i in range(IDLERS + 1)] for s in SIDES])
        wrap = np.array([row[f"wrap_{s}_{i}"] for s in SIDES for i in range(1, IDLERS + 1)])
        radius = np.array([row[f"radius_{s}_{i}"] for s in SIDES for i in range(1, IDLERS + 1)])
        out = np.empty((5, 2 * IDLERS, n))
        cable = (row["cable_radius"], row["cable_friction"], row["shaft_friction"], row["shaft_radius"])
        _contact_rows(wrap, radius, *cable, row["idlers_fixed"], out)
        rho, shaft, slip, lam, phi = out.reshape(5, 2, IDLERS, n)
        radius = radius.reshape(2, IDLERS, n)
        after = np.cumprod(lam, axis=1)  # K_{1,i}
        before = after / lam  # K_{1,i-1}
        fall = span[:, 0] + (span[:, 1:] / after + radius * phi / after).sum(axis=1)
        rise = span[:, 0] + (span[:, 1:] * after + radius * phi * before).sum(axis=1)
        return cls(
            rho,
            shaft,
            slip,
            lam,
            phi,
            radius,
            span,
            after[:, -1],
            kappa=np.array([[fall[0], rise[1]], [rise[0], fall[1]]]),
            length=span.sum(axis=1) + (radius * slip).sum(axis=1),
            pretension=np.array([row["pretension_top"], row["pretension_bottom"]]),
            drive_radius=row["drive_radius"],
            output_radius=row["output_radius"],
            tensile_stiffness=row["tensile_stiffness"],
        )

    @classmethod
    def from_rig(cls, rig: Mapping[str, Any]) -> "Statics":
        """Coefficients [n = 1] of one rig (parameter names to SI numbers); missing ones take Table 2's value."""
        cables = {name: value for name, value in rig.items() if name not in MOTOR}
        return cls.from_values(CIRCUIT.pack(cables)[:, None])

    @property
    def kappa3(self):
        """Eq. (41): T_pre_t L_t + T_pre_b L_b, N m  [n]."""
        return (self.pretension * self.length).sum(axis=0)

    def _direction(self, direction):
        """(kappa of t, kappa of b, T45/T01 of t, T45/T01 of b) for each direction; Eqs. (34), (39)-(40)."""
        ccw = np.asarray(direction) > 0
        kt, kb = self.product
        kappa_t = np.where(ccw, self.kappa[0, 0], self.kappa[1, 0])
        kappa_b = np.where(ccw, self.kappa[0, 1], self.kappa[1, 1])
        return kappa_t, kappa_b, np.where(ccw, 1 / kt, kt), np.where(ccw, kb, 1 / kb)

    def torque_range(self, direction):
        """(low, high) of the drive torque within which no cable is slack, N m; the limits of Eqs. (42)-(43)."""
        kappa_t, kappa_b, _, _ = self._direction(direction)
        full = self.drive_radius * self.kappa3
        return -full / kappa_b, full / kappa_t

    def working(self, drive_torque, direction, strict: bool = False) -> Working:
        """Everything at a given drive torque (N m) in steady motion.  Eqs. (42)-(45), Zou 2022.

        Arguments broadcast against the n mechanisms. Raises ConfigurationError for slack cables when ``strict``.
        """
        kappa_t, kappa_b, _, _ = self._direction(direction)
        force = np.asarray(drive_torque, dtype=float) / self.drive_radius
        top = (self.kappa3 + force * kappa_b) / (kappa_t + kappa_b)
        bottom = (self.kappa3 - force * kappa_t) / (kappa_t + kappa_b)
        slack = (top < 0) | (bottom < 0)
        top = np.where(bottom < 0, np.maximum(force, 0.0), np.maximum(top, 0.0))
        bottom = np.where(slack & (top == 0), np.maximum(-force, 0.0), np.maximum(bottom, 0.0))
        from_top = top * kappa_t - self.pretension[0] * self.length[0]
        from_bottom = self.pretension[1] * self.length[1] - bottom * kappa_b  # Eq. (36): Delta L_t = -Delta L_b
        stretch = np.where(top > 0, from_top, from_bottom)
        elongation = stretch / (self.tensile_stiffness * self.output_radius)
        return self._result(elongation, top, bottom, slack, direction, strict)

    def from_elongation(self, elongation_angle, direction, strict: bool = False) -> Working:
        """Everything at a given D = theta_in R0/R5 - theta_out (rad) in steady motion.  Eqs. (37)-(40), Zou 2022."""
        kappa_t, kappa_b, _, _ = self._direction(direction)
        stretch = self.tensile_stiffness * self.output_radius * np.asarray(elongation_angle, dtype=float)
        top = (self.pretension[0] * self.length[0] + stretch) / kappa_t
        bottom = (self.pretension[1] * self.length[1] - stretch) / kappa_b
        slack = (top < 0) | (bottom < 0)
        return self._result(elongation_angle, np.maximum(top, 0), np.maximum(bottom, 0), slack, direction, strict)

    def _result(self, elongation, top, bottom, slack, direction, strict) -> Working:
        if strict and np.any(slack):
            low, high = self.torque_range(direction)
            raise ConfigurationError(
                f"a cable is slack: Eqs. (42)-(46) hold for drive torques between {np.max(low):.4g} and "
                f"{np.min(high):.4g} N m at this pretension"
            )
        _, _, gain_t, gain_b = self._direction(direction)
        out_t, out_b = top * gain_t, bottom * gain_b
        return Working(
            (top - bottom) * self.drive_radius,
            (out_t - out_b) * self.output_radius,
            np.asarray(elongation, dtype=float) + np.zeros_like(top),
            top,
            bottom,
            out_t,
            out_b,
            slack,
        )

    def output_angle(self, drive_angle, drive_torque, direction, strict: bool = False):
        """theta_out in the working phase, rad.  Eq. (46), Zou 2022."""
        elongation = self.working(drive_torque, direction, strict).elongation_angle
        return np.asarray(drive_angle) * self.drive_radius / self.output_radius - elongation

    def inverse(self, output_angle, output_torque, direction, strict: bool = False) -> Inverse:
        """Drive angle and torque that hold ``output_angle`` (rad) at ``output_torque`` (N m) in steady motion.

        The inverse of Eqs. (44)-(46), and theta_comp = D R5 / R0 of Eq. (49), Zou 2022.
        """
        kappa_t, kappa_b, gain_t, gain_b = self._direction(direction)
        rest_t = self.pretension[0] * self.length[0]
        rest_b = self.pretension[1] * self.length[1]
        force = np.asarray(output_torque, dtype=float) / self.output_radius
        slope_t, slope_b = gain_t / kappa_t, gain_b / kappa_b  # d T45 / d (EA Delta L)
        stretch = (force - rest_t * slope_t + rest_b * slope_b) / (slope_t + slope_b)
        stretch = np.where(stretch > rest_b, force / slope_t - rest_t, stretch)  # cable b slack
        stretch = np.where(stretch < -rest_t, rest_b + force / slope_b, stretch)  # cable t slack
        elongation = stretch / (self.tensile_stiffness * self.output_radius)
        state = self.from_elongation(elongation, direction, strict)
        scale = self.output_radius / self.drive_radius
        angle = (np.asarray(output_angle) + elongation) * scale
        return Inverse(angle, state.drive_torque, elongation * scale, state.out_of_range)


def hold_flag(drive_velocity, drive_torque, output_top, output_bottom, as_printed: bool = False):
    """1 where Eq. (47) holds the output in the delay and transition phases, else 0; ssgn(0) = 1/2 gives values between.

    As printed, flag = (1 - ssgn(w M_in)) ssgn(w (T45t - T45b)) with w the drive's velocity. It can never be 1 together
    with the working-phase tensions of the same direction and no slack: for w > 0 the first factor asks for M_in < 0,
    that is T01t < T01b, and then T45t = T01t / K_t < K_b T01b = T45b, so the second factor is 0 (w < 0 is the mirror
    image). The text lost minus signs, and one belongs inside the second ssgn: the output holds while the drive moves
    against its own torque and against the difference of the output tensions, as after a reversal. That reading is the
    default.
    """

    def ssgn(x):
        return 0.5 + 0.5 * np.sign(x)

    minus = 1.0 if as_printed else -1.0
    difference = np.asarray(output_top) - np.asarray(output_bottom)
    return (1.0 - ssgn(np.asarray(drive_velocity) * drive_torque)) * ssgn(minus * drive_velocity * difference)


class Replay(NamedTuple):
    """Output predicted from recorded drive signals; arrays [steps]."""

    output_angle: np.ndarray
    output_torque: np.ndarray
    hold: np.ndarray
    """flag of Eq. (47)"""
    out_of_range: np.ndarray


def replay(statics: Statics, drive_angle, drive_torque, as_printed: bool = False, deadband: float = 0.0) -> Replay:
    """Output angle and torque from recorded drive angle (rad) and torque (N m), arrays [steps].  Eqs. (44)-(47).

    The direction is the sign of the last change of the drive angle that exceeds ``deadband`` (rad); a drive at rest
    keeps it. While the flag is 1 the output keeps its last values; the first sample is taken as working.
    """
    angle = np.asarray(drive_angle, dtype=float)
    torque = np.asarray(drive_torque, dtype=float)
    if angle.ndim != 1 or angle.shape != torque.shape:
        raise ConfigurationError(f"drive angle and torque: need two equal series, got {angle.shape} and {torque.shape}")
    direction = _directions(angle, deadband)
    state = statics.working(torque, direction)
    angle_out = angle * statics.drive_radius / statics.output_radius - state.elongation_angle
    torque_out = state.output_torque.copy()
    flag = hold_flag(direction, torque, state.tension_output_top, state.tension_output_bottom, as_printed)
    for k in range(1, len(angle)):
        angle_out[k] = (1.0 - flag[k]) * angle_out[k] + flag[k] * angle_out[k - 1]
        torque_out[k] = (1.0 - flag[k]) * torque_out[k] + flag[k] * torque_out[k - 1]
    return Replay(angle_out, torque_out, flag, state.out_of_range)


def _directions(angle: np.ndarray, deadband: float) -> np.ndarray:
    """+1 or -1 for each sample: the last motion beyond the dead band (before it, the first motion's direction)."""
    direction = np.zeros(len(angle))
    anchor, current = (angle[0] if len(angle) else 0.0), 0.0
    for k, value in enumerate(angle):
        if abs(value - anchor) > deadband:
            current, anchor = np.sign(value - anchor), value
        elif (value - anchor) * current > 0:
            anchor = value
        direction[k] = current
    moving = direction[direction != 0]
    return np.where(direction == 0, moving[0] if len(moving) else 1.0, direction)
