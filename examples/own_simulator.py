"""A simulator of one's own in the diagnosis: a pendulum of a few lines, and a log of a pendulum whose bearing rubs.

The simulator is two functions over batches of columns, and a declaration of what they take and give. The log comes from
a program that takes steps two hundred times as short, with dry friction that the simulator does not have. The diagnosis
names it, and gives the simulator with the friction at its pivot. The file also serves the command line.

    python examples/own_simulator.py
    python examples/own_simulator.py --write rig
    cablebench diagnose rig --simulator examples/own_simulator.py:make --out answer
"""

import argparse

import numpy as np

from cable_envs.diagnosis import Recording, diagnose
from cable_envs.diagnosis.simulators import (
    Command,
    Declaration,
    ForcePort,
    FunctionSimulator,
    Output,
    SimulatorParameter,
)

PERIOD, ARM, FRICTION = 0.01, 0.5 * 9.81, 0.02
DECLARATION = Declaration(
    name="pendulum",
    period=PERIOD,
    parameters=(
        SimulatorParameter("mass", "kg", nominal=0.41, low=0.1, high=1.0, std=0.02),
        SimulatorParameter("inertia", "kg m^2", nominal=0.105, low=0.05, high=0.2, std=0.01),
        SimulatorParameter("damping", "N m s/rad", nominal=0.04, low=0.0, high=0.5, std=0.02),
    ),
    commands=(Command("torque", "N m"),),
    outputs=(Output("angle", "rad", starts=True), Output("speed", "rad/s", starts=True)),
    ports=(ForcePort("pivot", velocity="speed", position="angle"),),
)


def start(parameters, first):
    """Begin runs at given angles and speeds [n], or hanging at rest."""
    rest = np.zeros_like(parameters["mass"])
    state = first.get("angle", rest), first.get("speed", rest)
    return state, dict(zip(("angle", "speed"), state, strict=True))


def run(state, commands, forces, parameters):
    """Steps of the midpoint rule, four in each period; torques [n, T] act over a whole period."""
    torques = commands["torque"] + forces["pivot"]
    x, v, h = *state, PERIOD / 4

    def faster(x, v, torque):
        weight = parameters["mass"] * ARM * np.sin(x)
        return (torque - parameters["damping"] * v - weight) / parameters["inertia"]

    out = {"angle": np.empty_like(torques), "speed": np.empty_like(torques)}
    for k in range(torques.shape[1]):
        for _ in range(4):
            middle = v + 0.5 * h * faster(x, v, torques[:, k])
            v = v + h * faster(x + 0.5 * h * v, middle, torques[:, k])
            x = x + h * middle
        out["angle"][:, k], out["speed"][:, k] = x, v
    return (x, v), out


def make():
    """The simulator."""
    return FunctionSimulator(DECLARATION, start, run)


def log(seconds=6.0, noise=1e-3, seed=0):
    """Torques and angles of the real pendulum, whose bearing rubs."""
    rng, time = np.random.default_rng(seed), np.arange(round(seconds / PERIOD) + 1) * PERIOD
    runs, h = {}, PERIOD / 200
    for name, size, rate in (("one", 0.8, 0.7), ("two", 0.5, 0.4), ("other", 0.6, 0.55)):
        torque = size * np.sin(2 * np.pi * rate * time * (0.3 + 0.7 * time / seconds))
        x, v, angle = 0.0, 0.0, [0.0]
        for held in np.repeat(torque[:-1], 200):
            free = v + h * (held - 0.05 * v - 0.4 * ARM * np.sin(x)) / 0.1
            v = np.sign(free) * max(abs(free) - h * FRICTION / 0.1, 0.0)  # friction stops, and never turns round
            x += h * v
            angle.append(x)
        runs[name] = {"time": time, "torque": torque, "angle": angle[::200] + rng.normal(0.0, noise, len(time))}
    return Recording.from_arrays(
        "own", runs, units={"torque": "N m", "angle": "rad"}, noise={"angle": noise}, heldout="other",
        channels={"torque": {"hold": "step"}},
    )  # fmt: skip


def main():
    """Diagnose the log, and simulate with what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", help="write the recording to this folder instead")
    parser.add_argument("--effects", nargs="*", help="look for these effects only")
    asked = parser.parse_args()
    if asked.write:
        return print(f"wrote {log().write(asked.write)}")
    found = diagnose(log(), simulator=make(), effects=asked.effects)
    for effect in found.effects:
        for name, e in effect.parameters.items():
            print(f"{effect.name}, {name}: {e.value:.4f} {e.unit} ({e.low:.4f} to {e.high:.4f}); {FRICTION} was put in")
    better = found.corrected(make())
    swing = better.simulate({"torque": np.zeros(500)}, first={"angle": 0.3, "speed": 0.0})["angle"]
    print(f"let go at 0.3 rad, the corrected pendulum comes to rest at {swing[-1]:.4f} rad")
    return None


if __name__ == "__main__":
    main()
