"""Two axes that meet something: a probe that presses on a soft sample, and a needle that is pushed into one.

A plain function of their own integrates them; neither MuJoCo nor a plant of this package has a part in it. Both are one
mass m on a motor force F, with a controller of its own that nobody logs:

    m v' = F - viscous v - friction sign(v) - s

    probe    s = k d (1 + c v), at least 0; d: depth below the sample's surface      (Hunt, Crossley 1975)
    needle   s = k d until it first punctures at the depth d_p; from there on, beyond the surface, per_depth d sign(v),
             and the force of cutting while it goes deeper than ever before          (Okamura, Simone, O'Leary 2004)
"""

from collections.abc import Callable

import numpy as np

from benchmarks.unlike.logs import CONTROL, Dialect, Log, Sensor, sines, text, trapezoids

MM = 1e3
FINE = 20
"""Steps of integration between two commands of the controller."""
Met = Callable[[float, float], tuple[float, float]]
"""(depth, speed) -> (force that pushes back, dry friction), N, of a sample; called in the order of time."""


def run(
    mass: float, viscous: float, friction: float, place: float, met: Met, motion: Callable[[float], float],
    seconds: float, bandwidth: float,
) -> np.ndarray:  # fmt: skip
    """Position, motor's force and target [1 + seconds / CONTROL, 3] of a run from rest at 0."""
    step, y, v, pushed, seen = CONTROL / FINE, 0.0, 0.0, 0.0, []
    stiff, damp = mass * bandwidth**2, 1.8 * mass * bandwidth
    for n in range(round(seconds / CONTROL) + 1):
        target = motion(n * CONTROL)
        pushed += 0.4 * bandwidth * stiff * (target - y) * CONTROL
        force = stiff * (target - y) - damp * v + pushed
        seen.append((y, force, target))
        for _ in range(FINE):
            back, dry = met(y - place, v)
            net, most = force - viscous * v - back, friction + dry
            free = v + step * net / mass
            slowed = step * most / mass
            v = 0.0 if abs(free) <= slowed else free - np.copysign(slowed, free)
            y += step * v
    return np.array(seen)


def probe(seed: int) -> Log:
    """A linear motor presses a probe on a soft sample and leaves it again."""
    rng = np.random.default_rng([6, seed])
    mass, viscous, friction = rng.uniform(0.8, 1.6), rng.uniform(4.0, 12.0), rng.uniform(1.0, 3.0)
    stiffness, place, loss = rng.uniform(600, 2000), rng.uniform(0.004, 0.012), rng.uniform(0.2, 1.0)

    def sample(depth: float, speed: float) -> tuple[float, float]:
        return max(stiffness * max(depth, 0.0) * (1.0 + loss * speed), 0.0), 0.0

    sensors = (
        Sensor("pos_mm", MM, count=0.001, digits=3), Sensor("force_N", noise=0.08, digits=2),
        Sensor("target_mm", MM, digits=3),
    )  # fmt: skip
    dialect = Dialect("time_s", 1.0, 250.0, jitter=1e-4, drift=2e-5)
    motions = {
        "press1.csv": sines(rng, 0.003, ((0.012, 0.2, 0.4), (0.003, 0.8, 1.3))),
        "press2.csv": trapezoids(rng, 0.004, 0.016, rng.uniform(0.03, 0.05), 0.5),
        "press3.csv": sines(rng, 0.005, ((0.011, 0.3, 0.5), (0.002, 1.0, 1.5))),
    }
    files = {
        name: text(run(mass, viscous, friction, place, sample, motion, 16.0, 60.0), sensors, dialect, rng)
        for name, motion in motions.items()
    }
    owner = {"mass": (mass * rng.normal(1.0, 0.03), "kg", 0.05 * mass)}
    about = "A linear motor that presses a probe on a soft sample. Its position and force, and the target."
    truth = {
        "viscous_friction": (viscous, "N s/m"), "coulomb_friction": (friction, "N"), "mass": (mass, "kg"),
        "stiffness of the sample": (stiffness, "N/m"), "surface of the sample": (place, "m"),
        "loss of the sample": (loss, "s/m"),
    }  # fmt: skip
    return Log("probe", about, files, "press3.csv", owner, truth)


def needle(seed: int) -> Log:
    """An axis that pushes a needle into a sample and draws it out, again and again at the same place."""
    rng = np.random.default_rng([7, seed])
    mass, viscous, friction = rng.uniform(0.3, 0.6), rng.uniform(1.0, 4.0), rng.uniform(0.3, 0.8)
    place, stiffness, punctured = rng.uniform(0.008, 0.015), rng.uniform(200, 500), rng.uniform(0.004, 0.007)
    per_depth, cutting = rng.uniform(30.0, 70.0), rng.uniform(0.4, 0.9)
    sensors = (Sensor("depth_mm", MM, count=0.002, digits=3), Sensor("force_N", noise=0.03, digits=3))
    dialect = Dialect("t_ms", 1e3, 200.0, jitter=1e-4, drift=3e-5)
    motions = {
        "insert1.csv": sines(rng, 0.020, ((0.018, 0.15, 0.25), (0.003, 0.5, 0.8))),
        "insert2.csv": sines(rng, 0.022, ((0.016, 0.1, 0.2), (0.004, 0.4, 0.6))),
        "insert3.csv": trapezoids(rng, 0.020, 0.018, rng.uniform(0.015, 0.03), 0.4),
    }
    files = {}
    for name, motion in motions.items():
        deepest = [0.0]

        def sample(depth: float, speed: float, deepest=deepest) -> tuple[float, float]:
            if depth <= 0.0:
                return 0.0, 0.0
            cuts = deepest[0] >= punctured and depth >= deepest[0]
            deepest[0] = max(deepest[0], depth)
            if deepest[0] < punctured:
                return stiffness * depth, 0.0
            return (cutting if cuts else 0.0), per_depth * depth

        files[name] = text(run(mass, viscous, friction, place, sample, motion, 20.0, 50.0), sensors, dialect, rng)
    owner = {"mass": (mass * rng.normal(1.0, 0.03), "kg", 0.05 * mass)}
    about = "An axis that pushes a needle into a sample and draws it out. Its depth and the motor's force."
    truth = {
        "viscous_friction": (viscous, "N s/m"), "coulomb_friction": (friction, "N"), "mass": (mass, "kg"),
        "friction of the sample per depth": (per_depth, "N/m"), "surface of the sample": (place, "m"),
        "force of cutting": (cutting, "N"),
    }  # fmt: skip
    return Log("needle", about, files, "insert3.csv", owner, truth)
