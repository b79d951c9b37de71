"""A recording of a small drive under a PD controller, integrated here by classical Runge-Kutta steps of 1 ms."""

from functools import cache

import numpy as np
import yaml

KP, KV, KD = 4000.0, 150.0, 150.0
NOISE = {"position": 1e-5, "velocity": 1e-3, "force": 0.05}
MASS, VISCOUS = 2.5, 12.0
HELD = 2.0
"""N in the integral of a controller that has one, when a record begins."""


@cache
def _sines(seed):
    """Frequencies, rad/s, sizes, m, and phases of three sines."""
    rng = np.random.default_rng(seed)
    return 2 * np.pi * rng.uniform(0.3, 1.4, 3), rng.uniform(0.005, 0.015, 3), rng.uniform(0, 6, 3)


def path(t, seed):
    """(reference, its slope), m and m/s: three sines."""
    w, a, p = _sines(seed)
    return np.sum(a * np.sin(w * t + p)) - np.sum(a * np.sin(p)), np.sum(a * w * np.cos(w * t + p))


def _slope(state, t, seed, load, ki):
    y, v, summed = state
    r, rate = path(t, seed)
    force = KP * (r - y) + KV * rate - KD * v + ki * summed
    return np.array([v, (force - VISCOUS * v - load(y, v, t)) / MASS, r - y])


@cache
def _run(seed, load, seconds=8.0, period=0.01, fine=10, ki=0.0):
    """Columns time, position_reference, position, velocity, force [T] with white noise; ``load(y, v, t)`` N.

    ki: gain of the controller's integral, in which `HELD` is left when the record begins.
    """
    h, state, rows = period / fine, np.array([0.0, path(0.0, seed)[1], HELD / ki if ki else 0.0]), []
    for k in range(int(seconds / period)):
        t = k * period
        r, rate = path(t, seed)
        rows.append((t, r, state[0], state[1], KP * (r - state[0]) + KV * rate - KD * state[1] + ki * state[2]))
        for j in range(fine):
            s = t + j * h
            k1 = _slope(state, s, seed, load, ki)
            k2 = _slope(state + 0.5 * h * k1, s + 0.5 * h, seed, load, ki)
            k3 = _slope(state + 0.5 * h * k2, s + 0.5 * h, seed, load, ki)
            k4 = _slope(state + h * k3, s + h, seed, load, ki)
            state = state + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
    table = np.array(rows)
    rng = np.random.default_rng([seed, 1])
    table[:, 2:] += rng.normal(0.0, list(NOISE.values()), (len(table), 3))
    return table


def run(seed, load, ki=0.0):
    """A table of one's own: of `_run`, which many tests ask for the same."""
    return _run(seed, load, ki=ki).copy()


def write(folder, load=lambda y, v, t: 0.0, uses=("fit", "fit", "heldout"), change=None, ki=0.0):
    """The recording's folder; ``change(k, table)`` may damage the table of record k."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, _ in enumerate(uses):
        table = run(10 + k, load, ki)
        table = table if change is None else change(k, table)
        names = "t,r,x,v,f"
        np.savetxt(folder / f"run_{k + 1}.csv", table, delimiter=",", header=names, comments="", fmt="%.9g")
    columns = {"time": ("t", "s"), "position_reference": ("r", "m"), "position": ("x", "m"),
               "velocity": ("v", "m/s"), "force": ("f", "N")}  # fmt: skip
    content = {
        "schema": "cable-recording/1",
        "system": "linear_drive",
        "known": {"coulomb": {"value": 0.0, "unit": "N"}},
        "nominal": {
            "mass": {"value": 2.3, "std": 0.4, "unit": "kg"},
            "viscous": {"value": 10.0, "std": 4.0, "unit": "N s/m"},
        },
        "records": [{"data": f"run_{k + 1}.csv", "use": use} for k, use in enumerate(uses)],
        "channels": {
            name: {"column": column, "unit": unit, **({"noise_std": NOISE[name]} if name in NOISE else {})}
            for name, (column, unit) in columns.items()
        },
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return folder
