"""The real rig: a program of its own without MuJoCo, with a bearing that sticks and a winch that is late."""

import numpy as np
from pendulum import GRAVITY, LENGTH, MOST, PERIOD, PULLEY

from cable_envs.diagnosis import Recording


class Reality:
    """The real rig: a program without MuJoCo. Its numbers are drawn; nobody tells them to the diagnosis."""

    FINE, COUNT = 100, 2 * np.pi / 4096  # steps of 0.2 ms, and the encoder's angle of one count

    def __init__(self, rig, count, noise_seed):
        draw, self.rng = np.random.default_rng([25, rig]), np.random.default_rng([26, rig, noise_seed])
        self.mass, self.bearing, self.viscous = draw.normal(0.42, 0.01), 0.004, draw.normal(0.018, 0.002)
        self.friction, self.lag = draw.uniform(0.02, 0.05), draw.uniform(0.025, 0.05)  # concealed: N m, s
        self.angle, self.speed, self.pull = np.zeros(count), np.zeros(count), np.zeros(count)

    def step(self, tension):
        """What the encoder shows [n] after 20 ms under commanded tensions [n]."""
        h, inertia = PERIOD / self.FINE, self.bearing + self.mass * LENGTH**2
        for _ in range(self.FINE):
            late, self.pull = self.pull, self.pull - (np.clip(tension, 0.0, MOST) - self.pull) * np.expm1(-h / self.lag)
            weight = self.mass * GRAVITY * LENGTH * np.sin(self.angle)
            free = self.speed + h * (PULLEY * 0.5 * (late + self.pull) - weight - self.viscous * self.speed) / inertia
            self.speed = np.sign(free) * np.maximum(np.abs(free) - h * self.friction / inertia, 0.0)
            self.angle = self.angle + h * self.speed
        return self.COUNT * np.round((self.angle + self.rng.normal(0.0, 3e-4, len(self.angle))) / self.COUNT)


def commands(rng, seconds):
    """A tension to try: three sines about a mean, which begins softly, held for 20 ms each."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    tension = 9.0 * np.minimum(time / 0.5, 1.0)
    for rate, size in ((rng.uniform(0.1, 0.3), 5.0), (rng.uniform(0.5, 1.2), 3.0), (rng.uniform(2.0, 4.0), 3.0)):
        tension = tension + size * np.sin(2 * np.pi * (rate * time + rng.uniform())) * np.minimum(time / 0.5, 1.0)
    return np.clip(tension, 0.0, MOST)


def log(rig, seconds=6.0):
    """A recording of the real rig: two runs to fit and one held out, on the logger's own clock."""
    rng, runs = np.random.default_rng([27, rig]), {}
    for name in ("one", "two", "other"):
        tension, real = commands(rng, seconds), Reality(rig, 1, noise_seed=len(runs))
        angle = np.array([0.0] + [real.step(tension[k : k + 1])[0] for k in range(len(tension))])
        time = np.arange(len(angle)) * PERIOD * (1.0 + 2e-5) + rng.normal(0.0, 1e-4, len(angle))
        runs[name] = {"time": time, "tension": np.append(tension, tension[-1]), "angle": angle}
    return Recording.from_arrays(
        "own", runs, units={"tension": "N", "angle": "rad"}, heldout="other", channels={"tension": {"hold": "step"}}
    )
