"""Short runs of the circuit plants for tests."""

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from cable_envs.core.inputs import INPUTS
from cable_envs.plants.base import Plant
from tests.support.inputs import COMMAND, COMMAND_RATE, MODE


def symmetric(**change) -> dict[str, float]:
    """Cable b runs like cable t."""
    rig = {"span_bottom_4": 39.9e-3, "wrap_bottom_4": 3.217}
    rig |= {f"radius_bottom_{i}": r for i, r in enumerate((4e-3, 8e-3, 5e-3, 8e-3), 1)}
    return rig | change


def pretension(newton: float, **change) -> dict[str, float]:
    return {"pretension_top": newton, "pretension_bottom": newton, **change}


class Run:
    """One mechanism, one control step at a time; keeps every state it passed."""

    def __init__(self, plant: Plant, rig: Mapping[str, float], position: float = 0.0, mode: str = "position"):
        self.plant = plant
        self.p = plant.prepare(plant.parameters.pack(rig)[:, None])
        self.x = plant.rest(self.p, np.array([position]))
        self.u = np.zeros((len(INPUTS), 1))
        self.u[MODE] = [m.name for m in plant.action_modes].index(mode)
        self.u[COMMAND] = self.x[plant.row("drive_angle" if mode == "position" else "drive_torque")]
        self.states = [self.x[:, 0].copy()]

    def step(self, steps: int, command: Callable | None = None, substeps: int = 10, dt: float = 1e-3) -> "Run":
        """``command`` maps the time since this call to (command, rate); without it the last one stays."""
        for k in range(steps):
            if command is not None:
                self.u[COMMAND], self.u[COMMAND_RATE] = command((k + 1) * substeps * dt)
            self.plant.advance(self.x, self.p, self.u, 0, 1, substeps, dt)
            self.states.append(self.x[:, 0].copy())
        return self

    def __getitem__(self, signal: str) -> np.ndarray:
        """A signal over time [states]."""
        row = self.plant.row(signal)
        return np.array([state[row] for state in self.states])


def ramp(start: float, rate: float) -> Callable:
    return lambda t: (start + rate * t, rate)


def sine(amplitude: float, period: float) -> Callable:
    w = 2 * np.pi / period
    return lambda t: (amplitude * np.sin(w * t), amplitude * w * np.cos(w * t))


def phase_order(phases: np.ndarray) -> list[int]:
    """The phases in their order, repetitions dropped."""
    return [int(phases[0]), *(int(b) for a, b in pairwise(phases) if a != b)]
