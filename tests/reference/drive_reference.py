"""The linear drive with its effects in plain Python: small explicit steps, friction by cases; no shared code."""

import math


class Drive:
    """One axis, rigid (``belt_stiffness`` 0) or with a belt; ``rig``: parameter values by their (dotted) names."""

    def __init__(self, rig, step=1e-5):
        self.rig, self.h = rig, step
        self.y = self.v = self.xm = self.vm = 0.0
        self.creep = self.slow = self.worn = self.command = 0.0
        width = rig["presliding_hysteresis.displacement"]
        self.springs = [[0.0, (k + 1) * width / 8] for k in range(4)]  # deflection, deflection at which it slips
        self.time = 0.0

    def settle(self, command):
        """The lag has reached the first command, and friction that builds up over a distance balances it."""
        self.command = command
        up, down = self.limits(0.0)
        share = min(max((command + (down - up) / 2) / max((up + down) / 2, 1e-12), -1.0), 1.0)
        self.springs = [[share * s, s] for _, s in self.springs]

    def friction_level(self, v):
        r = self.rig
        steady = r["coulomb"] + r["stribeck_friction.excess"] * math.exp(-((v / r["stribeck_friction.velocity"]) ** 2))
        return (1 + r["friction_drift.change"] * self.worn) * steady

    def limits(self, v):
        """(friction against upward motion, against downward motion)."""
        extra, level = self.rig["asymmetric_friction.difference"], self.friction_level(v)
        level += abs(self.rig["unilateral_contact.friction"]) * self.depth("friction")
        return level + max(extra, 0.0), level + max(-extra, 0.0)

    def depth(self, size):
        """How far the carriage is beyond the place, on the side on which that size is met."""
        way = self.y - self.rig["unilateral_contact.place"]
        return max(math.copysign(1.0, self.rig[f"unilateral_contact.{size}"]) * way, 0.0)

    def belt(self):
        r = self.rig
        stretch, half = self.xm - self.y, r["backlash.gap"] / 2
        beyond = stretch - math.copysign(half, stretch) if abs(stretch) > half else 0.0
        elastic = beyond - self.creep - self.slow
        linear = r["belt_stiffness"] * elastic
        force = linear * (1 + 0.5 * r["stiffness_hardening.coefficient"] * abs(linear))
        touching = half == 0 or abs(stretch) > half
        return force + (r["belt_damping"] * (self.vm - self.v) if touching else 0.0), elastic

    def load(self):
        r = self.rig
        turn = 2 * math.pi * self.y / r["position_ripple.period"] + r["position_ripple.phase"]
        spring = r["position_dependent_load.stiffness"] * (self.y - r["position_dependent_load.neutral"])
        met = r["unilateral_contact.stiffness"] * self.depth("stiffness")
        met += abs(r["unilateral_contact.damping"]) * self.depth("damping") * self.v
        return r["viscous"] * self.v + spring + met - r["position_ripple.force"] * math.sin(turn)

    def bent(self, mass):
        """Friction of the Maxwell-slip elements: each carries up to a quarter of the friction, either way."""
        up, down = self.limits(self.v)
        stiffness = sum((up + down) / 4 / (2 * s) for d, s in self.springs if abs(d) < s or d * self.v < 0)
        force = sum((up + down) / 2 * d / s / 4 for d, s in self.springs) + (up - down) / 2
        return force + 0.1 * math.sqrt(stiffness * mass) * self.v

    def slide(self, net, mass):
        """Speed after a step under set-valued dry friction."""
        up, down = self.limits(self.v)
        if self.v == 0.0 and -down <= net <= up:
            return 0.0
        direction = math.copysign(1.0, self.v if self.v != 0.0 else net)
        new = self.v + self.h / mass * (net - (up if direction > 0 else -down))
        return 0.0 if new * self.v < 0 else new

    def advance(self, command, seconds):
        r, h = self.rig, self.h
        for _ in range(round(seconds / h)):
            lag = r["actuator_lag.time"]
            self.command = command + (self.command - command) * math.exp(-h / lag) if lag else command
            rigid = r["belt_stiffness"] == 0
            mass = r["mass"] + (r["motor_mass"] if rigid else 0.0)
            pull, elastic = (self.command, 0.0) if rigid else self.belt()
            net = pull - self.load()
            if r["presliding_hysteresis.displacement"] > 0:
                new = self.v + h / mass * (net - self.bent(mass))
            else:
                new = self.slide(net, mass)
            moved = h * new
            self.v, self.y = new, self.y + moved
            for k, (d, s) in enumerate(self.springs):
                self.springs[k][0] = min(max(d + moved, -s), s)
            if rigid:
                self.xm, self.vm = self.y, self.v
            else:
                self.vm += h / r["motor_mass"] * (self.command - pull)
                self.xm += h * self.vm
                self.creep += h / r["viscoelastic_creep.time"] * (r["viscoelastic_creep.share"] * elastic - self.creep)
                self.slow += h / r["slow_creep.time"] * (r["slow_creep.share"] * elastic - self.slow)
            rate = 1 / r["friction_drift.time"] + abs(self.v) / r["friction_drift.travel"]
            self.worn += h * (1 - self.worn) * rate
            self.time += h
