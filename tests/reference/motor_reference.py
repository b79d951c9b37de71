"""A drive with a motor along a cable, and plants that it drives, written apart from the plants: tiny explicit steps.

Encoder, PID and saturator, motor with its supply, gear and friction. No code is shared with the kernels.
"""

import math

import numpy as np

from tests.reference.joint_reference import Joint
from tests.reference.wrist_reference import Wrist


def stuck_or_sliding(v: float, up: float, down: float, mass: float, dt: float) -> float:
    """Speed of a mass after a short explicit step, from the forces on it going up and going down."""
    if v == 0.0 and up <= 0.0 <= down:
        return 0.0
    new = v + dt * (up if v > 0.0 or (v == 0.0 and up > 0.0) else down) / mass
    return 0.0 if new * v < 0.0 else new


class Motor:
    """Encoder, servo and motor; ``q``: parameters by name, of which ``limit`` is the saturator's."""

    def __init__(self, q, at: float, pull: float, limit: str):
        self.q, self.turns, self.limit = q, q["gear_ratio"] / q["spool_radius"], q[limit]
        self.inertia = q["drive_mass"] + (q["spool_inertia"] + q["motor_inertia"] * q["gear_ratio"] ** 2) / (
            q["spool_radius"] ** 2
        )
        self.at, self.v, self.reading, self.rate = at, 0.0, at, 0.0
        self.integral = self.asked = pull
        self.target, self.pace = at, 0.0
        self.current, self.steps = pull / (q["motor_constant"] * self.turns), 0

    def read(self, target: float, rate: float) -> None:
        """A reading of the encoder, and what the servo makes of it."""
        q, period = self.q, self.q["encoder_period"]
        shown, counts = self.at, q["encoder_counts"]
        if counts:
            step = 2.0 * math.pi / (counts * self.turns)
            shown = step * round(self.at / step)
        self.rate += period / (period + q["servo_filter"]) * ((shown - self.reading) / period - self.rate)
        self.reading, error = shown, target - shown
        apart, grown = (
            q["servo_kp"] * error + q["servo_kd"] * (rate - self.rate),
            self.integral + period * q["servo_ki"] * error,
        )
        limit = self.limit
        if abs(apart + grown) <= limit or (apart + grown) * error < 0.0:
            self.integral = min(max(grown, -limit), limit)
        self.asked = min(max(apart + self.integral, -limit), limit)

    def ask(self, force: float) -> None:
        """A force for the saturator, in the place of the servo's."""
        self.asked = min(max(force, -self.limit), self.limit)

    def follow(self, target: float, rate: float, pull: float, dt: float) -> None:
        """One step towards a target, with a reading where one is due."""
        if self.steps % round(self.q["encoder_period"] / dt) == 0:
            self.read(target, rate)
        self.steps += 1
        self.move(pull, dt)

    def move(self, pull: float, dt: float) -> None:
        """One step against what the cables pull."""
        q, constant, eta = self.q, self.q["motor_constant"] * self.turns, self.q["gear_efficiency"]
        supply, resistance = q["supply_voltage"], q["motor_resistance"] + q["supply_resistance"]
        emf = constant * self.v
        low = max((-supply - emf) / resistance, -q["motor_current_limit"])
        high = min((supply - emf) / resistance, q["motor_current_limit"])
        self.current = min(max(self.asked / constant, low), high)
        push = constant * self.current
        cogging = q["cogging_torque"] * self.turns * math.sin(q["cogging_periods"] * self.turns * self.at)
        forward = push * (eta if push > 0.0 else 1.0 / eta) - q["drive_friction"]
        backward = push * (1.0 / eta if push > 0.0 else eta) + q["drive_friction"]
        against = pull + cogging + q["drive_damping"] * self.v
        self.v = stuck_or_sliding(self.v, forward - against, backward - against, self.inertia, dt)
        fastest = q["drive_speed_limit"] * q.get("drive_scale", 1.0)
        self.v = min(max(self.v, -fastest), fastest)
        self.at += dt * self.v


class JointWithMotors(Joint):
    """The joint with a motor for each tendon."""

    def __init__(self, rig, state, step):
        super().__init__(rig, state, step)
        self.motors = [
            Motor(rig, self.x[k], self.tensions[k][0], "drive_force_limit") for k in (0, 1)
        ]  # fmt: skip

    def placed(self, k, target, rate):
        self.motors[k].follow(target, rate, self.tensions[k][0], self.step)
        self.x[k] = self.motors[k].at

    def pulled_by(self, k, force):
        self.motors[k].ask(force)
        self.motors[k].move(self.tensions[k][0], self.step)
        self.x[k] = self.motors[k].at


class WristWithMotors(Wrist):
    """The wrist with a motor behind each joint, whose coordinate is the cable that it winds up."""

    def __init__(self, rig, state, step):
        super().__init__(rig, state, step)
        self.radii = rig["yaw_radius"], rig["pitch_radius"]
        self.motors = [
            Motor({**rig, "drive_scale": r}, r * at, self.pulled(k), "drive_force_limit")
            for k, (r, at) in enumerate(zip(self.radii, (self.d, self.dp), strict=True))
        ]

    def pulled(self, k):
        """What a pair of cables pulls at its drive."""
        return self.tensions[k][0][0] - self.tensions[k][1][0]

    def driven(self, k, x, v, target, rate):
        motor, r = self.motors[k], self.radii[k]
        motor.follow(r * target, r * rate, self.pulled(k), self.step)
        return motor.at / r, motor.v / r


