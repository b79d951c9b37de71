"""The interface every reference controller keeps, and how it fails."""

import ast
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cable_envs import baselines
from cable_envs.baselines import CONTROLLERS, controller_class, make_controller
from cable_envs.baselines.base import INFORMATION, OBSERVE, action_modes, tasks
from cable_envs.core.errors import ConfigurationError
from tests.support.baselines_support import DT, HANGING, PLANTS, REFERENCES, RIGS, simulate

CASES = [
    (name, plant, mode, task)
    for name, kind in CONTROLLERS.items()
    for plant in ("cable_hole", "pulley_circuit")
    for mode in action_modes(plant)
    for task in tasks(plant)
    if kind.applies(plant, mode, task)
]


PROGRAMS = ("mpc",)
"""Controllers that solve a program at every step."""


def make(name, plant, mode, task, **gains):
    return make_controller(name, plant, mode, task, RIGS[plant, task], DT, **gains)


def test_registry_holds_the_papers_controllers_and_the_marker():
    assert set(CONTROLLERS) == {
        "open-loop", "pid", "mrac-g22", "mrac-g9", "feedforward-pid", "uncompensated-pid", "oracle",
        "mrac", "adaptive-inverse", "scheduled-pid", "lqg", "ilc", "mpc", "virtual-jaw", "camera-jaw", "grasp-jaw",
        "drive-side", "sheath-drive-side",
    }  # fmt: skip
    for name, kind in CONTROLLERS.items():
        assert kind.name == name
        assert kind.information in INFORMATION
        assert set(kind.levels.values()) <= set(OBSERVE)


def test_every_plant_task_and_mode_has_open_loop_and_oracle():
    for plant in PLANTS:
        for mode in action_modes(plant):
            for task in tasks(plant):
                assert CONTROLLERS["open-loop"].applies(plant, mode, task)
                assert CONTROLLERS["oracle"].applies(plant, mode, task)


@pytest.mark.parametrize(("name", "plant", "mode", "task"), CASES)
def test_command_stays_in_range_and_runs_repeat_exactly(name, plant, mode, task):
    controller = make(name, plant, mode, task)
    bound = PLANTS[plant].PLANT.action_modes[action_modes(plant).index(mode)]
    most = controller.rig[bound.bound]
    reference = REFERENCES[plant, task, "step"]
    first = simulate(controller, reference, 1.5)
    assert np.all(first["u"] <= most)
    assert np.all(first["u"] >= (0.0 if bound.one_sided else -most))
    again = simulate(controller, reference, 1.5)  # the same object after reset()
    other = simulate(make(name, plant, mode, task), reference, 1.5)
    assert np.array_equal(first["u"], again["u"])
    assert np.array_equal(first["u"], other["u"])


@pytest.mark.parametrize(("name", "plant", "mode", "task"), CASES)
def test_gains_declare_bounds_and_are_used_within_them(name, plant, mode, task):
    table = CONTROLLERS[name].parameters_for(plant, mode, task)
    controller = make(name, plant, mode, task)
    assert controller.parameters.names == table.names
    for parameter in table:
        assert parameter.low <= parameter.default <= parameter.high
        assert parameter.low < parameter.high
        assert controller.gains[parameter.name] == parameter.default
        with pytest.raises(ConfigurationError, match=parameter.name):
            make(name, plant, mode, task, **{parameter.name: parameter.high * 2 + 1})


@pytest.mark.parametrize(("name", "plant", "mode", "task"), CASES)
def test_declared_observation_level_suffices(name, plant, mode, task):
    """Only signals of the declared level (configs/tasks) are read."""
    from cable_envs.sim.tasks import load_task

    family = "CableHole" if plant == "cable_hole" else "PulleyCircuit"
    controller = make(name, plant, mode, task)
    seen = load_task(f"{family}-{task.capitalize()}").observed(controller.observe)
    u = controller.act(0.0, dict.fromkeys(seen, 0.01), REFERENCES[plant, task, "sine"](0.0))
    assert np.isfinite(u)


