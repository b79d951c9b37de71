"""The dissipation inequality: what a mechanism stores is never more than the work that its drive has done on it."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from benchmarks.properties.rigs import Trial
from cable_envs.core.inputs import INPUTS


def energy_made(trial: Trial) -> np.ndarray:
    """Largest energy that was gained without work, over the work that passed, shape (n,), at every integration step.

    The work of a step is the mean tension at the drive (the torque) times its motion.
    """
    plant, n, dt = trial.plant, trial.values.shape[1], trial.period / trial.substeps
    stored, force, place = MECHANISMS[plant.name]
    value = dict(zip(plant.parameters.names, trial.values, strict=True))
    p = plant.prepare(trial.values)
    x = plant.rest(p, trial.start)
    u = INPUTS.zeros(n)
    u.mode[:] = plant.action_modes.index(trial.mode)
    rows = {s.name: r for r, s in enumerate(plant.signals)}

    def now() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return stored(value, {name: x[r] for name, r in rows.items()}), x[rows[force]].copy(), x[rows[place]].copy()

    first, pull, at = now()
    work, passed, worst = np.zeros(n), np.zeros(n), np.zeros(n)
    last = trial.command[0]
    for command in trial.command:
        u.command_rate[:], last = (command - last) / trial.period, command
        for _ in range(trial.substeps):
            u.command[:] = command
            plant.advance(x, p, u.rows, 0, n, 1, dt)
            energy, after, moved = now()
            step = 0.5 * (pull + after) * (moved - at)
            work, passed = work + step, passed + np.abs(step)
            pull, at = after, moved
            worst = np.maximum(worst, energy - first - work)
    return worst / np.maximum(passed, 1e-6)


def _hole(value: dict[str, np.ndarray], x: dict[str, np.ndarray]) -> np.ndarray:
    y, v = x["load_position"], x["load_velocity"]
    weight = value["load_mass"] * value["gravity"] * value["load_gravity"]
    stored = 0.5 * value["load_mass"] * v**2 + weight * y + 0.5 * value["load_stiffness"] * y**2
    slips = [x[name] for name in x if name.startswith("slip_position")] + [y]
    stored = stored + 0.5 * value["cable_stiffness"] * np.maximum(x["drive_position"] - slips[0], 0.0) ** 2
    for before, after in pairwise(slips):
        stored = stored + 0.5 * value["span_stiffness"] * np.maximum(before - after, 0.0) ** 2
    return stored


def _sheath(value: dict[str, np.ndarray], x: dict[str, np.ndarray]) -> np.ndarray:
    y, v = x["load_position"], x["load_velocity"]
    k = 1.0 / (1.0 / value["tendon_stiffness"] + 1.0 / value["sheath_stiffness"])
    stored = 0.5 * value["load_mass"] * v**2 + value["load_preload"] * y + 0.5 * value["load_stiffness"] * y**2
    contacts = sum(name.startswith("slip_position") for name in x)
    if not contacts:
        return stored + 0.5 * k * np.maximum(x["drive_position"] - y, 0.0) ** 2
    places = [x["drive_position"], *(x[f"slip_position_{h}"] for h in range(1, contacts + 1)), y]
    for j, (before, after) in enumerate(pairwise(places)):
        halves = 2.0 if j in (0, contacts) else 1.0
        stored = stored + 0.5 * halves * contacts * k * np.maximum(before - after, 0.0) ** 2
    return stored


MECHANISMS: dict[str, tuple[Callable, str, str]] = {
    "cable_hole": (_hole, "drive_tension", "drive_position"),
    "tendon_sheath": (_sheath, "drive_tension", "drive_position"),
}
