"""Textbook control of the pulley circuit: a virtual sensor of the jaw, and feedforward of the dead zone.

The cables stretch in proportion to the drive's torque M, so the jaw that nobody sees stands at

    z = z0 + gear (theta - theta0) - c (M - M0)

As long as the jaw sticks, z is z0, and the first samples of an episode tell c. Once it slides, M stays at the plateau
of the friction. The drive is told the angle that puts z on the reference with M at the plateau of the way it goes; an
integral of the virtual sensor's error corrects the rest. While the reference stands, the drive goes slowly forward
until the torque shows the plateau, so that a step finds the dead zone closed.

    cablebench submit examples/textbook_circuit.py --check-only --trust

`python -m benchmarks.references` compares the shipped reference controllers with this file.
"""

import math

name = "textbook-circuit"
information = "nominal"
observe = "drive"
tasks = ["PulleyCircuit-Position-Step", "PulleyCircuit-Position-Sine"]

COMPLIANCE, FRICTION = 0.27, 0.17
"""c of the nominal rig, rad/(N m), and the plateau of its torque, N m, as one recording of it shows them."""
BREAKS = 4e-3
"""Angle of the jaw from which it counts as sliding, rad."""
MOST = 0.02
"""Largest weight of what is known of c, (N m)^2: older reversals fade."""
NEAR = 0.05
"""Error up to which the integral works, rad: a jump of the reference is no fault of the feedforward."""
KNOWN = 2e-3
"""Sum of squared torques, (N m)^2, from which c is known."""


class TextbookCircuit:
    """``ki``: 1/s; ``lead``: s; ``turn``: s for a change of direction; ``search``: rad/s while the reference stands."""

    def __init__(self, ki=6.0, lead=0.005, turn=0.02, search=0.01, smooth=0.2):
        self.ki, self.lead, self.turn, self.search, self.smooth = ki, lead, turn, search, smooth

    def reset(self, about):
        """Begin an episode; ``about`` holds the nominal rig, the control period and the range of the command."""
        rig, self.dt, self.low, self.high = about["rig"], about["dt"], about["low"], about["high"]
        self.gear = rig["drive_radius"] / rig["output_radius"]
        self.slope, self.weight = COMPLIANCE, 1e-4  # c and how much is known of it, (N m)^2
        self.plateau, self.slides = FRICTION, False
        self.start, self.before = None, (0.0, 0.0)
        self.side = self.integral = self.ahead = self.still = 0.0
        self.way, self.last, self.jaw = 1.0, None, 0.0

    def act(self, t, y, ref):
        """The command, rad; ``y``: measurements by name; ``ref``: reference with its rate and acceleration; all SI."""
        angle, torque = y["drive_angle"], y["drive_torque"]
        if self.start is None:
            self.start, self.jaw = (ref[0], angle, torque), ref[0]
        zero, angle0, torque0 = self.start
        self.sense(self.gear * (angle - angle0), torque - torque0, torque, y["drive_velocity"], ref[1])
        moves = ref[1] != 0.0 or (self.last is not None and ref[0] != self.last)
        if moves:
            self.way = math.copysign(1.0, ref[1] if ref[1] != 0.0 else ref[0] - self.last)
        self.still, self.last = 0.0 if moves else self.still + self.dt, ref[0]
        if self.still < 0.5:
            self.side += (self.way - self.side) * self.dt / (self.dt + self.turn)
            if abs(ref[0] - self.jaw) < NEAR:
                self.integral += self.ki * (ref[0] - self.jaw) * self.dt
        elif not self.slides:
            self.side += self.search * self.dt / (self.slope * self.plateau)
        stretch = self.slope * (self.side * self.plateau - torque0)
        wanted = ref[0] + self.lead * ref[1] - zero + self.integral + stretch
        return min(max(angle0 + wanted / self.gear, self.low), self.high)

    def sense(self, turned, more, torque, speed, rate):
        """The virtual sensor: c while the jaw sticks, the plateau while it slides."""
        if not self.slides:
            missed = turned - self.slope * more
            if self.weight > KNOWN and abs(missed) > BREAKS:
                self.slides = True
            elif abs(more) > 5e-3:
                self.weight += more * more
                self.slope += more * missed / self.weight
        elif max(abs(torque), abs(self.before[1])) < 0.7 * self.plateau:  # a reversal shows c again
            step, change = turned - self.before[0], torque - self.before[1]
            self.weight = min(self.weight + change * change, MOST)
            self.slope += change * (step - self.slope * change) / self.weight
        elif rate != 0.0 and abs(self.side) > 0.9 and torque * self.way > 0.5 * self.plateau:
            self.plateau += 0.05 * (abs(torque) - self.plateau)
        self.before = turned, torque
        seen = self.start[0] + turned - self.slope * more
        carried = self.gear * speed * self.dt if self.slides and abs(torque) > 0.8 * self.plateau else 0.0
        self.jaw += self.smooth * (seen - self.jaw) + (1.0 - self.smooth) * carried
