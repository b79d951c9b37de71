"""Fingerprints of the plants' kernels: what effects that are switched off must leave as it is, to the bit.

The coefficients and the state at rest are rounded to ten digits, so that the fingerprints do not depend on the
platform's mathematical library; the kernels themselves use none. ``python -m tests.support.golden_kernels`` writes
tests/support/golden/kernels.json. What the ids -v0 have was made from the commit before the first
effect; the hole of -v1 from the commit that mended it.
"""

import hashlib
import json
from pathlib import Path

import numpy as np

from cable_envs.core.inputs import INPUTS
from cable_envs.plants import plant_for
from cable_envs.plants.base import OUT_OF_RANGE
from cable_envs.sim.rigs import load_rig
from tests.support.inputs import COMMAND, COMMAND_RATE, DISTURBANCE, MODE

FILE = Path(__file__).parent / "golden" / "kernels.json"
PERIOD, SUBSTEPS, STEPS = 0.01, 10, 150

HOLES = ("gu-inferred", "gu-anchored", "gu-steel-1mm", "gu-rubber-3mm")
CIRCUITS = ("zou-table2", "zou-grasp", "zou-instrument")
CASES = {
    "cable_hole": ("analytic", 1, HOLES, {"tension": 30.0, "speed": 0.012}, "v0"),
    "cable_hole v1": ("analytic", 1, HOLES, {"tension": 30.0, "speed": 0.012}, "v1"),
    "cable_hole of three": ("analytic", 3, ("gu-three-holes",), {"tension": 40.0, "speed": 0.01}, "v1"),
    "pulley_circuit": ("analytic", 1, CIRCUITS, {"position": 0.6, "torque": 0.2}, "v0"),
    "pulley_chain": ("chain", 1, CIRCUITS, {"position": 0.6, "torque": 0.2}, "v0"),
}
CHANGES = (
    {}, {"bending_rigidity": 1e-5}, {"load_damping": 30.0, "extrusion_gain": 0.0},
    {}, {"pretension_top": 12.5, "pretension_bottom": 12.5}, {"payload_mass": 0.2, "brake_torque": 0.02},
)  # fmt: skip


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.array([float(f"{v:.10g}") for v in values.ravel()]).reshape(values.shape)


def columns(case: str) -> tuple:
    """(plant, parameter columns [parameters, n]): every rig of the case, with each change that its plant knows."""
    variant, holes, rigs, _, version = CASES[case]
    plant = plant_for(case.split()[0].replace("chain", "circuit"), variant, holes, version)
    made = []
    for name in rigs:
        rig = load_rig(name)
        made.extend(
            plant.parameters.pack({**rig.values, **change, "breaking_tension": 1e5})
            for change in CHANGES
            if set(change) <= set(plant.parameters.names)
        )
    return plant, np.array(made).T


def commands(size: float, n: int, held: np.ndarray):
    """Reversing motion with rests and jumps, other for every column; (command, rate, disturbance) [n] of each step."""
    k = np.arange(n)
    last = held
    for step in range(STEPS):
        t = (step + 1) * PERIOD
        wave = np.sin(2.0 * np.pi * np.round(t * (1.0 + 0.25 * k), 6))
        wave = np.where(abs(wave) < 0.4, 0.0, np.round(wave, 6)) * (step % 60 < 45)
        command = held + size * wave
        yield command, (command - last) / PERIOD, np.where((step // 20 + k) % 3 == 0, 1e-3 * size, 0.0)
        last = command


def fingerprint(case: str, mode: str, effects: bool = False) -> str:
    """SHA-256 over all signals after every control step; ``effects``: with the rows of all effects, at null.

    Of all but out_of_range where the kernel does not set it: the hole had no such signal.
    """
    plant, values = columns(case)
    if effects:
        null = [p.default for p in plant.table][len(plant.parameters) :]
        values = np.concatenate([values, np.repeat(np.array(null)[:, None], values.shape[1], axis=1)])
    n = values.shape[1]
    p = plant.prepare(values)
    base = len(plant.coefficients)
    p[:base] = _rounded(p[:base])
    if effects:
        p[base + plant.effects.lanes.row("on")] = (
            1.0  # else the kernel would see that no effect is on, and leave them out
        )
    x = plant.rest(p, np.full(n, 1e-3))
    seen = len(plant.signals) - (plant.signals[-1] is OUT_OF_RANGE)
    x[:seen] = _rounded(x[:seen])
    action = plant.action_modes[[m.name for m in plant.action_modes].index(mode)]
    held = x[plant.row(action.rest_signal)].copy() if action.rest_signal else np.zeros(n)
    u = np.zeros((len(INPUTS), n))
    u[MODE] = plant.action_modes.index(action)
    digest = hashlib.sha256()
    for u[COMMAND], u[COMMAND_RATE], u[DISTURBANCE] in commands(CASES[case][3][mode], n, held):
        plant.advance(x, p, u, 0, n, SUBSTEPS, PERIOD / SUBSTEPS)
        digest.update(np.ascontiguousarray(x[:seen]).tobytes())
    assert np.isfinite(x[:seen]).all()
    return digest.hexdigest()


KEYS = tuple((case, mode) for case, (*_, modes, _) in CASES.items() for mode in modes)

if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    made = {f"{case}, {mode}": fingerprint(case, mode) for case, mode in KEYS}
    FILE.write_text(json.dumps(made, indent=1) + "\n")
    print(FILE.read_text())
