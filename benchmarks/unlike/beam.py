"""A plain simulator of the continuum that its owner would write: one angle of bending, a spring, and a tendon.

    I q'' = h T - k q - c q',    T = K (travel - h q), which never pushes

The owner measured h on a drawing, and the tendon's stiffness K on a bench. What no system of the tool is, is diagnosed
so: `cable_envs.diagnosis.simulators`.
"""

import numpy as np

from cable_envs.diagnosis.simulators import (
    Command,
    Declaration,
    ForcePort,
    FunctionSimulator,
    Output,
    SimulatorParameter,
)

PERIOD, FINE, SIDE = 0.01, 20, 0.006  # s, steps in it, m


def start(parameters, first):
    """Begin at rest at given angles, or straight."""
    angle = np.array(first.get("angle", np.zeros_like(parameters["bending"])))
    return (angle, np.zeros_like(angle)), {"angle": angle, "speed": 0.0 * angle, "tension": 0.0 * angle}


def run(state, commands, forces, parameters):
    """Linearly implicit steps of 0.5 ms; travels of the tendon [n, T] are reached at the end of a period."""
    (q, v), h, p = state, PERIOD / FINE, parameters
    travel = commands["travel"]
    out = {name: np.empty_like(travel) for name in ("angle", "speed", "tension")}
    for k in range(travel.shape[1]):
        for _ in range(FINE):
            pull = p["tendon"] * (travel[:, k] - SIDE * q)
            taut = pull > 0.0
            stiff = p["bending"] + np.where(taut, p["tendon"] * SIDE**2, 0.0)
            torque = SIDE * np.maximum(pull, 0.0) - p["bending"] * q - p["damping"] * v + forces["bend"][:, k]
            v = v + h * (torque - h * stiff * v) / (p["inertia"] + h * p["damping"] + h * h * stiff)
            q = q + h * v
        out["angle"][:, k], out["speed"][:, k] = q, v
        out["tension"][:, k] = np.maximum(p["tendon"] * (travel[:, k] - SIDE * q), 0.0)
    return (q, v), out


def make():
    """The simulator."""
    return FunctionSimulator(
        Declaration(
            name="beam",
            period=PERIOD,
            parameters=(
                SimulatorParameter("bending", "N m/rad", nominal=0.1, low=0.01, high=2.0),
                SimulatorParameter("damping", "N m s/rad", nominal=1e-3, low=0.0, high=0.1),
                SimulatorParameter("inertia", "kg m^2", nominal=3e-4, low=1e-5, high=1e-2),
                SimulatorParameter("tendon", "N/m", nominal=2e4, low=2e3, high=2e5, std=2e3),
            ),
            commands=(Command("travel", "m"),),
            outputs=(Output("angle", "rad", starts=True), Output("speed", "rad/s"), Output("tension", "N")),
            ports=(ForcePort("bend", velocity="speed", position="angle"),),
        ),
        start,
        run,
    )
