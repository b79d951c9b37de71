"""The closed circuit in plain NumPy and SciPy: quadratures, roots, slow sweeps; nothing of the package is used."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from tests.reference.contact_reference import tension_ratio_printed

MM = 1e-3
SPANS = {"t": np.array([38.5, 185, 85, 85, 39.9]) * MM, "b": np.array([38.5, 185, 85, 85, 38.7]) * MM}
RADII = {"t": np.array([4, 8, 5, 8]) * MM, "b": np.array([4, 5, 8, 5]) * MM}
WRAPS = {"t": np.array([0.279, 1.571, 3.141, 3.217]), "b": np.array([0.279, 1.571, 3.141, 3.390])}
R0, R5, CABLE, MU_C, MU_S, SHAFT, EA = 7 * MM, 5 * MM, 0.56 * MM, 0.54, 0.157, 2.5 * MM, 1.684e4
"""Table 2, Zou 2022"""


def slip_angles(side):
    """Shaft equilibrium of an idler by root finding, Eqs. (24)-(26), then the capstan equation."""
    angles = []
    for radius, wrap in zip(RADII[side], WRAPS[side], strict=True):
        arm = SHAFT * MU_S

        def excess(h, radius=radius, wrap=wrap, arm=arm):
            return (h - 1) * radius - arm * np.sqrt(h * h + 1 - 2 * h * np.cos(wrap))

        angles.append(min(np.log(brentq(excess, 1.0, 3.0, xtol=1e-14)) / MU_C, wrap))
    return np.array(angles)


def side_state(side, tension, grows):
    """(T45, EA times elongation) of a cable with ``tension`` at the drive: Eqs. (13), (14) by quadrature."""
    total, angles = tension * SPANS[side][0], slip_angles(side)
    for i in range(4):
        rho, angle = (RADII[side][i] - CABLE) / CABLE, angles[i]
        ratio = tension_ratio_printed(rho, MU_C, angle)
        low = tension if grows else tension / ratio
        total += RADII[side][i] * low * quad(lambda a, r=rho: tension_ratio_printed(r, MU_C, a), 0, angle)[0]
        tension = tension * ratio if grows else tension / ratio
        total += tension * SPANS[side][i + 1]
    return tension, total


def working_state(drive_torque, direction, pretension):
    """(T01t, T01b, M_out, D) from Delta L_t + Delta L_b = 0 by root finding, no cable slack.  Eqs. (31)-(41)."""
    length = {s: SPANS[s].sum() + (RADII[s] * slip_angles(s)).sum() for s in "tb"}

    def elongations(top):
        t = side_state("t", top, direction < 0)
        b = side_state("b", top - drive_torque / R0, direction > 0)
        return t, b, t[1] - pretension * length["t"], b[1] - pretension * length["b"]

    top = brentq(lambda x: sum(elongations(x)[2:]), 0, 1e4, xtol=1e-12)
    t, b, stretch, _ = elongations(top)
    return top, top - drive_torque / R0, R5 * (t[0] - b[0]), stretch / (EA * R5)


def chain_equilibrium(stretch, length, ratio):
    """(tensions, slips) of one side after its ends have moved: the contacts in turn, until nothing moves any more."""
    y, slip = np.array(stretch, dtype=float), np.zeros(len(ratio))
    if y.sum() <= 0:
        return np.zeros(len(y)), slip
    for _ in range(200000):
        change = 0.0
        for k, lam in enumerate(ratio):
            a, b, la, lb = y[k] + slip[k], y[k + 1] - slip[k], length[k], length[k + 1]
            new = 0.0
            if a / la > lam * b / lb:
                new = (a * lb - lam * b * la) / (lb + lam * la)
            elif b / lb > lam * a / la:
                new = -(b * la - lam * a * lb) / (la + lam * lb)
            y[k], y[k + 1] = a - new, b + new
            change, slip[k] = max(change, abs(new - slip[k])), new
        if change <= 1e-16 * abs(y).max():
            break
    return y / length, slip


class Chain:
    """Both sides of the circuit, moved quasi-statically by angles of drive and output (rad)."""

    def __init__(self, pretension):
        self.length, self.ratio = {}, {}
        for side in "tb":
            angles = slip_angles(side)
            rho = (RADII[side] - CABLE) / CABLE
            self.ratio[side] = tension_ratio_printed(rho, MU_C, angles)
            integral = [quad(lambda a, r=r: tension_ratio_printed(r, MU_C, a), 0, e)[0] for r, e in zip(rho, angles)]
            arc = RADII[side] * integral / (1 + self.ratio[side])
            self.length[side] = SPANS[side].copy()
            self.length[side][:-1] += arc
            self.length[side][1:] += arc
        preload = {s: pretension * (SPANS[s].sum() + (RADII[s] * slip_angles(s)).sum()) for s in "tb"}
        self.tension = {s: np.full(5, preload[s] / self.length[s].sum()) for s in "tb"}

    def move(self, drive, output):
        """Turn the pulleys; returns the slips of both sides."""
        slips = {}
        for side, sign in (("t", 1.0), ("b", -1.0)):
            y = self.tension[side] * self.length[side]
            y[0] += sign * EA * R0 * drive
            y[4] -= sign * EA * R5 * output
            self.tension[side], slips[side] = chain_equilibrium(y, self.length[side], self.ratio[side])
        return slips

    def slide(self, top, bottom, direction):
        """Take the tensions of steady motion with ``top`` and ``bottom`` at the drive."""
        for side, tension, sign in (("t", top, direction), ("b", bottom, -direction)):
            self.tension[side] = tension * np.cumprod(np.append(1.0, self.ratio[side] ** -sign))
