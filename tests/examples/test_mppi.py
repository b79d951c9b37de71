"""The planner of examples/mppi.py: what it tries is what happens, and it leaves the tuned controllers behind."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ROOT = Path(__file__).parents[2]
HOLE = "cable_envs/CableHole-Position-Sine-v0"


@pytest.fixture(scope="module")
def mppi():
    spec = importlib.util.spec_from_file_location("example_mppi", ROOT / "examples" / "mppi.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["example_mppi"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_the_cost_of_a_plan_is_what_it_costs(mppi):
    options = {"duration": 2.0}
    env = gym.make(HOLE, **options).unwrapped
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.array([0.1], np.float32))
    planner = mppi.Planner(HOLE, mppi.Settings(lanes=8, horizon=15), options)
    tried = np.random.default_rng(0).uniform(-0.5, 0.5, (15, 8))
    costs = planner.costs(env.state(), tried)
    paid = 0.0
    for action in tried[:, 3]:
        *_, info = env.step(np.array([action], np.float32))
        paid += (info["error"] / env.setup.task.error_scale) ** 2
    assert costs[3] == pytest.approx(paid, rel=1e-12)


def test_planning_leaves_the_tuned_controllers_behind(mppi):
    """On the paper's rig, which the planner knows exactly; they see measurements only."""
    planned = mppi.run(HOLE, 3.0, mppi.Settings(lanes=128), seed=1)
    for name in ("pid-tuned", "mrac-g22-tuned"):
        entrant = controller_file_entrant(name)
        env = gym.make(HOLE, duration=3.0)
        tuned = measure(run_episode(env, entrant.make(env.unwrapped.setup), seed=1))["rmse"]
        assert planned < 0.75 * tuned, name


@pytest.mark.slow
def test_the_command_line_says_the_error():
    command = [sys.executable, "examples/mppi.py", "--seconds", "0.5", "--lanes", "16"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and done.stdout.startswith("CableHole-Position-Sine: RMSE"), done.stderr
