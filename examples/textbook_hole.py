"""Textbook control of the hole: an inverse model whose friction is fitted by recursive least squares, and PI-D.

The tension that the drive needs is F = m (g + a) n^s, with s = 1 while the load is hauled and -1 while it is paid out.
The mass is read off the tension at rest. While the cable slides, the measured tension tells ln n = p + q |v|^omega,
which is linear in p and q: recursive least squares with forgetting finds them (Astrom and Wittenmark, Adaptive Control,
1995, ch. 2). The acceleration a is that of the reference with PI-D on the error.

    cablebench submit examples/textbook_hole.py --check-only --trust

`python -m benchmarks.references` compares the shipped reference controllers with this file.
"""

import math

name = "textbook-hole"
information = "nominal"
observe = "output"
tasks = ["CableHole-Position-Step", "CableHole-Position-Sine"]

MOST = 98.0
"""Largest tension asked for, N: the sensor reads up to 100."""
SLIDES = 1e-3
"""Speed from which the cable counts as sliding, m/s."""
FORGETS = 0.999
SPEED = 0.01
"""Speed at which q is the part of ln n that grows with the speed, m/s."""


class TextbookHole:
    """PI-D through the fitted inverse; ``kp``, ``ki``, ``kd`` in 1/s^2, 1/s^3 and 1/s, ``soft`` in m/s.

    ``toward`` (1/s) is the speed with which a missing position is wanted; the wanted speed decides s and n.
    """

    def __init__(self, kp=8000.0, ki=5000.0, kd=90.0, soft=2e-4, toward=5.0):
        self.kp, self.ki, self.kd, self.soft, self.toward = kp, ki, kd, soft, toward

    def reset(self, about):
        """Begin an episode; ``about`` holds the nominal rig, the control period and the range of the command."""
        self.rig, self.dt = about["rig"], about["dt"]
        self.low, self.high = about["low"], min(about["high"], MOST)
        self.mass, self.integral = 0.0, 0.0
        self.power = self.rig["extrusion_exponent"]
        edge = self.rig["wrap_angle"] * self.rig["friction_coefficient"] / self.rig["radius_ratio"]
        self.fit = [edge, 0.1 * edge]
        self.spread = [[0.04, 0.0], [0.0, 0.04]]

    def act(self, t, y, ref):
        """The command, N; ``y``: measurements by name; ``ref``: reference with its rate and acceleration; all SI."""
        gravity = self.rig["gravity"]
        if self.mass == 0.0:
            self.mass = y["drive_tension"] / gravity
        self.learn(y["load_velocity"], y["drive_tension"] / (self.mass * (gravity + ref[2])))
        error = ref[0] - y["load_position"]
        wanted = ref[1] + self.toward * error
        side = max(-1.0, min(1.0, wanted / self.soft))
        asked = ref[2] + self.kp * error + self.integral + self.kd * (ref[1] - y["load_velocity"])
        ratio = max(self.fit[0] + self.fit[1] * (abs(wanted) / SPEED) ** self.power, 0.0)
        free = self.mass * (gravity + asked) * math.exp(side * min(ratio, 1.4))
        force = min(max(free, self.low), self.high)
        if force == free:
            self.integral += self.ki * error * self.dt
        return force

    def learn(self, speed, ratio):
        """A step of recursive least squares for ln n, where the cable slides."""
        if abs(speed) < SLIDES or ratio <= 0.0:
            return
        row = (1.0, (abs(speed) / SPEED) ** self.power)
        along = [sum(s * r for s, r in zip(line, row, strict=True)) for line in self.spread]
        total = FORGETS + row[0] * along[0] + row[1] * along[1]
        missed = math.copysign(1.0, speed) * math.log(ratio) - self.fit[0] * row[0] - self.fit[1] * row[1]
        for i in range(2):
            self.fit[i] += along[i] / total * missed
            for j in range(2):
                self.spread[i][j] = (self.spread[i][j] - along[i] * along[j] / total) / FORGETS
