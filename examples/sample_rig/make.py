"""Makes the sample rig: ``python examples/sample_rig/make.py``, from a checkout.

The rig is the circuit of a surgical instrument's joint (preset ``zou-table2``) whose drive has a lag that its recording
does not mention. It is played by a generator of the blind proof, which shares no integrator with the simulators, and
recorded as a bench would: at 100 Hz, by an encoder of 10 000 counts a turn at the output, a torque sensor of 1 mN m a
step, and with noise that is correlated over some samples. The believed friction is 5 % off.

fit.csv       | to fit: a multisine
heldout.csv   | another motion, that no fit sees
rest.csv      | the rig at rest, which shows the noise of its sensors
"""

from pathlib import Path

import numpy as np
import yaml

from cable_envs.proof.excitation import reference
from cable_envs.proof.sensors import Colour
from cable_envs.proof.simulators import pulley_circuit
from cable_envs.sim.rigs import load_rig
from cablebench.export.concealed import KNOWN, NOMINAL

HERE = Path(__file__).parent
PRESET, LAG = "zou-table2", 0.015
"""The rig that is believed, and what it has beside: s by which its drive is late."""
LOAD = {"contact_stiffness": 0.2, "contact_angle": 0.0, "contact_damping": 2e-3, "output_damping": 2e-4}
"""A spring of rubber that the joint presses on, N m/rad and N m s: the preset's output is free."""
LACKS = {"actuator_lag.time": LAG}
PERIOD, SECONDS, AT_REST = 0.01, {"fit": 8.0, "heldout": 5.0}, 20.0
DESIGNS = {"fit": "multisine", "heldout": "triangle"}
USES = ("fit", "heldout", "rest")
AMPLITUDE = 0.7
COUNT, STEP = 2.0 * np.pi / 10_000.0, 1e-3
"""rad of the encoder, N m of the torque sensor."""
NOISE = {"drive_torque": 1.5e-3, "output_angle": 6e-4}
"""Standard deviations, N m and rad, in the order of the log's columns."""
COLOURS = {"drive_torque": Colour("ar1", 0.85), "output_angle": Colour("white")}
WRONG = 1.05
"""Believed over true friction of the shafts."""
DESCRIPTION = (
    "The joint of an instrument on a bench: encoder at the output, torque at the drive; what ails it is not told."
)


def signals(path: np.ndarray) -> dict[str, np.ndarray]:
    """What the rig does when its drive is told ``path``, rad at every ms."""
    rig, table = load_rig(PRESET).values, pulley_circuit.TABLE.names
    values = {name: value for name, value in rig.items() if name in table}
    values |= {name: value for name, value in LOAD.items() if name in table}
    values["coulomb_friction.torque"] = rig["brake_torque"]
    return pulley_circuit.simulate({**values, **LACKS}, path)


def sensed(of: dict[str, np.ndarray], at: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of a log at times ``at``, s: command in rad, torque and angle in steps of their sensors."""
    seen = {name: np.interp(at, of["time"], of[name]) for name in ("drive_angle_command", *NOISE)}
    for name, step in (("drive_torque", STEP), ("output_angle", COUNT)):
        noisy = seen[name] + COLOURS[name].draw(rng, len(at), NOISE[name])
        seen[name] = np.round(noisy / step).astype(int)
    return {"time": at, **seen}


def table(columns: dict[str, np.ndarray]) -> str:
    """A log as text: time in s, command in rad, counts."""
    rows = zip(*columns.values(), strict=True)
    lines = [f"{t:.2f},{command:.4g},{torque:d},{angle:d}" for t, command, torque, angle in rows]
    return "\n".join(["t,command,torque,encoder", *lines]) + "\n"


def logs(seed: int = 1) -> dict[str, str]:
    """File -> text of the three logs."""
    rng, found = np.random.default_rng(seed), {}
    for name, seconds in SECONDS.items():
        path = reference(DESIGNS[name], rng, seconds, AMPLITUDE, pulley_circuit.CLOCK)
        found[f"{name}.csv"] = table(sensed(signals(path), np.arange(0.0, seconds, PERIOD), rng))
    still = signals(np.zeros(round(1.0 / pulley_circuit.CLOCK)))
    at = np.arange(0.0, AT_REST, PERIOD)
    still = {name: np.full(len(at), values[-1]) for name, values in still.items()} | {"time": at}
    found["rest.csv"] = table(sensed(still, at, rng))
    return found


def recording() -> str:
    """The recording's YAML: what the columns mean, and what is believed of the rig."""
    rig = load_rig(PRESET)
    unit = {p.name: p.unit for p in rig.simulated_by().parameters}
    told = {
        part: {name: {"value": float(rig.values[name]), "unit": unit[name]} for name in names["pulley_circuit"]}
        for part, names in (("known", KNOWN), ("nominal", NOMINAL))
    }
    for name, value in LOAD.items():
        told["known"][name] = {"value": value, "unit": unit[name]}
    for name in ("output_inertia", "tensile_stiffness"):  # the rope on the idlers adds to the one
        told["nominal"][name] = told["known"].pop(name)
    for name in ("pretension_top", "pretension_bottom"):  # were measured
        told["known"][name] = told["nominal"].pop(name)
    told["nominal"]["shaft_friction"]["value"] *= WRONG
    for entry in told["nominal"].values():
        entry.update(value=float(f"{entry['value']:.4g}"), std=float(f"{0.1 * entry['value']:.2g}"))
    content = {
        "schema": "cable-recording/1", "description": DESCRIPTION, "system": "pulley_circuit", "rig": PRESET, **told,
        "channels": {
            "time": {"column": "t", "unit": "s"},
            "drive_angle_command": {"column": "command", "unit": "rad"},
            "drive_torque": {"column": "torque", "unit": "N m", "scale": STEP},
            "output_angle": {"column": "encoder", "unit": "rad", "scale": float(f"{COUNT:.12g}")},
        },
        "records": [{"data": f"{use}.csv", "use": use} for use in USES],
    }  # fmt: skip
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


if __name__ == "__main__":
    for file, text in {**logs(), "recording.yaml": recording()}.items():
        (HERE / file).write_text(text, encoding="utf-8")
        print(f"wrote {file}, {len(text)} bytes")
