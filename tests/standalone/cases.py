"""Rigs of every plant with and without effects, what drives them, and what the simulator's own replay gives."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from cable_envs import ConfigurationError, load_rig
from cable_envs.sim.replay import replay
from cable_envs.standalone.c_files import FLAGS, c_files
from cable_envs.standalone.law import law_of

STEPS = 200

RIGS = {
    "hole": ("gu-inferred", "analytic", None),
    "hole, speed": ("gu-inferred", "analytic", "speed"),
    "holes in series": ("gu-three-holes", "analytic", None),
    "circuit": ("zou-table2", "analytic", None),
    "circuit, torque": ("zou-grasp", "analytic", "torque"),
    "chain": ("zou-table2", "chain", None),
    "sheath": ("bowden-1m", "analytic", None),
    "sheath with contacts": ("bowden-1m-20", "analytic", None),
    "joint": ("finger-joint", "analytic", None),
    "wrist": ("wrist-8mm", "analytic", None),
    "drive": ({"plant": "linear_drive", "parameters": {"belt_stiffness": 2e4}}, "analytic", None),
    "coupled drives": ({"plant": "coupled_drives"}, "analytic", None),
    "transmission": ({"plant": "transmission"}, "analytic", None),
    "band brake": ({"plant": "band_brake"}, "analytic", None),
}
"""Name -> rig, variant, drive."""

MOTORS = {
    "hole": ("gu-steel-1mm-motor", "analytic", None),
    "circuit": ("zou-table2-motor", "analytic", None),
    "sheath": ("bowden-1m-motor", "analytic", None),
    "sheath with contacts": ("bowden-1m-20-motor", "analytic", None),
    "joint": ("finger-joint-motor", "analytic", None),
    "wrist": ("wrist-8mm-motor", "analytic", None),
}

BRISTLES = ("lugre_friction", "elastoplastic_friction")

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc to compile the C file")


def plain(case):
    """A rig as it is."""
    rig, variant, drive = case
    return law_of(rig, variant=variant, drive=drive)


def with_effects(case, bristles=False):
    """A rig with every effect at its typical size, those of sensors included, as far as they go together.

    ``bristles``: LuGre friction in the place of the friction that builds up otherwise.
    """
    rig, variant, drive = case
    rig = load_rig(rig)
    plant = rig.simulated_by(variant)
    first = [BRISTLES[0]] if bristles else []
    for name in [*first, *(n for n in plant.effects.effects if n not in BRISTLES)]:
        effect = plant.effects.effects[name]
        sizes = {f"{name}.{p.name}": p.typical for p in effect.parameters if p.typical and not p.alias}
        try:
            changed = rig.replace(sizes)
            plant.prepare(changed.column(plant))
        except ConfigurationError:
            continue  # two effects that exclude each other, or one that the rig cannot have
        rig = changed
    return law_of(rig, variant=variant, drive=drive)


def inputs_of(law, steps=STEPS):
    """Inputs over time by name: reversing motion with rests, a disturbance, a posture, a second command."""
    t = np.arange(1, steps + 1) * law.period
    wave = np.sin(2.0 * np.pi * 1.7 * t) * (t > 0.1)
    mode = next((m for m in law.plant.action_modes if m.name == law.drive), None)
    if mode is None:
        found = {"command": 0.02 * wave, "command_rate": np.gradient(0.02 * wave, law.period)}
    else:
        rest = law.values["signals"][mode.rest_signal] if mode.rest_signal else 0.0
        top = 0.5 * rest if mode.one_sided else 0.3 * law.rig.values[mode.bound]
        found = {"command": rest + top * wave}
    found |= {
        "disturbance": 0.05 * np.sin(7.0 * t), "posture": 0.1 * np.sin(3.0 * t),
        "second": law.second * (1.0 + 0.1 * np.sin(5.0 * t)),
    }  # fmt: skip
    return {one.name: found[one.name] for one in law.inputs}


def replayed(law, inputs, sensors=False):
    """Signals of the simulator's replay, [steps, signals]."""
    given = {k: v for k, v in inputs.items() if k not in ("command", "command_rate")}
    if law.follows:
        given["rate"] = inputs["command_rate"]
    return replay(
        law.plant, law.rig.column(law.plant), inputs["command"], law.period, drive=law.drive,
        signals=[s.name for s in law.plant.signals], hold="step", start=law.start, substeps=law.substeps,
        sensors=sensors, **given,
    )[:, :, 0]  # fmt: skip


def in_c(law, inputs, folder):
    """Signals of the C file, [steps, signals], and what its sensors show by name."""
    texts = c_files(law)
    texts["size.c"] = f'#include "{law.name}.h"\nint size(void) {{ return (int)sizeof({law.name}_mechanism); }}\n'
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    warnings = ("-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-Wno-unused-function")
    sources = [name for name in texts if name.endswith(".c")]
    subprocess.run(
        ["gcc", *FLAGS, *warnings, "-fPIC", "-shared", "-o", "rig.so", *sources, "-lm"], cwd=folder, check=True
    )
    library = ctypes.CDLL(str(folder / "rig.so"))
    rig = np.zeros(library.size() // 8)  # doubles, and one whole number
    address = ctypes.c_void_p(rig.ctypes.data)
    getattr(library, f"{law.name}_start")(address)
    first, many = len(law.inputs), len(law.plant.signals)
    seen, shown = [], []
    for t in range(len(inputs["command"])):
        rig[:first] = [inputs[one.name][t] for one in law.inputs]
        getattr(library, f"{law.name}_step")(address)
        seen.append(rig[first : first + many].copy())
        shown.append(rig[first + many : first + many + len(law.sensors)].copy())
    groups = {}
    for signal, (field, _) in law.places.items():
        groups.setdefault(field, []).append(signal)
    order = [signal for signals in groups.values() for signal in signals]
    columns = [order.index(s.name) for s in law.plant.signals]
    return np.array(seen)[:, columns], dict(zip([s.signal for s in law.sensors], np.array(shown).T, strict=True))
