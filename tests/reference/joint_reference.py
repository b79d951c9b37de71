"""The joint with two tendons as ordinary differential equations, written apart from the plant: SciPy integrates them.

The slip of a tendon at its bend is a state. It has no law of its own but the two limits, so the equations are integrated
from event to event: each contact holds, slips to the drive or slips to the joint, and each tendon may be slack.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


def ratio_of(rig):
    """T1 / T2 over the bend, from mu T'' + (1 + rho) T' - rho mu T = 0, T(0) = 1, T'(0) = 0, integrated."""
    mu, rho = rig["friction_coefficient"], rig["radius_ratio"]
    if mu == 0.0:
        return 1.0
    found = solve_ivp(
        lambda _, t: (t[1], (rho * mu * t[0] - (1.0 + rho) * t[1]) / mu), (0.0, rig["wrap_angle"]), (1.0, 0.0),
        method="Radau", rtol=1e-12, atol=1e-14,
    )  # fmt: skip
    return found.y[0, -1]


class Tendon:
    """Two springs and a contact with friction; ``slip`` is the stretch that has passed over it to the joint's side."""

    def __init__(self, rig):
        self.k1, self.k2 = rig["tendon_stiffness"] / rig["drive_share"], rig["tendon_stiffness"] / (1.0 - rig["drive_share"])
        self.c, self.n = rig["tendon_hardening"], ratio_of(rig)

    def force(self, k, y):
        line = k * max(y, 0.0)
        return line + 0.5 * self.c * line * line

    def at(self, e, y2):
        """(tension at the drive, at the joint, stretch of the joint's span) after slip, found by bisection."""
        if e <= 0.0:
            return 0.0, 0.0, e * self.k1 / (self.k1 + self.k2)
        for a, b in ((1.0, self.n), (self.n, 1.0)):
            over = (lambda y, a=a, b=b: a * self.force(self.k1, e - y) - b * self.force(self.k2, y))
            if a == 1.0 and over(y2) > 0.0 or a != 1.0 and over(y2) < 0.0:
                y2 = brentq(over, 0.0, e, xtol=1e-18, rtol=1e-14)
                break
        return self.force(self.k1, e - y2), self.force(self.k2, y2), y2


class Joint:
    """The joint between two drives; `advance` goes on by tiny explicit steps (symplectic Euler, slip projected)."""

    def __init__(self, rig, state, step):
        self.rig, self.step, self.tendons = rig, step, (Tendon(rig), Tendon(rig))
        self.q, self.v = state["joint_angle"], 0.0
        self.x = [state["drive_a_position"], state["drive_b_position"]]
        self.w = [0.0, 0.0]
        self.y2 = [state["stretch_joint_a"], state["stretch_joint_b"]]
        self.tensions = [(state["tension_drive_a"], state["tension_joint_a"]), (state["tension_drive_b"], state["tension_joint_b"])]

    def _pulled(self, q):
        r, g = self.rig["moment_arm"], self.rig["moment_arm_growth"]
        return r * q + 0.5 * g * q * q, -r * q + 0.5 * g * q * q

    def _take_up(self, tension):
        c = self.rig["tendon_hardening"]
        line = tension if c == 0.0 else (math.sqrt(1.0 + 2.0 * c * tension) - 1.0) / c
        return line / self.rig["tendon_stiffness"]

    def advance(self, mode, command, second, rate, second_rate, period):
        rig, h, r = self.rig, self.step, self.rig["moment_arm"]
        for _ in range(round(period / h)):
            if mode == "position":
                slope = (self._take_up(second + 1e-6) - self._take_up(max(second - 1e-6, 0.0))) / 2e-6
                for k, way in enumerate((1.0, -1.0)):
                    target, speed = self._take_up(second) + way * r * command, slope * second_rate + way * r * rate
                    w = rig["servo_frequency"]
                    a = w * w * (target - self.x[k]) + 2.0 * rig["servo_damping_ratio"] * w * (speed - self.w[k])
                    self._drive(k, a, rig["drive_acceleration_limit"], h)
            else:
                for k, way in enumerate((1.0, -1.0)):
                    force = min(max(second + way * command / (2.0 * r), 0.0), rig["drive_force_limit"])
                    a = (force - self.tensions[k][0] - rig["drive_damping"] * self.w[k]) / rig["drive_mass"]
                    self._drive(k, a, math.inf, h)
            arms = r + rig["moment_arm_growth"] * self.q, r - rig["moment_arm_growth"] * self.q
            torque = arms[0] * self.tensions[0][1] - arms[1] * self.tensions[1][1]
            torque -= rig["spring_stiffness"] * self.q + rig["weight_torque"] * math.sin(self.q)
            dry = rig["joint_friction"]
            free = self.v + h / rig["joint_inertia"] * (torque - rig["joint_damping"] * self.v)
            held = h / rig["joint_inertia"] * dry
            self.v = free - min(max(free, -held), held)
            before = self._pulled(self.q)
            self.q += h * self.v
            after = self._pulled(self.q)
            for k in (0, 1):
                e, y2 = self.x[k] - after[k], self.y2[k] - (after[k] - before[k])
                t1, t2, self.y2[k] = self.tendons[k].at(e, y2)
                self.tensions[k] = (t1, t2)

    def _drive(self, k, a, most, h):
        limit = self.rig["drive_speed_limit"]
        self.w[k] = min(max(self.w[k] + h * min(max(a, -most), most), -limit), limit)
        self.x[k] += h * self.w[k]


def smooth(rig, state, period, steps, command):
    """Angles of a joint without friction of the tendons in position mode, by an adaptive integrator [steps]."""
    joint = Joint(rig, state, period)
    r, w, z = rig["moment_arm"], rig["servo_frequency"], rig["servo_damping_ratio"]
    take_up, out, last = joint._take_up(rig["co_contraction"]), [], command[0]
    x = np.array([joint.q, 0.0, joint.x[0], 0.0, joint.x[1], 0.0])
    for now in command:
        rate = (now - last) / period
        last = now

        def rates(_, x, now=now, rate=rate):
            pulled = joint._pulled(x[0])
            a, b = (joint.tendons[k].at(x[2 + 2 * k] - pulled[k], 0.0 if False else _half(joint.tendons[k], x[2 + 2 * k] - pulled[k]))[1] for k in (0, 1))
            arms = r + rig["moment_arm_growth"] * x[0], r - rig["moment_arm_growth"] * x[0]
            net = arms[0] * a - arms[1] * b - rig["spring_stiffness"] * x[0] - rig["weight_torque"] * math.sin(x[0])
            pull = [w * w * (take_up + s * r * now - x[k]) + 2.0 * z * w * (s * r * rate - x[k + 1]) for k, s in ((2, 1), (4, -1))]
            return [x[1], (net - rig["joint_damping"] * x[1]) / rig["joint_inertia"], x[3], pull[0], x[5], pull[1]]

        x = solve_ivp(rates, (0.0, period), x, rtol=1e-9, atol=1e-12).y[:, -1]
        out.append(x[0])
    return np.array(out[:steps])


def _half(tendon, e):
    """Stretch of the joint's span of a tendon without friction."""
    return e * tendon.k1 / (tendon.k1 + tendon.k2)
