"""Task files, and the setup made from them: channels, ranges, references that reach the papers' speeds."""

import math

import pytest

import cable_envs
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.setup import make_setup
from cable_envs.sim.tasks import LEVELS, REFERENCES, TASKS, load_task


@pytest.mark.parametrize("name", TASKS)
def test_task_file_is_consistent(name):
    task, setup = load_task(name), make_setup(name, "Sine")
    signals = {s.name for s in setup.plant.signals}
    assert {task.output, task.proxy} <= signals and set(task.sensor_noise) <= signals
    assert {r.title() for r in task.references} == set(REFERENCES)
    assert len(set(task.observed("full"))) == len(task.observed("full"))
    for k, level in enumerate(LEVELS):
        assert set(task.observed(LEVELS[max(k - 1, 0)])) <= set(task.observed(level)) <= signals
        assert set(task.observed(level)) <= set(task.scales)
    assert task.output in task.observed("output") and task.output not in task.observed("drive")
    assert (task.control_period, task.substeps) == (0.01, 20)
    assert set(task.randomize) <= set(setup.plant.parameters.names)
    assert make_setup(name, "Step", randomize=True).randomize


def test_ids_are_tasks_times_references():
    old = [t for t in TASKS if load_task(t).since == "v0"]
    assert set(cable_envs.ENV_IDS) == {f"cable_envs/{t}-{r}-v0" for t in old for r in REFERENCES}
    assert set(cable_envs.V1_IDS) == {f"cable_envs/{t}-{r}-v1" for t in TASKS for r in REFERENCES}
    assert set(cable_envs.FIRST_IDS) == {f"cable_envs/{t}-{r}-{load_task(t).since}" for t in TASKS for r in REFERENCES}


def test_defaults_of_observation():
    assert load_task("CableHole-Position").observe == "output"
    for name in ("PulleyCircuit-Position", "PulleyCircuit-Torque"):
        assert load_task(name).observe == "drive"  # no sensor fits at the instrument's tip
        assert not {"output_angle", "output_torque"} & {c.name for c in make_setup(name, "Step").channels}


@pytest.mark.parametrize("name", TASKS)
def test_step_is_at_ten_seconds(name):
    assert make_setup(name, "Step").reference["start"] == 10.0


def test_gu_peak_speed_of_the_sinusoid():
    sine = make_setup("CableHole-Position", "Sine").reference
    assert 2 * math.pi * sine["frequency"] * sine["amplitude"] == pytest.approx(10.8e-3, rel=1e-3)
    tension = make_setup("CableHole-Tension", "Sine")
    moved = tension.reference["amplitude"] / tension.rig.values["load_stiffness"]
    assert 2 * math.pi * tension.reference["frequency"] * moved == pytest.approx(10.8e-3, rel=1e-3)


def test_zou_amplitude_and_period_of_the_sinusoid():
    setup = make_setup("PulleyCircuit-Position", "Sine")
    gear = setup.rig.values["output_radius"] / setup.rig.values["drive_radius"]
    assert setup.reference["amplitude"] * gear == pytest.approx(1.74, rel=1e-3)
    assert 1 / setup.reference["frequency"] == 12.5


@pytest.mark.parametrize("name", TASKS)
def test_command_range_is_the_action_modes(name):
    for mode in make_setup(name, "Step").plant.action_modes:
        setup = make_setup(name, "Step", action_mode=mode.name)
        assert setup.high == setup.rig.values[mode.bound]
        assert setup.low == (0.0 if mode.one_sided else -setup.high)


def test_unknown_tasks_and_references_name_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'CableHole-Position'"):
        load_task("CableHole-Positon")
    with pytest.raises(ConfigurationError, match="did you mean 'sine'"):
        make_setup("CableHole-Position", "Sin")
