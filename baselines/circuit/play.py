"""The circuit as a play with a friction, a compliance and an object that are fitted while it moves.

Zou's working lines (Eqs. 42-46) are straight as long as both cables are taut. At a grasp torque tau the elongation D
and the drive torque M lie between the clockwise and the counter-clockwise line; in between the output holds:

    D = g (theta - theta_0) - c (z - z_0) + eps D_0
    c = 1  (z: output angle)   or   1 / (kappa k)  (z: grasp torque)
    eps (D_m - phi D_h) <= D <= eps (D_m + phi D_h)          D_m, D_h: middle and half width, linear in tau
    M = M_m + M_h (D - eps D_m) / (eps D_h)

phi, eps and kappa scale the nominal friction (shafts and pretension), the compliance of the cables and the stiffness of
the object. Before the output moves, `parts.Hold` fits the line of the hold, angle over torque: its slope tells eps, and
where the drive goes beyond it, the output has broken away, at a torque that tells phi. From then on an extended Kalman
filter follows (z, ln phi, ln eps, ln kappa) by the measured drive angle and torque, with slopes by differences. No
absolute angle is needed: z_0 is what the output is where the filter begins.
"""

import math

from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.parts import Hold

UNCERTAIN = (0.05, 0.05, 0.5)
"""Standard deviations of ln phi, ln eps and ln kappa at breakaway."""

SLOWER = 0.01
"""Variance by which ln eps and ln kappa walk, over that of ln phi: friction drifts, cable and object hardly do."""

SMOOTH = 0.15
"""Share of the measured angle in the angle that is carried on by the measured speed."""

_STEPS = (1e-5, 1e-4, 1e-4, 1e-4)
"""Differences for the slopes: z (rad or N m), logarithms."""

_WIDEST = 2.0
"""|ln phi|, |ln eps| and |ln kappa| stay within this."""


class Lines:
    """Middle and half width of the two working lines, as (constant, slope) in the grasp torque."""

    def __init__(self, model: CircuitModel):
        span = 0.1
        torques = [(p.drive_torque(0.0), p.drive_torque(span)) for p in (model.ccw, model.cw)]
        elongations = [(p.elongation(0.0), p.elongation(span)) for p in (model.ccw, model.cw)]
        self.torque, self.torque_half = _lines(torques[0], torques[1], span)
        self.elongation, self.elongation_half = _lines(elongations[0], elongations[1], span)


def _lines(ccw: tuple[float, float], cw: tuple[float, float], span: float) -> tuple:
    up, down = (ccw[1] - ccw[0]) / span, (cw[1] - cw[0]) / span
    return (0.5 * (ccw[0] + cw[0]), 0.5 * (up + down)), (0.5 * (ccw[0] - cw[0]), 0.5 * (up - down))


