"""A simulator for the tests of the diagnosis: the force that a given motion takes, in closed form."""

from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Coordinate, Free

PARAMETERS = (
    Free("mass", 10.0, 0.1, 100.0, 10.0),
    Free("viscous", 18.0, 0.0, 1e3, 20.0),
    Free("coulomb", 5.5, 0.0, 1e3, 5.0),
    Free("stiffness", 0.0, 0.0, 1e5, 100.0),
    Free("difference", 0.0, -100.0, 100.0, 1.0),
    Free("excess", 0.0, 0.0, 100.0, 1.0),
    Free("velocity", 0.02, 1e-3, 1.0, 0.02),
    Free("bias", 0.0, -100.0, 100.0, 1.0),
    Free("drift", 0.0, -0.9, 5.0, 0.3),
)
NOMINALS = ("mass", "viscous", "coulomb")
_BY_NAME = {p.name: p for p in PARAMETERS}


def _of(name, sizes, **shapes):
    free = (_BY_NAME[name], *(_BY_NAME[s] for s in shapes))
    shape, values = next(iter(shapes.items()), (None, (None,)))
    probes = tuple(({name: s, **({shape: v} if shape else {})},) for s in sizes for v in values)
    return Hypothesis(f"{name}_effect", free, probes, nulls={name: 0.0})


HYPOTHESES = [
    _of("stiffness", (10.0,)), _of("difference", (1.0,)), _of("excess", (1.0,), velocity=(0.005, 0.02, 0.08)),
    _of("bias", (1.0,)), _of("drift", (0.1, -0.1)),
]  # fmt: skip


def force(p, t, y, v, a):
    """Force [T, n] of parameter columns by name."""
    v, direction = v[:, None], np.tanh(v / 1e-3)[:, None]
    level = (p["coulomb"] + p["excess"] * np.exp(-((v / p["velocity"]) ** 2))) * (1.0 + p["drift"] * t[:, None] / t[-1])
    return (
        p["mass"] * a[:, None] + p["viscous"] * v + level * direction + p["stiffness"] * y[:, None] + p["bias"]
        + 0.5 * p["difference"] * (1.0 + direction)
    )  # fmt: skip


class Toy:
    """A `cable_envs.diagnosis.model.model.Model` over records of a known motion."""

    def __init__(self, truth, seed, records=2, colour=0.0, std=0.3, extra=None, count=1500):
        rng = np.random.default_rng(seed)
        self.parameters, self.blocks, self._motion = PARAMETERS, [], []
        values = {p.name: p.start for p in PARAMETERS} | {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0} | truth
        for k in range(records):
            t = 0.01 * np.arange(count)
            w = 2.0 * np.pi * rng.uniform(0.2, 1.3, 3)
            size, phase = rng.uniform(0.02, 0.06, 3), rng.uniform(0, 6, 3)
            y = np.sum(size * np.sin(w * t[:, None] + phase), axis=1)
            v = np.sum(size * w * np.cos(w * t[:, None] + phase), axis=1)
            a = np.sum(-size * w**2 * np.sin(w * t[:, None] + phase), axis=1)
            clean = force({n: np.array([x]) for n, x in values.items()}, t, y, v, a)[:, 0]
            clean = clean + (extra(t, y, v) if extra else 0.0)
            noise = np.empty(count)
            last = 0.0
            for i, w_i in enumerate(rng.normal(0.0, std * np.sqrt(1.0 - colour**2), count)):
                noise[i] = last = colour * last + w_i
            self.blocks.append(Block(f"run{k}", "force", t, clean + noise, np.ones(count, dtype=bool)))
            self._motion.append((t, y, v, a))

    def predict(self, values):
        """As the protocol says."""
        p = dict(zip([q.name for q in PARAMETERS], values[: len(PARAMETERS)], strict=True))
        return [force(p, *motion) for motion in self._motion]


def along(y, v):
    """Coordinates of a motion."""
    return (
        Coordinate("position", "m", y),
        Coordinate("speed", "m/s", v),
        Coordinate("direction", "1", np.sign(v)),
    )


class Moving(Toy):
    """The toy with its motion as coordinates."""

    def __init__(self, truth, seed, *args, **options):
        super().__init__(truth, seed, *args, **options)
        self.blocks = [replace(b, along=along(y, v)) for b, (_, y, v, _) in zip(self.blocks, self._motion, strict=True)]