class ContactsWithMotor:
    """A tendon that rubs at N contacts between a motor and a load.

    Which contacts slip, and how, is guessed from the step before and mended until it fits: a dense system of linear
    equations for each guess.
    """

    def __init__(self, rig, contacts, start, step):
        self.rig, self.n, self.step = rig, contacts, step
        k = 1.0 / (1.0 / rig["tendon_stiffness"] + 1.0 / rig["sheath_stiffness"])
        share = np.full(contacts + 1, 1.0 / contacts)
        share[[0, -1]] *= 0.5
        self.spans = k / share
        tension = rig["load_preload"] + rig["load_stiffness"] * start
        self.places = np.append(start + tension / k * np.cumsum(share[::-1])[::-1], start)
        self.motor = Motor(rig, self.places[0], tension, "tension_command_limit")
        self.v, self.ratio = 0.0, math.exp(rig["friction_coefficient"] * rig["bend_angle"] / contacts)
        self.ways, self.inverses = np.zeros(contacts, int), {}

    def tension(self, j):
        """Tension of span j."""
        return max(self.spans[j] * (self.places[j] - self.places[j + 1]), 0.0)

    def inverse(self, ways):
        """Of the equations for all places: a resting one stays, at a slipping one the tensions are in their ratio."""
        key = ways.tobytes()
        if key not in self.inverses:
            a = np.eye(self.n + 2)
            for h in np.flatnonzero(ways) + 1:
                before, behind = self.spans[h - 1], self.spans[h]
                before, behind = (before, self.ratio * behind) if ways[h - 1] > 0 else (self.ratio * before, behind)
                a[h, h - 1 : h + 2] = before, -before - behind, behind
            self.inverses[key] = np.linalg.inv(a)
        return self.inverses[key]

    def slip(self):
        """Let all contacts slip as far as they must."""
        old = self.places.copy()
        for turn in range(200):
            known = old.copy()
            known[1:-1][self.ways != 0] = 0.0
            self.places = self.inverse(self.ways) @ known
            t = np.maximum(self.spans * (self.places[:-1] - self.places[1:]), 0.0)
            up, down = t[:-1] > self.ratio * t[1:] * (1 + 1e-9), t[1:] > self.ratio * t[:-1] * (1 + 1e-9)
            rests = np.where(up, 1, np.where(down, -1, 0))
            slips = np.where(self.ways * (self.places - old)[1:-1] < -1e-13, 0, self.ways)
            new = np.where(self.ways == 0, rests, slips)
            wrong = np.flatnonzero(new != self.ways)
            if not len(wrong):
                return
            wrong = wrong if turn < 10 else wrong[:1]
            self.ways = self.ways.copy()
            self.ways[wrong] = new[wrong]
        raise AssertionError("the contacts do not settle")

    def advance(self, mode, command, rate, period):
        """One control period; (T_0, T_N, x, y) behind it."""
        rig, h = self.rig, self.step
        for _ in range(round(period / h)):
            if mode == "position":
                self.motor.follow(command, rate, self.tension(0), h)
            else:
                self.motor.ask(command)
                self.motor.move(self.tension(0), h)
            y = self.places[-1]
            net = self.tension(self.n) - rig["load_preload"] - rig["load_stiffness"] * y - rig["load_damping"] * self.v
            self.v += h * net / rig["load_mass"]
            self.places[0], self.places[-1] = self.motor.at, y + h * self.v
            self.slip()
        return self.tension(0), self.tension(self.n), self.places[0], self.places[-1]


class HolesWithMotor(ContactsWithMotor):
    """A motor that hauls a load through holes in series; the load is at the last one, the others have no inertia.

    Without extrusion and without damping of the cable, so that the ratio of each hole is one number.
    """

    def __init__(self, rig, ratio, holes, step):
        self.rig, self.n, self.step, self.ratio = rig, holes - 1, step, ratio
        self.spans = np.array([rig["cable_stiffness"], *[rig["span_stiffness"]] * (holes - 1)])
        self.weight = rig["load_mass"] * rig["gravity"] * rig["load_gravity"]
        self.places = np.append(np.cumsum((self.weight / self.spans)[::-1])[::-1], 0.0)
        self.motor = Motor(rig, self.places[0], self.weight, "tension_command_limit")
        self.v, self.ways, self.inverses = 0.0, np.zeros(self.n, int), {}

    def advance(self, mode, command, rate, period):
        """One control period; (T_0, T_{N-1}, x, y) behind it."""
        rig, h, motor = self.rig, self.step, self.motor
        most = h * rig["drive_acceleration_limit"]
        for _ in range(round(period / h)):
            if mode == "tension":
                motor.ask(max(command, 0.0))
                motor.move(self.tension(0), h)
            else:
                motor.follow(motor.target, motor.pace, self.tension(0), h)
                motor.target += h * motor.pace
                motor.pace += min(max(command - motor.pace, -most), most)
            above = self.tension(self.n)
            up, down = above / self.ratio - self.weight, above * self.ratio - self.weight
            self.v = stuck_or_sliding(self.v, up, down, rig["load_mass"], h)
            self.places[0], self.places[-1] = motor.at, self.places[-1] + h * self.v
            self.slip()
        return self.tension(0), self.tension(self.n), self.places[0], self.places[-1]