class PlayFilter:
    """Estimate of the output and of three numbers of the circuit from the drive's angle, speed and torque.

    ``stiffness``: nominal stiffness of the grasped object where z is the grasp torque, else 0, and z is the angle of a
    free output. ``beyond``: drive angle (rad) beyond the line of the hold from which the output counts as moving.
    """

    def __init__(self, model: CircuitModel, stiffness: float, misfit: float, walk: float, beyond: float, dt: float):
        self._lines, self._gear, self._stiffness = Lines(model), model.ratio, stiffness
        self._misfit, self._walk, self._beyond, self._dt = misfit, walk * walk * dt, beyond, dt
        self._count = 4 if stiffness > 0.0 else 3
        self._relaxation = model.relaxation
        self.begin(0.0, 0.0, 0.0)

    def begin(self, output: float, angle: float, torque: float) -> None:
        """Start at rest with the output at ``output`` and the drive at ``angle`` with ``torque``."""
        self.state = [output, 0.0, 0.0, 0.0][: self._count]
        self.moved = False
        """whether the output has broken away since"""
        tau = output if self._stiffness > 0.0 else 0.0
        (m0, m1), (h0, h1) = self._lines.torque, self._lines.torque_half
        (d0, d1), (e0, e1) = self._lines.elongation, self._lines.elongation_half
        self._angle, self._torque, self._output, self._seen = angle, torque, output, angle
        self._speed = 0.0
        self._middle, self._half = m0 + m1 * tau, h0 + h1 * tau
        self._elongation = d0 + d1 * tau + (torque - self._middle) / self._half * (e0 + e1 * tau)
        self._nominal = (e0 + e1 * tau) / (self._gear * self._half)
        self._hold = Hold(self._nominal, self._misfit, self._beyond)

    @property
    def output(self) -> float:
        """Estimated output: rad, or N m of grasp torque."""
        return self.state[0]

    def shift(self, by: float) -> None:
        """Move the output, and the zero that it is measured from, by ``by`` (rad, or N m): it was seen elsewhere."""
        self.state[0] += by
        self._output += by

    def update(self, angle: float, speed: float, torque: float) -> None:
        """One more measurement of the drive: rad, rad/s, N m."""
        self._seen += 0.5 * (self._speed + speed) * self._dt
        self._speed = speed
        self._seen += SMOOTH * (angle - self._seen)
        if self.moved:
            self._correct(self._seen, torque)
            return
        damped = self._relaxation * speed / self._nominal  # the cable's damping, as its stretch grows at this speed
        self.moved = self._hold.leaves(self._seen - self._angle, torque - damped - self._torque)
        self.state[2] = math.log(max(self._hold.compliance / self._nominal, math.exp(-_WIDEST)))
        if self.moved:
            self._slide(torque, self._gear * self._hold.gone * (self._stiffness if self._count > 3 else 1.0))

    def begin_grasp(self, angle: float, torque: float, plateau: float) -> None:
        """Start with an object just met: ``plateau`` was the drive torque (N m) of the freely sliding jaw."""
        (m0, m1), (h0, h1) = self._lines.torque, self._lines.torque_half
        phi = (plateau - m0) / h0
        self.begin((torque - plateau) / (m1 + phi * h1), angle, torque)
        self.moved = True
        self._slide(torque, 0.0)

    def _slide(self, torque: float, gone: float) -> None:
        """The filter begins: ``torque`` tells phi; the output has gone by ``gone`` since it broke away."""
        self.state[1] = math.log(max(abs(torque - self._middle) / self._half, math.exp(-_WIDEST)))
        self.state[0] += gone
        n, spread = self._count, (0.5 * abs(gone), *UNCERTAIN)
        self._spread = [[spread[i] ** 2 if i == j else 0.0 for j in range(n)] for i in range(n)]

    def _correct(self, angle: float, torque: float) -> None:
        """A step of the extended Kalman filter."""
        n, x = self._count, self.state
        held, seen = self._step(x, angle)
        slopes, row = [], []
        for k in range(n):
            moved = list(x)
            moved[k] += _STEPS[k]
            held_k, seen_k = self._step(moved, angle)
            slopes.append((held_k - held) / _STEPS[k])
            row.append((seen_k - seen) / _STEPS[k])
        spread = self._spread
        along = [sum(spread[i][j] * row[j] for j in range(n)) for i in range(n)]
        total = sum(row[i] * along[i] for i in range(n)) + self._misfit**2
        gain, missed = [a / total for a in along], torque - seen
        for i in range(n):
            for j in range(n):
                spread[i][j] -= gain[i] * along[j]
        after = held + sum(slopes[k] * gain[k] * missed for k in range(n))
        bent = (x[k] + gain[k] * missed for k in range(1, n))
        self.state = [after, *(min(max(v, -_WIDEST), _WIDEST) for v in bent)]
        first = [sum(slopes[k] * spread[k][j] for k in range(n)) for j in range(n)]
        corner = sum(first[k] * slopes[k] for k in range(n))
        for j in range(1, n):
            spread[0][j] = spread[j][0] = first[j]
            spread[j][j] += self._walk if j == 1 else self._walk * SLOWER
        spread[0][0] = corner + 1e-12

    def _step(self, x: list[float], angle: float) -> tuple[float, float]:
        """(z after the drive has come to ``angle``, drive torque there)."""
        z, phi, eps = x[0], math.exp(x[1]), math.exp(x[2])
        (m0, m1), (h0, h1) = self._lines.torque, self._lines.torque_half
        (d0, d1), (e0, e1) = self._lines.elongation, self._lines.elongation_half
        grasps = self._stiffness > 0.0
        c = 1.0 / (self._stiffness * math.exp(x[3])) if grasps else 1.0
        free = self._gear * (angle - self._angle) + eps * self._elongation + c * self._output
        slope = 1.0 if grasps else 0.0
        least = (free - eps * (d0 + phi * e0)) / (c + slope * eps * (d1 + phi * e1))
        most = (free - eps * (d0 - phi * e0)) / (c + slope * eps * (d1 - phi * e1))
        z = least if z < least else most if z > most else z
        tau = z if grasps else 0.0
        part = (free - c * z - eps * (d0 + d1 * tau)) / (eps * (e0 + e1 * tau))
        return z, m0 + m1 * tau + (h0 + h1 * tau) * part

    def held_at(self, output: float, side: float) -> tuple[float, float]:
        """(drive angle, drive torque) with the output at ``output``, from the side -1 to 1 of the dead zone."""
        phi, eps = math.exp(self.state[1]), math.exp(self.state[2])
        (m0, m1), (h0, h1) = self._lines.torque, self._lines.torque_half
        (d0, d1), (e0, e1) = self._lines.elongation, self._lines.elongation_half
        grasps = self._stiffness > 0.0
        tau = output if grasps else 0.0
        c = 1.0 / (self._stiffness * math.exp(self.state[3])) if grasps else 1.0
        elongation = eps * (d0 + d1 * tau + side * phi * (e0 + e1 * tau))
        angle = self._angle + (elongation - eps * self._elongation + c * (output - self._output)) / self._gear
        return angle, m0 + m1 * tau + side * phi * (h0 + h1 * tau)