def test_unknown_names_raise_with_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'mrac-g22'"):
        controller_class("mrac-g2")
    with pytest.raises(ConfigurationError, match="did you mean 'kp'"):
        make("pid", "cable_hole", "tension", "position", kpp=1.0)
    with pytest.raises(ConfigurationError, match="did you mean 'load_mass'"):
        make_controller("pid", "cable_hole", "tension", "position", {"load_mas": 1.0}, DT)
    with pytest.raises(ConfigurationError, match="did you mean 'cable_hole'"):
        make_controller("pid", "cable_hol", "tension", "position", {}, DT)
    with pytest.raises(ConfigurationError, match="action mode"):
        make_controller("pid", "cable_hole", "torque", "position", {}, DT)
    with pytest.raises(ConfigurationError, match="task"):
        make_controller("pid", "cable_hole", "tension", "torque", {}, DT)
    with pytest.raises(ConfigurationError, match="control period"):
        make_controller("pid", "cable_hole", "tension", "position", {}, 0.0)


def test_controllers_refuse_what_they_are_not_made_for():
    with pytest.raises(ConfigurationError, match="made for pulley_circuit, pulley_chain, not for 'cable_hole'"):
        make_controller("feedforward-pid", "cable_hole", "tension", "position", {}, DT)
    with pytest.raises(ConfigurationError, match="made for cable_hole"):
        make_controller("mrac-g22", "pulley_circuit", "position", "position", {}, DT)
    assert not CONTROLLERS["mrac-g9"].applies("pulley_chain", "torque", "torque")


@pytest.mark.parametrize("name", ["open-loop", "pid", "mrac-g22", "oracle"])
def test_tension_task_needs_a_spring(name):
    with pytest.raises(ConfigurationError, match="load_stiffness"):
        make_controller(name, "cable_hole", "tension", "tension", HANGING, DT)


@pytest.mark.parametrize("name", ["open-loop", "pid", "feedforward-pid", "oracle"])
def test_grasp_task_needs_an_object(name):
    with pytest.raises(ConfigurationError, match="contact_stiffness"):
        make_controller(name, "pulley_circuit", "position", "torque", RIGS["pulley_circuit", "position"], DT)


def test_only_the_oracle_learns_the_true_rig():
    for name, plant, mode, task in CASES:
        controller = make(name, plant, mode, task)
        key = "load_mass" if plant == "cable_hole" else "tensile_stiffness"
        nominal = controller.rig[key]
        controller.set_rig({**controller.rig, key: 1.1 * nominal})
        assert controller.rig[key] == pytest.approx((1.1 if name == "oracle" else 1.0) * nominal)


def test_series_of_holes_multiplies_the_ratios():
    from cable_envs.baselines.hole_model import HoleModel
    from cable_envs.sim.rigs import load_rig

    rig = dict(load_rig("gu-three-holes").values)
    controller = make_controller("mrac-g22", "cable_hole", "tension", "position", rig, DT)
    one = {**rig, "wrap_angle_2": 0.0, "wrap_angle_3": 0.0}
    single, model = HoleModel(controller.rig | one), HoleModel(controller.rig)
    assert model.ratio(0.0, 50.0, 50.0) > single.ratio(0.0, 50.0, 50.0) > 1.0


def test_baselines_import_no_gym_and_nothing_above_the_plants():
    for path in Path(baselines.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            for name in names:
                assert name.split(".")[0] not in ("gymnasium", "torch", "cablebench", "agents"), path.name
                assert name not in ("cable_envs.envs", "cable_envs.vector", "cable_envs.sim.tasks"), path.name
    # `import cable_envs` registers with gymnasium, so only the sources above can show that none is used here
    heavy = "{'torch', 'cablebench', 'cable_envs.agents'}"
    code = f"import sys, cable_envs.baselines; assert not {heavy} & set(sys.modules), 'heavy import'"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


@pytest.mark.parametrize(("name", "plant", "mode", "task"), CASES)
def test_one_decision_takes_microseconds(name, plant, mode, task):
    """Measured 1 to 40 us, and 2 to 3 ms for what solves a program at every step; the rest is room for a loaded
    machine, and still shows an array operation slipped in."""
    controller = make(name, plant, mode, task)
    y = {s.name: 0.1 for s in PLANTS[plant].PLANT.signals}
    controller.act(0.0, y, (0.1, 0.0, 0.0))
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        for k in range(100):
            controller.act(k * DT, y, (0.1 + 1e-4 * (k % 7), 0.01, 0.0))
        best = min(best, (time.perf_counter() - start) / 100)
    assert best < (20e-3 if name in PROGRAMS else 100e-6)
