"""Closed loops of a reference controller and a plant without any environment."""

import math
from types import ModuleType

import numpy as np

from cable_envs.baselines import make_controller
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.circuit import chain as pulley_chain
from cable_envs.plants.circuit import closed_form as pulley_circuit
from cable_envs.plants.hole import plant as cable_hole
from cable_envs.sim.rigs import load_rig

DT, SUBSTEPS = 0.01, 10
PLANTS: dict[str, ModuleType] = {
    "cable_hole": cable_hole, "pulley_circuit": pulley_circuit, "pulley_chain": pulley_chain,
}  # fmt: skip
OUTPUT = {
    ("cable_hole", "position"): "load_position", ("cable_hole", "tension"): "load_tension",
    ("pulley_circuit", "position"): "output_angle", ("pulley_circuit", "torque"): "output_torque",
}  # fmt: skip
HANGING = dict(load_rig("gu-inferred").values)
ANCHORED = dict(load_rig("gu-anchored").values)
FREE = dict(load_rig("zou-table2").values)
GRASP = dict(load_rig("zou-grasp").values)
RIGS = {
    ("cable_hole", "position"): HANGING, ("cable_hole", "tension"): ANCHORED,
    ("pulley_circuit", "position"): FREE, ("pulley_circuit", "torque"): GRASP,
}  # fmt: skip


def step(amplitude, start, offset=0.0):
    """Reference function t -> (r, r_dot, r_ddot)."""
    return lambda t: (offset + (amplitude if t >= start - 1e-9 else 0.0), 0.0, 0.0)


def sine(amplitude, frequency, offset=0.0):
    w = 2 * math.pi * frequency
    return lambda t: (
        offset + amplitude * math.sin(w * t),
        amplitude * w * math.cos(w * t),
        -amplitude * w * w * math.sin(w * t),
    )


REFERENCES = {
    ("cable_hole", "position", "step"): step(0.01, 1.0),
    ("cable_hole", "position", "sine"): sine(0.01, 0.17189),
    ("cable_hole", "tension", "step"): step(20.0, 1.0, 20.0),
    ("cable_hole", "tension", "sine"): sine(26.0, 0.17189, 36.0),
    ("pulley_circuit", "position", "step"): step(0.5, 1.0),
    ("pulley_circuit", "position", "sine"): sine(2.436, 0.08),
    ("pulley_circuit", "torque", "step"): step(0.1, 1.0, 0.05),
    ("pulley_circuit", "torque", "sine"): sine(0.08, 0.08, 0.11),
}
"""The benchmark's references; steps come early to keep the tests short."""


def rest_position(plant, task, rig, value):
    """Output position at which an episode that tracks ``value`` starts."""
    if task == "tension":
        return value / rig["load_stiffness"]
    if task == "torque":
        return rig["contact_angle"] + value / rig["contact_stiffness"]
    return value


def simulate(controller, reference, duration, rig=None, disturbance=0.0):
    """Time series by signal name, with "u", "r" (at the end of each period) and "error".

    ``rig`` is the true rig (default: the controller's own); ``disturbance`` acts on the load.
    """
    plant_name, task = controller.plant, controller.task
    rig = dict(rig or controller.rig)
    plant = PLANTS[plant_name].PLANT
    p = plant.prepare(plant.parameters.pack(rig)[:, None])
    x = plant.rest(p, np.array([rest_position(plant_name, task, rig, reference(0.0)[0])]))
    names = [s.name for s in plant.signals]
    mode = [m.name for m in plant.action_modes].index(controller.action_mode)
    u, last = np.zeros((len(INPUTS), 1)), None
    u[3] = disturbance
    rows, commands, targets = [], [], []
    controller.set_rig(rig)
    controller.reset()
    for k in range(round(duration / DT)):
        command = controller.act(k * DT, dict(zip(names, x[:, 0].tolist(), strict=True)), reference(k * DT))
        u[0], u[1], u[2] = command, 0.0 if last is None else (command - last) / DT, mode
        last = command
        plant.advance(x, p, u, 0, 1, SUBSTEPS, DT / SUBSTEPS)
        rows.append(x[:, 0].copy())
        commands.append(command)
        targets.append(reference((k + 1) * DT)[0])
    series = dict(zip(names, np.array(rows).T, strict=True))
    kind = "cable_hole" if plant_name == "cable_hole" else "pulley_circuit"
    output = series[OUTPUT[kind, task]]
    return {**series, "u": np.array(commands), "r": np.array(targets), "error": np.array(targets) - output}


def rmse(series):
    return float(np.sqrt(np.mean(series["error"] ** 2)))


def run(name, plant, mode, task, kind, duration=8.0, rig=None, **gains):
    """RMSE of a controller with default gains on one of `REFERENCES`."""
    family = "cable_hole" if plant == "cable_hole" else "pulley_circuit"
    rig = RIGS[family, task] if rig is None else rig
    controller = make_controller(name, plant, mode, task, rig, DT, **gains)
    return simulate(controller, REFERENCES[family, task, kind], duration)
