"""A drive as a MuJoCo model moves as in the simulator, as far as MuJoCo describes the same law."""

import numpy as np
import pytest

from cable_envs import ConfigurationError
from cable_envs.sim.replay import replay
from cable_envs.standalone.law import law_of
from cable_envs.standalone.mujoco_text import mjcf

mujoco = pytest.importorskip("mujoco", reason="MJCF is run by MuJoCo: pip install 'cable-envs[mujoco]'")

PERIOD, STEPS = 2e-3, 500
LAG = {"actuator_lag": {"time": 0.02}}
SPRING = {"position_dependent_load": {"stiffness": 200.0, "neutral": 0.05}}
SIZES = {"force": 30.0, "position": 0.1, "voltage": 3.0}


def difference(law):
    """Largest difference of the load's position over its range."""
    model = mujoco.MjModel.from_xml_string(mjcf(law))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    t = np.arange(STEPS) * law.period  # at rest first: where the replay's lag begins, as that of the keyframe
    command = data.ctrl[0] + SIZES[law.drive] * np.sin(2.0 * np.pi * 1.1 * t)
    rate = np.concatenate([[0.0], np.diff(command) / law.period])
    signal, joint = ("position", "carriage") if law.plant.name == "linear_drive" else ("pulley_position", "pulley")
    expected = replay(
        law.plant, law.rig.column(law.plant), command, law.period, drive=law.drive, signals=[signal], hold="step",
        substeps=law.substeps,
    )[:, 0, 0]  # fmt: skip
    seen = []
    for k in range(STEPS):
        data.ctrl[:] = (command[k], rate[k])[: model.nu]
        mujoco.mj_step(model, data, law.substeps)
        seen.append(data.joint(joint).qpos[0])
    return np.abs(np.array(seen) - expected).max() / np.ptp(expected)


@pytest.mark.parametrize("effects", [{}, LAG, SPRING, {**LAG, **SPRING}], ids=["plain", "lag", "spring", "both"])
@pytest.mark.parametrize("drive", ["force", "position"])
@pytest.mark.parametrize("parameters", [{}, {"belt_stiffness": 2e4}], ids=["rigid", "belt"])
def test_without_dry_friction_it_is_the_same_law(parameters, drive, effects):
    """Both converge to the same motion: MuJoCo's integrator is of order 1, so a fourth of the step leaves a fourth."""
    rig = {"plant": "linear_drive", "parameters": {"coulomb": 0.0, **parameters}, "effects": effects}
    coarse, fine = (difference(law_of(rig, drive=drive, period=PERIOD, substeps=n)) for n in (5, 20))
    assert fine < 2e-3 and fine < 0.4 * coarse


@pytest.mark.parametrize(
    "parameters", [{}, {"belt_stiffness": 2e4}, {"gravity_share": 1.0}], ids=["rigid", "belt", "up"]
)
def test_dry_friction_is_a_stiff_constraint_there(parameters):
    rig = {"plant": "linear_drive", "parameters": {"coulomb": 10.0, **parameters}}
    assert difference(law_of(rig, period=PERIOD, substeps=20)) < 5e-3


def test_coupled_drives():
    rig = {"plant": "coupled_drives", "parameters": {"coulomb": 5.0}}
    assert difference(law_of(rig, period=PERIOD, substeps=20)) < 5e-3


def test_a_weight_is_held_at_the_start():
    law = law_of({"plant": "linear_drive", "parameters": {"gravity_share": 1.0, "belt_stiffness": 2e4}}, start=0.1)
    model = mujoco.MjModel.from_xml_string(mjcf(law))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 200)
    assert abs(data.joint("carriage").qpos[0] - 0.1) < 1e-6


@pytest.mark.parametrize(
    ("rig", "drive", "said"),
    [
        ("gu-inferred", None, "the law of cable_hole"),
        ({"plant": "linear_drive", "effects": {"stribeck_friction": {"excess": 2.0}, "sensor_bias": {"velocity": 0.1}}},
         None, "no element for stribeck_friction, sensor_bias"),
        ({"plant": "linear_drive"}, "follow", "follows a path"),
    ],
)  # fmt: skip
def test_what_mujoco_has_no_element_for_is_named(rig, drive, said):
    with pytest.raises(ConfigurationError, match=said):
        mjcf(law_of(rig, drive=drive))
