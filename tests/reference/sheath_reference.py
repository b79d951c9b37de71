"""A tendon in a sheath in plain Python: small explicit steps, a distributed tendon at rest in every moment, and a nut.

No code is shared with the plant; the tension from the stretch is found by bisection from the capstan profile itself.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp


def mean_tension(t1, t2):
    """Mean along the sheath of the exponential between two tensions."""
    return t1 if abs(t1 - t2) < 1e-12 * (t1 + t2) else (t1 - t2) / math.log(t1 / t2)


def entering(mean, t2, a):
    """T1 within T2 e^(-a) .. T2 e^(a) for which the mean is ``mean``, by bisection."""
    low, high = t2 * math.exp(-a), t2 * math.exp(a)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mean_tension(middle, t2) < mean else (low, middle)
    return 0.5 * (low + high)


class Sheath:
    """Load and drive by small explicit steps; ``rig``: parameter values by their (dotted) names."""

    def __init__(self, rig, start, step=1e-5):
        self.rig, self.h = rig, step
        self.k = 1 / (1 / rig["tendon_stiffness"] + 1 / rig["sheath_stiffness"])
        tension = rig["load_preload"] + rig["load_stiffness"] * start
        hard = rig["stiffness_hardening.coefficient"]
        stretch = ((math.sqrt(1 + 2 * hard * tension) - 1) / hard if hard else tension) / self.k
        self.creep, self.worn, self.v, self.vx, self.y = rig["viscoelastic_creep.share"] * stretch, 0.0, 0.0, 0.0, start
        self.end = self.x = start + stretch + self.creep + rig["slack.length"]
        self.t1 = self.t2 = tension
        self.command = None

    def exponent(self, v, towards):
        r = self.rig
        mu = r["friction_coefficient"]
        mu += r["stribeck_friction.contact"] * math.exp(-((v / r["stribeck_friction.velocity"]) ** 2))
        side = math.copysign(1.0, towards) if towards else 0.0
        factor = (1 + r["friction_drift.change"] * self.worn) * (1 + r["asymmetric_friction.contact"] * side)
        return mu * factor * r["bend_angle"]

    def stretched(self):
        """(mean tension, elastic stretch)."""
        r = self.rig
        elastic = self.end - self.y - self.creep - r["slack.length"]
        if elastic <= 0:
            return 0.0, 0.0
        linear = self.k * elastic
        pull = linear * (1 + 0.5 * r["stiffness_hardening.coefficient"] * linear)
        return max(pull + r["tendon_damping"] * (self.end_speed - self.v), 0.0), elastic

    def ends(self, mean, direction, a, resist):
        """(T1, T2) of a mean tension: on the limit while sliding, in balance with the load while it sticks."""
        if mean <= 0.0:
            return 0.0, 0.0
        if direction:
            r = direction * a
            t1 = mean * r / (1 - math.exp(-r)) if r else mean
            return t1, t1 * math.exp(-r)
        least, most = self.ends(mean, 1, a, 0)[1], self.ends(mean, -1, a, 0)[1]
        t2 = min(max(resist, least), most)
        return entering(mean, t2, a), t2

    def resist(self):
        r = self.rig
        return r["load_preload"] + r["load_stiffness"] * self.y + r["load_damping"] * self.v

    def dry(self):
        """(friction of the load moving up, moving down)."""
        r = self.rig
        level = r["load_friction"]
        level += r["stribeck_friction.excess"] * math.exp(-((self.v / r["stribeck_friction.velocity"]) ** 2))
        level *= 1 + r["friction_drift.change"] * self.worn
        extra = r["asymmetric_friction.difference"]
        return level + max(extra, 0.0), level + max(-extra, 0.0)

    def drive(self, command, rate, mode):
        r, h = self.rig, self.h
        if mode == "position":
            w, z = r["servo_frequency"], r["servo_damping_ratio"]
            wanted = w * w * (command - self.x) + 2 * z * w * (rate - self.vx)
            limit = r["drive_acceleration_limit"]
            self.vx += h * min(max(wanted, -limit), limit)
        else:
            self.vx += h / r["drive_mass"] * (command - self.t1 - r["drive_damping"] * self.vx)
        self.vx = min(max(self.vx, -r["drive_speed_limit"]), r["drive_speed_limit"])
        self.x += h * self.vx
        half, before = 0.5 * r["backlash.gap"], self.end
        held = min(max(self.end, self.x - half), self.x + half)
        self.end = held if mode == "position" else self.x
        self.end_speed = (self.end - before) / h

    def advance(self, command, rate, mode, seconds):
        r, h = self.rig, self.h
        lag = r["actuator_lag.time"]
        for _ in range(round(seconds / h)):
            if self.command is None:
                self.command, self.rate = command - rate * seconds, 0.0
            keep = math.exp(-h / lag) if lag else 0.0
            self.command = command + (self.command - command) * keep
            self.rate = rate + (self.rate - rate) * keep
            self.drive(self.command, self.rate, mode)
            mean, elastic = self.stretched()
            resist = self.resist()
            a = self.exponent(self.v, self.v or mean - resist)
            up, down = self.dry()
            low, high = self.ends(mean, 1, a, 0)[1], self.ends(mean, -1, a, 0)[1]
            if self.v > 0 or (self.v == 0 and low - resist - up > 0):
                new = self.v + h / r["load_mass"] * (low - resist - up)
                new = new if new > 0 else 0.0
            elif self.v < 0 or high - resist + down < 0:
                new = self.v + h / r["load_mass"] * (high - resist + down)
                new = new if new < 0 else 0.0
            else:
                new = 0.0
            self.v, self.y = new, self.y + h * new
            self.t1, self.t2 = self.ends(mean, (new > 0) - (new < 0), a, resist)
            self.creep += h / r["viscoelastic_creep.time"] * (r["viscoelastic_creep.share"] * elastic - self.creep)
            fast = 1 / r["friction_drift.time"] + abs(new) / r["friction_drift.travel"]
            self.worn += h * (1 - self.worn) * fast


def nut_in_a_gap(rig, gap, commands, start, period, stiff=2e6, drag=0.1):
    """(drive position, load position, tension at the nut), [T] each, of a drive told its force, held for a period each.

    Nothing is said of where the nut is: it has no mass and hardly any drag, the tendon pulls it, and it meets the edges
    of a gap in the drive as springs of 2 MN/m that push and never pull. The tendon has no friction in its sheath.
    """
    k, c = 1 / (1 / rig["tendon_stiffness"] + 1 / rig["sheath_stiffness"]), rig["tendon_damping"]
    tension = rig["load_preload"] + rig["load_stiffness"] * start
    nut = start + tension / k
    z = [nut + 0.5 * gap + tension / stiff, 0.0, nut, start, 0.0]

    def pushed(x, nut):
        return stiff * max(x - 0.5 * gap - nut, 0.0) - stiff * max(nut - x - 0.5 * gap, 0.0)

    def pulled(nut, speed, y, v):
        return max(k * (nut - y) + c * (speed - v), 0.0) if nut > y else 0.0

    def crawls(x, nut, y, v):
        """Speed of the nut: drag balances push less pull, which falls with the speed by c where it is taut."""
        free = pushed(x, nut) / drag
        taut = (pushed(x, nut) - k * (nut - y) + c * v) / (drag + c)
        return taut if nut > y and k * (nut - y) + c * (taut - v) > 0 else free

    def rates(t, z, command):
        x, vx, nut, y, v = z
        speed = crawls(x, nut, y, v)
        resist = rig["load_preload"] + rig["load_stiffness"] * y + rig["load_damping"] * v
        drive = (command - pushed(x, nut) - rig["drive_damping"] * vx) / rig["drive_mass"]
        return [vx, drive, speed, v, (pulled(nut, speed, y, v) - resist) / rig["load_mass"]]

    out = []
    for command in commands:
        run = solve_ivp(rates, (0.0, period), z, "Radau", args=(command,), rtol=1e-7, atol=1e-10)
        z = run.y[:, -1]
        x, _, nut, y, v = z
        out.append((x, y, pulled(nut, crawls(x, nut, y, v), y, v)))
    return np.array(out).T


def distributed(rig, drive, start, points=400):
    """(load position, T1, T2), each [T], of a distributed tendon between a slow drive [T] and a spring.

    Friction acts on every element. Where the drive pulls, all from the drive to where the old profile is higher than
    T1 e^(-a s) slides in: T(s) = max(T_old, T1 e^(-a s)); paying out, T(s) = min(T_old, T1 e^(a s)). The load's spring
    sets the position that belongs to T(1); T1 is found by bisection from the stretch.
    """
    a, s = rig["friction_coefficient"] * rig["bend_angle"], np.linspace(0.0, 1.0, points)
    k = 1 / (1 / rig["tendon_stiffness"] + 1 / rig["sheath_stiffness"])
    profile = np.full(points, rig["load_preload"] + rig["load_stiffness"] * start)

    def place(profile):
        return (profile[-1] - rig["load_preload"]) / rig["load_stiffness"]

    def reach(profile):
        return place(profile) + np.trapezoid(profile, s) / k

    found = []
    for x in drive:
        pulls = x > reach(profile)

        def new(t1, old=profile, pulls=pulls):
            return np.maximum(old, t1 * np.exp(-a * s)) if pulls else np.minimum(old, t1 * np.exp(a * s))

        low, high = 0.0, 10.0 * profile.max()
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if reach(new(middle)) < x else (low, middle)
        profile = new(0.5 * (low + high))
        found.append((place(profile), profile[0], profile[-1]))
    return np.array(found).T
