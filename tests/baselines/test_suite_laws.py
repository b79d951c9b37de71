"""Laws for the sensors of suite v1: a late camera, an open jaw, and rigs of which only the drive is measured."""

import math

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.baselines.circuit.play import PlayFilter
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.sheath.drive_side import mean_tension
from cablebench.entrants.entrant import controller_entrant
from cablebench.run.evaluation import core_of, run_episode
from tests.support.baselines_support import DT, FREE, GRASP

SEED = 3_000_000
"""of the split "train"; no law was tuned on it"""


def priced(name, task, seed=SEED):
    """Median of the priced error after the homing, SI, and the controller."""
    entrant = controller_entrant(name)
    env_id = f"cable_envs/{task}-v1"
    options = entrant.enters(env_id, {"split": "train"})
    env = gym.make(env_id, disable_env_checker=True, **options)
    actor = entrant.make(core_of(env).setup)
    episode = run_episode(env, actor, seed)
    assert episode.complete
    assert episode.signals["failure"][-1] == 0.0
    late = episode.time >= core_of(env).setup.task.homing
    return float(np.median(episode.signals["priced_error"][late])), actor.controller, core_of(env).true_rig


def test_a_picture_moves_jaw_and_zero_together():
    """What holds the jaw at one place before holds it 0.1 rad further after, with the drive where it was."""
    jaw = PlayFilter(CircuitModel(FREE), 0.0, 3e-3, 3e-4, 1e-3, DT)
    jaw.begin(0.2, 0.5, 0.01)
    before = jaw.held_at(0.3, 1.0)
    jaw.shift(0.1)
    assert jaw.output == pytest.approx(0.3, abs=1e-15)
    assert jaw.held_at(0.4, 1.0) == pytest.approx(before, rel=1e-12)


def test_camera_gives_the_zero_that_the_drive_lacks():
    """The drive's encoder is up to 0.25 rad off: without pictures the jaw is, too."""
    seen, _, _ = priced("camera-jaw", "PulleyCircuit-Track-Medium")
    blind, _, _ = priced("virtual-jaw", "PulleyCircuit-Track-Medium")
    assert seen < 0.01
    assert blind > 10.0 * seen


def test_the_rise_above_the_plateau_is_the_grasp_torque():
    """On the counter-clockwise working line with 0.8 of the friction, at a grasp torque of 20 mN m."""
    jaw = PlayFilter(CircuitModel(GRASP), GRASP["contact_stiffness"], 5e-3, 3e-3, 1.5e-3, DT)
    jaw.state[1] = math.log(0.8)
    plateau, torque = (jaw.held_at(tau, 1.0)[1] for tau in (0.0, 0.02))
    jaw.begin_grasp(0.3, torque, plateau)
    assert jaw.output == pytest.approx(0.02, rel=1e-9)
    assert jaw.state[1] == pytest.approx(math.log(0.8), rel=1e-9)
    assert jaw.moved


def test_an_open_jaw_closes_and_grasps():
    """Half of what the feedforward leaves, on an object whose place and stiffness nobody told."""
    found, controller, _ = priced("grasp-jaw", "PulleyCircuit-Grasp-Medium")
    other, _, _ = priced("feedforward-pid", "PulleyCircuit-Grasp-Medium")
    assert controller.closed
    assert 0.05 < controller.plateau < 0.3
    assert found < 0.5 * other


def test_mean_tension_is_the_capstan_laws():
    """Against the mean of T1 exp(-r s) over 0 <= s <= 1 on a fine grid, in both directions and without friction."""
    s = (np.arange(20000) + 0.5) / 20000
    for load, r in ((20.0, 0.35), (20.0, -0.35), (20.0, 1e-5)):
        drive = load * math.exp(r)
        assert mean_tension(drive, load) == pytest.approx(np.mean(drive * np.exp(-r * s)), rel=1e-8)


def test_sheath_is_followed_from_the_drive():
    """0.2 mm where the drive's own position is 3 to 4 mm from the load's; the compliance is found within 10 %."""
    found, controller, true = priced("sheath-drive-side", "TendonSheath-Track-Medium")
    assert found < 2e-4
    compliance = 1.0 / true["tendon_stiffness"] + 1.0 / true["sheath_stiffness"]
    assert controller.compliance == pytest.approx(compliance, rel=0.1)


def test_load_behind_three_holes_is_followed_from_the_drive():
    """0.4 mm of 4 mm that doing nothing leaves."""
    found, controller, true = priced("drive-side", "CableHole-Series-Hard")
    assert found < 4e-4
    compliance = 1.0 / true["cable_stiffness"] + 2.0 / true["span_stiffness"]
    assert controller.compliance == pytest.approx(compliance, rel=0.2)
