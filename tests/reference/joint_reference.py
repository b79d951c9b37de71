"""The joint with two tendons, written apart from the plant: tiny explicit steps, and SciPy where nothing rubs."""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq


def ratio_of(rig):
    """T1 / T2 over the bend: mu T'' + (1 + rho) T' - rho mu T = 0, T(0) = 1, T'(0) = 0, by a matrix exponential."""
    mu, rho = rig["friction_coefficient"], rig["radius_ratio"]
    if mu == 0.0:
        return 1.0
    return expm(rig["wrap_angle"] * np.array([[0.0, 1.0], [rho, -(1.0 + rho) / mu]]))[0, 0]


class Tendon:
    """Two springs with a friction contact between them."""

    def __init__(self, stiffness, share, hardening, ratio):
        self.k1, self.k2, self.c, self.n = stiffness / share, stiffness / (1.0 - share), hardening, ratio

    def force(self, k, y):
        """Tension of a span."""
        line = k * max(y, 0.0)
        return line + 0.5 * self.c * line * line

    def at(self, e, y2):
        """(tension at the drive, at the joint, stretch of the joint's span) once it has slipped as far as it must."""
        if e <= 0.0:
            return 0.0, 0.0, e * self.k1 / (self.k1 + self.k2)

        def over(y, a, b):
            return a * self.force(self.k1, e - y) - b * self.force(self.k2, y)

        if over(y2, 1.0, self.n) > 0.0:
            y2 = brentq(over, 0.0, e, args=(1.0, self.n), xtol=1e-18, rtol=1e-14)
        elif over(y2, self.n, 1.0) < 0.0:
            y2 = brentq(over, 0.0, e, args=(self.n, 1.0), xtol=1e-18, rtol=1e-14)
        return self.force(self.k1, e - y2), self.force(self.k2, y2), y2


class Joint:
    """The joint between two drives; `advance` goes on by tiny explicit steps."""

    def __init__(self, rig, state, step):
        self.rig, self.step = rig, step
        self.tendon = Tendon(rig["tendon_stiffness"], rig["drive_share"], rig["tendon_hardening"], ratio_of(rig))
        self.q, self.v, self.w = state["joint_angle"], 0.0, [0.0, 0.0]
        self.x, self.y2 = ([state[name.format(k)] for k in "ab"] for name in ("drive_{}_position", "stretch_joint_{}"))
        self.tensions = [(state[f"tension_drive_{k}"], state[f"tension_joint_{k}"]) for k in "ab"]

    def pulled(self, q):
        """How far the joint pulls both tendons in."""
        r, g = self.rig["moment_arm"], self.rig["moment_arm_growth"]
        return r * q + 0.5 * g * q * q, -r * q + 0.5 * g * q * q

    def arms(self, q):
        """Their moment arms."""
        r, g = self.rig["moment_arm"], self.rig["moment_arm_growth"]
        return r + g * q, r - g * q

    def take_up(self, tension):
        """Stretch of a tendon that has this tension everywhere."""
        c = self.rig["tendon_hardening"]
        line = tension if c == 0.0 else (math.sqrt(1.0 + 2.0 * c * tension) - 1.0) / c
        return line / self.rig["tendon_stiffness"]

    def resisted(self, q):
        """Torque of spring and weight."""
        return self.rig["spring_stiffness"] * q + self.rig["weight_torque"] * math.sin(q)

    def placed(self, k, target, rate):
        """One step of a drive that is told where to go."""
        rig, w = self.rig, self.rig["servo_frequency"]
        a = w * w * (target - self.x[k]) + 2.0 * rig["servo_damping_ratio"] * w * (rate - self.w[k])
        self.moved(k, min(max(a, -rig["drive_acceleration_limit"]), rig["drive_acceleration_limit"]))

    def pulled_by(self, k, force):
        """One step of a drive that is told its force."""
        rig = self.rig
        self.moved(k, (force - self.tensions[k][0] - rig["drive_damping"] * self.w[k]) / rig["drive_mass"])

    def moved(self, k, a):
        """One step of a drive that accelerates so."""
        limit = self.rig["drive_speed_limit"]
        self.w[k] = min(max(self.w[k] + self.step * a, -limit), limit)
        self.x[k] += self.step * self.w[k]

    def advance(self, mode, command, second, rate, second_rate, period):
        """One control period."""
        rig, h, r = self.rig, self.step, self.rig["moment_arm"]
        for _ in range(round(period / h)):
            for k, way in enumerate((1.0, -1.0)):
                if mode == "position":
                    slope = (self.take_up(second + 1e-6) - self.take_up(max(second - 1e-6, 0.0))) / 2e-6
                    self.placed(
                        k, self.take_up(second) + way * r * command, slope * second_rate + way * r * rate
                    )  # fmt: skip
                else:
                    self.pulled_by(k, min(max(second + way * command / (2.0 * r), 0.0), rig["drive_force_limit"]))
            arms = self.arms(self.q)
            net = arms[0] * self.tensions[0][1] - arms[1] * self.tensions[1][1] - self.resisted(self.q)
            free = self.v + h / rig["joint_inertia"] * (net - rig["joint_damping"] * self.v)
            held = h / rig["joint_inertia"] * rig["joint_friction"]
            self.v = free - min(max(free, -held), held)
            before, self.q = self.pulled(self.q), self.q + h * self.v
            for k, (was, now) in enumerate(zip(before, self.pulled(self.q), strict=True)):
                t1, t2, self.y2[k] = self.tendon.at(self.x[k] - now, self.y2[k] - (now - was))
                self.tensions[k] = (t1, t2)


def smooth(rig, state, period, commands):
    """(angle, speed) [steps, 2] of a joint without any dry friction in position mode, by an adaptive integrator."""
    joint = Joint(rig, state, period)
    r, w, z = rig["moment_arm"], rig["servo_frequency"], rig["servo_damping_ratio"]
    take_up, out, last = joint.take_up(rig["co_contraction"]), [], commands[0]
    x = np.array([joint.q, 0.0, joint.x[0], 0.0, joint.x[1], 0.0])
    k = rig["tendon_stiffness"]

    def rates(_, x, command, rate):
        torque = 0.0
        for end, pulled, arm, way in zip(x[[2, 4]], joint.pulled(x[0]), joint.arms(x[0]), (1.0, -1.0), strict=True):
            line = k * max(end - pulled, 0.0)
            torque += way * arm * (line + 0.5 * rig["tendon_hardening"] * line * line)
        told = [
            w * w * (take_up + way * r * command - x[row]) + 2.0 * z * w * (way * r * rate - x[row + 1])
            for row, way in ((2, 1.0), (4, -1.0))
        ]
        faster = (torque - joint.resisted(x[0]) - rig["joint_damping"] * x[1]) / rig["joint_inertia"]
        return [x[1], faster, x[3], told[0], x[5], told[1]]

    for command in commands:
        args = (command, (command - last) / period)
        x, last = solve_ivp(rates, (0.0, period), x, rtol=1e-9, atol=1e-12, args=args).y[:, -1], command
        out.append(x[:2])
    return np.array(out)
