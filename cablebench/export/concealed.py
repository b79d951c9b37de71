"""Recordings of a rig whose effects the recording does not tell: what a diagnosis is asked about.

They are made by the generators of the blind proof (`proof`), which share no integrator with the simulators:
what a diagnosis finds in a simulator's own episodes it has put there itself.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.core.errors import require_known
from cable_envs.core.files import write_atomic
from cable_envs.diagnosis.data.writing import FILE, SCHEMA
from cable_envs.plants import family
from cable_envs.proof.excitation import reference
from cable_envs.proof.sensors import stamps
from cable_envs.proof.simulators import cable_hole, pulley_circuit
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.setup import Setup
from cablebench.export.recording import channel_entry, check_folder

GENERATORS: Mapping[str, Any] = {"cable_hole": cable_hole, "pulley_circuit": pulley_circuit}
COMMAND = {"cable_hole": "drive_velocity_command", "pulley_circuit": "drive_angle_command"}
RENAMED = {
    "coulomb_friction.level": {"cable_hole": "coulomb_friction.force", "pulley_circuit": "coulomb_friction.torque"}
}
"""Parameter of an effect -> what a system's generator calls it."""

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
    setup: Setup, motions: Sequence[Mapping[str, Any]], believed: str, folder: Path, seconds: float, seed: int
) -> Path:
    """One record for each motion, the last held out; returns the recording's file.

    setup: the true rig with its effects, and the noise of its sensors; believed: a preset, all that is told. motions:
    {design, amplitude, centre} of `cable_envs.proof.excitation`; m of the load, or rad of the drive. A channel that
    never moves is left out. Raises ConfigurationError for an effect that the generator does not have.
    """
    check_folder(folder)
    system = setup.rig.plant
    generator, values = GENERATORS[system], _values(setup)
    rows = [s.name for s in setup.plant.signals]
    records = []
    for k, motion in enumerate(motions):
        rng = np.random.default_rng([seed, k])
        path = reference(motion["design"], rng, seconds, motion["amplitude"], generator.CLOCK)
        signals = generator.simulate(values, motion["centre"] + path)
        at = stamps(rng, 0.0, seconds, setup.control_period, 0.02)
        columns = {"time": np.round(at, 6)}
        for name in dict.fromkeys((*generator.OUTPUTS, COMMAND[system])):
            if np.ptp(signals[name]) == 0.0:
                continue
            columns[name] = np.interp(at, signals["time"], signals[name])
            if name != COMMAND[system]:
                noise = setup.noise[rows.index(family(system).signals.get(name, name))]
                columns[name] += noise * rng.standard_normal(len(at))
        records.append(_write_table(folder, k, columns, k == len(motions) - 1))
    return _write_yaml(folder, believed, records, {name: channel_entry(setup, name) for name in columns})


def _values(setup: Setup) -> dict[str, float]:
    """A rig and its effects by the names of its generator."""
    rig, system = setup.rig.values, setup.rig.plant
    table = GENERATORS[system].TABLE.names
    effects = {RENAMED.get(name, {}).get(system, name): value for name, value in setup.rig.effects.items()}
    require_known("effect of the generator", effects, table)
    found = {name: value for name, value in rig.items() if name in table} | effects
    if system == "pulley_circuit":
        return found | {"coulomb_friction.torque": rig["brake_torque"]}
    return found | {
        "radius_ratio": rig["radius_ratio"] * (1.0 + rig["extrusion_delta"]),
        "lateral_extrusion.gain": rig["extrusion_gain"],
        "bending_stiffness.rigidity": rig["bending_rigidity"],
        "viscous_friction.coefficient": rig["load_damping"],
        "acceleration_limit": rig["drive_acceleration_limit"],
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
