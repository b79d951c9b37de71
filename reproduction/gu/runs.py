"""Runs of the cable-hole under the papers' adaptive controllers, as in section 5.3 of Gu 2024."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cable_envs.baselines.mrac import MracG9, MracG22
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.hole.plant import cable_hole
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.tasks import load_task

DT, SUBSTEPS = load_task("CableHole-Position").control_period, load_task("CableHole-Position").substeps
DURATION, STEP_TIME = 20.0, 10.0
"""s; "at t = 10 s, a sudden step occurs" """
CONTROLLERS = {"g22": MracG22, "g9": MracG9}
SENSED = ("load_position", "load_velocity", "drive_position", "drive_velocity", "drive_tension", "load_tension")


class Step(NamedTuple):
    """A step at `STEP_TIME`; m."""

    amplitude: float

    def at(self, t: float) -> tuple[float, float, float]:
        """Value and two derivatives."""
        return (self.amplitude if t >= STEP_TIME - 1e-9 else 0.0), 0.0, 0.0


class Sine(NamedTuple):
    """amplitude sin(2 pi frequency t); m, Hz."""

    amplitude: float
    frequency: float

    def at(self, t: float) -> tuple[float, float, float]:
        """Value and two derivatives."""
        w = 2 * math.pi * self.frequency
        sine = math.sin(w * t)
        return self.amplitude * sine, self.amplitude * w * math.cos(w * t), -self.amplitude * w * w * sine


class Ramp(NamedTuple):
    """Motion at a constant speed; m/s."""

    speed: float

    def at(self, t: float) -> tuple[float, float, float]:
        """Value and two derivatives."""
        return self.speed * t, self.speed, 0.0


@dataclass(frozen=True)
class Case:
    """One controller on one true rig."""

    controller: str
    """key of `CONTROLLERS`"""
    reference: Step | Sine | Ramp
    rig: Mapping[str, float]
    """changes to the preset gu-inferred: the truth"""
    belief: Mapping[str, float] | None = None
    """changes to the truth that the controller believes in"""
    direction: str = "wanted"
    direction_speed: float = 5e-4
    """m/s; half width over which the direction of friction is interpolated"""
    noise: float = 1.0
    """times the sensor noise of the position task"""
    gains: Mapping[str, float] = field(default_factory=dict)
    """of the controller, other than its defaults"""


@dataclass(frozen=True)
class Runs:
    """Signals [samples, cases]."""

    time: np.ndarray
    signals: Mapping[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]

    @property
    def error(self) -> np.ndarray:
        """Wanted less actual load position, m."""
        return self["reference"] - self["load_position"]

    def late(self, start: float) -> "Runs":
        """Samples after ``start`` seconds."""
        inside = self.time > start + 1e-9
        return Runs(self.time[inside], {n: v[inside] for n, v in self.signals.items()})


def run(cases: Sequence[Case], duration: float = DURATION, seed: int = 2) -> Runs:
    """Cases side by side, from rest at 0; in tension mode through the inner loop of Eq. (35).

    Parameters
    ----------
    cases : sequence of Case
        A controller on a true rig each.
    duration : float
        s.
    seed : int
        Of the sensors' noise.

    Returns
    -------
    Runs
        Signals [samples, cases].
    """
    preset = load_rig("gu-inferred").values
    plant = cable_hole()
    rigs = [{**preset, **case.rig} for case in cases]
    p = plant.prepare(np.stack([plant.parameters.pack(r) for r in rigs], axis=1))
    x = plant.rest(p, np.zeros(len(cases)))
    u = INPUTS.zeros(len(cases))
    u.command[:] = x[plant.row("drive_tension")]
    actors = [
        CONTROLLERS[c.controller](
            "cable_hole",
            "tension",
            "position",
            {**r, **(c.belief or {})},
            DT,
            direction=c.direction,
            direction_speed=c.direction_speed,
            **c.gains,
        )
        for c, r in zip(cases, rigs, strict=True)
    ]
    std = load_task("CableHole-Position").sensor_noise
    noise = np.array([c.noise for c in cases])
    rng = np.random.default_rng(seed)
    names = [s.name for s in plant.signals]
    steps = round(duration / DT)
    kept = np.empty((steps, len(names) + 2, len(cases)))
    for k in range(steps):
        seen = {n: x[plant.row(n)] + noise * std[n] * rng.standard_normal(len(cases)) for n in SENSED}
        command = np.array(
            [
                a.limit(a.act(k * DT, {n: float(v[j]) for n, v in seen.items()}, cases[j].reference.at(k * DT)))
                for j, a in enumerate(actors)
            ]
        )
        u.command_rate[:] = (command - u.command) / DT
        u.command[:] = command
        plant.advance(x, p, u.rows, 0, len(cases), SUBSTEPS, DT / SUBSTEPS)
        kept[k, : len(names)] = x[: len(names)]
        kept[k, -2] = command
        kept[k, -1] = [c.reference.at((k + 1) * DT)[0] for c in cases]
    signals = {n: kept[:, i] for i, n in enumerate((*names, "command", "reference"))}
    return Runs(DT * np.arange(1, steps + 1), signals)


def chatter(values: np.ndarray, dt: float = DT, cutoff: float = 10.0) -> np.ndarray:
    """RMS of what lies above a frequency: the root of the benchmark's metric of the same name.

    Parameters
    ----------
    values : ndarray [samples, cases]
    dt : float
        Sampling period, s.
    cutoff : float
        Hz.

    Returns
    -------
    ndarray [cases]
    """
    n = len(values)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    spectrum = np.abs(np.fft.rfft((values - values.mean(axis=0)) * window[:, None], axis=0)) ** 2
    spectrum[1 : (n + 1) // 2] *= 2.0
    power = spectrum / (n * np.sum(window**2))
    return np.sqrt(power[np.fft.rfftfreq(n, dt) >= cutoff].sum(axis=0))
