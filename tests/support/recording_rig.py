"""A recording made with the plant: a speed staircase through three wraps, in the recording format."""

from pathlib import Path

import numpy as np
import yaml

from cable_envs.core.inputs import INPUTS
from cable_envs.sim.rigs import load_rig


def staircase(rig, speeds, seconds=0.6, step=0.01):
    """(plant, signals [samples, signals], times) of a rig driven at each speed for a while; substeps of 1 ms."""
    plant = rig.simulated_by()
    p = plant.prepare(plant.parameters.pack(rig.values)[:, None])
    x = plant.rest(p, np.zeros(1))
    rows, time = [], []
    for speed in speeds:
        u = np.zeros((INPUTS.count, 1))
        u[INPUTS.row("command")], u[INPUTS.row("mode")] = speed, 1.0
        for _ in range(round(seconds / step)):
            plant.advance(x, p, u, 0, 1, 10, step / 10)
            rows.append(x[:, 0].copy())
            time.append(len(time) * step)
    return plant, np.array(rows), np.array(time)


def write_recording(folder: Path, rng=None, noise=0.1, wraps=(30.0, 60.0, 90.0), **changes) -> Path:
    """``folder``/recording.yaml with one CSV (in mm/s) for each wrap, a last one held out; ``noise`` in N."""
    speeds = [v * sign for sign in (1, -1) for v in np.linspace(10.8e-3, 1e-3, 8)]
    records = []
    for k, wrap in enumerate([*wraps, wraps[-1]]):
        rig = load_rig("gu-inferred").replace({"wrap_angle": np.radians(wrap)})
        plant, rows, time = staircase(rig, speeds)
        signal = {s.name: rows[:, j] for j, s in enumerate(plant.signals)}
        tensions = [signal["drive_tension"], signal["load_tension"]]
        if rng is not None:
            tensions = [t + noise * rng.standard_normal(len(t)) for t in tensions]
        table = np.column_stack([time, 1e3 * signal["drive_velocity"], *tensions, np.full(len(time), wrap)])
        name = f"run_{k + 1}.csv"
        np.savetxt(folder / name, table, delimiter=",", header="t,v_mm_s,F1,F2,wrap", comments="", fmt="%.9g")
        records.append({"data": name, "use": "heldout" if k == len(wraps) else "fit"})
    tension = {"unit": "N", "noise_std": noise} if rng is not None else {"unit": "N"}
    content = {
        "schema": "cable-recording/1",
        "system": "cable_hole",
        "known": {"radius_ratio": 1.5},
        "records": records,
        "channels": {
            "time": {"column": "t", "unit": "s"},
            "drive_velocity": {"column": "v_mm_s", "unit": "mm/s"},
            "drive_tension": {"column": "F1", **tension},
            "load_tension": {"column": "F2", **tension},
            "wrap_angle": {"column": "wrap", "unit": "deg"},
        },
    } | changes
    path = folder / "recording.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path
