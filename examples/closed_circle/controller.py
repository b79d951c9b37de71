"""A controller that knows what a model says, its gains tuned on the model by the cross-entropy method."""

import mujoco
import numpy as np
from pendulum import GRAVITY, LENGTH, MOST, PERIOD, PULLEY, Batch
from reality import Reality


class Controller:
    """What the model says that a motion takes, looking ``lead`` s ahead, and a PD law; gains [n]: kp, kd, lead."""

    def __init__(self, text, gains):
        one = mujoco.MjModel.from_xml_string(text)
        self.mass, self.inertia = one.body_mass[1], one.dof_armature[0] + one.body_mass[1] * LENGTH**2
        self.damping, self.friction = one.dof_damping[0], one.dof_frictionloss[0]
        (self.kp, self.kd, self.lead), self.before, self.rate = gains, None, 0.0

    def act(self, time, shown, path):
        """Tensions [n] at a time, s, from the shown angles [n]; path: function of the time."""
        change = 0.0 if self.before is None else (shown - self.before) / PERIOD
        self.before, self.rate = shown, 0.5 * (self.rate + change)  # of counts, hence smoothed
        here, ahead = path(time), path(time + self.lead)
        torque = self.mass * GRAVITY * LENGTH * np.sin(ahead[0]) + self.inertia * ahead[2] + self.damping * ahead[1]
        torque = torque + self.friction * np.tanh(ahead[1] / 0.02)
        tension = torque / PULLEY + self.kp * (here[0] - shown) + self.kd * (here[1] - self.rate)
        return np.clip(tension, 0.0, MOST)


def path(seed, count):
    """Angles to follow [count], with rate and acceleration, as a function of the time (a number, or [count])."""
    rng = np.random.default_rng([29, seed])
    parts = [(rng.uniform(low, high, count), rng.uniform(0.0, 2 * np.pi, count), size)
             for low, high, size in ((0.6, 1.2, 0.25), (1.5, 3.0, 0.12))]  # fmt: skip

    def of(time):
        found = [0.5, 0.0, 0.0]
        for w, phase, size in parts:
            found[0] = found[0] + size * np.sin(w * time + phase)
            found[1] = found[1] + size * w * np.cos(w * time + phase)
            found[2] = found[2] - size * w**2 * np.sin(w * time + phase)
        return found

    return of


def followed(step, text, gains, along, seconds=5.0):
    """RMS error, rad, of each column [n] after the first second, under ``step``: tensions [n] -> shown angles [n]."""
    controller, shown, squares = Controller(text, gains), np.zeros(len(gains[0])), 0.0
    steps, begun = round(seconds / PERIOD), round(1.0 / PERIOD)
    for k in range(steps):
        shown = step(controller.act(k * PERIOD, shown, along))
        if k >= begun:
            squares = squares + (shown - along((k + 1) * PERIOD)[0]) ** 2
    return np.sqrt(squares / (steps - begun))


LOWEST, HIGHEST = np.array([1.0, 0.05, 0.0]), np.array([400.0, 40.0, 0.12])  # N/rad, N s/rad, s


def tuned(text, seed=0, tries=24, rounds=8, paths=3):
    """Gains [3] that follow best in a model, by the cross-entropy method (Rubinstein and Kroese 2004)."""
    rng, along = np.random.default_rng([30, seed]), path(seed, tries * paths)
    noise, count = np.random.default_rng([31, seed]), Reality.COUNT
    middle, spread = np.array([0.6, 0.5, 0.3]), np.array([0.25, 0.25, 0.25])  # of the way, in kp and kd by factors
    for _ in range(rounds):
        parts = np.clip(middle + spread * rng.normal(size=(tries, 3)), 0.0, 1.0)
        parts[0] = middle
        gains = np.repeat(_gains(parts), paths, axis=1)
        batch = Batch(text, tries * paths)

        def step(tension, batch=batch):
            angle = batch.step(tension[:, None])[0][:, 0] + noise.normal(0.0, 3e-4, tries * paths)
            return count * np.round(angle / count)  # the encoder is known from its data sheet

        errors = followed(step, text, gains, along).reshape(tries, paths).mean(axis=1)
        best = parts[np.argsort(errors)[: tries // 4]]
        middle, spread = best.mean(axis=0), best.std(axis=0) + 0.01
    return _gains(middle[None])[:, 0]


def _gains(parts):
    """Gains [3, n] from shares [n, 3] of the way from the lowest to the highest."""
    low, high = np.log(LOWEST[:2]), np.log(HIGHEST[:2])
    return np.vstack([np.exp(low + parts[:, :2] * (high - low)).T, LOWEST[2] + parts[:, 2] * (HIGHEST[2] - LOWEST[2])])


def tried(text, gains, rig, runs=8):
    """RMS error [runs], rad, on the real rig, along paths of which no tuning knew."""
    real = Reality(rig, runs, noise_seed=200)
    return followed(real.step, text, np.repeat(np.reshape(gains, (3, 1)), runs, axis=1), path(1000 + rig, runs))
