"""Recordings of a simulated rig whose effects the recording does not tell: what a diagnosis is asked about."""

import io
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import yaml

from cable_envs.errors import require_known
from cable_envs.rigs import load_rig
from cable_envs.setup import Setup
from cablebench.entrants import Entrant
from cablebench.export.recording import COMMANDS, FILE, REFERENCES, SIGNALS, channel_columns, check_folder
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
        "tensile_stiffness",
    ),
}  # fmt: skip
"""Trusted by the recording, by system; what an effect changes may stand here too, as the preset has it. The servo and
the cable of the circuit are their makers': refitted, they take up a lag of 0.1 s and a gap."""
NOMINAL = {
    "cable_hole": ("friction_coefficient", "cable_stiffness"),
    "pulley_circuit": ("shaft_friction", "pretension_top", "pretension_bottom"),
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
        held = columns[COMMANDS[setup.rig.plant, setup.action_mode.name]]
        # it is held from row to row, and read back as straight lines between rows: as it is, half a step early
        held[1:] = 0.5 * (held[:-1] + held[1:])
        records.append(_write_table(folder, k, columns, k == len(motions) - 1))
    return _write_yaml(folder, believed, records, {name: _channel(setup, name) for name in columns})


def write_generated(
    setup: Setup, motions: Sequence[Mapping[str, Any]], believed: str, folder: Path, seconds: float, seed: int
) -> Path:
    """The same of a cable-hole by the generator of `diagnosis.proof`: another integrator, another friction at rest.

    setup: rig and effects, and what its sensors' noise is; motions: {design, amplitude, centre} of
    `diagnosis.proof.excitation`, m. Raises ConfigurationError for an effect that the generator does not have.
    """
    from diagnosis.proof import cable_hole
    from diagnosis.proof.excitation import reference
    from diagnosis.proof.sensors import stamps

    check_folder(folder)
    rows = [s.name for s in setup.plant.signals]
    names = [n for n in cable_hole.OUTPUTS if n != "drive_velocity_command"]
    noise = {n: float(setup.noise[rows.index(n)]) for n in names}
    records = []
    for k, motion in enumerate(motions):
        rng = np.random.default_rng([seed, k])
        path = reference(motion["design"], rng, seconds, motion["amplitude"], cable_hole.CLOCK)
        signals = cable_hole.simulate(_generator_values(setup), motion["centre"] + path)
        at = stamps(rng, 0.0, seconds, setup.control_period, 0.02)
        columns = {"time": np.round(at, 6)}
        columns |= {n: np.interp(at, signals["time"], signals[n]) for n in cable_hole.OUTPUTS}
        for name, std in noise.items():
            columns[name] += std * rng.standard_normal(len(at))
        records.append(_write_table(folder, k, columns, k == len(motions) - 1))
    return _write_yaml(folder, believed, records, {name: _channel(setup, name) for name in columns})


def _generator_values(setup: Setup) -> dict[str, float]:
    """A hole and its effects by the generator's names."""
    from diagnosis.proof.cable_hole import TABLE

    rig, renamed = setup.rig.values, {"coulomb_friction.level": "coulomb_friction.force"}
    same = ("load_mass", "load_stiffness", "cable_stiffness", "cable_damping", "wrap_angle", "cable_radius",
            "friction_coefficient", "extrusion_exponent")  # fmt: skip
    effects = {renamed.get(name, name): value for name, value in setup.rig.effects.items()}
    require_known("effect of the generator", effects, TABLE.names)
    return {
        **{name: rig[name] for name in same},
        "radius_ratio": rig["radius_ratio"] * (1.0 + rig["extrusion_delta"]),
        "lateral_extrusion.gain": rig["extrusion_gain"],
        "bending_stiffness.rigidity": rig["bending_rigidity"],
        "viscous_friction.coefficient": rig["load_damping"],
        "acceleration_limit": rig["drive_acceleration_limit"],
        **effects,
    }


def _write_table(folder: Path, k: int, columns: Mapping[str, np.ndarray], heldout: bool) -> dict[str, str]:
    text = io.StringIO()
    np.savetxt(text, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    write_atomic(folder / f"motion_{k}.csv", text.getvalue())
    return {"data": f"motion_{k}.csv", "use": "heldout" if heldout else "fit"}


def _write_yaml(folder: Path, believed: str, records: Sequence[Any], channels: Mapping[str, Any]) -> Path:
    rig = load_rig(believed)
    table = rig.simulated_by().parameters
    told = {
        part: {name: {"value": float(rig.values[name]), "unit": table[name].unit} for name in names}
        for part, names in (("known", KNOWN[rig.plant]), ("nominal", NOMINAL[rig.plant]))
    }
    content = {
        "schema": SCHEMA, "description": "Simulated rig; what it has beyond the preset is not told.",
        "system": rig.plant, "rig": believed, **told, "records": records, "channels": dict(channels),
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
