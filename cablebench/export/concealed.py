"""Recordings of a simulated rig whose effects the recording does not tell: what a diagnosis is asked about."""

import io
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import yaml

from cable_envs.rigs import load_rig
from cablebench.entrants import Entrant
from cablebench.export.recording import FILE, REFERENCES, SIGNALS, channel_columns, check_folder
from cablebench.export.trace import measured, record
from cablebench.store import write_atomic
from diagnosis.recording import CHANNELS, SCHEMA

KNOWN = {
    "cable_hole": (
        "load_mass", "gravity", "load_gravity", "wrap_angle", "radius_ratio", "cable_radius", "load_stiffness",
        "load_damping", "bending_rigidity", "extrusion_delta", "extrusion_gain", "extrusion_exponent", "cable_damping",
    ),
    "pulley_circuit": (
        "drive_radius", "output_radius", "cable_radius", "shaft_radius", "payload_mass", "payload_arm", "gravity",
        "cable_friction", "output_inertia", "contact_stiffness", "servo_frequency", "servo_damping_ratio",
    ),
}  # fmt: skip
"""Trusted by the recording, by system; what an effect changes may stand here too, as the preset has it. The servo is
told by the drive's maker: refitted, it takes up a lag of 0.1 s."""
NOMINAL = {
    "cable_hole": ("friction_coefficient", "cable_stiffness"),
    "pulley_circuit": ("shaft_friction", "tensile_stiffness", "pretension_top", "pretension_bottom"),
}
"""Refitted before anything counts as missing, by system."""


def write_concealed(
    env_id: str, options: Mapping[str, Any], motions: Sequence[Mapping[str, Any]], entrant: Entrant, believed: str,
    folder: Path, seed: int,
) -> Path:  # fmt: skip
    """One episode of a rig for each motion (a reference), the last held out; returns the recording's file.

    ``options`` hold the true rig and effects; the recording names ``believed``, a preset, and its numbers only.
    """
    check_folder(folder)
    records = []
    for k, motion in enumerate(motions):
        asked = {**options, "reference": motion}
        with (
            closing(gym.make(env_id, disable_env_checker=True, **asked)) as env,
            closing(gym.make(env_id, disable_env_checker=True, **{**asked, "observe": "full"})) as full,
        ):
            trace = record(env, entrant, [seed + k])[0]
            setup: Any = full.unwrapped.setup
            columns = channel_columns(setup, trace, measured(full, trace))
        # a loop around the rig is not the rig's; the command is recorded
        columns.pop(REFERENCES[setup.rig.plant, setup.task.kind], None)
        text = io.StringIO()
        np.savetxt(text, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
        write_atomic(folder / f"motion_{k}.csv", text.getvalue())
        records.append({"data": f"motion_{k}.csv", "use": "heldout" if k == len(motions) - 1 else "fit"})
    rig = load_rig(believed)
    table = rig.simulated_by().parameters
    told = {
        part: {name: {"value": float(rig.values[name]), "unit": table[name].unit} for name in names}
        for part, names in (("known", KNOWN[rig.plant]), ("nominal", NOMINAL[rig.plant]))
    }
    content = {
        "schema": SCHEMA, "description": "Simulated rig; what it has beyond the preset is not told.",
        "system": rig.plant, "rig": believed, **told, "records": records,
        "channels": {name: _channel(setup, name) for name in columns},
    }  # fmt: skip
    return write_atomic(folder / FILE, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120))


def _channel(setup: Any, name: str) -> dict[str, Any]:
    system = setup.rig.plant
    entry: dict[str, Any] = {"column": name, "unit": CHANNELS[system][name]}
    rows = [s.name for s in setup.plant.signals]
    signal = SIGNALS.get(system, {}).get(name, name)
    if signal in rows and setup.noise[rows.index(signal)] > 0.0:
        entry["noise_std"] = float(setup.noise[rows.index(signal)])
    return entry
